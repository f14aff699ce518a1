//! The page in a real browser: Chromium without a screen, driven by chromedriver. Skipped where
//! chromedriver is not installed.
//!
//! With `FORCE_WEB_PICTURES=FOLDER` it leaves pictures of the page there, to be looked at.
#![cfg(unix)]

mod common;

use common::Served;
use serde_json::{json, Value};
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Longest wait for what has to come. A limit of patience, not of speed: the machine may be busy.
const PATIENCE: Duration = Duration::from_secs(60);
/// The two sizes that are looked at: a notebook and a phone, which is touched.
const SIZES: [(u32, u32); 2] = [(1280, 800), PHONE];
const PHONE: (u32, u32) = (390, 844);

/// chromedriver, which ends with this.
struct Driver {
    process: Child,
    port: u16,
}

impl Drop for Driver {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl Driver {
    /// `None` where it is not installed.
    fn start() -> Option<Self> {
        let port = TcpListener::bind("127.0.0.1:0")
            .ok()?
            .local_addr()
            .ok()?
            .port();
        let process = Command::new("chromedriver")
            .arg(format!("--port={port}"))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .ok()?;
        let driver = Self { process, port };
        let until = Instant::now() + PATIENCE;
        while TcpStream::connect(("127.0.0.1", port)).is_err() {
            assert!(Instant::now() < until, "chromedriver does not listen");
            std::thread::sleep(Duration::from_millis(20));
        }
        Some(driver)
    }

    /// One command of the WebDriver protocol.
    fn call(&self, method: &str, path: &str, body: &Value) -> Value {
        let said = self
            .answer(method, path, body)
            .unwrap_or_else(|error| panic!("{path}: {error}"));
        let value = said["value"].clone();
        assert!(value["error"].is_null(), "{path} {body}: {value}");
        value
    }

    fn answer(&self, method: &str, path: &str, body: &Value) -> std::io::Result<Value> {
        let body = if method == "GET" {
            String::new()
        } else {
            body.to_string()
        };
        let mut stream = TcpStream::connect(("127.0.0.1", self.port))?;
        stream.set_read_timeout(Some(PATIENCE))?;
        write!(
            stream,
            "{method} {path} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\nContent-Type: application/json\r\nContent-Length: {}\r\n\r\n{body}",
            self.port,
            body.len()
        )?;
        // It keeps the connection, whatever it is asked.
        let mut reader = BufReader::new(stream);
        let mut length = 0;
        loop {
            let mut line = String::new();
            reader.read_line(&mut line)?;
            let line = line.trim().to_ascii_lowercase();
            if let Some(value) = line.strip_prefix("content-length:") {
                length = value.trim().parse().unwrap_or(0);
            }
            if line.is_empty() {
                break;
            }
        }
        let mut content = vec![0; length];
        reader.read_exact(&mut content)?;
        Ok(serde_json::from_slice(&content)?)
    }
}

/// One window, as large as a screen.
struct Window<'d> {
    driver: &'d Driver,
    path: String,
}

impl Drop for Window<'_> {
    fn drop(&mut self) {
        // Ends the browser, also where the test has failed.
        let _ = self.driver.answer("DELETE", &self.path, &json!({}));
    }
}

impl<'d> Window<'d> {
    fn open(driver: &'d Driver, (width, height): (u32, u32), link: &str) -> Self {
        let arguments = [
            "--headless=new",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-dev-shm-usage",
        ];
        let touch = (width, height) == PHONE;
        let metrics = json!({"width": width, "height": height, "pixelRatio": 1.0, "mobile": touch, "touch": touch});
        let options = json!({"args": arguments, "mobileEmulation": {"deviceMetrics": metrics}});
        let wanted = json!({"capabilities": {"alwaysMatch": {"goog:chromeOptions": options, "goog:loggingPrefs": {"browser": "ALL"}}}});
        let session = driver.call("POST", "/session", &wanted);
        let path = format!("/session/{}", session["sessionId"].as_str().unwrap());
        let window = Self { driver, path };
        window.call("POST", "/url", &json!({"url": link}));
        window
    }

    fn call(&self, method: &str, what: &str, body: &Value) -> Value {
        self.driver
            .call(method, &format!("{}{what}", self.path), body)
    }

