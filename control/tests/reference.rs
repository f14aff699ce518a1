//! The fixed-point step against its `f64` reference: at most 1 mN from load code to command.

#[path = "common/compare.rs"]
mod compare;
#[path = "common/reference.rs"]
mod reference;

/// The bound that the project states, in N.
const BOUND_N: f64 = 1.0e-3;

fn check(found: &compare::Found) {
    println!("{found:?}");
    assert!(found.worst_command <= BOUND_N, "{found:?}");
    for (name, worst) in ["tension", "p", "i", "d", "feedforward"]
        .iter()
        .zip(found.worst_terms)
    {
        assert!(worst <= BOUND_N, "{name}: {worst} N");
    }
    // The comparison says something only if commands were neither zero nor at a limit all the time,
    // and if few runs were given up.
    assert!(found.largest_command > 10.0, "{found:?}");
    assert!(found.free * 10 > found.samples, "{found:?}");
    assert!(found.undecided < 20, "{found:?}");
}

#[test]
fn short_runs_of_many_configurations() {
    let found = compare::compare(11, 400_000, 2_000);
    check(&found);
    assert!(found.trips > 0, "no run tripped: {found:?}");
}

#[test]
fn long_runs_do_not_drift() {
    // 100,000 samples are more than five minutes of one unit.
    check(&compare::compare(12, 600_000, 100_000));
}

#[test]
fn dac_code_is_the_nearest_one() {
    let found = compare::compare(13, 100_000, 2_000);
    // Half a code by rounding, and 1 mN at the configurations' largest scale of 800 codes/N.
    assert!(found.worst_codes <= 0.5 + 800.0 * BOUND_N, "{found:?}");
}
