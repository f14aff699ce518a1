//! Lost motion: the driven side stands still while the gap is crossed.

use crate::rig::knowing;
use residual_effects::*;

/// Runs far apart: behind a gap as wide as the whole range nothing moves within a run.
#[test]
fn a_gap_is_narrower_than_the_motion_of_a_run() {
    let rows = 300;
    let of = |i: usize| 10.0 * (i / rows) as f64 + (0.05 * (i % rows) as f64).sin();
    let command: Vec<f64> = (0..3 * rows).map(of).collect();
    let spec = "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\" }\n\
                command = { column = \"c\" }\n[[terms]]\nname = \"a\"\nexpr = \"command\"\n";
    let target = command.iter().map(|c| c + 0.1).collect();
    let columns = [("target", target), ("command", command)];
    knowing(spec, &columns, rows, |ctx| {
        let forms = effect(EffectKind::Backlash).variants(ctx);
        let holds = forms[0].possible.as_ref().unwrap();
        assert!(holds(1.5, &[]) && !holds(1.7, &[]));
    });
}

#[test]
fn is_named() {
    let mut play = 0.0;
    crate::rig::names("backlash", move |s| {
        if s.first {
            play = s.command;
        }
        play = f64::clamp(play, s.command - 0.3, s.command + 0.3);
        play - s.command
    });
}
