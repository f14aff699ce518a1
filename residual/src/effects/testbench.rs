//! A small rig for the tests of the catalogue: eight runs of 40 s at 50 rows a second, smooth random
//! motion, a command that wanders and steps, coloured and white noise.

use crate::analysis::analyse;
use crate::data::Data;
use crate::report::{Report, Verdict};
use crate::spec::Spec;
use crate::stats::Rng;

/// One row of the simulated rig, before the target is formed.
pub(crate) struct Row<'a> {
    pub first: bool,
    pub group: u32,
    pub dt: f64,
    pub elapsed: f64,
    pub command: f64,
    pub velocity: f64,
    pub acceleration: f64,
    pub angle: f64,
    pub pose: f64,
    pub temperature: f64,
    pub neighbour: f64,
    wander: &'a [(f64, f64, f64)],
}

impl Row<'_> {
    /// The command at another time of the run.
    pub fn command_at(&self, t: f64) -> f64 {
        command(self.wander, t)
    }
}

fn command(w: &[(f64, f64, f64)], t: f64) -> f64 {
    3.0 + w.iter().map(|(a, f, p)| a * (f * t + p).sin()).sum::<f64>()
}

/// What differs from the usual run.
#[derive(Clone)]
pub(crate) struct Excitation {
    pub declare_coulomb: bool,
    pub stops: bool,
    pub metres: bool,
    /// Whether a controller on the measured target drives the command, with the setpoint logged.
    pub closed: bool,
    pub seed: u64,
    /// RMS of the noise.
    pub noise: f64,
    /// Share of the noise's variance that is slow.
    pub slow: f64,
}

impl Default for Excitation {
    fn default() -> Self {
        Excitation {
            declare_coulomb: false,
            stops: false,
            metres: false,
            closed: false,
            seed: 1,
            noise: 0.1,
            slow: 0.3,
        }
    }
}

/// Shape of the simulated data: groups, rows in each, step in s.
const SHAPE: (u32, usize, f64) = (8, 2000, 0.02);

/// Runs `visit` over the rows of every group.
fn rows_of(x: &Excitation, visit: &mut dyn FnMut(&Row)) {
    let (groups, rows, dt) = SHAPE;
    let mut rng = Rng::new(x.seed);
    for group in 0..groups {
        let mut draw = |n: usize, a: f64, lo: f64, hi: f64| -> Vec<(f64, f64, f64)> {
            (0..n)
                .map(|_| {
                    (
                        a * (0.5 + rng.uniform()),
                        lo * (hi / lo).powf(rng.uniform()),
                        rng.uniform() * 6.3,
                    )
                })
                .collect()
        };
        let wander = draw(5, 0.45, 0.3, 9.0);
        let motion = draw(4, 0.5, 0.5, 5.0);
        let poses = draw(2, 0.25, 0.1, 0.8);
        let other = draw(4, 0.6, 0.2, 6.0);
        let warm = draw(2, 1.5, 0.03, 0.2);
        let mut angle = 0.0;
        for i in 0..rows {
            let t = i as f64 * dt;
            let mut v: f64 = motion.iter().map(|(a, f, p)| a * (f * t + p).sin()).sum();
            let acceleration: f64 = motion
                .iter()
                .map(|(a, f, p)| a * f * (f * t + p).cos())
                .sum();
            if x.stops && (t * 0.7 + f64::from(group)).sin() > 0.3 {
                v = 0.0;
            }
            angle += 6.0 * v * dt;
            visit(&Row {
                first: i == 0,
                group,
                dt,
                elapsed: t,
                command: command(&wander, t),
                velocity: v,
                acceleration,
                angle,
                pose: poses.iter().map(|(a, f, p)| a * (f * t + p).sin()).sum(),
                temperature: 25.0
                    + warm
                        .iter()
                        .map(|(a, f, p)| a * (f * t + p).sin())
                        .sum::<f64>(),
                neighbour: other.iter().map(|(a, f, p)| a * (f * t + p).sin()).sum(),
                wander: &wander,
            });
        }
    }
}

