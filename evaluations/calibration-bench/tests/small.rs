//! A small Monte Carlo of the whole calibration, with thresholds that chance does not reach: each
//! is more than four standard deviations of its count away from what is expected. The large one is
//! the program.

use calibration_bench::cells::SetErrors;
use calibration_bench::surveys::Layout;
use calibration_bench::tally::Tally;
use calibration_bench::{cells, forces, runs, surveys};

/// Whether a coverage of 95 % is plausible for so many draws. The intervals of one draw share the
/// weights, the place and the stations: as cautious as if a draw were one interval.
fn covers(tally: &Tally, draws: u64) -> bool {
    let sd = (0.95 * 0.05 / draws as f64).sqrt();
    (tally.coverage() - 0.95).abs() < 4.0 * sd
}

#[test]
fn gains_and_zeros_are_within_their_limits() {
    let draws = 80;
    let found = cells::cells(draws);
    assert!(
        found.gain.within(1.5e-3) >= 0.97,
        "{}",
        found.gain.within(1.5e-3)
    );
    assert!(
        found.zero.within(5e-3) >= 0.99,
        "{}",
        found.zero.within(5e-3)
    );
    assert!(covers(&found.gain, draws), "{}", found.gain.coverage());
    assert!(covers(&found.zero, draws), "{}", found.zero.coverage());
    assert_eq!((found.false_names, found.zeros_refused), (0, 0));
}

#[test]
fn geometry_runs_and_tip_force_are_within_their_limits() {
    let draws = 60;
    let layout = Layout {
        plate_radius_m: 0.15,
        holes: 4,
        closed: true,
        repeats: 10,
    };
    let figures = surveys::surveys(draws, layout, false);
    let (joint, chain, bound) = (&figures.joint, &figures.chain, &figures.bound);
    assert!(figures.false_alarms <= 3, "{}", figures.false_alarms);
    assert!(
        joint.position.within(4e-4) >= 0.95,
        "{}",
        joint.position.within(4e-4)
    );
    assert!(joint.axis.within(0.5f64.to_radians()) >= 0.95);
    assert!(
        covers(&joint.position, draws),
        "{}",
        joint.position.coverage()
    );
    assert!(covers(&joint.axis, draws), "{}", joint.axis.coverage());
    // Efficient: as good as the bound, better than the chain.
    let ratio = joint.position.rms() / bound.position.rms();
    assert!((0.85..1.15).contains(&ratio), "{ratio}");
    assert!(chain.position.rms() > 1.1 * joint.position.rms());

    let (alone, fused) = runs::runs(draws, 6000, 0.07, &figures);
    assert!(alone.within(2e-3) >= 0.95, "{}", alone.within(2e-3));
    assert!(covers(&alone, draws), "{}", alone.coverage());
    assert!(covers(&fused, draws), "{}", fused.coverage());
    assert!(fused.rms() < joint.position.rms());

    let cells = cells::cells(draws);
    let exact = forces::forces(draws, &cells, &figures, 0.0);
    assert!(exact.after.rms() < 0.1 * exact.before.rms());
    let rough = forces::forces(draws, &cells, &figures, 1e-3);
    assert!(rough.after.rms() > 3.0 * exact.after.rms());
    for found in [&exact, &rough] {
        assert!(covers(&found.after, draws), "{}", found.after.coverage());
        assert!(covers(&found.balls, draws), "{}", found.balls.coverage());
    }
}

#[test]
fn an_error_that_a_set_shares_is_in_the_interval() {
    let draws = 100;
    for (errors, correlation) in [
        (SetErrors::Own, 1.0),
        (SetErrors::Common, 1.0),
        (SetErrors::Own, 0.0),
    ] {
        let found = cells::sets(draws, errors, correlation);
        assert!(found.coverage() >= 0.9, "{errors:?}: {}", found.coverage());
    }
}

#[test]
fn a_preloaded_cable_is_told_from_a_power_up() {
    let found = cells::power_ups(40);
    // docs/calibration/figures.md has the expected parts.
    assert!(found.slack_refused * 100 < found.slack, "{found:?}");
    assert!(found.preloaded.0 * 20 < found.preloaded.1, "{found:?}");
    let paid_out = cells::pay_outs(20);
    assert_eq!(
        (paid_out.slack.0, paid_out.preloaded.0),
        (0, 0),
        "{paid_out:?}"
    );
    for (hits, of) in [found.mounting, found.converter] {
        // Errors of axis and mass are common to the power-ups of a unit: 240 independent units.
        let part = hits as f64 / of as f64;
        assert!((0.89..=0.99).contains(&part), "{part}");
    }
}
