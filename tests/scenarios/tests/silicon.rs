//! What silicon does and the data sheets hide: errata, and behaviour that they leave open.

use control::{Fault, MotorState, SystemState};
use emulator_link::Injection;
use session::link::fast::FastRig;
use session::link::{EmbeddedOptions, RigLink};
use test_stand::{all_at_zero, quantile, rig, Stand, ZERO_V};
use wire::message::BoardConfig;
use wire::{Command, UNITS};

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

/// DRDY is high when the bring-up ends: that level is no sample, and the first sample comes 41 ms
/// later.
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

/// Mean delay in samples between a step of the force and its sample, over 16 steps, with the
/// register pointer written ahead or not.
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

/// The measurement of docs/bring-up.md: which of the two the converters do shows in the delay of a
/// step.
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

/// The five variants of the converters that the datasheet lines at hand leave open, in all
/// combinations; bits 0 to 4.
fn variant(link: &mut dyn RigLink, bits: u8) -> String {
    let on = |bit: u8| bits >> bit & 1 == 1;
    let injections = [
        Injection::FreeRun(on(0)),
        Injection::ReportUnsettled(on(1)),
        Injection::KeepReady(on(2)),
        Injection::LatchAtPointer(on(3)),
        Injection::StartSlowly(on(4)),
    ];
    let controls = link.controls().expect("an emulated rig");
    for injection in injections {
        (controls.inject(injection)).unwrap_or_else(|error| panic!("{error}"));
    }
    format!("{injections:?}")
}

/// What hangs on each cell while it is brought up, N: the last result that settles lacks 0.5 % of
/// it.
const LOAD_N: f64 = 10.0;
/// Largest difference of held tensions between two rigs, N.
const HELD_N: f64 = 0.05;
/// Seven times the noise of a converter at 320 SPS, codes.
const NOISE_CODES: f64 = 1_500.0;

/// Each unit's first samples after its bring-up are settled; then the loads are taken off.
fn first_samples_are_settled(stand: &mut Stand<'_>, what: &str) {
    for unit in 1..=6 {
        stand.inject(Injection::PullCable(unit, LOAD_N));
    }
    stand.ask(&Command::Stream { decimation: 1 });
    let configs = test_stand::rig_file().units.map(|unit| unit.to_wire());
    stand.session.configure(&configs).expect("configured");
    stand.run(1.0);
    let samples = stand.session.drain().samples;
    for unit in 0..UNITS {
        let codes: Vec<f64> = (samples.iter())
            .filter(|timed| usize::from(timed.sample.unit) == unit)
            .map(|timed| f64::from(timed.sample.adc_code))
            .collect();
        let settled = quantile(&codes, 0.5);
        assert!(codes.len() > 50 && settled.abs() > 5e5, "{what}: {codes:?}");
        for code in &codes[..3] {
            assert!(
                (code - settled).abs() < NOISE_CODES,
                "{what}: unit {} begins with {:?}, settled {settled}",
                unit + 1,
                &codes[..3]
            );
        }
    }
    for unit in 1..=6 {
        stand.inject(Injection::PullCable(unit, 0.0));
    }
}

/// From disarmed to every cable at 3 N, with new zeros; the mean true tensions, N. What a cable
/// keeps while it is zeroed is in them.
fn arm(stand: &mut Stand<'_>) -> [f64; UNITS] {
    stand.wait("all units are ready", 6.0, |status| {
        status.state == SystemState::Ready as u8
            && !status.alive_withheld
            && (status.units.iter()).all(|unit| unit.state == MotorState::Ready as u8)
    });
    stand.ask(&Command::Zero { units: 0b11_1111 });
    stand.run(0.1);
    stand.wait("zeroing is over", 4.0, |status| {
        status.state == SystemState::Ready as u8
    });
    stand.ask(&Command::Arm);
    stand.hold([3.0; UNITS]);
    stand.run(0.6);
    stand.truth();
    stand.run(0.2);
    let rows = stand.truth();
    std::array::from_fn(|unit| {
        rows.iter().map(|row| row.tension_n[unit]).sum::<f64>() / rows.len() as f64
    })
}