/// Simulates with `effect` added to the declared model, scaled by `scale`.
pub(crate) fn simulate(x: &Excitation, scale: f64, effect: &mut dyn FnMut(&Row) -> f64) -> Report {
    let (groups, rows, _) = SHAPE;
    let mut rng = Rng::new(x.seed ^ 0x0d15_ea5e);
    let names = [
        "setpoint",
        "command",
        "velocity",
        "angle",
        "pose_a",
        "temperature",
        "neighbour",
        "target",
    ];
    let mut cols: Vec<Vec<f64>> = names.iter().map(|_| vec![]).collect();
    let mut time = vec![];
    let white = x.noise * (1.0 - x.slow).sqrt();
    let rho = 0.98f64;
    let mut slow = 0.0;
    let (mut integral, mut correction) = (0.0, 0.0);
    rows_of(x, &mut |row| {
        if row.first {
            slow = 0.0;
            (integral, correction) = (0.0, 0.0);
        }
        let setpoint = row.command;
        let row = &Row {
            command: setpoint + correction,
            ..*row
        };
        slow = rho * slow + (1.0 - rho * rho).sqrt() * rng.normal();
        let v = row.velocity;
        let friction = if x.declare_coulomb && v != 0.0 {
            -0.6 * v.signum()
        } else {
            0.0
        };
        let y = row.command
            + friction
            + scale * effect(row)
            + white * rng.normal()
            + x.noise * x.slow.sqrt() * slow;
        if x.closed {
            let error: f64 = setpoint - y;
            integral += 3.0 * error * row.dt;
            correction = 0.2 * error + integral;
        }
        let values = [
            setpoint,
            row.command,
            v,
            row.angle,
            row.pose,
            row.temperature,
            row.neighbour,
            y,
        ];
        cols.iter_mut().zip(values).for_each(|(c, v)| c.push(v));
        time.push(row.elapsed);
    });
    let sequences = (0..groups as usize).map(|g| g * rows..(g + 1) * rows);
    let data = Data::from_columns(time, names.iter().copied().zip(cols))
        .sequences(sequences)
        .build()
        .expect("the simulated columns are valid");
    let unit = if x.metres { "m/s" } else { "rad/s" };
    let friction = if x.declare_coulomb {
        "[[terms]]\nname = \"f\"\nexpr = \"sign(velocity)\"\n"
    } else {
        ""
    };
    let setpoint = if x.closed {
        "setpoint = { column = \"s\", unit = \"N\" }\n"
    } else {
        ""
    };
    let angle = if x.metres {
        ""
    } else {
        "angle = { column = \"angle\", unit = \"rad\" }\n"
    };
    let spec = Spec::parse(&format!(
        "[roles]\ntime = {{ column = \"t\" }}\ntarget = {{ column = \"y\", unit = \"N\" }}\n\
         command = {{ column = \"c\", unit = \"N\" }}\nvelocity = {{ column = \"v\", unit = \"{unit}\" }}\n{angle}{setpoint}\
         temperature = {{ column = \"T\", unit = \"K\" }}\npose.pose_a = {{ column = \"p\", unit = \"rad\" }}\n\
         channels.neighbour = {{ column = \"n\", unit = \"N\" }}\n\
         [[terms]]\nname = \"tension\"\nexpr = \"command\"\nfixed = 1.0\n{friction}"
    ))
    .expect("the test model is valid");
    analyse(&spec, data, &mut ()).expect("the analysis runs")
}

/// The effect must be named first, and bring the error down to the noise.
pub(crate) fn names(effect: &str, f: impl FnMut(&Row) -> f64) {
    names_with(effect, Excitation::default(), f);
}

/// As [`names`], with another excitation.
pub(crate) fn names_with(effect: &str, x: Excitation, mut f: impl FnMut(&Row) -> f64) {
    let report = simulate(&x, 1.0, &mut f);
    let found: Vec<&str> = report.effects.iter().map(|e| e.name.as_str()).collect();
    assert_eq!(
        found.first().copied(),
        Some(effect),
        "{}\n{}",
        report.summary(),
        report.markdown()
    );
    assert!(
        matches!(report.verdict, Verdict::Effect | Verdict::Several),
        "{}",
        report.markdown()
    );
    assert!(
        report.last.heldout_rmse < 1.12 * x.noise,
        "{}",
        report.markdown()
    );
}

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
fn a_delay_far_below_a_row_cannot_be_told_from_a_lag() {
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
fn a_disturbance_that_the_loop_fights_is_no_effect_of_the_command() {
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
