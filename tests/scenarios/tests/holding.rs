//! The main job: a Cartesian force held at the tip of a moving, frictional, noisy robot.

use run::{self, Ended, NoopObserver, Options};
use test_stand::{rig, rig_file};

fn hold(seed: u64, force_n: [f64; 3]) -> run::Outcome {
    let mut link = rig(seed);
    run::set_force(
        &mut link,
        &rig_file(),
        &Options::new(force_n, 4.0),
        &mut NoopObserver,
    )
    .unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn two_and_a_half_newtons_along_y() {
    for seed in [1, 2] {
        let outcome = hold(seed, [0.0, 2.5, 0.0]);
        assert_eq!(outcome.ended, Ended::Done);
        assert!(outcome.faults.is_empty(), "{:?}", outcome.faults);
        assert_eq!(outcome.samples_lost, 0);
        let metrics = outcome.metrics.expect("a run of 4 s has figures");
        assert!(metrics.from_truth);
        assert!(
            metrics.tip_force_error_n <= 0.05,
            "seed {seed}: steady error {:.3} N",
            metrics.tip_force_error_n
        );
        let along_s = metrics.settling_along_s.expect("it settles");
        assert!(
            along_s <= 0.5,
            "seed {seed}: settled along y after {along_s:.2} s"
        );
        // A friction reversal across the force may come at any time; with seed 1 it does within the
        // first second.
        let settling_s = metrics.settling_s.expect("it settles");
        assert!(
            settling_s <= 1.0,
            "seed {seed}: settled after {settling_s:.2} s"
        );
        for (unit, rms_n) in metrics.tension_rms_n.into_iter().enumerate() {
            assert!(
                rms_n <= 0.12,
                "seed {seed}, unit {}: tension {rms_n:.3} N RMS off",
                unit + 1
            );
        }
        // Never slack, never above the limit.
        for step in outcome.steps.iter().filter(|step| step.t_s > 0.5) {
            for tension in step.best_tension_n() {
                assert!(
                    tension > 0.5 && tension < 14.0,
                    "{tension:.2} N at {:.2} s",
                    step.t_s
                );
            }
        }
    }
}

#[test]
fn forces_in_other_directions() {
    for (seed, force_n) in [(3, [-1.5, 0.0, 1.0]), (4, [2.0, -2.0, 0.0])] {
        let metrics = hold(seed, force_n).metrics.expect("figures");
        assert!(
            metrics.tip_force_error_n <= 0.05,
            "{force_n:?}: steady error {:.3} N",
            metrics.tip_force_error_n
        );
    }
}

#[test]
fn a_force_out_of_reach_is_approached_and_reported() {
    let outcome = hold(5, [0.0, 11.9, 0.0]);
    let reach = outcome.reach.expect("the run says how far it came");
    assert!(!reach.feasible);
    assert!(
        reach.fraction.value().is_some_and(|f| f > 0.5 && f < 1.0),
        "{reach:?}"
    );
    assert_eq!(outcome.ended, Ended::Degraded);
}

#[test]
fn forces_that_are_none_are_refused_before_anything_is_driven() {
    for force_n in [
        [f64::NAN, 0.0, 0.0],
        [0.0, f64::INFINITY, 0.0],
        [0.0, 0.0, 1e9],
    ] {
        let mut link = rig(6);
        let error = run::set_force(
            &mut link,
            &rig_file(),
            &Options::new(force_n, 1.0),
            &mut NoopObserver,
        )
        .expect_err("must be refused");
        assert!(matches!(error, run::RunError::Argument(_)), "{error}");
        use session::link::RigLink;
        let report = link
            .controls()
            .expect("an embedded rig")
            .report()
            .expect("a report");
        assert_eq!(report.now_ns, 0, "time passed, so the board was spoken to");
    }
}
