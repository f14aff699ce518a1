//! Sessions over the board's USB port: a force held, the cable pulled, the bus suspended, both
//! links at once, a host that stops reading.

use emulator_link::{Injection, Latency, Truth};
use emulator_usb::host::State;
use scenarios::usb::{Link, UsbRig};
use session::link::RigLink;
use std::path::PathBuf;
use std::process::{Command as Process, Stdio};
use test_stand::{all_at_zero, quantile, Stand, MS};
use wire::UNITS;

/// Tension that the cables hold, in newtons.
const TENSION_N: f64 = 3.0;

fn forcectl(line: &str) -> (Option<i32>, String) {
    let rig = PathBuf::from(std::env::var_os("FORCE_RIG_BIN").expect("FORCE_RIG_BIN is set"));
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output =
        Process::new(rig.with_file_name(format!("forcectl{}", std::env::consts::EXE_SUFFIX)))
            .args(line.split_whitespace())
            .current_dir(folder.path())
            .stdin(Stdio::null())
            .output()
            .expect("forcectl runs");
    let text =
        [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
    (output.status.code(), text.concat())
}

#[test]
fn forcectl_holds_a_force_over_usb() {
    let (code, text) = forcectl("set-force 0 2.5 0 --duration 3 --usb");
    assert_eq!(code, Some(0), "{text}");
    assert!(text.contains("by USB"), "{text}");
}

#[test]
fn forcectl_says_that_the_cable_was_pulled() {
    let (code, text) = forcectl("set-force 0 2.5 0 --duration 5 --usb --inject usb-out@2s");
    assert_ne!(code, Some(0), "{text}");
    assert!(
        text.contains("USB port went away") && text.contains("0 V by itself"),
        "{text}"
    );
    assert!(!text.contains("panicked"), "{text}");
}

/// Time in milliseconds from the first row on until all outputs stand at 0 V for good.
fn zero_after_ms(truth: &[Truth]) -> usize {
    truth
        .iter()
        .rposition(|row| !all_at_zero(row))
        .map_or(0, |last| last + 1)
}

#[test]
fn a_pulled_cable_stops_the_motors_and_a_new_session_holds_again() {
    let mut rig = UsbRig::open(71);
    let mut stand = Stand::armed(&mut rig, TENSION_N);
    stand.truth();
    stand.inject(Injection::PlugUsb(false));
    drop(stand);
    let mut truth = Vec::new();
    for _ in 0..100 {
        truth.extend(rig.exchange(&[], 10 * MS).unwrap().truth);
    }
    let driven = truth.iter().take(20).any(|row| !all_at_zero(row));
    assert!(driven, "the motors held before");
    // Setpoints are valid for 100 ms, the ramp follows.
    let stopped = zero_after_ms(&truth);
    assert!(stopped < 500, "0 V after {stopped} ms");
    assert_eq!(rig.usb(|host, _| host.state()), State::Detached);
    rig.plug(true);
    rig.wait_state(State::Open, 1_000);
    let mut stand = Stand::connect(&mut rig);
    stand.ask(&wire::Command::ClearFaults);
    stand.run(0.1);
    stand.ask(&wire::Command::Arm);
    stand.hold([TENSION_N; UNITS]);
    stand.run(1.0);
    let last = stand.truth().pop().expect("rows");
    for (unit, tension) in last.tension_n.iter().enumerate() {
        assert!(
            (tension - TENSION_N).abs() < 0.3,
            "unit {}: {tension} N",
            unit + 1
        );
    }
    let counters = stand.session.counters();
    assert_eq!(
        (counters.frames_lost, counters.frames_bad),
        (0, 0),
        "stale bytes in the new session"
    );
}

#[test]
fn a_suspended_bus_stops_the_motors_and_goes_on_after_resume() {
    let mut rig = UsbRig::open(72);
    let mut stand = Stand::armed(&mut rig, TENSION_N);
    stand.truth();
    stand.inject(Injection::SuspendUsb(true));
    drop(stand);
    let mut truth = Vec::new();
    for _ in 0..100 {
        truth.extend(rig.exchange(&[], 10 * MS).unwrap().truth);
    }
    let stopped = zero_after_ms(&truth);
    assert!((50..500).contains(&stopped), "0 V after {stopped} ms");
    rig.usb(|host, core| host.set_suspended(core, false));
    rig.wait_state(State::Open, 100);
    let mut stand = Stand::connect(&mut rig);
    stand.run(0.5);
    let status = stand.status();
    // The same session of the USB stack: no enumeration.
    assert!(status.fault != 0, "the expired setpoints are reported");
    drop(stand);
    let log = rig.usb(|host, _| host.log().to_vec());
    assert_eq!(
        log.iter().filter(|(_, what)| what == "configured").count(),
        1,
        "{log:?}"
    );
}

#[test]
fn a_port_that_is_opened_again_starts_with_a_whole_frame() {
    let mut rig = UsbRig::open(75);
    for pause_ms in [3, 50, 400, 1_700] {
        let mut stand = Stand::connect(&mut rig);
        stand.ask(&wire::Command::Stream { decimation: 1 });
        stand.run(0.3);
        let counters = stand.session.counters();
        assert_eq!(
            (
                counters.frames_lost,
                counters.frames_bad,
                counters.frames_unknown
            ),
            (0, 0, 0),
            "before {pause_ms} ms"
        );
        drop(stand);
        rig.usb(|host, _| host.set_open(false));
        rig.wait_state(State::Configured, 50);
        rig.run(pause_ms);
        // A closed port has no reader: what the operating system had is gone with it.
        rig.usb(|host, _| drop(host.take_read()));
        rig.usb(|host, _| host.set_open(true));
        rig.wait_state(State::Open, 50);
    }
}

/// Time from DRDY to the output, in microseconds: median, 99th percentile, largest.
fn path_us(latencies: &[Latency]) -> [f64; 3] {
    let us: Vec<f64> = latencies
        .iter()
        .map(|latency| (latency.dac_update_ns - latency.drdy_ns) as f64 * 1e-3)
        .collect();
    [0.5, 0.99, 1.0].map(|part| quantile(&us, part))
}

#[test]
fn both_links_stream_every_sample_and_nothing_is_lost() {
    let mut rig = UsbRig::open(73);
    let mut stand = Stand::armed(&mut rig, TENSION_N);
    stand.ask(&wire::Command::Stream { decimation: 1 });
    stand.report();
    stand.run(3.0);
    let alone = path_us(&stand.report().latencies);
    drop(stand);
    let mut rig = UsbRig::open(73);
    rig.other.stream_all();
    let mut stand = Stand::armed(&mut rig, TENSION_N);
    stand.ask(&wire::Command::Stream { decimation: 1 });
    stand.session.drain();
    let before = stand.report().conversions;
    stand.run(3.0);
    let report = stand.report();
    let both = path_us(&report.latencies);
    let streamed = stand.session.drain().samples.len() as u64;
    let made: u64 = report.conversions.iter().sum::<u64>() - before.iter().sum::<u64>();
    let counters = stand.session.counters();
    assert_eq!((counters.frames_lost, counters.frames_bad), (0, 0));
    let status = stand.status();
    assert_eq!(status.frames_dropped, 0);
    drop(stand);
    println!(
        "DRDY to DAC in us (median, p99, largest): USB {alone:.1?}, USB and USART3 {both:.1?}"
    );
    println!(
        "{made} conversions, {streamed} samples by USB, {} by USART3",
        rig.other.samples
    );
    assert!(
        streamed.abs_diff(made) <= 60,
        "{streamed} of {made} samples by USB"
    );
    assert_eq!((rig.other.lost, rig.other.bad), (0, 0));
    assert!(rig.other.samples > made, "USART3 streams since the start");
    for (with, without) in both.iter().zip(alone) {
        assert!(*with < without + 10.0, "{both:?} against {alone:?}");
    }
}

/// Times of the sample path in three parts of a session over USART3, while the host at the USB port
/// has opened it, asks for every sample, and reads in those parts that `reads` says; and the rig
/// after it.
fn paths_beside_usb(reads: [bool; 3]) -> ([[f64; 3]; 3], UsbRig) {
    let mut rig = UsbRig::open(74);
    rig.session = Link::Serial;
    rig.other.stream_all();
    let mut stand = Stand::armed(&mut rig, TENSION_N);
    stand.ask(&wire::Command::Stream { decimation: 1 });
    let figures = reads.map(|reads| {
        stand.inject(Injection::ReadUsb(reads));
        stand.run(0.5);
        stand.report();
        let missed = stand.status().units.map(|unit| unit.missed);
        stand.run(3.0);
        let path = path_us(&stand.report().latencies);
        assert_eq!(
            stand.status().units.map(|unit| unit.missed),
            missed,
            "reads: {reads}"
        );
        let rows = stand.truth();
        let held = rows.last().expect("rows").tension_n;
        assert!(
            held.iter().all(|tension| (tension - TENSION_N).abs() < 0.3),
            "{held:?}"
        );
        path
    });
    let counters = stand.session.counters();
    assert_eq!(
        (counters.frames_lost, counters.frames_bad),
        (0, 0),
        "USART3 goes on"
    );
    drop(stand);
    (figures, rig)
}

#[test]
fn a_host_that_stops_reading_is_not_noticed_by_the_sample_path() {
    // Part by part against a host that always reads: how samples of six converters meet on the bus
    // changes with time, so one part says nothing of the next.
    let (reading, _) = paths_beside_usb([true; 3]);
    let (stopping, rig) = paths_beside_usb([true, false, true]);
    println!("DRDY to DAC in us (median, p99, largest): host reads {reading:.1?}, stops in the second part {stopping:.1?}");
    for (with, without) in stopping.iter().flatten().zip(reading.iter().flatten()) {
        assert!(*with < without + 10.0, "{stopping:?} against {reading:?}");
    }
    // What did not fit is counted by the board and missing in the numbers; no frame is damaged.
    let status = rig.other.status.as_ref().expect("status frames");
    assert!(status.frames_dropped > 100, "{}", status.frames_dropped);
    assert!(rig.other.lost >= u64::from(status.frames_dropped));
    assert_eq!(rig.other.bad, 0);
}
