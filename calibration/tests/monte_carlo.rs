//! A small Monte Carlo of the whole calibration, with thresholds that chance does not reach: each is more than four standard
//! deviations of its count away from what is expected. The large one is `examples/monte_carlo.rs`.

#[path = "common/monte_carlo.rs"]
mod monte_carlo;
#[path = "common/scene.rs"]
mod scene;

use monte_carlo::{Layout, Tally};

/// Whether a coverage of 95 % is plausible for so many draws. The intervals of one draw share the weights, the place
/// and the stations: as cautious as if a draw were one interval.
fn covers(tally: &Tally, draws: u64) -> bool {
    let sd = (0.95 * 0.05 / draws as f64).sqrt();
    (tally.coverage() - 0.95).abs() < 4.0 * sd
}

#[test]
fn gains_and_zeros_are_within_their_limits() {
    let draws = 80;
    let found = monte_carlo::cells(draws);
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
    let surveys = monte_carlo::surveys(draws, layout, false);
    let (joint, chain, bound) = (&surveys.joint, &surveys.chain, &surveys.bound);
    assert!(surveys.false_alarms <= 3, "{}", surveys.false_alarms);
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

    let (alone, fused) = monte_carlo::runs(draws, 6000, &surveys);
    assert!(alone.within(2e-3) >= 0.95, "{}", alone.within(2e-3));
    assert!(covers(&alone, draws), "{}", alone.coverage());
    assert!(covers(&fused, draws), "{}", fused.coverage());
    assert!(fused.rms() < joint.position.rms());

    let forces = monte_carlo::forces(draws, &monte_carlo::cells(draws), &surveys);
    assert!(forces.after.rms() < 0.1 * forces.before.rms());
    assert!(covers(&forces.after, draws), "{}", forces.after.coverage());
}
