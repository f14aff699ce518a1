//! Holds `docs/residual/effects.md` against the catalogue: it says what the catalogue offers, in
//! the catalogue's own words.

use crate::rig::simulate;
use residual_columns::frame::Frame;
use residual_columns::stats;
use residual_effects::CATALOGUE;
use residual_fit::problem::Problem;
use residual_log::spec::Spec;
use residual_search::model::{Fit, Fitted, Model};
use residual_search::scan::Scan;
use std::collections::BTreeMap;

const REPORT: &str = include_str!("../../../docs/residual/report-json.md");
const PAGE: &str = include_str!("../../../docs/residual/effects.md");

/// Logs that show everything: motion with stops, loads of both signs, a ripple, a tone, a target in
/// steps, one run long after the other.
fn problem(amplitude: f64) -> Problem {
    let (rows, dt) = (1200, 0.02);
    let n = 2 * rows;
    let time: Vec<f64> = (0..n)
        .map(|i| (i % rows) as f64 * dt + (i / rows) as f64 * 100.0)
        .collect();
    let elapsed: Vec<f64> = (0..n).map(|i| (i % rows) as f64 * dt).collect();
    let of = |f: &dyn Fn(f64) -> f64| elapsed.iter().map(|t| f(*t)).collect::<Vec<f64>>();
    let velocity = of(&|t| {
        if t < 0.3 || (0.7 * t).sin() > 0.8 {
            0.0
        } else {
            amplitude * ((1.3 * t).sin() + 0.4 * (2.9 * t).cos())
        }
    });
    let mut angle = Vec::new();
    let mut at = 0.0;
    for v in &velocity {
        at += 8.0 * v * dt / amplitude;
        angle.push(at);
    }
    let command = of(&|t| 2.0 * (0.9 * t).sin() + (0.31 * t).cos());
    let pose = of(&|t| (0.4 * t).sin());
    let mut rng = stats::Rng::new(1);
    let target: Vec<f64> = (0..n)
        .map(|i| {
            let y = command[i]
                + 0.3 * (5.0 * angle[i]).sin() * (1.0 + command[i])
                + 0.2 * (std::f64::consts::TAU * 7.3 * time[i]).sin()
                + 0.05 * rng.normal();
            (y / 0.01).round() * 0.01
        })
        .collect();
    let columns = vec![
        ("target".to_string(), target),
        ("command".into(), command),
        ("velocity".into(), velocity),
        ("angle".into(), angle),
        ("temperature".into(), of(&|t| 20.0 + (0.2 * t).sin())),
        ("POSE".into(), pose.clone()),
        ("OTHER".into(), of(&|t| (0.23 * t).cos())),
        ("CHANNEL".into(), of(&|t| (1.7 * t).cos())),
    ];
    let frame = Frame::new(columns, time, vec![0..rows, rows..n]);
    let fold: Vec<u32> = (0..n).map(|i| (i / rows) as u32).collect();
    Problem::new(frame, &vec![true; n], &fold, 16, 1)
}

/// Forms on offer for one model: parameters with their units by effect and form, in catalogue
/// order.
fn offered(velocity: &str, terms: &str, out: &mut BTreeMap<(usize, String), Vec<String>>) {
    let spec = Spec::parse(&format!(
        "[roles]\ntime = {{ column = \"t\", unit = \"s\" }}\ntarget = {{ column = \"y\", unit = \"N\" }}\n\
         command = {{ column = \"c\", unit = \"N\" }}\n{velocity}\
         temperature = {{ column = \"T\", unit = \"K\" }}\n\
         pose.POSE = {{ column = \"p\", unit = \"rad\" }}\npose.OTHER = {{ column = \"o\", unit = \"rad\" }}\n\
         channels.CHANNEL = {{ column = \"n\", unit = \"V\" }}\n{terms}"
    ))
    .unwrap();
    let problem = problem(if velocity.contains("m/s") { 1.0 } else { 3.0 });
    let model = Model::declared(&spec).unwrap();
    let fit = Fit::new(&problem, &model).unwrap();
    let fitted = Fitted { model, fit };
    let context = Scan::new(&problem, &spec, "command", &fitted).context();
    for (i, effect) in CATALOGUE.iter().enumerate() {
        for variant in effect.variants(&context) {
            if variant.label.contains("OTHER") {
                continue;
            }
            let psi = variant
                .psi
                .as_ref()
                .map_or(0.0, |p| p.grid[p.grid.len() / 2]);
            let count = variant.pieces(psi);
            let known = out.entry((i, variant.label.clone())).or_default();
            for p in variant.params(psi, &vec![1.0; count]) {
                let text = format!("`{}` {}", p.name, p.unit);
                if !p.name.contains("OTHER") && !known.contains(&text) {
                    known.push(text);
                }
            }
        }
    }
}

#[test]
fn the_page_names_every_effect_form_and_parameter_and_no_other() {
    let rotating = "velocity = { column = \"v\", unit = \"rad/s\", deadband = 0.01 }\n\
                    angle = { column = \"a\", unit = \"rad\" }\n";
    let straight = "velocity = { column = \"v\", unit = \"m/s\", deadband = 0.01 }\n";
    let term =
        |expr: &str| format!("[[terms]]\nname = \"{expr}\"\nexpr = \"{expr}\"\nfixed = 1.0\n");
    let mut forms = BTreeMap::new();
    offered(rotating, &term("command"), &mut forms);
    // With friction declared, with the angle in the model, and without the command in it.
    offered(
        rotating,
        &(term("command") + &term("sgn(velocity, 0.01)")),
        &mut forms,
    );
    offered(rotating, &(term("command") + &term("angle")), &mut forms);
    offered(rotating, &term("POSE"), &mut forms);
    // Only what a straight motion adds: the units of all else are those of the turning one.
    let mut more = BTreeMap::new();
    offered(straight, &term("command"), &mut more);
    for (form, parameters) in more {
        forms.entry(form).or_insert(parameters);
    }
    let mut expected: Vec<String> = CATALOGUE
        .iter()
        .map(|e| {
            format!(
                "| `{}` | {} | {} |",
                e.name(),
                e.kind().meaning(),
                e.kind().experiment()
            )
        })
        .collect();
    for (i, effect) in CATALOGUE.iter().enumerate() {
        let own: Vec<_> = forms.iter().filter(|((k, _), _)| *k == i).collect();
        assert!(
            !own.is_empty(),
            "these logs offer nothing for {}",
            effect.name()
        );
        for ((_, label), parameters) in own {
            expected.push(format!(
                "| `{}` | {label} | {} |",
                effect.name(),
                parameters.join(", ")
            ));
        }
    }
    let page: Vec<&str> = PAGE.lines().filter(|l| l.starts_with("| `")).collect();
    assert!(
        page == expected,
        "the rows of docs/residual/effects.md that start with an effect should be\n{}",
        expected.join("\n")
    );
}

/// A tone with a phase for each run has no phase, and no interval.
#[test]
fn the_page_says_which_effects_have_no_interval() {
    let report = simulate(&Default::default(), 1.0, &mut |s| {
        0.3 * (std::f64::consts::TAU * 3.7 * s.elapsed + f64::from(s.group)).sin()
    });
    let effect = &report.effects[0];
    assert_eq!(effect.form, "a phase for each run");
    assert!(effect.ci.is_empty() && !effect.params.contains_key("phase"));
    let row = REPORT
        .lines()
        .find(|l| l.starts_with("| `effects[].ci.NAME`"));
    assert!(row.is_some_and(|l| l.contains(&effect.form)), "{row:?}");
}
