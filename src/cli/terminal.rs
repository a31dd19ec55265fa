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

use crate::progress::Progress;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use signal_hook::consts::SIGINT;
#[cfg(unix)]
use signal_hook::consts::{SIGHUP, SIGTERM};
use signal_hook::flag::register;
use tracing::Metadata;
use tracing::field::{Field, Visit};
use tracing_subscriber::filter::{LevelFilter, filter_fn};
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields};
use tracing_subscriber::layer::{Context, Layer, SubscriberExt};
use tracing_subscriber::registry::LookupSpan;

use super::advice;

/// Exit code after Ctrl-C: 128 plus the number of the signal, as in shells.
pub(super) const INTERRUPTED: u8 = 130;

/// Exit codes after the signals with which launchers and shells that close end a process.
#[cfg(unix)]
const TERMINATED: u8 = 143;
#[cfg(unix)]
const HUNG_UP: u8 = 129;

/// Error message after Ctrl-C.
pub(super) const TOLD: &str = "interrupted";

/// Time for work to notice Ctrl-C and end by itself; a sixth of the delay that people notice.
#[cfg(unix)]
const PATIENCE: Duration = Duration::from_millis(50);

/// The same time if finished rows are still written.
#[cfg(unix)]
const PATIENCE_WITH_ROWS: Duration = Duration::from_secs(5);

/// Shows progress on standard error if that is a terminal, and turns Ctrl-C into a request to stop.
pub(crate) struct Terminal {
    bar: ProgressBar,
    stage: Mutex<String>,
    interrupted: Arc<AtomicBool>,
    has_rows: Arc<AtomicBool>,
    warnings: Warnings,
}

impl Terminal {
    pub(crate) fn new(quiet: bool, json: bool) -> Self {
        let shown = if quiet { LevelFilter::ERROR } else { LevelFilter::INFO };
        // Hides messages of the window's libraries, which are for their developers.
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
        // Fails only if another subscriber is set, which then stays in use.
        tracing::subscriber::set_global_default(subscriber).ok();
        let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr_with_hz(10) };
        let bar = ProgressBar::with_draw_target(None, target);
        if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {percent}%") {
            bar.set_style(style);
        }
        let interrupted = Arc::new(AtomicBool::new(false));
        let has_rows = Arc::new(AtomicBool::new(false));
        let heard = end_soon(&interrupted, &has_rows, json.then(|| warnings.clone()))
            .and_then(|()| register(SIGINT, Arc::clone(&interrupted)));
        if let Err(error) = heard {
            tracing::warn!(
                "cannot handle Ctrl-C ({error}); it will end the program at once and may leave temporary files"
            );
        }
        #[cfg(unix)]
        if let Err(error) = end_at_once(SIGTERM, TERMINATED).and_then(|()| end_at_once(SIGHUP, HUNG_UP)) {
            tracing::warn!("cannot handle the signals TERM and HUP ({error}); they may leave temporary files");
        }
        // Handled so that the signal does not kill the program: the write beyond `ulimit -f` then fails and is
        // reported.
        #[cfg(unix)]
        register(signal_hook::consts::SIGXFSZ, Arc::default()).ok();
        Self { bar, stage: Mutex::default(), interrupted, has_rows, warnings }
    }

    /// Gives work with finished rows more time to end after Ctrl-C.
    pub(crate) fn wait_for_rows(&self) {
        self.has_rows.store(true, Ordering::Relaxed);
    }

    /// Has the program end with a sentence about its launcher when that ends it, in place of the usual one.
    pub(crate) fn end_with_others(&self, rank: usize, count: usize) {
        let ended = format!(
            "rank {rank} of {count} processes: the launcher ended this process, as it does when another one failed or was \
             killed, or the job was cancelled; this one leaves no incomplete file"
        );
        *ENDED.lock().unwrap_or_else(PoisonError::into_inner) = Some(ended);
    }

    /// Removes the progress bar.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }

    /// All warnings, also with `--quiet`.
    pub(crate) fn warnings(&self) -> Vec<String> {
        self.warnings.all()
    }
}

/// Ends the program soon after Ctrl-C, whatever it is doing, and discards half-written files. Prints JSON with these warnings
/// if there are some to be printed.
#[cfg(unix)]
fn end_soon(_: &Arc<AtomicBool>, has_rows: &Arc<AtomicBool>, json: Option<Warnings>) -> io::Result<()> {
    let has_rows = Arc::clone(has_rows);
    on_signal(SIGINT, "ctrl-c", move || {
        wake_all();
        std::thread::sleep(if has_rows.load(Ordering::Relaxed) { PATIENCE_WITH_ROWS } else { PATIENCE });
        crate::output::discard_unfinished();
        let error = super::CliError::Failed(TOLD.to_owned());
        let json = json.as_ref().map(|warnings| super::error_json(&error, INTERRUPTED, &warnings.all()));
        complain(&error, json.as_deref());
        // Runs no exit handlers, because other threads are still at work.
        signal_hook::low_level::exit(INTERRUPTED.into());
    })
}

