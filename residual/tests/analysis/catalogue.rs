//! Tests of the whole analysis on the simulated rig: what was put in must be named, and nothing
//! else.

use crate::rig::{names_with, rows_of, simulate, Excitation, Row};
use residual::Verdict;
use residual::{Ambiguity, Report};
use residual_effects::EffectKind;

/// Effects for the table, each as (name, excitation, function).
type Case = (
    &'static str,
    Excitation,
    fn() -> Box<dyn FnMut(&Row) -> f64>,
);

fn cases() -> Vec<Case> {
    let usual = Excitation::default;
    vec![
        ("offset", usual(), || Box::new(|_| 1.0)),
        ("gain", usual(), || Box::new(|s| s.command)),
        ("quadratic", usual(), || Box::new(|s| s.command * s.command)),
        ("coulomb", usual(), || Box::new(|s| -s.velocity.signum())),
        ("load_dependent_coulomb", usual(), || {
            Box::new(|s| -s.command * s.velocity.signum())
        }),
        ("viscous", usual(), || Box::new(|s| -s.velocity)),
        ("stribeck", usual(), || {
            Box::new(|s| -s.velocity.signum() * (0.3 + (-(s.velocity / 0.3).powi(2)).exp()))
        }),
        ("periodic_angle", usual(), || {
            Box::new(|s| (3.7 * s.angle + 0.4).sin())
        }),
        ("inertia", usual(), || Box::new(|s| s.acceleration)),
        ("drift_time", usual(), || Box::new(|s| s.elapsed)),
        ("drift_temperature", usual(), || {
            Box::new(|s| s.temperature - 25.0)
        }),
        ("crosstalk", usual(), || Box::new(|s| s.neighbour)),
        ("tone", usual(), || {
            Box::new(|s| (std::f64::consts::TAU * 4.3 * s.elapsed + f64::from(s.group)).sin())
        }),
        ("geometry", usual(), || Box::new(|s| s.command * s.pose)),
        ("gravity_angle", usual(), || {
            Box::new(|s| (s.pose + 0.7).sin())
        }),
        (
            "presliding",
            Excitation {
                declare_coulomb: true,
                stops: true,
                ..usual()
            },
            || {
                let mut last = 0.0;
                Box::new(move |s| {
                    if s.first {
                        last = 0.0;
                    }
                    if s.velocity != 0.0 {
                        last = s.velocity.signum();
                        0.0
                    } else {
                        -last
                    }
                })
            },
        ),
        ("hysteresis", usual(), || {
            let (mut z, mut last) = (0.0, 0.0);
            Box::new(move |s| {
                if s.first {
                    (z, last) = (0.0, s.command);
                }
                let dx: f64 = s.command - last;
                last = s.command;
                let g = dx.signum();
                z = g + (z - g) * (-dx.abs() / 0.8).exp();
                z
            })
        }),
        ("creep", usual(), || {
            let mut z = 0.0;
            Box::new(move |s| {
                if s.first {
                    z = 0.0;
                }
                z += (s.command - z) * (1.0 - (-s.dt / 6.0f64).exp());
                z
            })
        }),
    ]
}

/// Names found for one case at an RMS of `strength` times the noise.
fn attempt(case: &Case, strength: f64, seed: u64) -> Report {
    let x = Excitation {
        seed,
        ..case.1.clone()
    };
    // The RMS of the raw effect is measured first, on the same rows.
    let (mut sum, mut n) = (0.0, 0.0);
    let mut f = (case.2)();
    let mut probe = |s: &Row| {
        let v = f(s);
        sum += v * v;
        n += 1.0;
        v
    };
    rows_of(&x, &mut |row| {
        probe(row);
    });
    let scale = strength * x.noise / f64::sqrt(sum / n);
    simulate(&x, scale, &mut *(case.2)())
}

/// Seeds of each statistical test: `RESIDUAL_SEEDS`, else `usual`.
fn seeds(usual: u64) -> u64 {
    std::env::var("RESIDUAL_SEEDS")
        .ok()
        .and_then(|s| s.parse().ok())
        .unwrap_or(usual)
}

