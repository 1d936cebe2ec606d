//! Drives headless Chromium by its own protocol (https://chromedevtools.github.io/devtools-protocol/), through two named pipes:
//! messages are JSON, each ends with a zero byte.

use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

/// The longest that a page may take to show what a test waits for.
const PATIENCE: Duration = Duration::from_secs(60);

/// A browser with one page.
pub struct Browser {
    process: Child,
    to: File,
    from: BufReader<File>,
    /// Number of the last message.
    last: u64,
    session: String,
    events: Vec<Value>,
}

impl Browser {
    /// Starts one that keeps its files in a folder.
    pub fn start(folder: &Path) -> Browser {
        std::fs::create_dir_all(folder).unwrap();
        let pipes = ["to", "from"].map(|name| folder.join(name));
        assert!(Command::new("mkfifo").args(&pipes).status().unwrap().success());
        let browser = std::env::var("RELIGHT_BROWSER").unwrap_or_else(|_| "chromium".to_owned());
        let mut process = Command::new("sh")
            .args(["-c", "exec \"$0\" \"$@\" 3<to 4>from", &browser])
            .args(["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-sync"])
            .args(["--disable-background-networking", "--disable-component-update", "--hide-scrollbars"])
            .args(["--remote-debugging-pipe", "--user-data-dir=profile", "about:blank"])
            .current_dir(folder)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        // In the order in which the shell opens them: each waits for its other end.
        let to = File::options().write(true).open(&pipes[0]).unwrap();
        let from = BufReader::new(File::open(&pipes[1]).unwrap());
        let (last, session) = (0, String::new());
        if let Some(status) = process.try_wait().unwrap() {
            panic!("{browser}: {status}; install chromium, or set RELIGHT_BROWSER");
        }
        let mut browser = Browser { process, to, from, last, session, events: Vec::new() };
        let targets = browser.call("Target.getTargets", json!({}));
        let page = targets["targetInfos"].as_array().unwrap().iter().find(|target| target["type"] == "page");
        let target = page.unwrap()["targetId"].clone();
        let attached = browser.call("Target.attachToTarget", json!({ "targetId": target, "flatten": true }));
        browser.session = attached["sessionId"].as_str().unwrap().to_owned();
        for domain in ["Page", "Runtime", "Log", "DOM"] {
            browser.call(&format!("{domain}.enable"), json!({}));
        }
        browser
    }

    /// The result of a method.
    pub fn call(&mut self, method: &str, parameters: Value) -> Value {
        let told = self.answer(method, parameters);
        assert!(told["error"].is_null(), "{method}: {told}");
        told["result"].clone()
    }

    /// The answer to a method: a result, or an error.
    fn answer(&mut self, method: &str, parameters: Value) -> Value {
        self.last += 1;
        let mut message = json!({ "id": self.last, "method": method, "params": parameters });
        if !self.session.is_empty() {
            message["sessionId"] = json!(self.session);
        }
        let mut bytes = message.to_string().into_bytes();
        bytes.push(0);
        self.to.write_all(&bytes).unwrap();
        loop {
            let told = self.read();
            if told["id"] == self.last {
                return told;
            }
        }
    }

    /// The next message; events are kept too.
    fn read(&mut self) -> Value {
        let mut bytes = Vec::new();
        self.from.read_until(0, &mut bytes).unwrap();
        assert_eq!(bytes.pop(), Some(0), "the browser has ended: install chromium, or set RELIGHT_BROWSER");
        let told: Value = serde_json::from_slice(&bytes).unwrap();
        if told["id"].is_null() {
            self.events.push(told.clone());
        }
        told
    }

    /// Loads a page, with all that it needs at once.
    pub fn open(&mut self, address: &str) {
        let told = self.call("Page.navigate", json!({ "url": address }));
        assert!(told["errorText"].is_null(), "{address}: {told}");
        self.wait("document.readyState === 'complete' && location.href !== 'about:blank'");
    }

    /// What an expression is worth on the page.
    pub fn ask(&mut self, expression: &str) -> Value {
        self.evaluate(expression).unwrap_or_else(|error| panic!("{expression}: {error}"))
    }

    /// As [`Browser::ask`], or the error if the page was left before it answered.
    fn evaluate(&mut self, expression: &str) -> Result<Value, Value> {
        let told =
            self.answer("Runtime.evaluate", json!({ "expression": expression, "returnByValue": true }));
        if !told["error"].is_null() {
            return Err(told["error"].clone());
        }
        let result = &told["result"];
        assert!(result["exceptionDetails"].is_null(), "{expression}: {result}");
        Ok(result["result"]["value"].clone())
    }

    /// Waits until an expression is true; pages may be left meanwhile.
    pub fn wait(&mut self, expression: &str) {
        let begun = Instant::now();
        while self.evaluate(&format!("!!({expression})")) != Ok(true.into()) {
            assert!(begun.elapsed() < PATIENCE, "never true: {expression}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Clicks an element and waits for the page that this leads to.
    pub fn follow(&mut self, selector: &str) {
        self.ask("window.isOld = true");
        // The page may be left before it answers.
        drop(self.evaluate(&format!("document.querySelector({}).click()", json!(selector))));
        self.wait("!window.isOld && document.readyState === 'complete'");
    }

    /// Types a text into a field.
    pub fn fill(&mut self, selector: &str, text: &str) {
        self.ask(&format!("document.querySelector({}).focus()", json!(selector)));
        self.call("Input.insertText", json!({ "text": text }));
    }

    /// Presses a key by its name, such as `ArrowRight`.
    pub fn press(&mut self, key: &str, code: u32) {
        for kind in ["rawKeyDown", "keyUp"] {
            let event = json!({ "type": kind, "key": key, "code": key, "windowsVirtualKeyCode": code });
            self.call("Input.dispatchKeyEvent", event);
        }
    }

    /// Sets the window's width, and whether its user likes it dark.
    pub fn look(&mut self, width: u32, dark: bool) {
        let size = json!({ "width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600 });
        self.call("Emulation.setDeviceMetricsOverride", size);
        let scheme = if dark { "dark" } else { "light" };
        let feature = json!({ "features": [{ "name": "prefers-color-scheme", "value": scheme }] });
        self.call("Emulation.setEmulatedMedia", feature);
    }

    /// Takes a picture of the whole page.
    pub fn picture(&mut self, file: &Path) {
        use base64::Engine as _;
        let size = self.call("Page.getLayoutMetrics", json!({}))["cssContentSize"].clone();
        let clip = json!({ "x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": 1 });
        let shot = json!({ "format": "png", "captureBeyondViewport": true, "clip": clip });
        let told = self.call("Page.captureScreenshot", shot);
        let png = base64::engine::general_purpose::STANDARD.decode(told["data"].as_str().unwrap()).unwrap();
        std::fs::write(file, png).unwrap();
    }

    /// What went wrong since this was asked last: exceptions, errors that scripts wrote, what the browser refused to load or run.
    pub fn faults(&mut self) -> Vec<String> {
        // Events that happened before this call come before its answer.
        self.ask("0");
        let is_fault = |event: &Value| match event["method"].as_str() {
            Some("Runtime.exceptionThrown") => true,
            Some("Runtime.consoleAPICalled") => event["params"]["type"] == "error",
            Some("Log.entryAdded") => event["params"]["entry"]["level"] == "error",
            _ => false,
        };
        self.events.drain(..).filter(is_fault).map(|event| event["params"].to_string()).collect()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
