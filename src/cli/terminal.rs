//! Progress bars, warnings and Ctrl-C.

use std::fmt;
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use relume::progress::Progress;
use signal_hook::consts::SIGINT;
use signal_hook::flag::{register, register_conditional_shutdown};
use tracing::field::{Field, Visit};
use tracing_subscriber::filter::LevelFilter;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields};
use tracing_subscriber::layer::{Context, Layer, SubscriberExt};
use tracing_subscriber::registry::LookupSpan;

/// The exit code of what Ctrl-C ended: 128 and the number of the signal, as shells have it.
pub(super) const INTERRUPTED: u8 = 130;

/// The terminal: shows how far work is on standard error where that is a terminal, and turns Ctrl-C into a request to
/// stop.
pub(crate) struct Terminal {
    bar: ProgressBar,
    stage: Mutex<String>,
    interrupted: Arc<AtomicBool>,
    warnings: Warnings,
}

impl Terminal {
    pub(crate) fn new(quiet: bool) -> Self {
        let shown = if quiet { LevelFilter::ERROR } else { LevelFilter::WARN };
        let printed =
            tracing_subscriber::fmt::layer().with_writer(std::io::stderr).event_format(Plain).with_filter(shown);
        let warnings = Warnings::default();
        let subscriber =
            tracing_subscriber::registry().with(printed).with(warnings.clone().with_filter(LevelFilter::WARN));
        // Fails only where somebody else has set one: then theirs is used.
        tracing::subscriber::set_global_default(subscriber).ok();
        let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr_with_hz(10) };
        let bar = ProgressBar::with_draw_target(None, target);
        if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {percent}%") {
            bar.set_style(style);
        }
        let interrupted = Arc::new(AtomicBool::new(false));
        // A second Ctrl-C does not wait for the work to notice.
        let heard = register_conditional_shutdown(SIGINT, INTERRUPTED.into(), Arc::clone(&interrupted))
            .and_then(|_| register(SIGINT, Arc::clone(&interrupted)));
        if let Err(error) = heard {
            tracing::warn!("Ctrl-C will end the program at once: {error}");
        }
        // Heard, so that it does not kill the program: the write that outgrows `ulimit -f` then fails, and is told of.
        #[cfg(unix)]
        register(signal_hook::consts::SIGXFSZ, Arc::default()).ok();
        Self { bar, stage: Mutex::default(), interrupted, warnings }
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

/// Keeps what is warned of, for `--json`.
#[derive(Clone, Debug, Default)]
struct Warnings(Arc<Mutex<Vec<String>>>);

impl<S: tracing::Subscriber> Layer<S> for Warnings {
    fn on_event(&self, event: &tracing::Event<'_>, _: Context<'_, S>) {
        let mut message = Message::default();
        event.record(&mut message);
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(message.0);
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

/// `warning: what is wrong`, as errors are printed.
struct Plain;

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
        write!(writer, "{level}: ")?;
        context.field_format().format_fields(writer.by_ref(), event)?;
        writeln!(writer)
    }
}

/// Prints a result. A reader that has gone away (`| head`) is no error.
pub(crate) fn print(text: &str) {
    let mut out = std::io::stdout().lock();
    out.write_all(text.as_bytes()).and_then(|()| out.flush()).ok();
}

/// Prints an error and its causes, in one line each.
pub(crate) fn complain(error: &dyn std::error::Error) {
    let mut text = format!("error: {error}\n");
    let mut cause = error.source();
    while let Some(error) = cause {
        text.push_str(&format!("  because: {error}\n"));
        cause = error.source();
    }
    let mut err = std::io::stderr().lock();
    err.write_all(text.as_bytes()).and_then(|()| err.flush()).ok();
}
