//! Panics of decoding crates as errors.

use std::cell::Cell;
use std::io;
use std::panic::{self, AssertUnwindSafe};
use std::sync::Once;

thread_local! {
    /// Whether this thread decodes, so that a panic is an error and prints nothing.
    static DECODES: Cell<bool> = const { Cell::new(false) };
}

static HOOK: Once = Once::new();

/// The result of `decode`; a panic in it is an error of kind `InvalidData`. The crates check sums of lengths by
/// panicking, and their messages do not speak of the file.
pub(crate) fn guarded<T>(decode: impl FnOnce() -> io::Result<T>) -> io::Result<T> {
    HOOK.call_once(|| {
        let before = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            if !DECODES.get() {
                before(info);
            }
        }));
    });
    let outer = DECODES.replace(true);
    let decoded = panic::catch_unwind(AssertUnwindSafe(decode));
    DECODES.set(outer);
    decoded.unwrap_or_else(|_| Err(io::Error::new(io::ErrorKind::InvalidData, "the decoder met an impossible value")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_of_a_decoder_is_an_error() {
        let failed = guarded(|| -> io::Result<()> { panic!("a length of −1") });
        assert_eq!(failed.map_err(|error| error.kind()), Err(io::ErrorKind::InvalidData));
        assert_eq!(guarded(|| Ok(7)).ok(), Some(7));
    }
}
