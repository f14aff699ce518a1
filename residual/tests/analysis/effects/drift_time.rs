//! Drift along the run.

use crate::rig::knowing;
use residual_effects::Form;
use residual_effects::*;

/// A motor whose speed is lowered step by step: damping falls with time as a drift would.
#[test]
fn a_speed_that_falls_with_time_is_no_drift() {
    let rows = 1200;
    let refused = |speed: &dyn Fn(usize) -> f64| {
        let velocity: Vec<f64> = (0..rows).map(speed).collect();
        let spec = "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\" }\n\
                    velocity = { column = \"v\", unit = \"rad/s\" }\n[[terms]]\nname = \"a\"\nexpr = \"1\"\n";
        let columns = [("target", velocity.clone()), ("velocity", velocity)];
        let mut out = false;
        knowing(spec, &columns, rows, |ctx| {
            let estimate = Estimate {
                form: Form::Other,
                label: "since the start of the run",
                params: &[],
                intervals: &Default::default(),
            };
            out = effect(EffectKind::DriftTime)
                .impossible(&estimate, ctx)
                .is_some();
        });
        out
    };
    assert!(refused(&|i| 10.0 - (i / 100) as f64));
    assert!(!refused(&|i| (0.05 * i as f64).sin()));
}

#[test]
fn is_named() {
    crate::rig::names("drift_time", |s| 0.01 * s.elapsed);
}