/// The table of what was injected and what was named, at the noise and at 0.3 of it.
#[test]
fn effects_are_named_at_the_noise_and_below() {
    use rayon::prelude::*;
    let seeds = seeds(1);
    for (strength, floor) in [(1.0, 0.9), (0.3, 0.7)] {
        let rows: Vec<(usize, Vec<String>)> = cases()
            .par_iter()
            .map(|case| {
                let got: Vec<String> = (0..seeds)
                    .into_par_iter()
                    .map(|s| {
                        let r = attempt(case, strength, 10 + s);
                        let names: Vec<&str> = r.effects.iter().map(|e| e.name.as_str()).collect();
                        format!("{}:{}", r.verdict.word(), names.join("+"))
                    })
                    .collect();
                let right = got
                    .iter()
                    .filter(|g| {
                        g.split(':')
                            .nth(1)
                            .is_some_and(|n| n.split('+').next() == Some(case.0))
                    })
                    .count();
                (right, got)
            })
            .collect();
        let (mut right, mut all) = (0, 0);
        for (case, (r, got)) in cases().iter().zip(&rows) {
            println!("{strength} {:24} {r}/{seeds} {}", case.0, got.join(" "));
            right += r;
            all += got.len();
        }
        println!("{strength}: {right} of {all} named right first");
        assert!(
            right as f64 >= floor * all as f64,
            "{right} of {all} at {strength}"
        );
    }
}

#[test]
fn nothing_is_found_in_noise() {
    for seed in 0..seeds(4) {
        let report = simulate(
            &Excitation {
                seed,
                slow: 0.6,
                ..Excitation::default()
            },
            0.0,
            &mut |_| 0.0,
        );
        assert_eq!(
            report.verdict,
            Verdict::None,
            "seed {seed}: {}",
            report.markdown()
        );
    }
}

#[test]
fn what_has_no_name_is_called_unknown() {
    let report = simulate(&Excitation::default(), 1.0, &mut |s| {
        0.25 * (2.5 * s.neighbour).sin() * (1.5 * s.velocity).cos()
    });
    assert_eq!(report.verdict, Verdict::Unknown, "{}", report.markdown());
    assert!(
        !report.markdown().contains("## Effect "),
        "what stands in is no effect found: {}",
        report.markdown()
    );
}

/// Names found, in alphabetical order.
fn found(report: &Report) -> Vec<&str> {
    let mut names: Vec<&str> = report.effects.iter().map(|e| e.name.as_str()).collect();
    names.sort_unstable();
    names
}

#[test]
fn two_effects_are_both_named() {
    let report = simulate(&Excitation::default(), 1.0, &mut |s| {
        -0.2 * s.velocity.signum() + 0.2 * s.neighbour
    });
    assert_eq!(report.verdict, Verdict::Several, "{}", report.markdown());
    assert_eq!(
        found(&report),
        ["coulomb", "crosstalk"],
        "{}",
        report.markdown()
    );
}

#[test]
fn a_delay_far_below_a_row_cannot_be_distinguished_from_a_lag() {
    let report = simulate(&Excitation::default(), 1.0, &mut |s| {
        s.command_at(s.elapsed - 0.012) - s.command
    });
    assert_eq!(
        report.verdict,
        Verdict::NotIdentifiable,
        "{}",
        report.markdown()
    );
    let first = &report.not_identifiable[0];
    for name in ["delay", "cable_stretch"] {
        assert!(first.effects.iter().any(|e| e == name), "{first:?}");
        assert!(first.experiment.contains(&format!("{name}: ")), "{first:?}");
    }
    // Both show in proportion to the slope of the load; the picture is against that, in words.
    let page = report.html();
    assert!(
        page.contains(">rate of change of load, N/s</text>"),
        "{page}"
    );
    assert!(page.contains("<h2>Effect 1: "), "{page}");
}

/// Kinds that cannot be distinguished; empty where one effect is certain.
fn group(mut effect: impl FnMut(&Row) -> f64) -> Vec<&'static str> {
    let report = simulate(&Excitation::default(), 1.0, &mut effect);
    let groups = report.not_identifiable.iter();
    let kinds = groups.flat_map(|group| &group.effects);
    kinds.map(|kind| kind.as_str()).collect()
}

