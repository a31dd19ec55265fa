//! Progress bars, warnings and Ctrl-C.

use std::fmt;
#[cfg(unix)]
use std::io::Read;
use std::io::{self, Write};
#[cfg(unix)]
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
#[cfg(unix)]
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use relume::progress::Progress;
use signal_hook::consts::SIGINT;
use signal_hook::flag::register;
use tracing::Metadata;
use tracing::field::{Field, Visit};
use tracing_subscriber::filter::{LevelFilter, filter_fn};
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields};
use tracing_subscriber::layer::{Context, Layer, SubscriberExt};
use tracing_subscriber::registry::LookupSpan;

/// The exit code of what Ctrl-C ended: 128 and the number of the signal, as shells have it.
pub(super) const INTERRUPTED: u8 = 130;

/// What is said of it.
pub(super) const TOLD: &str = "interrupted";

/// How long work has to notice Ctrl-C, and to end in its own way; people notice six times that.
#[cfg(unix)]
const PATIENCE: Duration = Duration::from_millis(50);

/// The same where what is finished is still written.
#[cfg(unix)]
const PATIENCE_WITH_ROWS: Duration = Duration::from_secs(5);

/// The terminal: shows how far work is on standard error where that is a terminal, and turns Ctrl-C into a request to
/// stop.
pub(crate) struct Terminal {
    bar: ProgressBar,
    stage: Mutex<String>,
    interrupted: Arc<AtomicBool>,
    has_rows: Arc<AtomicBool>,
    warnings: Warnings,
}

impl Terminal {
    pub(crate) fn new(quiet: bool) -> Self {
        let shown = if quiet { LevelFilter::ERROR } else { LevelFilter::WARN };
        // What the libraries of the window tell their own developers is not for its user.
        let ours = |most: LevelFilter| {
            filter_fn(move |it: &Metadata<'_>| *it.level() <= most && it.target().starts_with("relume"))
        };
        let printed = tracing_subscriber::fmt::layer()
            .with_writer(io::stderr)
            .event_format(Plain::default())
            .with_filter(ours(shown));
        let warnings = Warnings::default();
        let kept = warnings.clone().with_filter(ours(LevelFilter::WARN));
        let subscriber = tracing_subscriber::registry().with(printed).with(kept);
        // Fails only where somebody else has set one: then theirs is used.
        tracing::subscriber::set_global_default(subscriber).ok();
        let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr_with_hz(10) };
        let bar = ProgressBar::with_draw_target(None, target);
        if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {percent}%") {
            bar.set_style(style);
        }
        let interrupted = Arc::new(AtomicBool::new(false));
        let has_rows = Arc::new(AtomicBool::new(false));
        let heard = end_soon(&interrupted, &has_rows).and_then(|()| register(SIGINT, Arc::clone(&interrupted)));
        if let Err(error) = heard {
            tracing::warn!("Ctrl-C will end the program at once: {error}");
        }
        // Heard, so that it does not kill the program: the write that outgrows `ulimit -f` then fails, and is told of.
        #[cfg(unix)]
        register(signal_hook::consts::SIGXFSZ, Arc::default()).ok();
        Self { bar, stage: Mutex::default(), interrupted, has_rows, warnings }
    }

    /// Gives work whose finished part is worth keeping longer to end after Ctrl-C.
    pub(crate) fn wait_for_rows(&self) {
        self.has_rows.store(true, Ordering::Relaxed);
    }

    /// Takes the progress bar away.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }

    /// What was warned of, `--quiet` or not.
    pub(crate) fn warnings(&self) -> Vec<String> {
        self.warnings.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// Sees to it that the program ends soon after Ctrl-C, whatever it is at; what is half written goes with it.
#[cfg(unix)]
fn end_soon(_: &Arc<AtomicBool>, has_rows: &Arc<AtomicBool>) -> io::Result<()> {
    let (mut heard, signal) = UnixStream::pair()?;
    signal_hook::low_level::pipe::register(SIGINT, signal)?;
    let has_rows = Arc::clone(has_rows);
    let wait = move || {
        if heard.read_exact(&mut [0]).is_ok() {
            wake_all();
            std::thread::sleep(if has_rows.load(Ordering::Relaxed) { PATIENCE_WITH_ROWS } else { PATIENCE });
            relume::output::discard_unfinished();
            complain(&super::CliError::Failed(TOLD.to_owned()));
            // Without the ends of other threads, which are still at work.
            signal_hook::low_level::exit(INTERRUPTED.into());
        }
    };
    std::thread::Builder::new().name("ctrl-c".to_owned()).spawn(wait).map(drop)
}

/// Lets every thread of the program end as soon as any other, as far as the system allows that. Mesa's shader cache has one
/// of the lowest priority: while other programs compute, it takes seconds to end, and frees all memory where it is last.
#[cfg(target_os = "linux")]
fn wake_all() {
    use rustix::process::{Pid, setpriority_process};
    let threads = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    for thread in threads {
        let id = thread.file_name().to_str().and_then(|id| id.parse().ok()).and_then(Pid::from_raw);
        if let Some(id) = id {
            setpriority_process(Some(id), 0).ok();
        }
    }
}

/// Only Linux has priorities of threads that this program knows of.
#[cfg(not(target_os = "linux"))]
fn wake_all() {}

/// A second Ctrl-C does not wait for the work to notice.
#[cfg(not(unix))]
fn end_soon(interrupted: &Arc<AtomicBool>, _: &Arc<AtomicBool>) -> io::Result<()> {
    signal_hook::flag::register_conditional_shutdown(SIGINT, INTERRUPTED.into(), Arc::clone(interrupted)).map(drop)
}

impl Progress for Terminal {
    fn report(&self, stage: &str, done: u64, total: u64) {
        let mut shown = self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        if *shown != stage {
            stage.clone_into(&mut shown);
            self.bar.set_message(stage.to_owned());
        }
        self.bar.set_length(total);
        self.bar.set_position(done);
    }

    fn cancelled(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }
}

/// Keeps what is warned of, once each, for `--json`.
#[derive(Clone, Debug, Default)]
struct Warnings(Arc<Mutex<Vec<String>>>);

impl<S: tracing::Subscriber> Layer<S> for Warnings {
    fn on_event(&self, event: &tracing::Event<'_>, _: Context<'_, S>) {
        if *event.metadata().level() != tracing::Level::WARN {
            return;
        }
        let mut message = Message::default();
        event.record(&mut message);
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if !kept.contains(&message.0) {
            kept.push(message.0);
        }
    }
}

/// The text of an event.
#[derive(Default)]
struct Message(String);

impl Visit for Message {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        if field.name() == "message" {
            self.0 = format!("{value:?}");
        }
    }
}

