//! Whatever comes in: no panic, and never more than the force limit at the motor.

#[path = "common/compare.rs"]
mod compare;
#[path = "common/reference.rs"]
mod reference;

use control::friction::ReelSpeed;
use control::unit::{Drive, Setpoint};
use control::{
    AdcCode, Config, Controller, DacCode, EncoderCounts, Input, InvCos, Micros, Newton, State,
};
use proptest::prelude::*;
use wire::message::{flags, FilterChoice, Ripple, Sample, UnitConfig, UnitSetpoint, DIRECTION_ONE};

fn input() -> impl Strategy<Value = Input> {
    (
        any::<i32>(),
        any::<i64>(),
        any::<u32>(),
        any::<i32>(),
        any::<i32>(),
        0..3usize,
        any::<Option<i32>>(),
    )
        .prop_map(|(code, counts, at, tension, inv_cos, drive, reel)| Input {
            adc_code: AdcCode::new(code),
            encoder_counts: EncoderCounts(counts),
            at: Micros(at),
            setpoint: Setpoint {
                tension: Newton::from_bits(tension),
                inv_cos: InvCos::from_q16(inv_cos),
                reel: reel.map(ReelSpeed::from_um_per_s),
            },
            drive: [Drive::Off, Drive::Follow, Drive::Ramp][drive],
        })
}

proptest! {
    #[test]
    fn output_stays_within_its_limits(seed: u64, inputs in prop::collection::vec(input(), 1..60)) {
        let wire = compare::config(&mut compare::Random(seed));
        let config = Config::from_wire(&wire).expect("drawn within the ranges");
        let mut state = State::default();
        let scale = f64::from(wire.dac_counts_per_n_q16) / 65_536.0;
        let limit = f64::from(wire.force_limit_un) * 1e-6;
        for input in inputs {
            let output = Controller::step(&config, &mut state, input);
            let force = f64::from(output.dac.steps()) / scale;
            let step = 0.51 / scale.abs();
            // Never pushing, never past the limit: the sign is that of the scale.
            prop_assert!(force >= -step && force <= limit + step, "{force} N of {limit} N");
            if input.drive == Drive::Off || output.fault.is_some() {
                prop_assert_eq!(output.dac, DacCode::ZERO_VOLT);
                prop_assert_eq!(output.flags & flags::ACTIVE, 0);
            }
            let mut sample = Sample::default();
            output.describe(&mut sample);
            prop_assert_eq!(sample.dac_code, output.dac.0);
        }
    }

    #[test]
    fn configurations_are_taken_or_refused(
        numbers in prop::array::uniform28(any::<i32>()),
        filter in prop_oneof![
            any::<u8>().prop_map(FilterChoice::MovingAverage),
            any::<u16>().prop_map(|corner_chz| FilterChoice::LowPass { corner_chz }),
        ],
    ) {
        let n = numbers;
        let wire = UnitConfig {
            scale_pn_per_count: n[0], zero_code: n[1], filter, spike_limit_un: n[2], kp_q16: n[3], ki_q16: n[4],
            kd_q16: n[5], damping_q16: n[6], friction_offset_un: n[7], friction_gain_q16: n[8], coulomb_un: n[9],
            coulomb_load_q16: n[10], reversal_nm: n[11], travel_nm_per_count: n[12], dac_counts_per_n_q16: n[13],
            force_limit_un: n[14], slew_un_per_s: n[15], over_tension_un: n[16], viscous_q16: n[17],
            ripples: [
                Ripple::default(),
                Ripple {
                    periods_per_count_q32: n[18], phase_q32: n[19], amplitude_un: n[20], amplitude_load_q16: n[21],
                },
            ],
            stored_zero_code: n[22], zero_deviation_un: n[23], authority_un: n[24], plausible_un: n[25], tension_max_un: n[26],
            leaky_ki_q16: n[27],
            ..Config::nominal()
        };
        if let Err(e) = Config::from_wire(&wire) {
            prop_assert!(e.got < e.min || e.got > e.max, "{e}");
        }
    }
}

#[test]
fn setpoints_are_checked() {
    let config = Config::from_wire(&Config::nominal()).expect("nominal");
    let check = |tension_un, inv_cos_q16| {
        Setpoint::from_wire(
            &config,
            &UnitSetpoint {
                tension_un,
                inv_cos_q16,
                direction_q14: [0, 0, DIRECTION_ONE],
                reel_um_per_s: None,
            },
        )
        .map(|s| s.tension.to_un())
    };
    assert_eq!(check(2_500_000, 65_536), Ok(2_500_000));
    assert_eq!(check(0, 262_144), Ok(0));
    assert_eq!(check(-1, 65_536), Err(0));
    assert_eq!(check(16_000_001, 65_536), Err(0));
    assert_eq!(check(2_500_000, 65_535), Err(1));
    assert_eq!(check(2_500_000, 262_145), Err(1));
    let sideways = UnitSetpoint {
        tension_un: 2_500_000,
        inv_cos_q16: 65_536,
        direction_q14: [DIRECTION_ONE; 3],
        reel_um_per_s: None,
    };
    assert_eq!(Setpoint::from_wire(&config, &sideways), Err(2));
    let moving = |reel_um_per_s| UnitSetpoint {
        direction_q14: [0; 3],
        reel_um_per_s,
        ..sideways
    };
    for speed in [None, Some(-1_000_000), Some(0), Some(1_000_000)] {
        assert!(
            Setpoint::from_wire(&config, &moving(speed)).is_ok(),
            "{speed:?}"
        );
    }
    for speed in [i32::MIN, -1_000_001, 1_000_001, i32::MAX] {
        assert_eq!(Setpoint::from_wire(&config, &moving(Some(speed))), Err(3));
    }
}