#[test]
fn a_small_gain_may_be_a_curve_or_a_span_drift() {
    let may_be = ["gain", "quadratic", "drift_temperature"];
    assert_eq!(group(|s| 0.0016 * (s.command + 2.0) * s.command), may_be);
    assert!(group(|s| 0.02 * s.command).is_empty());
}

/// The search may keep a constant and a share where a share alone explains nearly as much, and a
/// constant alone as well.
#[test]
fn friction_with_a_constant_part_and_a_share_has_no_other_law() {
    assert!(group(|s| 0.2 - (0.92 + 0.153 * s.command) * s.velocity.signum()).is_empty());
}

#[test]
fn small_friction_that_grows_with_the_load_may_have_another_law() {
    let may_be = ["load_dependent_coulomb", "coulomb", "stribeck"];
    assert_eq!(group(|s| -0.0167 * s.command * s.velocity.signum()), may_be);
    assert!(group(|s| -0.05 * s.command * s.velocity.signum()).is_empty());
}

#[test]
fn what_the_setpoint_confirms_is_named_in_a_closed_loop() {
    let x = Excitation {
        closed: true,
        ..Excitation::default()
    };
    names_with("gain", x.clone(), |s| 0.1 * s.command);
    names_with("coulomb", x, |s| -0.3 * s.velocity.signum());
}

#[test]
fn a_disturbance_that_the_loop_compensates_is_no_effect_of_the_command() {
    let x = Excitation {
        closed: true,
        ..Excitation::default()
    };
    let report = simulate(&x, 1.0, &mut |s| {
        let g = f64::from(s.group);
        0.4 * ((0.9 + 0.17 * g) * s.elapsed + g).sin() + 0.3 * ((0.4 + 0.11 * g) * s.elapsed).sin()
    });
    assert!(
        !matches!(report.verdict, Verdict::Effect | Verdict::Several),
        "{}",
        report.markdown()
    );
}

/// Everything in a report that is for readers only, replaced.
fn reworded(report: &Report) -> Report {
    let mut out = report.clone();
    out.title = "x".into();
    for (i, e) in out.effects.iter_mut().enumerate() {
        e.form = format!("form {i} load lag of the command");
        e.meaning = "meaning".into();
        e.terms.iter_mut().for_each(|t| *t = "term".into());
        e.units.values_mut().for_each(|u| *u = "unit".into());
    }
    for a in &mut out.not_identifiable {
        a.experiment = "experiment".into();
    }
    for s in &mut out.structure {
        s.depends_on = "variable".into();
    }
    for t in &mut out.tested {
        t.form = "form".into();
    }
    out
}

#[test]
fn a_doubtful_effect_is_not_compensated_beside_a_clear_one() {
    let mut report = simulate(&Excitation::default(), 1.0, &mut |s| {
        -0.2 * s.velocity.signum() + 0.1 * s.command
    });
    assert_eq!(report.verdict, Verdict::Several, "{}", report.markdown());
    let left_out = |report: &Report| report.compensation().expect("friction").left_out;
    assert!(left_out(&report).is_empty());
    let rivals = vec![EffectKind::Gain, EffectKind::Quadratic];
    report.not_identifiable = vec![Ambiguity::new(rivals, "")];
    assert_eq!(left_out(&report), ["gain"]);
}

#[test]
fn no_board_setting_depends_on_the_words_of_a_report() {
    let mut lag = 0.0;
    let late = simulate(&Excitation::default(), 1.0, &mut |s| {
        if s.first {
            lag = s.command;
        }
        lag += (s.command - lag) * (1.0 - (-s.dt / 0.15f64).exp());
        lag - s.command
    });
    let ripple = |of_load: bool| {
        simulate(&Excitation::default(), 1.0, &mut |s| {
            let size = if of_load { 0.2 * s.command } else { 0.4 };
            size * (3.0 * s.angle + 0.4).sin() - 0.3 * s.velocity.signum()
        })
    };
    let of = |report: &Report| report.compensation().expect("a setting");
    let (plain, loaded) = (ripple(false), ripple(true));
    assert!(of(&late).delay_s > 0.1);
    assert!(!of(&plain).ripples[0].of_load && of(&plain).friction < -0.2);
    assert!(of(&loaded).ripples[0].of_load);
    for report in [late, plain, loaded] {
        assert_eq!(reworded(&report).compensation(), report.compensation());
    }
}
