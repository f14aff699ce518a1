//! A service made of canned lines.

use rig::{DEFAULT_NAME, DEFAULT_TEXT};
use serde_json::{json, Value};
use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixListener;
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Methods that were called.
pub type Calls = Arc<Mutex<Vec<String>>>;

/// A service with one client. It remembers what was called.
pub fn service(folder: &std::path::Path) -> Calls {
    named(folder, "fake", None)
}

/// An emulated rig that is kept, by its name, and the lock that it holds.
pub fn kept(folder: &std::path::Path, name: &str) -> (std::fs::File, Calls) {
    let mut lock = std::fs::File::create(folder.join(format!("{name}.lock"))).unwrap();
    lock.lock().unwrap();
    lock.write_all(b"7\nembedded rig\n").unwrap();
    (lock, named(folder, name, Some(1)))
}

fn named(folder: &std::path::Path, name: &str, seed: Option<u64>) -> Calls {
    let listener = UnixListener::bind(folder.join(format!("{name}.sock"))).unwrap();
    let name = name.to_owned();
    let calls: Calls = Arc::default();
    let log = Arc::clone(&calls);
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let Ok(stream) = stream else { return };
            let (log, name) = (Arc::clone(&log), name.clone());
            std::thread::spawn(move || {
                let mut out = stream.try_clone().unwrap();
                for line in BufReader::new(stream).lines().map_while(Result::ok) {
                    let request: Value = serde_json::from_str(&line).unwrap();
                    let method = request["method"].as_str().unwrap().to_owned();
                    log.lock().unwrap().push(method.clone());
                    let result = if method == "hello" {
                        json!({
                            "version": 1, "name": name, "link": "a fake link", "pid": 7, "seed": seed, "board": null,
                            "rig_file": DEFAULT_NAME, "rig_text": DEFAULT_TEXT, "now_ns": 0, "terminal": null,
                        })
                    } else {
                        json!({})
                    };
                    let answer = json!({"jsonrpc": "2.0", "id": request["id"], "result": result});
                    if !send(&mut out, &answer) {
                        return;
                    }
                    if method == "subscribe" {
                        let mut out = out.try_clone().unwrap();
                        std::thread::spawn(move || telemetry(&mut out));
                    }
                }
            });
        }
    });
    calls
}

/// Sends a line in one write: a value writes itself piece by piece, and two threads write to a
/// client.
fn send(out: &mut impl Write, line: &Value) -> bool {
    out.write_all(format!("{line}\n").as_bytes()).is_ok()
}

/// Telemetry as an older service sends it: without some of the newer keys.
fn telemetry(out: &mut impl Write) {
    for n in 0.. {
        let params = json!({
            "t_s": f64::from(n) * 0.02, "tension_n": [1.5, null, null, null, null, null],
            "setpoint_n": [null, null, null, null, null, null], "state": "running", "tip_m": null, "true_force_n": null,
            "encoder_counts": [4000, null, -17, null, null, null], "adc_code": [123_456, null, null, null, null, null],
        });
        let line = json!({"jsonrpc": "2.0", "method": "telemetry", "params": params});
        if !send(out, &line) {
            return;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}
