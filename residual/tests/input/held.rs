//! A target that is logged more often than it is measured, and lines that inputs have too.

use crate::{analyse, hash, Folder, MODEL};
use residual::{EffectKind, Report};
use std::f64::consts::TAU;

/// Logs of 40 s with 200 rows/s, of a target that is measured `per_s` times a second; dry friction
/// of 0.3 N, a hum of 50 Hz, noise of 0.03 N.
fn held(per_s: f64) -> Report {
    let folder = Folder::new();
    for run in 0..3u64 {
        let p = run as f64;
        let mut text = String::from("t,c,v,y\n");
        for i in 0..8000 {
            let t = 0.005 * f64::from(i);
            let at = |s: f64| {
                let v = (1.3 * s + p).sin() + 0.4 * (3.1 * s).cos();
                (3.0 + (0.7 * s + p).sin(), v)
            };
            let k = (t * per_s + 1e-9) as usize;
            let s = k as f64 / per_s;
            let (c, v) = at(s);
            let noise = 0.05 * (hash(k, run) + hash(k, run + 77));
            let hum = 0.15 * (TAU * 50.0 * s + p).sin();
            let y = c - 0.3 * v.signum() + hum + noise;
            let (c, v) = at(t);
            text += &format!("{t:.3},{c:.4},{v:.4},{y:.3}\n");
        }
        folder.put(&format!("run{run}.csv"), &text);
    }
    analyse(&[folder.path()], MODEL).unwrap()
}

#[test]
fn a_held_target_has_no_images_and_no_delay_of_its_own() {
    let per_s = 80.0;
    let report = held(per_s);
    let text = report.summary();
    assert!(
        text.starts_with("The target holds each value for"),
        "{text}"
    );
    // The hum folded into what the values can carry.
    let alias = (50.0 - per_s).abs();
    for e in &report.effects {
        match e.name {
            EffectKind::Coulomb => {
                assert!((e.params["friction"] + 0.3).abs() < 0.01, "{text}");
            }
            EffectKind::Tone => {
                assert!((e.params["frequency"] - alias).abs() < 0.5, "{text}");
            }
            _ => panic!("{text}"),
        }
    }
    assert_eq!(report.effects[0].name, EffectKind::Coulomb, "{text}");
}

/// The velocity has a small line of its own at the frequency of a disturbance.
#[test]
fn a_line_that_an_input_has_too_is_said() {
    let folder = Folder::new();
    for run in 0..3u64 {
        let p = run as f64;
        let mut text = String::from("t,c,v,y\n");
        for i in 0..4000 {
            let t = 0.01 * f64::from(i);
            let line = 0.02 * (TAU * 3.333 * t + p).sin();
            let c = 3.0 + (0.7 * t + p).sin();
            let v = (1.3 * t + p).sin() + 0.4 * (3.1 * t).cos() + line;
            let y = c + 0.2 * (TAU * 3.333 * t + 2.0 * p + 1.0).sin() + 0.1 * hash(i as usize, run);
            text += &format!("{t:.3},{c:.5},{v:.4},{y:.4}\n");
        }
        folder.put(&format!("run{run}.csv"), &text);
    }
    let text = analyse(&[folder.path()], MODEL).unwrap().summary();
    assert!(
        text.contains("that an input or its slope has too: 3.3"),
        "{text}"
    );
}
