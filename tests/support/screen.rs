//! Virtual display for tests of the viewer.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
#[cfg(target_os = "linux")]
use std::time::{Duration, Instant};

use serde_json::Value;
#[cfg(target_os = "linux")]
use x11rb::connection::Connection as _;
#[cfg(target_os = "linux")]
use x11rb::protocol::xproto::{
    AtomEnum, ClientMessageEvent, ConnectionExt as _, EventMask, ImageFormat, InputFocus, KEY_PRESS_EVENT,
    KEY_RELEASE_EVENT, KeyButMask, KeyPressEvent, MapState,
};
#[cfg(target_os = "linux")]
use x11rb::rust_connection::RustConnection;

use super::program::{Folder, Outcome};

/// Display of an Xvfb server.
pub struct Screen {
    server: Child,
    display: String,
}

impl Screen {
    /// Starts an Xvfb server; `None` if GPU tests are skipped (`GPU_TESTS=skip`).
    ///
    /// # Panics
    ///
    /// If Xvfb is missing; the message says how to install it.
    #[expect(clippy::print_stderr, reason = "a test that ran on nothing says so")]
    pub fn new() -> Option<Self> {
        if std::env::var("GPU_TESTS").as_deref() == Ok("skip") {
            eprintln!("skipped: GPU_TESTS=skip");
            return None;
        }
        let mut command = Command::new("Xvfb");
        command.args(["-displayfd", "1", "-screen", "0", "1700x1100x24", "-nolisten", "tcp", "-noreset"]);
        let started = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
        let mut server =
            started.unwrap_or_else(|error| panic!("this test needs Xvfb (scripts/setup --tests installs it): {error}"));
        let mut number = String::new();
        BufReader::new(server.stdout.take().unwrap()).read_line(&mut number).unwrap();
        Some(Self { server, display: format!(":{}", number.trim()) })
    }

    /// Returns the command for the viewer in `folder` with `arguments` and validation, in a window of 640×480.
    pub fn command(&self, folder: &Folder, arguments: &[&str]) -> Command {
        self.command_of_any_size(folder, &[&["--size", "640x480"], arguments].concat())
    }

    /// As [`Self::command`], without a window size.
    pub fn command_of_any_size(&self, folder: &Folder, arguments: &[&str]) -> Command {
        let mut command = folder.command(&["view", "--json", "--validation"]);
        command.args(arguments).env("DISPLAY", &self.display).env_remove("WAYLAND_DISPLAY");
        command
    }

    /// Runs the viewer in `folder` with `arguments`.
    pub fn run(&self, folder: &Folder, arguments: &[&str]) -> Outcome {
        Outcome::of(&mut self.command(folder, arguments))
    }

    /// Runs `script` on `scene` and returns the [`report`].
    pub fn script(&self, folder: &Folder, scene: &str, script: &str) -> Value {
        std::fs::write(folder.path("script.txt"), script).unwrap();
        let outcome = self.run(folder, &[scene, "--script", "script.txt"]);
        report(&outcome)
    }

    /// Stops the server.
    pub fn end(&mut self) {
        self.server.kill().ok();
        self.server.wait().ok();
    }