/// Checks one unit: first samples, loss of its converter, E-stop, clear. Returns the tensions that
/// were held.
fn is_safe(stand: &mut Stand<'_>, unit: u8, loss: Injection, what: &str) -> [f64; UNITS] {
    let what = format!("{what}, {loss:?}");
    let slot = usize::from(unit) - 1;
    first_samples_are_settled(stand, &what);
    let held = arm(stand);

    // A converter that falls silent stops its unit within 20 ms, and no other.
    stand.truth();
    stand.inject(loss);
    stand.run(0.1);
    let rows = stand.truth();
    let driven = rows.iter().rposition(|row| row.dac_v[slot].abs() > ZERO_V);
    assert!(
        driven.is_none_or(|last| last < 20),
        "{what}: driven {driven:?} ms"
    );
    let status = stand.status();
    assert_eq!(status.state, SystemState::Running as u8, "{what}");
    for (other, state) in status.units.iter().enumerate() {
        assert_eq!(state.fault != 0, other == slot, "{what}: {status:?}");
    }

    // The E-stop takes all outputs to 0 V within 5 ms.
    stand.truth();
    stand.inject(Injection::EStop(true));
    stand.run(0.1);
    let rows = stand.truth();
    let driven = rows.iter().rposition(|row| !all_at_zero(row));
    assert!(
        driven.is_none_or(|last| last < 5),
        "{what}: driven {driven:?} ms"
    );
    let status = stand.status();
    assert_eq!(Fault::from_code(status.fault), Some(Fault::EStop), "{what}");

    // The converter starts anew, and a clear arms nothing.
    stand.session.set_setpoints(None);
    stand.inject(Injection::EStop(false));
    stand.inject(Injection::PlugSensor(unit));
    stand.run(0.1);
    stand.ask(&Command::ClearFaults);
    stand.wait("the unit is back", 4.0, |status| {
        status.units[slot].state == MotorState::Ready as u8 && status.units[slot].fault == 0
    });
    assert!(
        stand.truth().iter().all(all_at_zero),
        "{what}: driven after a clear"
    );

    let report = stand.report();
    let misuse: Vec<_> = (report.register_events.iter())
        .filter(|event| {
            ["NAU", "DAC", "LS7", "SPI"]
                .iter()
                .any(|part| event.place.starts_with(part))
        })
        .collect();
    assert!(misuse.is_empty(), "{what}: {misuse:?}");
    held
}

/// The same on the rig without the emulated controller.
fn is_safe_on_the_fast_rig(seed: u64, bits: u8, unit: u8, loss: Injection) -> [f64; UNITS] {
    let options = EmbeddedOptions {
        seed: Some(seed),
        ..EmbeddedOptions::default()
    };
    let mut link = FastRig::open(&options).unwrap_or_else(|error| panic!("{error}"));
    let what = variant(&mut link, bits);
    is_safe(&mut Stand::connect(&mut link), unit, loss, &what)
}

/// Largest difference between the tensions that two rigs hold, N.
fn difference_n(a: &[f64; UNITS], b: &[f64; UNITS]) -> f64 {
    let pairs = a.iter().zip(b);
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Every unit in every combination of variants; what is held is what the plain parts hold, but for
/// noise and friction.
#[test]
fn every_unit_is_safe_in_every_combination_of_variants() {
    let mut worst = 0.0_f64;
    for unit in 1..=6 {
        let mut plain = None;
        for bits in 0..32_u8 {
            let loss = if (bits + unit).is_multiple_of(2) {
                Injection::UnplugSensor(unit)
            } else {
                Injection::Nack(unit)
            };
            let held = is_safe_on_the_fast_rig(90, bits, unit, loss);
            let difference = difference_n(plain.get_or_insert(held), &held);
            assert!(
                difference < HELD_N,
                "unit {unit}, variants {bits:05b}: {difference} N"
            );
            worst = worst.max(difference);
        }
    }
    println!("largest difference of held tensions: {worst:.3} N");
}

/// The image with the two variants that contradict the datasheet, and with all five.
#[test]
fn the_image_is_safe_on_the_converters_that_other_drivers_expect() {
    for (bits, unit) in [(0b0_0011, 4), (0b1_1111, 2)] {
        let loss = Injection::UnplugSensor(unit);
        let plain = is_safe_on_the_fast_rig(77, 0, unit, loss);
        let mut link = rig(77);
        let what = variant(&mut link, bits);
        let held = is_safe(&mut Stand::connect(&mut link), unit, loss, &what);
        let difference = difference_n(&plain, &held);
        println!("image, variants {bits:05b}: {difference:.3} N");
        assert!(difference < HELD_N, "{what}: {difference} N");
    }
}

/// LDAC moves what a DAC's shift register holds, so a load within a word would be a wrong torque.
/// It can't happen: one interrupt sends a word, raises CS and pulses LDAC, in this order, and
/// begins the next word after it. Here words come as fast as the samples of six units, the
/// repetitions of each millisecond, faults, and a SPI that stops in the middle of a word let them;
/// the board's model watches each rising edge of LDAC.
#[test]
fn no_load_of_the_dacs_falls_within_a_word() {
    let mut link = rig(78);
    let mut stand = Stand::armed_for(&mut link, 3.0, 0.4);
    stand.robot(true);
    stand.inject(Injection::UnplugSensor(3));
    stand.run(0.1);
    stand.inject(Injection::EStop(true));
    stand.run(0.05);
    stand.inject(Injection::EStop(false));
    stand.inject(Injection::PlugSensor(3));
    stand.session.set_setpoints(None);
    stand.run(0.1);
    stand.ask(&Command::ClearFaults);
    stand.run(0.1);
    stand.inject(Injection::StopSpi(true));
    stand.run(0.05);
    stand.inject(Injection::StopSpi(false));
    stand.run(0.05);
    stand.ask(&Command::ClearFaults);
    stand.run(0.3);
    let events = stand.report().register_events;
    let of_dacs: Vec<_> = (events.iter())
        .filter(|event| event.place.starts_with("DAC7731"))
        .collect();
    assert!(of_dacs.is_empty(), "{of_dacs:?}");
}