/// Sentence of one of several processes that its launcher ends.
static ENDED: Mutex<Option<String>> = Mutex::new(None);

/// Ends the program when the signal arrives, with this exit code, and discards half-written files.
#[cfg(unix)]
fn end_at_once(signal: i32, code: u8) -> io::Result<()> {
    // `nohup` has the program go on.
    if is_ignored(signal) {
        return Ok(());
    }
    let name = if signal == SIGHUP { "HUP" } else { "TERM" };
    on_signal(signal, name, move || {
        crate::output::discard_unfinished();
        let ended = ENDED.lock().unwrap_or_else(PoisonError::into_inner).take();
        let ended = ended.unwrap_or_else(|| format!("ended by the signal {name}; no incomplete file is left"));
        complain(&super::CliError::Failed(ended), None);
        signal_hook::low_level::exit(code.into());
    })
}

/// Whether the program was started with this signal ignored, as far as the system says.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    mask >> (signal - 1) & 1 == 1
}

/// Runs `end` in a thread of its own, called `name`, when the signal arrives.
#[cfg(unix)]
fn on_signal(signal: i32, name: &str, end: impl FnOnce() + Send + 'static) -> io::Result<()> {
    let (mut heard, sent) = UnixStream::pair()?;
    signal_hook::low_level::pipe::register(signal, sent)?;
    let wait = move || {
        if heard.read_exact(&mut [0]).is_ok() {
            end();
        }
    };
    std::thread::Builder::new().name(name.to_owned()).spawn(wait).map(drop)
}

/// Gives every thread normal priority, as far as the system allows, so that all can end equally soon. Mesa's shader
/// cache has a thread of the lowest priority: while other programs compute, it takes seconds to end, and frees all
/// memory if it ends last.
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

/// Thread priorities are raised on Linux only.
#[cfg(not(target_os = "linux"))]
fn wake_all() {}

/// A second Ctrl-C ends the program without waiting for the work to notice.
#[cfg(not(unix))]
fn end_soon(interrupted: &Arc<AtomicBool>, _: &Arc<AtomicBool>, _: Option<Warnings>) -> io::Result<()> {
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

/// Collects warnings for `--json`, each once.
#[derive(Clone, Debug, Default)]
struct Warnings(Arc<Mutex<Vec<String>>>);

impl Warnings {
    fn all(&self) -> Vec<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

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

/// Text of an event.
#[derive(Default)]
struct Message(String);

impl Visit for Message {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        if field.name() == "message" {
            self.0 = format!("{value:?}");
        }
    }
}

/// Prints `warning: …` in the form of errors; equal messages only once, even if several settings cause them.
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

/// Ends the program at once after the loss of its display; other threads may still be at work.
#[cfg(feature = "window")]
pub(super) fn end_without_display() -> ! {
    crate::output::discard_unfinished();
    complain(&super::CliError::Failed("lost the connection to the display".to_owned()), None);
    signal_hook::low_level::exit(1)
}

/// Prints a result. A closed pipe (`| head`) is not an error.
pub(crate) fn print(text: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        printed => printed,
    }
}

/// True once the result or an error of the run was printed, or another process prints it.
static IS_TOLD: Mutex<bool> = Mutex::new(false);

/// Leaves the error of the run to another process, also if the launcher ends this one before it ends by itself.
pub(crate) fn leave_to_others() {
    *IS_TOLD.lock().unwrap_or_else(PoisonError::into_inner) = true;
}

/// Prints the result of the run, unless it was told to be interrupted.
///
/// # Errors
///
/// Those of standard output; the run has no result then.
pub(crate) fn conclude(text: &str) -> io::Result<()> {
    let mut told = IS_TOLD.lock().unwrap_or_else(PoisonError::into_inner);
    if !*told {
        print(text)?;
        *told = true;
    }
    Ok(())
}

/// Prints an error and its causes, one line each, with the flags that help, and `json` to standard output. Of two threads that end the
/// program, the first one tells.
pub(crate) fn complain(error: &(dyn std::error::Error + 'static), json: Option<&str>) {
    let mut told = IS_TOLD.lock().unwrap_or_else(PoisonError::into_inner);
    if std::mem::replace(&mut *told, true) {
        return;
    }
    let mut text = String::new();
    for sentence in advice::sentences(error) {
        let head = if text.is_empty() { "error" } else { "  because" };
        text.push_str(&format!("{head}: {sentence}\n"));
    }
    let mut err = io::stderr().lock();
    err.write_all(text.as_bytes()).and_then(|()| err.flush()).ok();
    if let Some(json) = json {
        // The failure itself is told already.
        print(json).ok();
    }
}
