//! Two drivers of the NAU7802 from PyPI, unmodified, on the model of the chip:
//! `sparkfun-qwiic-nau7802` and `nau7802`. A program in Python loads them with a bus that is a pipe
//! to this test; waits and clock are the model's, so nothing here takes real time.
//!
//! `cargo xtask test python-drivers` installs them and names their Python in CHIP_TEST_PYTHON.
//! Without it the test skips itself.

use emulator::devices::nau7802::Nau7802;
use emulator::devices::Complaints;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Write};
use std::process::{Command, Stdio};

/// A byte with its acknowledge at 100 kHz, as a Raspberry Pi has it, ns.
const BYTE_NS: u64 = 90_000;

/// One converter on a bus, with its time.
struct Stand {
    chip: Nau7802,
    now_ns: u64,
    bridge_v_per_v: f64,
    complaints: Complaints,
}

impl Stand {
    fn pass(&mut self, ns: u64) {
        let end = self.now_ns + ns;
        while let Some(at) = self.chip.next_event().filter(|at| *at <= end) {
            let bridge = self.bridge_v_per_v;
            self.chip.advance(at, |_, _| bridge);
        }
        self.now_ns = end;
    }

    /// `None`: not acknowledged.
    fn begin(&mut self, address: u64, read: bool) -> Option<()> {
        self.pass(BYTE_NS);
        let own = address == u64::from(emulator::devices::nau7802::ADDRESS);
        (own && self.chip.start(read, self.now_ns, &mut self.complaints)).then_some(())
    }

    fn write(&mut self, bytes: &[u64]) -> Option<()> {
        for byte in bytes {
            self.pass(BYTE_NS);
            let byte = u8::try_from(*byte).expect("a byte");
            if !self.chip.write(byte, self.now_ns, &mut self.complaints) {
                return None;
            }
        }
        Some(())
    }

    fn transaction(&mut self, words: &[&str]) -> Option<Vec<u64>> {
        let numbers = |words: &[&str]| -> Vec<u64> {
            let number = |word: &&str| word.parse().unwrap_or_else(|_| panic!("{words:?}"));
            words.iter().map(number).collect()
        };
        match words {
            ["wait", ns] => self.pass(ns.parse().expect("a time")),
            ["time"] => return Some(vec![self.now_ns]),
            ["load", load] => self.bridge_v_per_v = load.parse::<f64>().expect("a load") * 1e-6,
            ["write", rest @ ..] => {
                let bytes = numbers(rest);
                self.begin(bytes[0], false)?;
                self.write(&bytes[1..])?;
                self.chip.stop();
            }
            ["read", rest @ ..] => {
                let numbers = numbers(rest);
                self.begin(numbers[0], false)?;
                self.write(&numbers[1..2])?;
                self.begin(numbers[0], true)?;
                let mut bytes = Vec::new();
                for _ in 0..numbers[2] {
                    self.pass(BYTE_NS);
                    bytes.push(u64::from(self.chip.read(self.now_ns)));
                }
                self.chip.stop();
                return Some(bytes);
            }
            other => panic!("{other:?} is no request"),
        }
        Some(Vec::new())
    }
}

/// The Python that has the drivers, if there is one.
fn python() -> Option<String> {
    let Ok(python) = std::env::var("CHIP_TEST_PYTHON") else {
        println!("skipped: CHIP_TEST_PYTHON names no Python that has the drivers (cargo xtask test python-drivers installs them)");
        return None;
    };
    Some(python)
}

/// What the driver found on a converter of this kind.
fn run(driver: &str, free_runs: bool, reports_unsettled: bool) -> Option<BTreeMap<String, String>> {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/python/drivers.py");
    let mut child = Command::new(python()?)
        .args(["-B", script, driver])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("Python starts");
    let mut to = child.stdin.take().expect("its input");
    let mut stand = Stand {
        chip: Nau7802::new(1, 41),
        now_ns: 1_000,
        bridge_v_per_v: 0.0,
        complaints: Complaints::default(),
    };
    stand.chip.defects().free_runs = free_runs;
    stand.chip.defects().reports_unsettled = reports_unsettled;
    let mut found = BTreeMap::new();
    for line in BufReader::new(child.stdout.take().expect("its output")).lines() {
        let line = line.expect("text");
        let words: Vec<&str> = line.split_whitespace().collect();
        if let ["found", name, value] = words[..] {
            found.insert(name.to_owned(), value.to_owned());
            continue;
        }
        let answer = match stand.transaction(&words) {
            Some(numbers) => numbers
                .iter()
                .fold("ok".to_owned(), |line, number| format!("{line} {number}")),
            None => {
                stand.chip.stop();
                "nack".to_owned()
            }
        };
        writeln!(to, "{answer}").expect("it listens");
    }
    let status = child.wait().expect("it ends");
    println!("{driver}, free {free_runs}, unsettled {reports_unsettled}: {found:?}");
    assert!(status.success(), "{driver}: {status}");
    assert!(stand.complaints.is_empty(), "{:?}", stand.complaints);
    Some(found)
}

fn number(found: &BTreeMap<String, String>, name: &str) -> f64 {
    let text = found
        .get(name)
        .unwrap_or_else(|| panic!("no {name}: {found:?}"));
    text.parse().unwrap_or_else(|_| panic!("{name}: {text}"))
}

/// Codes of 1 mV/V at gain 128: full scale is half the reference.
const PER_MV_PER_V: f64 = 1e-3 * 128.0 * 16_777_216.0;

/// Neither driver sets CS, and both are known to work: they read a converter that runs free, and
/// get nothing from one that does what section 9.1 says.
#[test]
fn drivers_from_pypi_read_a_converter_that_runs_free() {
    for reports_unsettled in [false, true] {
        let Some(found) = run("sparkfun", true, reports_unsettled) else {
            return;
        };
        assert_eq!(found["begin"], "True");
        assert_eq!(found["revision"], "15");
        assert_eq!(found["calibrated"], "True");
        let scale = number(&found, "codes-per-mv-per-v") / PER_MV_PER_V;
        assert!((scale - 1.0).abs() < 0.002, "{scale}");
        let weight = number(&found, "weight");
        assert!((weight + 1.0).abs() < 0.005, "{weight}");

        let found = run("typed", true, reports_unsettled).expect("there was one");
        assert_eq!(found["revision"], "15");
        assert_eq!(found["calibrated"], "True");
        assert_eq!(found["ctrl2"], "48");
        let scale = number(&found, "codes-per-mv-per-v") / PER_MV_PER_V;
        assert!((scale - 1.0).abs() < 0.002, "{scale}");
        assert_eq!(found["calibrated-2"], "True");
        assert_eq!(found["offset-1-kept"], "True");
        assert_eq!(found["offset-2-new"], "True");
    }
}

#[test]
fn drivers_that_never_set_cs_get_nothing_from_a_converter_that_needs_it() {
    let Some(found) = run("sparkfun", false, false) else {
        return;
    };
    assert_eq!(found["begin"], "True");
    let scale = number(&found, "codes-per-mv-per-v");
    assert!(scale.abs() < 1.0, "{scale}");
    let found = run("typed", false, false).expect("there was one");
    assert_eq!(found["calibrated"], "True");
    assert!(number(&found, "codes-per-mv-per-v").is_nan());
}
