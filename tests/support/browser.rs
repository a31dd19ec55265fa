//! Headless Chromium, driven over its remote debugging pipe.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

/// A browser with pages.
pub struct Browser {
    process: Child,
    to: ChildStdin,
    from: Receiver<Vec<u8>>,
    number: u64,
    /// Events of all pages since the last look.
    events: Vec<Value>,
    _profile: tempfile::TempDir,
}

/// Longest wait for a condition in a page.
const PATIENCE: Duration = Duration::from_secs(30);
/// Longest wait for a message of Chromium, which may draw meanwhile.
const SILENCE: Duration = Duration::from_secs(120);

impl Browser {
    /// Starts Chromium with WebGL in software.
    ///
    /// # Panics
    ///
    /// If it is missing; the message says how to install it.
    pub fn new() -> Self {
        Self::with(&[])
    }

    /// [`Self::new`] with WebGPU in software.
    pub fn with_webgpu() -> Self {
        Self::with(&[
            "--use-webgpu-adapter=swiftshader",
            "--enable-unsafe-webgpu",
            "--enable-features=Vulkan",
            "--use-vulkan=swiftshader",
        ])
    }

    fn with(flags: &[&str]) -> Self {
        let profile = tempfile::tempdir().unwrap();
        // The pipe of the protocol is in file descriptors 3 and 4. The tests open their own pages only, so that they may
        // run as root, without a sandbox.
        let mut command = Command::new("sh");
        command.args([
            "-c",
            "exec chromium \"$@\" 3<&0 4>&1",
            "chromium",
            "--headless",
            "--no-sandbox",
            "--no-first-run",
        ]);
        command.args(["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--remote-debugging-pipe"]);
        command.args(flags);
        command.args(["--disable-background-networking", "--disable-component-update", "--disable-dev-shm-usage"]);
        command.arg(format!("--user-data-dir={}", profile.path().display())).arg("about:blank");
        // Its temporary folders go with the profile.
        command.env("TMPDIR", profile.path());
        let mut process = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let (to, mut out) = (process.stdin.take().unwrap(), BufReader::new(process.stdout.take().unwrap()));
        let (messages, from) = channel();
        std::thread::spawn(move || {
            let mut bytes = Vec::new();
            while out.read_until(0, &mut bytes).is_ok_and(|length| length > 0) {
                if messages.send(std::mem::take(&mut bytes)).is_err() {
                    break;
                }
            }
        });
        let mut browser = Self { process, to, from, number: 0, events: Vec::new(), _profile: profile };
        browser.send("Browser.getVersion", json!({}), None);
        browser
    }

    /// Sends a command of the protocol and returns its result.
    fn send(&mut self, method: &str, parameters: Value, session: Option<&str>) -> Value {
        self.number += 1;
        let mut message = json!({"id": self.number, "method": method, "params": parameters});
        if let Some(session) = session {
            message["sessionId"] = json!(session);
        }
        let missing = "this test needs Chromium (scripts/setup --tests installs it)";
        self.to.write_all(format!("{message}\0").as_bytes()).unwrap_or_else(|error| panic!("{missing}: {error}"));
        self.to.flush().unwrap();
        loop {
            let answered = self.from.recv_timeout(SILENCE);
            let mut bytes = answered.unwrap_or_else(|error| panic!("{missing}, and {method} an answer: {error}"));
            assert_eq!(bytes.pop(), Some(0), "{missing}: it ended");
            let answer: Value = serde_json::from_slice(&bytes).unwrap();
            if answer["id"] != self.number {
                self.events.push(answer);
                continue;
            }
            assert!(answer["error"].is_null(), "{method}: {}", answer["error"]);
            return answer["result"].clone();
        }
    }

    /// Opens `file` with the fragment `hash` in a new page of this size, and waits until its picture is drawn.
    pub fn open(&mut self, file: &Path, hash: &str, size: [u32; 2]) -> Page<'_> {
        let mut page = self.navigated(file, hash, size);
        page.wait("document.getElementById('relume')?.dataset.ready");
        page
    }

    /// Opens `file` in a new page of this size, and returns the page in its only frame once its picture is drawn.
    pub fn open_frame(&mut self, file: &Path, size: [u32; 2]) -> Page<'_> {
        let mut around = self.navigated(file, "", size);
        around.wait("document.readyState === 'complete'");
        // A frame out of sight draws nothing.
        around.value("document.querySelector('iframe').scrollIntoView()");
        let begun = Instant::now();
        let session = loop {
            let targets = self.send("Target.getTargets", json!({}), None);
            let is_frame = |one: &&Value| one["type"] == "iframe";
            if let Some(frame) = targets["targetInfos"].as_array().unwrap().iter().find(is_frame) {
                break self.attached(&frame["targetId"]);
            }
            assert!(begun.elapsed() < PATIENCE, "there is no frame: {targets}");
            std::thread::sleep(Duration::from_millis(10));
        };
        let mut page = Page { browser: self, session };
        for domain in ["Runtime", "Network", "Log"] {
            page.send(&format!("{domain}.enable"), json!({}));
        }
        page.wait("document.getElementById('relume')?.dataset.ready");
        page
    }

    /// Session of a target.
    fn attached(&mut self, target: &Value) -> String {
        let attached = self.send("Target.attachToTarget", json!({"targetId": target, "flatten": true}), None);
        attached["sessionId"].as_str().unwrap().to_owned()
    }

    /// Opens `file` in a new page of this size.
    pub fn navigated(&mut self, file: &Path, hash: &str, [width, height]: [u32; 2]) -> Page<'_> {
        let target = self.send("Target.createTarget", json!({"url": "about:blank"}), None)["targetId"].clone();
        let session = self.attached(&target);
        let mut page = Page { browser: self, session };
        for domain in ["Page", "Runtime", "Network", "Log", "Accessibility"] {
            page.send(&format!("{domain}.enable"), json!({}));
        }
        let size = json!({"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600});
        page.send("Emulation.setDeviceMetricsOverride", size);
        page.send("Page.navigate", json!({"url": format!("file://{}{hash}", file.display())}));
        page
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        self.process.kill().ok();
        self.process.wait().ok();
    }
}

