//! What the plant's tests share: the force-gauge experiment and a small least-squares fit.
#![allow(dead_code)] // each test binary uses a part

use plant::config::{PathConfig, PlantConfig, SweepPath, UnitConfig};

/// One unit, its cable along x, and a tip that moves back and forth along the cable: the
/// force-gauge experiment.
pub fn gauge(amplitude_m: f64, speed_m_per_s: f64) -> PlantConfig {
    let mut config = PlantConfig::default();
    let center = config.robot.workspace_center_m;
    config.units = vec![UnitConfig {
        position_m: [center[0] + 0.4, center[1], center[2]],
        axis_tilt_rad: [0.0; 2],
    }];
    config.robot.ramp_s = 0.2;
    config.robot.path = PathConfig::Sweep(SweepPath {
        direction: [-1.0, 0.0, 0.0],
        amplitude_m,
        speed_m_per_s,
    });
    config
}

/// Amplifier input for a loss-free pull of `pull_n`.
pub fn volts_for_pull(config: &PlantConfig, pull_n: f64) -> f64 {
    pull_n / config.drive.tension_per_current_n_per_a() / config.amplifier.gain_a_per_v
}

/// Least squares by normal equations and Gauss-Jordan elimination.
pub fn least_squares<const N: usize>(rows: &[[f64; N]], values: &[f64]) -> [f64; N] {
    assert!(rows.len() >= N && rows.len() == values.len());
    let mut a = [[0.0; N]; N];
    let mut b = [0.0; N];
    for (row, value) in rows.iter().zip(values) {
        for i in 0..N {
            b[i] += row[i] * value;
            for j in 0..N {
                a[i][j] += row[i] * row[j];
            }
        }
    }
    for i in 0..N {
        let pivot = (i..N)
            .max_by(|&p, &q| a[p][i].abs().total_cmp(&a[q][i].abs()))
            .unwrap();
        a.swap(i, pivot);
        b.swap(i, pivot);
        assert!(a[i][i].abs() > 1e-9, "rank deficient");
        for k in 0..N {
            if k != i {
                let factor = a[k][i] / a[i][i];
                let pivot_row = a[i];
                for (value, pivot) in a[k].iter_mut().zip(pivot_row) {
                    *value -= factor * pivot;
                }
                b[k] -= factor * b[i];
            }
        }
    }
    let mut x = [0.0; N];
    for i in 0..N {
        x[i] = b[i] / a[i][i];
    }
    x
}

/// Root mean square of what a fit leaves.
pub fn rms<const N: usize>(rows: &[[f64; N]], values: &[f64], fit: &[f64; N]) -> f64 {
    let sum: f64 = rows
        .iter()
        .zip(values)
        .map(|(row, value)| (value - row.iter().zip(fit).map(|(r, f)| r * f).sum::<f64>()).powi(2))
        .sum();
    (sum / rows.len() as f64).sqrt()
}