    /// The value of an expression in the page.
    fn value(&self, expression: &str) -> Value {
        let script = format!("return {expression}");
        self.call(
            "POST",
            "/execute/sync",
            &json!({"script": script, "args": []}),
        )
    }

    fn text(&self, id: &str) -> String {
        let text = self.value(&format!("document.getElementById('{id}').textContent"));
        text.as_str().unwrap_or_default().to_owned()
    }

    /// Waits until an element's text is as wanted.
    fn until(&self, id: &str, wanted: impl Fn(&str) -> bool) -> String {
        let until = Instant::now() + PATIENCE;
        loop {
            let text = self.text(id);
            if wanted(&text) {
                return text;
            }
            assert!(Instant::now() < until, "{id}: {text}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Clicks as a mouse does: an element that another one covers is an error.
    fn click(&self, id: &str) {
        let found = json!({"using": "css selector", "value": format!("#{id}")});
        let element = self.call("POST", "/element", &found);
        let number = element.as_object().unwrap().values().next().unwrap();
        let path = format!("/element/{}/click", number.as_str().unwrap());
        self.call("POST", &path, &json!({}));
    }

    /// Puts a finger on an element and lifts it. The browser makes no mouse of it before that.
    fn touch(&self, id: &str) {
        let middle = self.value(&format!(
            "(() => {{ const box = document.getElementById('{id}').getBoundingClientRect(); return [box.left + box.width / 2, box.top + box.height / 2]; }})()"
        ));
        let [x, y] = [0, 1].map(|i| middle[i].as_f64().unwrap() as i64);
        let finger = json!({"type": "pointer", "id": "finger", "parameters": {"pointerType": "touch"}, "actions": [
            {"type": "pointerMove", "duration": 0, "origin": "viewport", "x": x, "y": y},
            {"type": "pointerDown", "button": 0},
            {"type": "pause", "duration": 50},
            {"type": "pointerUp", "button": 0},
        ]});
        self.call("POST", "/actions", &json!({"actions": [finger]}));
    }

    fn picture(&self, name: &str) {
        let Some(folder) = std::env::var_os("FORCE_WEB_PICTURES") else {
            return;
        };
        let encoded = self.call("GET", "/screenshot", &json!({}));
        let file = std::path::Path::new(&folder).join(format!("{name}.png.base64"));
        std::fs::write(file, encoded.as_str().unwrap()).unwrap();
    }

    /// Messages on the browser's console: errors of scripts, files that were refused.
    fn complaints(&self) -> Value {
        self.call("POST", "/se/log", &json!({"type": "browser"}))
    }
}

#[test]
fn a_browser_shows_the_force_stops_the_rig_and_clears_it() {
    let Some(driver) = Driver::start() else {
        println!("skipped: chromedriver is not installed (Debian: chromium-driver)");
        return;
    };
    let mut served = Served::new(Some("0123456789abcdef"));
    let [notebook, phone] = SIZES.map(|size| Window::open(&driver, size, &served.link));
    for window in [&notebook, &phone] {
        window.until("state", |text| text == "ready");
        // As large as a hand, and always on the screen: 96 pixels are an inch.
        let stop = window.value("(() => { const { width, height, top, bottom } = document.getElementById('stop').getBoundingClientRect(); return [width, height, top, window.innerHeight - bottom]; })()");
        let stop: Vec<f64> = serde_json::from_value(stop).unwrap();
        assert!(stop[0] > 200.0 && stop[1] > 120.0, "{stop:?}");
        assert!(stop[2] >= 0.0 && stop[3] >= 0.0, "{stop:?}");
        let whole = "[...document.querySelectorAll('#stop, .figure')].every((e) => e.scrollWidth <= e.clientWidth)";
        assert_eq!(window.value(whole), true, "letters are cut off");
        let beyond = window.value("document.documentElement.scrollWidth - window.innerWidth");
        assert!(
            beyond.as_f64().unwrap() <= 0.0,
            "wider than the screen by {beyond}"
        );
    }
    notebook.value("document.getElementById('seconds').value = 600");
    notebook.click("set_force");
    let force = |text: &str| {
        text.parse::<f64>()
            .is_ok_and(|force| (2.3..2.7).contains(&force))
    };
    notebook.until("force", force);
    phone.until("force", force);
    phone.until("who", |text| text.contains("page at 127.0.0.1 commands"));
    for (window, name) in [(&notebook, "notebook-force"), (&phone, "phone-force")] {
        window.picture(name);
    }
    // The phone may not command beside the notebook, and it may stop.
    phone.click("hold");
    phone.until("said", |text| text.contains("commands this rig"));
    phone.value("document.getElementById('stop').addEventListener('pointerdown', (event) => { window.by = event.pointerType; })");
    phone.touch("stop");
    let confirmed = |text: &str| text.contains("the board has confirmed 0 V");
    println!("{}", phone.until("stopped", confirmed));
    assert_eq!(phone.value("window.by"), "touch");
    notebook.until("said", |text| text.contains("stopped by page at 127.0.0.1"));
    for window in [&notebook, &phone] {
        window.until("faults", |text| {
            text.contains("stopped by the host (fault 3)")
        });
    }
    for (window, name) in [(&notebook, "notebook-stopped"), (&phone, "phone-stopped")] {
        window.picture(name);
    }
    phone.click("clear");
    phone.until("said", |text| text == "no fault is latched");
    notebook.until("state", |text| text == "ready");
    for window in [&notebook, &phone] {
        assert_eq!(window.complaints(), json!([]));
    }
    // The service ends: nothing is shown as if it were now, and a stop says that it does nothing.
    served.end_service();
    for window in [&notebook, &phone] {
        window.until("state", |text| text == "not connected" || text == "no data");
        assert_eq!(window.text("force"), "\u{2013}");
        assert_eq!(
            window.value("document.getElementById('scene').dataset.unknown"),
            "no data"
        );
        let cells = "[...document.querySelectorAll('#units td:nth-child(n+2)')]";
        let empty = window.value(&format!(
            "{cells}.length === 18 && {cells}.every((cell) => cell.textContent === '\\u2013')"
        ));
        assert_eq!(empty, true, "figures of before are left in the table");
    }
    phone.until("state", |text| text == "not connected");
    phone.touch("stop");
    phone.until("stopped", |text| text.contains("NOT CONNECTED"));
    phone.picture("phone-gone");
}

/// The arrow of a force that was, and cables that end where the tip was, are not left on the
/// screen.
#[test]
fn a_tip_that_is_lost_is_shown_as_lost() {
    let Some(driver) = Driver::start() else {
        println!("skipped: chromedriver is not installed (Debian: chromium-driver)");
        return;
    };
    let served = Served::new(Some("0123456789abcdef"));
    let window = Window::open(&driver, SIZES[0], &served.link);
    window.until("state", |text| text == "ready");
    let script = "const done = arguments[0]; import(new URL('scene.js', location)).then(({ Scene }) => {
        const canvas = document.createElement('canvas');
        canvas.style.cssText = 'position: fixed; inset: 0; width: 400px; height: 300px;';
        document.body.append(canvas);
        const scene = new Scene(canvas);
        const rig = { center_m: [0, 0, 0], radius_m: 0.05, units: [{ exit_m: [0.4, 0, 0] }, { exit_m: [-0.4, 0, 0.3] }] };
        const now = { tip_m: [0, 0, 0], force_n: [0, 0, 2.5], tension_n: [3, 3] };
        const bright = () => {
            scene.draw();
            const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
            let count = 0;
            for (let i = 0; i < data.length; i += 4) count += data[i] === 255 && data[i + 1] === 255 && data[i + 2] === 255;
            return count;
        };
        const found = [];
        for (const shown of [now, { ...now, force_n: null }, { ...now, tip_m: null, force_n: null }, null]) {
            scene.show(rig, shown);
            found.push([bright(), canvas.dataset.unknown]);
        }
        done(found);
    }).catch((error) => done(String(error)));";
    let found = window.call(
        "POST",
        "/execute/async",
        &json!({"script": script, "args": []}),
    );
    let words: Vec<&str> = (0..4).map(|i| found[i][1].as_str().unwrap()).collect();
    assert_eq!(
        words,
        ["", "force not known", "tip not known", "no data"],
        "{found}"
    );
    // The arrow and the tip, a disc of 10 pixels, are the only white things. Where letters cross, a
    // pixel may be white.
    let white: Vec<i64> = (0..4).map(|i| found[i][0].as_i64().unwrap()).collect();
    assert!(white[0] > white[1] && white[1] > 0, "{found}");
    assert!(
        white[1] > 60 && white[2..].iter().all(|n| *n < 6),
        "{found}"
    );
}