    /// Returns the viewer's window as an X client sees it; waits up to a minute for it.
    #[cfg(target_os = "linux")]
    pub fn window(&self) -> Window {
        let (connection, number) = x11rb::connect(Some(&self.display)).unwrap();
        let root = connection.setup().roots[number].root;
        let begun = Instant::now();
        loop {
            for id in connection.query_tree(root).unwrap().reply().unwrap().children {
                // The window may be gone by now.
                let seen = connection.get_window_attributes(id).unwrap().reply();
                let name = connection.get_property(false, id, AtomEnum::WM_NAME, AtomEnum::ANY, 0, 64).unwrap().reply();
                let is_ours = name.is_ok_and(|it| it.value.ends_with(b"Relume"));
                if seen.is_ok_and(|it| it.map_state == MapState::VIEWABLE) && is_ours {
                    return Window { connection, id };
                }
            }
            assert!(begun.elapsed() < Duration::from_secs(60), "there is no window");
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

/// Window of another X client.
#[cfg(target_os = "linux")]
pub struct Window {
    connection: RustConnection,
    id: u32,
}

#[cfg(target_os = "linux")]
impl Window {
    /// Asks the window to close, as its close button does.
    pub fn close(&self) {
        let atom = |name: &str| self.connection.intern_atom(false, name.as_bytes()).unwrap().reply().unwrap().atom;
        let data = [atom("WM_DELETE_WINDOW"), 0, 0, 0, 0];
        let message = ClientMessageEvent::new(32, self.id, atom("WM_PROTOCOLS"), data);
        self.connection.send_event(false, self.id, EventMask::NO_EVENT, message).unwrap().check().unwrap();
    }

    /// Hides the window, as minimising does, or shows it again.
    pub fn show(&self, shown: bool) {
        let asked = if shown { self.connection.map_window(self.id) } else { self.connection.unmap_window(self.id) };
        asked.unwrap().check().unwrap();
    }

    /// Moves the pointer to a pixel of the window.
    pub fn point(&self, x: i16, y: i16) {
        self.connection.warp_pointer(x11rb::NONE, self.id, 0, 0, 0, 0, x, y).unwrap().check().unwrap();
    }

    /// Presses and releases Ctrl and a lower-case letter.
    pub fn press_with_control(&self, letter: char) {
        // Key events go to the focused window.
        self.connection.set_input_focus(InputFocus::PARENT, self.id, x11rb::CURRENT_TIME).unwrap().check().unwrap();
        let setup = self.connection.setup();
        let (first, last) = (setup.min_keycode, setup.max_keycode);
        let keys = self.connection.get_keyboard_mapping(first, last - first + 1).unwrap().reply().unwrap();
        let of_key = keys.keysyms.chunks(keys.keysyms_per_keycode.into());
        let (code, _) = (first..).zip(of_key).find(|(_, symbols)| symbols.contains(&u32::from(letter))).unwrap();
        for kind in [KEY_PRESS_EVENT, KEY_RELEASE_EVENT] {
            let event = KeyPressEvent {
                response_type: kind,
                detail: code,
                event: self.id,
                root: setup.roots[0].root,
                state: KeyButMask::CONTROL,
                same_screen: true,
                ..KeyPressEvent::default()
            };
            self.connection.send_event(false, self.id, EventMask::NO_EVENT, event).unwrap().check().unwrap();
        }
    }

    /// Number of the window's pixels of this colour.
    pub fn pixels_of(&self, [red, green, blue]: [u8; 3]) -> usize {
        let size = self.connection.get_geometry(self.id).unwrap().reply().unwrap();
        let image = self.connection.get_image(ImageFormat::Z_PIXMAP, self.id, 0, 0, size.width, size.height, u32::MAX);
        let pixels = image.unwrap().reply().unwrap().data;
        pixels.chunks_exact(4).filter(|pixel| pixel[..3] == [blue, green, red]).count()
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        self.end();
    }
}

/// Returns the report of a session without validation messages. It must exit with 0, or with 1 and every failure on
/// standard
/// error.
pub fn report(outcome: &Outcome) -> Value {
    assert!(!outcome.out.is_empty(), "{:?}: {}", outcome.code, outcome.err);
    let report = outcome.json();
    let failures = report["failures"].as_array().unwrap();
    assert_eq!(outcome.code, Some(i32::from(!failures.is_empty())), "{}", outcome.err);
    assert!(failures.iter().all(|failure| outcome.err.contains(failure.as_str().unwrap())), "{}", outcome.err);
    assert_eq!(report["validation"], Value::Array(Vec::new()), "the validation layer");
    report
}
