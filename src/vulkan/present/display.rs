//! Loss of the X display.

use std::ffi::c_int;
use std::panic;
use std::sync::OnceLock;

use x11_dl::xlib::{Display, Xlib};

static GONE: OnceLock<fn() -> !> = OnceLock::new();

/// Installs `gone` as the exit of the program for when the X server stops answering. No X library survives this: Xlib's
/// own exit calls functions that other threads still use and usually crashes, and winit panics. `gone` may be called on
/// any thread, with locks held.
pub fn when_display_is_gone(gone: fn() -> !) {
    // Without Xlib there is no X11 window either.
    let Ok(xlib) = Xlib::open() else { return };
    if !answers(&xlib) || GONE.set(gone).is_err() {
        return;
    }
    // SAFETY: the handler has this signature and lives as long as the program.
    unsafe { (xlib.XSetIOErrorHandler)(Some(end)) };
    let tell = panic::take_hook();
    panic::set_hook(Box::new(move |panic| if answers(&xlib) { tell(panic) } else { gone() }));
}

/// Whether an X server answers.
fn answers(xlib: &Xlib) -> bool {
    // SAFETY: a null name selects the display of the environment. The result is null if that display does not answer.
    let display = unsafe { (xlib.XOpenDisplay)(std::ptr::null()) };
    if !display.is_null() {
        // SAFETY: the display was opened above and is not shared.
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
