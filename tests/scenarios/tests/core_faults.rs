//! Faults of the controller itself: its clock, its supply, its stack, its memory and registers. The DACs' RST line and the reset take
//! the motors to 0 V; the next start reports why and arms nothing.

use control::{Fault, SystemState};
use emulator_link::{Injection, Truth};
use session::link::RigLink;
use test_stand::{all_at_zero, rig, rig_file, Stand};
use wire::message::BoardInfo;

/// Rows until the motors are at 0 V, and from then on they stay there.
fn rows_to_zero(rows: &[Truth]) -> usize {
    let driven = rows.iter().rposition(|row| !all_at_zero(row));
    driven.map_or(0, |last| last + 1)
}

/// Injects into an armed rig what ends in a reset. Returns what the board says of itself afterwards, and how many milliseconds a
/// motor was still driven.
fn reset_by(link: &mut dyn RigLink, injection: Injection) -> (BoardInfo, usize) {
    let rows = {
        let mut stand = Stand::armed(link, 3.0);
        stand.truth();
        stand.inject(injection);
        let ended = (0..50).any(|_| stand.session.exchange(session::PERIOD).is_err());
        assert!(ended, "the session does not notice the reset");
        stand.truth()
    };
    let mut stand = Stand::connect(link);
    stand.run(0.5);
    assert!(
        stand.truth().iter().all(all_at_zero),
        "a motor is driven after the reset"
    );
    let status = stand.status();
    assert_ne!(status.state, SystemState::Running as u8, "armed by itself");
    assert!(status.alive_withheld, "the amplifiers get power back");
    let info = stand.session.info().expect("connected").clone();
    (info, rows_to_zero(&rows))
}

fn fault_of(info: &BoardInfo) -> Option<Fault> {
    info.crash_record
        .as_ref()
        .and_then(|record| Fault::from_code(record.code))
}

#[test]
fn a_clock_that_stops_ends_the_run_and_the_board_starts_on_its_own_clock() {
    let mut link = rig(81);
    let (info, driven_ms) = reset_by(&mut link, Injection::LoseClock(true));
    assert_eq!(fault_of(&info), Some(Fault::ClockFailure), "{info:?}");
    assert!(!info.hse, "the clock is still gone");
    assert!(driven_ms <= 2, "{driven_ms} ms");
    // Sensors, outputs and the link work on the internal clock.
    let mut stand = Stand::connect(&mut link);
    let configs = rig_file().units.map(|unit| unit.to_wire());
    stand.session.configure(&configs).expect("configured");
    stand.ask(&wire::Command::ClearFaults);
    stand.wait("ready without the ST-Link's clock", 6.0, |status| {
        status.state == SystemState::Ready as u8
    });
}

#[test]
fn a_dip_of_the_supply_is_reported_and_arms_nothing() {
    let mut link = rig(82);
    let (info, driven_ms) = reset_by(&mut link, Injection::BrownOut);
    assert_eq!(fault_of(&info), Some(Fault::Supply), "{info:?}");
    assert!(info.hse);
    assert!(driven_ms <= 2, "{driven_ms} ms");
}

#[test]
fn a_stack_that_overflows_is_a_processor_fault_and_not_a_silent_overwrite() {
    let mut link = rig(83);
    let (info, driven_ms) = reset_by(&mut link, Injection::OverflowStack);
    assert_eq!(fault_of(&info), Some(Fault::HardFault), "{info:?}");
    let record = info.crash_record.expect("a record");
    assert!(record.text.contains("stack overflow"), "{record:?}");
    assert!(driven_ms <= 3, "{driven_ms} ms");
}