/// A page of a browser.
pub struct Page<'a> {
    browser: &'a mut Browser,
    session: String,
}

impl Page<'_> {
    /// Sends a command of the protocol and returns its result.
    pub fn send(&mut self, method: &str, parameters: Value) -> Value {
        let session = self.session.clone();
        self.browser.send(method, parameters, Some(&session))
    }

    /// Value of a JavaScript expression; a promise is awaited.
    pub fn value(&mut self, expression: &str) -> Value {
        let parameters = json!({"expression": expression, "awaitPromise": true, "returnByValue": true});
        let result = self.send("Runtime.evaluate", parameters);
        assert!(result["exceptionDetails"].is_null(), "{expression}: {}", result["exceptionDetails"]);
        result["result"]["value"].clone()
    }

    /// Waits until `expression` is true.
    pub fn wait(&mut self, expression: &str) {
        let begun = Instant::now();
        while self.value(&format!("Boolean({expression})")) != true {
            assert!(begun.elapsed() < PATIENCE, "not within {PATIENCE:?}: {expression}");
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Drags a finger from one place of the page to another.
    pub fn drag(&mut self, from: [f64; 2], to: [f64; 2]) {
        self.send("Emulation.setTouchEmulationEnabled", json!({"enabled": true}));
        let middle = [0, 1].map(|axis| f64::midpoint(from[axis], to[axis]));
        for (kind, place) in
            [("touchStart", Some(from)), ("touchMove", Some(middle)), ("touchMove", Some(to)), ("touchEnd", None)]
        {
            let points: Vec<Value> = place.into_iter().map(|[x, y]| json!({"x": x, "y": y})).collect();
            self.send("Input.dispatchTouchEvent", json!({"type": kind, "touchPoints": points}));
        }
    }

    /// Presses and releases a key.
    pub fn press(&mut self, key: &str) {
        let code = if key == " " { "Space" } else { key };
        let number = match key {
            "Enter" => 13,
            " " => 32,
            "Tab" => 9,
            _ => 0,
        };
        let text = match key {
            "Enter" => Some("\r"),
            key if key.chars().count() == 1 => Some(key),
            _ => None,
        };
        for kind in ["keyDown", "keyUp"] {
            let mut event = json!({"type": kind, "key": key, "code": code, "windowsVirtualKeyCode": number});
            if let (Some(text), "keyDown") = (text, kind) {
                event["text"] = json!(text);
            }
            self.send("Input.dispatchKeyEvent", event);
        }
    }

    /// RGB codes of the picture, drawn with the present mix.
    pub fn pixels(&mut self) -> Vec<u8> {
        let read = "(async () => {
            await new Promise((go) => requestAnimationFrame(() => requestAnimationFrame(go)));
            const from = document.querySelector('.relume canvas'), to = document.createElement('canvas');
            [to.width, to.height] = [from.width, from.height];
            const context = to.getContext('2d');
            context.drawImage(from, 0, 0);
            const { data } = context.getImageData(0, 0, to.width, to.height);
            return Array.from(data.filter((_, i) => i % 4 < 3), (code) => code.toString(16).padStart(2, '0')).join('');
        })()";
        let text = self.value(read);
        let text = text.as_str().unwrap();
        (0..text.len()).step_by(2).map(|at| u8::from_str_radix(&text[at..at + 2], 16).unwrap()).collect()
    }

    /// Console lines, failures, violations and requests of anything but files and data since the browser started.
    pub fn complaints(&mut self) -> Vec<String> {
        self.value("1");
        let is_bad = |event: &&Value| match event["method"].as_str().unwrap_or_default() {
            // A page reads a pixel to measure how long it draws; some drivers tell that it then waits, as it shall.
            "Log.entryAdded" => {
                !event["params"]["entry"]["text"].as_str().unwrap_or_default().contains("GPU stall due to ReadPixels")
            }
            "Runtime.consoleAPICalled" | "Runtime.exceptionThrown" => true,
            "Network.requestWillBeSent" => {
                let url = event["params"]["request"]["url"].as_str().unwrap_or_default();
                !url.starts_with("file:") && !url.starts_with("data:")
            }
            _ => false,
        };
        self.browser.events.iter().filter(is_bad).map(Value::to_string).collect()
    }
}
