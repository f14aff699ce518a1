//! A report with something in every field, for the tests of the writers.

use super::*;
use residual_effects::{EffectKind, Form};
use residual_evidence::attribution::EqualPath;
use residual_evidence::by_log::LogError;
use residual_evidence::check::Check;
use residual_fit::diagnostics::ResidualTest;
use residual_log::finding::Finding;
use residual_log::spec::Spec;

const MODEL: &str = r#"
title = "Example"
[roles]
time = { column = "t", unit = "s" }
target = { column = "y", unit = "N" }
velocity = { column = "v", unit = "rad/s", scale = 0.1 }
[selection]
seed = 9007199254740993
[[terms]]
name = "offset"
expr = "1"
fitted = 0.30000000000000004
"#;

fn figures(rmse: f64) -> Figures {
    Figures {
        heldout_rmse: rmse,
        heldout_rmse_ci: [0.9 * rmse, 1.1 * rmse],
        heldout_mae: 0.8 * rmse,
        heldout_mae_ci: [0.7 * rmse, 0.9 * rmse],
        insample_rmse: 0.99 * rmse,
    }
}

fn test(model: &str, against: &str) -> ModelTest {
    ModelTest {
        model: model.into(),
        test: ResidualTest {
            against: against.into(),
            lag: -3,
            correlation: 0.1 / 3.0,
            p: 1e-300,
        },
    }
}

/// The report.
pub(super) fn report() -> Report {
    let x: Vec<f64> = (0..50).map(|i| f64::from(i) / 7.0).collect();
    let plot = Plot::new("integ(velocity)", &x, &x, &x).named("residual", WITHOUT, "with it");
    let one = |value: f64| [("friction".to_string(), value)].into();
    Report {
        schema_version: SCHEMA_VERSION,
        title: "Example".into(),
        unit: "N".into(),
        files: vec!["a.csv".into(), "b.csv".into()],
        rows: 100,
        sequences: 2,
        groups: 2,
        folds: vec!["a.csv".into(), "b.csv".into()],
        baseline: figures(1.0 / 3.0),
        last: figures(0.1),
        nested_rmse: Some(0.12),
        verdict: Verdict::NotIdentifiable,
        effects: vec![Effect {
            name: EffectKind::Coulomb,
            form: "constant".into(),
            form_kind: Form::default(),
            meaning: "friction".into(),
            terms: vec!["sgn(velocity, 0)".into()],
            params: one(-0.1 - 0.2),
            units: [("friction".to_string(), "N".to_string())].into(),
            ci: [("friction".to_string(), [-0.4, -0.2])].into(),
            at_limit: vec!["friction".into()],
            heldout_before: 1.0 / 3.0,
            heldout_after: 0.1,
            heldout_without: 1.0 / 3.0,
            unsupported: String::new(),
            rival: Some(Rival {
                name: EffectKind::Viscous,
                heldout_rmse: 0.11,
                behind: 0.1,
            }),
            plot: plot.clone(),
        }],
        improves: vec![],
        with_all: Some(figures(0.09)),
        limited: Some(EffectKind::Tone),
        check: Some(Check {
            files: vec!["c.csv".into()],
            rows: 50,
            repeated_rows: 20,
            declared_rmse: 0.34,
            found_rmse: 0.12,
            all_rmse: 0.12,
        }),
        not_identifiable: vec![Ambiguity::new(
            vec![EffectKind::Coulomb, EffectKind::Viscous],
            "other speeds",
        )],
        equal_paths: vec![EqualPath {
            effects: vec![EffectKind::Coulomb],
            instead: vec![EffectKind::Hysteresis, EffectKind::Gain],
            heldout_rmse: 0.1,
        }],
        paths_not_judged: 2,
        by_log: vec![LogError {
            file: "a.csv".into(),
            rows: 50,
            declared_rmse: 0.4,
            final_rmse: 0.1 / 3.0,
        }],
        structure: vec![Structure::new("a curve in velocity", 0.021, 3e-5)],
        seen_not_material: vec![NotMaterial {
            name: EffectKind::Gain,
            form: "of load".into(),
            gain: 0.01,
            params: one(1.5),
        }],
        tested: vec![Tested {
            name: EffectKind::Gain,
            form: "of load".into(),
            gain: -0.01,
            p_value: 0.5,
            t_statistic: -1.25,
            params: one(1.5),
        }],
        absent: vec![EffectKind::DriftTemperature],
        hygiene: vec![Finding {
            check: "gap".into(),
            count: 2,
            first: "a.csv".into(),
            what: "gaps in time".into(),
        }],
        residual_tests: vec![test("before", "itself"), test("after", "velocity")],
        declared: vec![DeclaredTerm {
            name: "offset".into(),
            coefficient: 0.1 + 0.2,
            unit: "N".into(),
            fixed: false,
            per_sequence: true,
        }],
        extended: Spec::parse(MODEL).expect("a good model"),
        plot_unknown: Some(plot),
    }
}
