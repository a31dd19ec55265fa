//! The display, when it goes away.

use std::ffi::c_int;
use std::sync::OnceLock;

use x11_dl::xlib::{Display, Xlib};

static GONE: OnceLock<fn() -> !> = OnceLock::new();

/// From now on `gone` ends the program when an X server does not answer any more, which no library of X survives: Xlib's
/// own end calls what other threads still use, and mostly crashes. It may be called on any thread, with locks held.
pub fn when_display_is_gone(gone: fn() -> !) {
    // Without Xlib there is no window of it either.
    let Ok(xlib) = Xlib::open() else { return };
    if GONE.set(gone).is_ok() {
        // SAFETY: the handler is a function of this signature, which is there as long as the program.
        unsafe { (xlib.XSetIOErrorHandler)(Some(end)) };
    }
}

unsafe extern "C" fn end(_: *mut Display) -> c_int {
    match GONE.get() {
        Some(gone) => gone(),
        None => 0,
    }
}
