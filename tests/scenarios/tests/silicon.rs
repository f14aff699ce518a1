//! What silicon does and the data sheets hide: errata, and behaviour that they leave open.

use control::{Fault, SystemState};
use emulator_link::Injection;
use test_stand::{rig, Stand};
use wire::message::BoardConfig;
use wire::Command;

#[test]
fn a_bus_error_in_controller_mode_is_cleared_and_nothing_else() {
    let mut link = rig(71);
    let mut stand = Stand::armed(&mut link, 3.0);
    let before = stand.status();
    for _ in 0..20 {
        stand.inject(Injection::BusError);
        stand.run(0.05);
    }
    let after = stand.status();
    assert_eq!(after.bus_recoveries, before.bus_recoveries);
    for unit in 0..6 {
        assert_eq!(after.units[unit].missed, before.units[unit].missed);
    }
    assert_eq!(after.state, SystemState::Running as u8);
}

#[test]
fn a_pulse_on_drdy_is_no_conversion() {
    let mut link = rig(72);
    let mut stand = Stand::armed(&mut link, 3.0);
    let before = stand.status();
    for _ in 0..50 {
        stand.inject(Injection::DrdyGlitch(3));
        stand.run(0.02);
    }
    let after = stand.status();
    let samples = |status: &wire::message::Status, unit: usize| status.units[unit].samples;
    let fresh = samples(&after, 2) - samples(&before, 2);
    let reference = samples(&after, 1) - samples(&before, 1);
    // The two converters' clocks differ by 6 % at most.
    assert!(fresh * 100 < reference * 107, "{fresh} of {reference}");
    assert_eq!(after.units[2].fault, 0);
}

#[test]
fn a_stalled_serial_stream_is_restarted() {
    let mut link = rig(73);
    let mut stand = Stand::armed(&mut link, 3.0);
    for _ in 0..5 {
        stand.inject(Injection::StallUsart);
        stand.run(0.3);
        assert_eq!(stand.status().state, SystemState::Running as u8);
    }
}

/// DRDY is high when the bring-up ends: that level is no sample, and the first sample comes 22 ms later.
#[test]
fn a_ready_line_that_a_start_leaves_high_is_no_sample() {
    let mut link = rig(74);
    let mut stand = Stand::connect(&mut link);
    stand.inject(Injection::KeepReady(true));
    let configs = test_stand::rig_file().units.map(|unit| unit.to_wire());
    stand.session.configure(&configs).expect("configured");
    stand.wait("all units are ready", 6.0, |status| {
        status.state == SystemState::Ready as u8
    });
    stand.run(0.2);
    let status = stand.status();
    assert!(
        status.units.iter().all(|unit| unit.fault == 0),
        "{status:?}"
    );
}

#[test]
fn the_crash_record_survives_the_reset_that_follows_it() {
    let mut link = rig(75);
    {
        let mut stand = Stand::armed(&mut link, 3.0);
        stand.inject(Injection::HangLoop);
        for _ in 0..100 {
            if stand.session.exchange(session::PERIOD).is_err() {
                break;
            }
        }
    }
    let stand = Stand::connect(&mut link);
    let info = stand.session.info().expect("connected");
    let record = info.crash_record.clone().expect("a crash record");
    assert_eq!(Fault::from_code(record.code), Some(Fault::WatchdogReset));
    assert_eq!(info.silicon, 0x2003);
    assert!(info.hse);
}

/// Mean delay in samples between a step of the force and its sample, over 16 steps, with the register pointer written ahead or not.
fn delay_samples(latches_at_pointer: bool, pointer_ahead: bool) -> f64 {
    let mut link = rig(76);
    let mut stand = Stand::connect(&mut link);
    stand.inject(Injection::LatchAtPointer(latches_at_pointer));
    stand
        .session
        .stage_board(BoardConfig {
            pointer_ahead,
            ..BoardConfig::default()
        })
        .expect("staged");
    let configs = test_stand::rig_file().units.map(|unit| unit.to_wire());
    stand.session.configure(&configs).expect("configured");
    stand.wait("all units are ready", 6.0, |status| {
        status.state == SystemState::Ready as u8
    });
    stand.ask(&Command::Stream { decimation: 1 });
    stand.run(0.1);
    let mut sum = 0;
    for step in 0..16 {
        stand.session.drain();
        stand.inject(Injection::PullCable(
            2,
            if step % 2 == 0 { 5.0 } else { 0.0 },
        ));
        stand.run(0.09 + 0.01 * f64::from(step % 3));
        let codes: Vec<i32> = (stand.session.drain().samples.iter())
            .filter(|timed| timed.sample.unit == 1)
            .map(|timed| timed.sample.adc_code)
            .collect();
        let (first, last) = (codes[0], codes[codes.len() - 1]);
        sum += codes
            .iter()
            .position(|code| (code - first).abs() * 2 > (last - first).abs())
            .expect("a step");
    }
    sum as f64 / 16.0
}

/// The measurement of docs/bring-up.md: which of the two the converters do shows in the delay of a step.
#[test]
fn the_pointer_measurement_tells_when_the_result_is_latched() {
    let at_read = [delay_samples(false, true), delay_samples(false, false)];
    let at_pointer = [delay_samples(true, true), delay_samples(true, false)];
    println!("samples to half a step, pointer ahead and not: latched at the read {at_read:?}, at the pointer {at_pointer:?}");
    assert!((at_read[0] - at_read[1]).abs() < 0.3, "{at_read:?}");
    let older = at_pointer[0] - at_pointer[1];
    assert!(
        (0.7..1.3).contains(&older),
        "one sample old: {at_pointer:?}"
    );
}
