//! Corrections on the built-in rig.

use super::*;
use residual::Ripple;
use rig::Rig;

fn frame() -> Frame {
    Frame {
        increment: true,
        gain_of_drive: true,
        velocity_m_per_s: Some(1.0),
        travel_m_per_rad: Some(0.010),
    }
}

fn rig() -> Rig {
    Rig::built_in().expect("the built-in rig is good")
}

fn ripple(order: f64, amplitude: f64, phase: f64, of_load: bool) -> Ripple {
    Ripple {
        order,
        amplitude,
        phase,
        of_load,
    }
}

/// Force of a unit by its settings, as the board's documentation has it.
fn force(u: &UnitSettings, dac: f64, speed: f64, travel: f64) -> f64 {
    let command = dac / u.dac_codes_per_n;
    let ripples: f64 = u
        .ripples
        .iter()
        .filter(|r| !r.is_none())
        .map(|r| r.amplitude_n * (TAU * travel / r.period_m + r.phase_rad).sin())
        .sum();
    u.friction_offset_n + u.friction_gain * command
        - speed.signum() * (u.coulomb_n + u.coulomb_per_n * command)
        - u.viscous_n_s_per_m * speed
        + ripples
}

#[test]
fn new_settings_say_what_old_ones_and_findings_said() {
    let old = rig().units[0];
    let compensation = Compensation {
        friction: -0.4,
        friction_per_load: -0.05,
        viscous: -12.0,
        gain_error: -0.2,
        offset: 0.1,
        ripples: vec![ripple(26.0 / 7.0, 0.5, 1.2, false)],
        ..Compensation::default()
    };
    let new = correct(&old, &compensation, &frame());
    assert!(new.not_used.is_empty(), "{new:?}");
    for (dac, speed, travel) in [
        (600.0, 0.02, 0.01),
        (1500.0, -0.01, -0.02),
        (1000.0, 0.001, 0.5),
    ] {
        let command = dac / old.dac_codes_per_n;
        let sign = f64::signum(speed);
        let load = (old.friction_gain - old.coulomb_per_n * sign) * command;
        let found = compensation.offset
            + compensation.gain_error * load
            + sign * (compensation.friction + compensation.friction_per_load * load)
            + compensation.viscous * speed
            + 0.5 * f64::sin(26.0 / 7.0 * travel / 0.010 + 1.2);
        let expected = force(&old, dac, speed, travel) + found;
        let made = force(&new.unit, dac, speed, travel);
        // Rounded to four digits.
        assert!((made - expected).abs() < 2e-3, "{made} {expected}");
    }
}

/// A second `identify` on the result of the first finds what is left, and takes nothing away by
/// itself.
#[test]
fn what_was_not_found_is_not_changed() {
    let old = rig().units[0];
    let per_load = Compensation {
        friction_per_load: -0.05,
        ..Compensation::default()
    };
    for compensation in [Compensation::default(), per_load] {
        let new = correct(&old, &compensation, &frame());
        assert_eq!(new.unit.coulomb_n, old.coulomb_n, "{compensation:?}");
    }
}

