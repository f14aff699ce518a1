//! Friction that the rig file doesn't declare: found on the real firmware, declared, and the
//! tensions are better for it.

use identify::{self, Figures};
use rig::{Rig, DEFAULT_TEXT};
use run::{self, NoopObserver, Options};
use session::link::embedded::{EmbeddedRig, Programs};
use session::link::EmbeddedOptions;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use test_stand::rig_file;

/// Two fifths more than the rig file says, in every unit; cables slack where zeros are taken.
const PLANT: &str = "\
[cable]
initial_slack_m = 0.003

[[effects]]
kind = \"coulomb\"
constant_n = 0.6
";

fn start(plant: &Path) -> EmbeddedRig {
    let programs = Programs::from_environment().unwrap_or_else(|error| panic!("{error}"));
    let options = EmbeddedOptions {
        seed: Some(2),
        plant: Some(plant.to_owned()),
        ..EmbeddedOptions::default()
    };
    EmbeddedRig::start(&programs, &options).unwrap_or_else(|error| panic!("{error}"))
}

fn hold(plant: &Path, rig: &Rig) -> Figures {
    let options = Options::new([0.0, 2.5, 0.0], 10.0);
    let outcome = run::set_force(&mut start(plant), rig, &options, &mut NoopObserver)
        .unwrap_or_else(|error| panic!("{error}"));
    Figures::of(&outcome).expect("ten seconds have figures")
}

#[test]
fn undeclared_friction_is_found_and_compensated() {
    let out = tempfile::tempdir().expect("a temporary folder");
    let plant = out.path().join("plant.toml");
    std::fs::write(&plant, PLANT).expect("a plant file");

    let before = hold(&plant, &rig_file());
    let stop = AtomicBool::new(false);
    let recording = identify::excite(
        &mut start(&plant),
        &rig_file(),
        20.0,
        1.0,
        &run::Zeroing::Measure,
        &stop,
        &mut NoopObserver,
    )
    .unwrap_or_else(|error| panic!("{error}"));
    let found = identify::find(
        &recording,
        &rig_file(),
        "built-in",
        DEFAULT_TEXT,
        out.path(),
        &mut (),
    )
    .unwrap_or_else(|error| panic!("{error}"));
    for (unit, new) in found.units.iter().zip(&found.rig.units) {
        // Constant and share of load together, at the excitation's middle; units differ by 0.1 N by
        // themselves.
        let more = new.coulomb_n + 4.5 * new.coulomb_per_n - 0.909 - 4.5 * 0.154;
        assert!(
            (more - 0.6).abs() < 0.25,
            "unit {}: {more:.3} N more found, 0.6 there; {:?}",
            unit.unit,
            unit.report.effects
        );
    }
    let after = hold(&plant, &found.rig);
    let mean = |figures: &Figures| figures.tension_rms_n.iter().sum::<f64>() / 6.0;
    assert!(
        mean(&after) < 0.85 * mean(&before),
        "tensions {:?} N off before, {:?} N after",
        before.tension_rms_n,
        after.tension_rms_n
    );
}
