//! Trajectories: within their ranges, smooth, at rest at both ends, repeatable, and each kind does
//! what its name says.

use robot::trajectory::{Kind, Trajectory, TrajectoryConfig, TrajectoryError};

const KINDS: [Kind; 4] = [
    Kind::Sinusoids,
    Kind::LowSpeed,
    Kind::StopAndGo,
    Kind::ReversalRich,
];

fn config(kind: Kind) -> TrajectoryConfig {
    TrajectoryConfig {
        kind,
        duration_s: 300.0,
        ..TrajectoryConfig::default()
    }
}

/// Samples at 100 Hz.
fn times() -> impl Iterator<Item = f64> {
    (0..=30_000).map(|i| f64::from(i) * 0.01)
}

#[test]
fn every_kind_keeps_its_range_its_speed_and_is_smooth() {
    for kind in KINDS {
        for seed in 0..5 {
            let config = config(kind);
            let trajectory = Trajectory::new(&config, seed).unwrap();
            let mut before = trajectory.at(0.0);
            assert_eq!(before.velocity, [0.0; 3]);
            for t in times().skip(1) {
                let now = trajectory.at(t);
                for i in 0..3 {
                    assert!(
                        now.position[i] >= config.lower[i] - 1e-12
                            && now.position[i] <= config.upper[i] + 1e-12,
                        "{kind:?}"
                    );
                    assert!(
                        now.velocity[i].abs() <= config.fastest[i] * (1.0 + 1e-9),
                        "{kind:?}"
                    );
                    // The velocity is the derivative of the position, and does not jump.
                    let mean = 0.5 * (now.velocity[i] + before.velocity[i]);
                    let moved = (now.position[i] - before.position[i]) / 0.01;
                    assert!(
                        (moved - mean).abs() < 2e-2 * config.fastest[i],
                        "{kind:?} {t} {i}: {moved} {mean}"
                    );
                }
                before = now;
            }
            assert_eq!(trajectory.at(1e9).velocity, [0.0; 3]);
            assert_eq!(trajectory.at(1e9).position, trajectory.at(300.0).position);
        }
    }
}

#[test]
fn a_seed_is_a_trajectory() {
    for kind in KINDS {
        let new = |seed| Trajectory::new(&config(kind), seed).unwrap();
        assert_eq!(new(7), new(7));
        assert_ne!(new(7), new(8));
    }
}

#[test]
fn the_kinds_do_what_their_names_say() {
    let speed_rms = |t: &Trajectory, i: usize| {
        (times().map(|s| t.at(s).velocity[i].powi(2)).sum::<f64>() / 30_001.0).sqrt()
    };
    let standing = |t: &Trajectory| {
        times().filter(|s| t.at(*s).velocity == [0.0; 3]).count() as f64 / 30_001.0
    };
    let new = |kind| Trajectory::new(&config(kind), 3).unwrap();
    let (sinusoids, slow) = (new(Kind::Sinusoids), new(Kind::LowSpeed));
    let (stops, turns) = (new(Kind::StopAndGo), new(Kind::ReversalRich));
    for i in 0..3 {
        assert!(speed_rms(&slow, i) < 0.4 * speed_rms(&sinusoids, i));
        let (many, few) = (turns.reversals_s(i).len(), sinusoids.reversals_s(i).len());
        assert!(many > 3 * few, "{many} {few}");
    }
    assert!(standing(&sinusoids) < 0.01, "{}", standing(&sinusoids));
    assert!(standing(&stops) > 0.05, "{}", standing(&stops));
}

#[test]
fn the_whole_range_is_used() {
    let config = TrajectoryConfig::default();
    let trajectory = Trajectory::new(&config, 1).unwrap();
    for i in 0..3 {
        let width = config.upper[i] - config.lower[i];
        let mut bins = [0_u32; 10];
        for t in (0..120_000).map(|n| f64::from(n) * 0.01) {
            let part = (trajectory.at(t).position[i] - config.lower[i]) / width;
            bins[((part * 10.0) as usize).min(9)] += 1;
        }
        // No tenth of the range has less than a fifth of its share in 20 min.
        assert!(bins.iter().all(|n| *n > 2_400), "joint {i}: {bins:?}");
    }
}

#[test]
fn impossible_trajectories_are_refused_with_the_joint() {
    let mut bad = TrajectoryConfig::default();
    bad.upper[2] = 0.6;
    let error = Trajectory::new(&bad, 1).unwrap_err();
    assert!(
        matches!(error, TrajectoryError::Range { joint: 3, .. }),
        "{error}"
    );
    bad = TrajectoryConfig::default();
    bad.lower[0] = f64::NAN;
    assert!(matches!(
        Trajectory::new(&bad, 1),
        Err(TrajectoryError::Range { joint: 1, .. })
    ));
    bad = TrajectoryConfig::default();
    bad.slowest[1] = 0.0;
    assert!(matches!(
        Trajectory::new(&bad, 1),
        Err(TrajectoryError::Speed { joint: 2, .. })
    ));
    bad = TrajectoryConfig::default();
    bad.duration_s = f64::INFINITY;
    assert!(matches!(
        Trajectory::new(&bad, 1),
        Err(TrajectoryError::Duration(_))
    ));
}