#[test]
fn corrections_are_bounded_and_all_or_nothing() {
    let old = rig().units[0];
    let refused = [
        Compensation {
            friction: -2.5,
            ..Compensation::default()
        },
        Compensation {
            friction: 2.0,
            ..Compensation::default()
        },
        Compensation {
            gain_error: -0.6,
            ..Compensation::default()
        },
        Compensation {
            gain_error: f64::NAN,
            ..Compensation::default()
        },
        Compensation {
            friction_per_load: -0.3,
            ..Compensation::default()
        },
        Compensation {
            offset: f64::INFINITY,
            ..Compensation::default()
        },
        Compensation {
            viscous: -150.0,
            ..Compensation::default()
        },
        Compensation {
            delay_s: 0.05,
            ..Compensation::default()
        },
        Compensation {
            ripples: vec![ripple(1e4, 0.5, 0.0, false)],
            ..Compensation::default()
        },
        Compensation {
            ripples: vec![ripple(1.0, 2.5, 0.0, false)],
            ..Compensation::default()
        },
        Compensation {
            ripples: (1..4)
                .map(|n| ripple(f64::from(n), 0.1, 0.0, false))
                .collect(),
            ..Compensation::default()
        },
    ];
    for mut compensation in refused {
        // A good finding beside the bad one is not used either.
        compensation.left_out = vec!["creep".into()];
        if compensation.offset == 0.0 {
            compensation.offset = 0.1;
        }
        let new = correct(&old, &compensation, &frame());
        assert_eq!(new.unit, old, "{compensation:?}");
        assert!(
            new.not_used.iter().any(|why| why.starts_with("all of it")),
            "{new:?}"
        );
        assert!(new.not_used.iter().any(|why| why.contains("creep")));
    }
}

#[test]
fn a_delay_brings_gains_down_once() {
    let old = rig().units[0];
    let compensation = |delay_s| Compensation {
        delay_s,
        ..Compensation::default()
    };
    let short = correct(&old, &compensation(0.001), &frame());
    assert_eq!(short.unit, old);
    assert!(short.not_used[0].contains("1.0 ms"));
    let mut last = old;
    for ms in [2.0, 4.0, 8.0, 30.0] {
        let new = correct(&old, &compensation(ms * 1e-3), &frame()).unit;
        assert!(new.kp < last.kp || last.kp == 0.0, "{ms} ms: {}", new.kp);
        assert!(new.ki_per_s <= last.ki_per_s && new.ki_per_s >= 10.0);
        assert!(new.damping_n_s_per_m <= last.damping_n_s_per_m);
        // The delay is still there the next time; the gains allow for it by then.
        assert_eq!(correct(&new, &compensation(ms * 1e-3), &frame()).unit, new);
        last = new;
    }
    assert_eq!((last.kp, last.damping_n_s_per_m), (0.0, 0.0));
}

#[test]
fn without_a_delay_no_setting_is_touched() {
    let mut unit = rig().units[0];
    unit.dac_codes_per_n = 277.477_123_4;
    for delay_s in [0.0, NEGLIGIBLE_DELAY_S, 2.0 * MAX_DELAY_S] {
        assert_eq!(slowed(&unit, delay_s), unit);
    }
    assert!(slowed(&unit, 0.0045).kp < unit.kp);
}

#[test]
fn ripples_of_one_period_add_up_and_others_take_the_next_place() {
    let compensation = |ripples| Compensation {
        ripples,
        ..Compensation::default()
    };
    let old = rig().units[0];
    let one = correct(
        &old,
        &compensation(vec![ripple(3.7, 0.4, 0.5, false)]),
        &frame(),
    )
    .unit;
    // The same again with its sign turned: gone.
    let half_turn = 0.5 + std::f64::consts::PI;
    let none = correct(
        &one,
        &compensation(vec![ripple(3.71, 0.4, half_turn, false)]),
        &frame(),
    )
    .unit;
    assert!(none.ripples[0].amplitude_n < 1e-3, "{none:?}");
    let two = correct(
        &one,
        &compensation(vec![ripple(1.0, 0.03, 0.0, true)]),
        &frame(),
    )
    .unit;
    assert_eq!(two.ripples[0], one.ripples[0]);
    assert!((two.ripples[1].amplitude_per_n - 0.03).abs() < 1e-9);
    assert!((two.ripples[1].period_m - 0.0628319).abs() < 1e-6);
    // Without the board's own angle a ripple has no phase.
    let foreign = Frame {
        travel_m_per_rad: None,
        ..frame()
    };
    let new = correct(
        &old,
        &compensation(vec![ripple(3.7, 0.4, 0.5, false)]),
        &foreign,
    );
    assert_eq!(new.unit, old);
    assert!(new.not_used[0].contains("phase"));
}