/// `warning: what is wrong`, as errors are printed; the same one once, however many settings it is true of.
#[derive(Default)]
struct Plain(Mutex<Vec<String>>);

impl<S, N> FormatEvent<S, N> for Plain
where
    S: tracing::Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(
        &self,
        context: &FmtContext<'_, S, N>,
        mut writer: Writer<'_>,
        event: &tracing::Event<'_>,
    ) -> fmt::Result {
        let level = match *event.metadata().level() {
            tracing::Level::ERROR => "error",
            tracing::Level::WARN => "warning",
            _ => "note",
        };
        let mut text = format!("{level}: ");
        context.field_format().format_fields(Writer::new(&mut text), event)?;
        let mut told = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if told.contains(&text) {
            return Ok(());
        }
        writeln!(writer, "{text}")?;
        told.push(text);
        Ok(())
    }
}

/// Ends the program at once, as its display has gone; other threads may still be at work.
#[cfg(feature = "window")]
pub(super) fn end_without_display() -> ! {
    relume::output::discard_unfinished();
    complain(&super::CliError::Failed("the display of the window is gone".to_owned()));
    signal_hook::low_level::exit(1)
}

/// Prints a result. A reader that has gone away (`| head`) is no error.
pub(crate) fn print(text: &str) {
    let mut out = io::stdout().lock();
    out.write_all(text.as_bytes()).and_then(|()| out.flush()).ok();
}

/// Prints an error and its causes, in one line each; nothing of a second one, when two threads end the program.
pub(crate) fn complain(error: &dyn std::error::Error) {
    static TOLD: Mutex<bool> = Mutex::new(false);
    let mut told = TOLD.lock().unwrap_or_else(PoisonError::into_inner);
    if std::mem::replace(&mut *told, true) {
        return;
    }
    let mut text = format!("error: {error}\n");
    let mut cause = error.source();
    while let Some(error) = cause {
        text.push_str(&format!("  because: {error}\n"));
        cause = error.source();
    }
    let mut err = io::stderr().lock();
    err.write_all(text.as_bytes()).and_then(|()| err.flush()).ok();
}
