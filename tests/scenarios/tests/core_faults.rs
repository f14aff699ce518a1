//! Faults of the controller itself: its clock, its supply, its stack, its memory and registers. The
//! DACs' RST line and the reset take the motors to 0 V; the next start reports why and arms
//! nothing.

use control::{Fault, SystemState};
use emulator_link::{DacResetPull, Forbidden, Injection, Truth};
use session::link::RigLink;
use test_stand::{all_at_zero, rig, rig_file, Stand};
use wire::message::{BoardInfo, Pull};

/// Rows until the motors are at 0 V, and from then on they stay there.
fn rows_to_zero(rows: &[Truth]) -> usize {
    let driven = rows.iter().rposition(|row| !all_at_zero(row));
    driven.map_or(0, |last| last + 1)
}

/// Injects into an armed rig what ends in a reset. Returns what the board says of itself
/// afterwards, and how many milliseconds a motor was still driven.
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
    // The option bytes are read at the start.
    assert_eq!(info.brown_out_level(), BoardInfo::BROWN_OUT_LEVEL);
    assert!(driven_ms <= 2, "{driven_ms} ms");
}

/// The image looks at the pin itself: registers of the port, with its own pull resistors.
#[test]
fn each_start_tells_what_holds_the_reset_line_of_the_dacs() {
    let mut link = rig(88);
    for (injected, told) in [
        (DacResetPull::Down, Pull::Down),
        (DacResetPull::None, Pull::None),
        (DacResetPull::Up, Pull::Up),
    ] {
        let controls = link.controls().expect("an emulated rig");
        let injected_now = controls.inject(Injection::DacResetPull(injected));
        injected_now.expect("injected");
        let dip = controls.inject(Injection::BrownOut);
        dip.expect("injected");
        let mut stand = Stand::connect(&mut link);
        stand.run(0.1);
        let info = stand.session.info().expect("connected");
        assert_eq!(info.dac_reset_pull, told);
    }
}

fn is_refused(seed: u64, access: Forbidden) -> String {
    let mut link = rig(seed);
    let (info, driven_ms) = reset_by(&mut link, Injection::Forbidden(access));
    assert_eq!(fault_of(&info), Some(Fault::HardFault), "{info:?}");
    let record = info.crash_record.expect("a record");
    // MMFSR: it was the MPU that stopped it.
    assert_ne!(record.detail & 0xFF, 0, "{record:?}");
    assert!(driven_ms <= 3, "{driven_ms} ms");
    record.text.as_str().to_owned()
}

#[test]
fn a_stack_that_overflows_is_a_processor_fault_and_not_a_silent_overwrite() {
    let text = is_refused(83, Forbidden::Push);
    assert!(text.contains("stack overflow"), "{text}");
}

#[test]
fn a_null_pointer_a_write_to_flash_and_code_in_ram_are_processor_faults() {
    for (seed, access) in [
        (85, Forbidden::NullRead),
        (86, Forbidden::FlashWrite),
        (87, Forbidden::RunRam),
    ] {
        let text = is_refused(seed, access);
        assert!(!text.contains("stack overflow"), "{access:?}: {text}");
    }
}

/// A dip of the 5 V takes a counter's registers: it stands somewhere else and counts nothing until
/// it is set up again.
#[test]
fn a_counter_that_loses_its_supply_is_a_fault_and_counts_again() {
    let mut link = rig(84);
    let mut stand = Stand::armed(&mut link, 3.0);
    let before = stand.status().units;
    assert!(
        before.iter().all(|unit| unit.adc_code != 0),
        "a code of each cell: {before:?}"
    );
    stand.inject(Injection::DipCounter(2));
    let status = stand.wait("the counter is lost", 0.1, |status| status.fault != 0);
    let fault = (Fault::from_code(status.fault), status.fault_detail);
    assert_eq!(fault, (Some(Fault::CounterBus), 2 | 1 << 8), "{status:?}");
    assert!(
        status.alive_withheld,
        "motors without encoders keep their power"
    );
    stand.truth();
    stand.run(0.1);
    assert!(stand.truth().iter().all(all_at_zero));
    // The robot pulls at the reels, and each counter counts what its reel turns, those of the chip
    // as well.
    let before = stand.status().units;
    stand.truth();
    stand.robot(true);
    stand.run(4.0);
    let after = stand.status().units;
    let rows = stand.truth();
    let mut most = [0.0f64; 6];
    for unit in 0..6 {
        // A row each millisecond; 4,000 counts a turn of the motor, 26:7.
        let turned_rad: f64 = rows.iter().map(|row| row.reel_rad_s[unit] * 1e-3).sum();
        let turned = turned_rad / std::f64::consts::TAU * 4_000.0 * 26.0 / 7.0;
        let counted = after[unit]
            .encoder_counts
            .wrapping_sub(before[unit].encoder_counts);
        let difference = f64::from(counted).abs() - turned.abs();
        assert!(
            difference.abs() < 30.0 + 0.02 * turned.abs(),
            "unit {}: {counted} counts, the reel turned by {turned:.0}",
            unit + 1
        );
        most[unit] = turned.abs();
    }
    assert!(
        most[2].max(most[3]) > 100.0,
        "no reel of the chip turned: {most:?}"
    );
    // A clear does not end it: what was measured before was from elsewhere.
    stand
        .session
        .command(&wire::Command::ClearFaults)
        .unwrap_err();
}
