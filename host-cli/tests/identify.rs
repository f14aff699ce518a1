//! `forcectl identify` with weights, as a user runs it.

#![cfg(feature = "residual")]

mod common;

use common::{run, Said};
use tempfile::tempdir;

/// Cells that creep: the session names it, weights measure it, and the force is held without it.
#[test]
fn creep_is_named_weighed_and_taken_out() {
    let folder = tempdir().unwrap();
    let plant = "[cable]\ninitial_slack_m = 0.003\n\n[[effects]]\nkind = \"creep\"\nfraction = 0.08\ntime_constant_s = 6.0\n";
    std::fs::write(folder.path().join("creeps.toml"), plant).unwrap();
    let rig = "--link fast --seed 17 --plant creeps.toml";
    let said: Said = run(
        folder.path(),
        &format!("identify {rig} --weigh --yes --duration 6 --drive-duration 20 --pairs 3 --out found --json"),
    );
    assert_eq!(said.code, Some(0), "{said:?}");
    let found: serde_json::Value = serde_json::from_str(&said.out).unwrap();
    let gains = found["weighed"]["gains"]["gains"].as_array().unwrap();
    assert_eq!(gains.len(), 6, "{gains:?}");
    for gain in gains {
        let share = gain["creep"].as_f64().unwrap();
        assert!((share - 0.08).abs() < 1e-3, "{gain}");
    }
    // The second analysis is of straight cells.
    let named_again = |unit: &serde_json::Value| {
        let effects = unit["effects"].as_array().unwrap();
        effects.iter().any(|effect| effect["name"] == "creep")
    };
    let units = found["units"].as_array().unwrap();
    assert_eq!(units.iter().filter(|unit| named_again(unit)).count(), 0);
    let tip = |when: &str| found[when]["tip_rms_n"].as_f64().unwrap();
    assert!(tip("after") < 0.7 * tip("before"), "{}", found["gain"]);
    // It is in force from now on.
    let shown = run(folder.path(), "calibrate show --link fast --seed 17");
    assert_eq!(shown.code, Some(0), "{shown:?}");
}
