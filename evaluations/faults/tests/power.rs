//! Power that comes back: what a clear, a reset or a configuration gives a motor whose output does
//! not follow.

use control::Fault;
use faults::campaign::CURRENT_LIMIT_A;
use faults::injection::Injection as I;
use faults::outcome::{PULL_MS, PULL_N, TENSION_N};
use faults::rig::Rig;
use wire::message::{Command, Response};

const UNIT: usize = 3;

/// Milliseconds in which a motor that may not pull did so at a stretch, and the largest tension of
/// any cable, N.
fn watch(rig: &mut Rig, ms: u32) -> (u32, f64) {
    let (mut pulls, mut longest, mut most_n) = (0, 0, 0.0f64);
    for _ in 0..ms {
        rig.run_ms(1);
        pulls = if rig.pull_n(UNIT) > PULL_N {
            pulls + 1
        } else {
            0
        };
        longest = longest.max(pulls);
        most_n = (0..6)
            .map(|unit| rig.tension_n(unit))
            .fold(most_n, f64::max);
    }
    (longest, most_n)
}

/// An output that is stuck behind a load cell or an encoder that is broken too: the unit faults,
/// the board faults, the power is off. A clear starts the converter anew, and for 0.65 s nothing is
/// measured.
#[test]
fn a_clear_gives_a_stuck_motor_no_power_that_it_keeps() {
    for seed in [1, 2] {
        for other in [
            I::OpenBridge(UNIT),
            I::WrongSign(UNIT),
            I::Frozen(UNIT),
            I::Silent(UNIT),
            I::ReadsFail(UNIT),
            I::EncoderFrozen(UNIT),
            I::Saturated(UNIT, true),
        ] {
            let mut rig = Rig::armed(seed, [6.0; 6], CURRENT_LIMIT_A);
            rig.inject(I::DacStuck(UNIT));
            rig.inject(other);
            rig.run_ms(100);
            rig.inject(I::StopElsewhere);
            rig.run_ms(600);
            if rig.power() {
                // An encoder that stands still shows nothing of it, and the load cell has seen the
                // cable let go.
                assert!(rig.is_faulted());
                continue;
            }
            for clear in 0..2 {
                let _ = rig.command(Command::ClearFaults);
                let (pulls, most_n) = watch(&mut rig, 2_000);
                let context = format!("seed {seed}, {other:?}, clear {clear}: {:?}", rig.status());
                assert!(pulls <= PULL_MS, "{pulls} ms, {context}");
                // Without its encoder nothing shows that a slack cable is taken up: it tightens
                // with a shock.
                let seen = other != I::EncoderFrozen(UNIT);
                assert!(!seen || most_n < TENSION_N, "{most_n:.1} N, {context}");
                assert!(!rig.power(), "{context}");
            }
        }
    }
}

/// The same with a stop: no converter is started anew.
#[test]
fn a_clear_after_a_stop_gives_a_stuck_motor_no_power_that_it_keeps() {
    let mut rig = Rig::armed(1, [6.0; 6], CURRENT_LIMIT_A);
    rig.inject(I::DacStuck(UNIT));
    rig.inject(I::StopElsewhere);
    rig.run_ms(600);
    assert!(!rig.power());
    assert_eq!(rig.command(Command::ClearFaults), Response::Done);
    let (pulls, most_n) = watch(&mut rig, 2_000);
    assert!(
        pulls <= PULL_MS && most_n < TENSION_N,
        "{pulls} ms, {most_n:.1} N"
    );
    assert_eq!(rig.status().fault, Fault::OutputStuck.code());
}

/// Many clears in a row, in every phase of the converters' periods: none ends in a fault of its
/// own.
#[test]
fn a_clear_starts_every_converter_that_works() {
    for late_ms in 0..30 {
        let mut rig = Rig::armed(1, [4.0; 6], CURRENT_LIMIT_A);
        rig.inject(I::WrongSign(UNIT));
        rig.run_ms(200 + late_ms);
        rig.inject(I::StopElsewhere);
        rig.run_ms(300);
        let _ = rig.command(Command::ClearFaults);
        rig.run_ms(1_200);
        let status = rig.status();
        assert_ne!(
            status.units[UNIT].fault,
            Fault::SensorSilent.code(),
            "{late_ms}: {status:?}"
        );
    }
}
