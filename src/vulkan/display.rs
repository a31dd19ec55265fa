//! The display, when it goes away.

use std::ffi::c_int;
use std::panic;
use std::sync::OnceLock;

use x11_dl::xlib::{Display, Xlib};

static GONE: OnceLock<fn() -> !> = OnceLock::new();

/// From now on `gone` ends the program when an X server does not answer any more, which no library of X survives: Xlib's
/// own end calls what other threads still use, and mostly crashes, and winit panics. It may be called on any thread, with
/// locks held.
pub fn when_display_is_gone(gone: fn() -> !) {
    // Without Xlib there is no window of it either.
    let Ok(xlib) = Xlib::open() else { return };
    if !answers(&xlib) || GONE.set(gone).is_err() {
        return;
    }
    // SAFETY: the handler is a function of this signature, which is there as long as the program.
    unsafe { (xlib.XSetIOErrorHandler)(Some(end)) };
    let tell = panic::take_hook();
    panic::set_hook(Box::new(move |panic| if answers(&xlib) { tell(panic) } else { gone() }));
}

/// Whether there is an X server to talk to.
fn answers(xlib: &Xlib) -> bool {
    // SAFETY: without a name it is the display of the environment; null where that does not answer.
    let display = unsafe { (xlib.XOpenDisplay)(std::ptr::null()) };
    if !display.is_null() {
        // SAFETY: it was opened above, and nothing else knows it.
        unsafe { (xlib.XCloseDisplay)(display) };
    }
    !display.is_null()
}

unsafe extern "C" fn end(_: *mut Display) -> c_int {
    match GONE.get() {
        Some(gone) => gone(),
        None => 0,
    }
}
