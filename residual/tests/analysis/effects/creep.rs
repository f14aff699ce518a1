//! Creep: a slow part of the response of sensor or cable to a load.

use crate::rig::knowing;
use residual::{Form, Param};
use residual_effects::*;

#[test]
fn is_refused_where_it_may_be_as_fast_as_a_gain() {
    let refused = |interval: [f64; 2]| {
        let time_constant = Param::new("time_constant", 6.0, "s");
        let estimate = Estimate {
            form: Form::Other,
            label: "",
            params: &[time_constant],
            intervals: &[("time_constant".to_string(), interval)].into(),
        };
        let spec =
            "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\", unit = \"N\" }\n\
             [[terms]]\nname = \"y\"\nexpr = \"1\"\n";
        let mut out = false;
        let column = (0..2000).map(|i| (0.1 * i as f64).sin()).collect();
        knowing(spec, &[("target", column)], 1000, |ctx| {
            out = effect(EffectKind::Creep)
                .impossible(&estimate, ctx)
                .is_some()
        });
        out
    };
    // 15 rows of 0.02 s are 0.3 s.
    assert!(!refused([0.4, 18.0]));
    assert!(refused([0.0, 18.0]));
}

#[test]
fn is_named() {
    let mut z = 0.0;
    crate::rig::names("creep", move |s| {
        if s.first {
            z = 0.0;
        }
        z += (s.command - z) * (1.0 - (-s.dt / 8.0f64).exp());
        0.2 * z
    });
}
