//! The rigid motion and the statistics against `scipy`, where it is installed; skipped by name
//! where it is not.

use calibration::{kabsch, se3, stats};
use nalgebra::{Vector3, Vector6};
use std::process::Command;

/// Aligns the points of standard input with `scipy.spatial.transform.Rotation.align_vectors` and
/// prints matrix and quantiles.
const SCRIPT: &str = "
import sys
import numpy as np
from scipy.spatial.transform import Rotation
from scipy import stats
rows = np.array([[float(v) for v in line.split()] for line in sys.argv[1].split(';')])
a, b = rows[:, :3], rows[:, 3:]
r, _ = Rotation.align_vectors(b - b.mean(0), a - a.mean(0))
print(*r.as_matrix().ravel(), stats.t.ppf(0.975, 7.3), stats.chi2.ppf(0.95, 3), stats.chi2.sf(30.0, 17))
";

#[test]
fn rotation_and_quantiles_agree_with_scipy() {
    let there = Command::new("python3")
        .args(["-c", "import scipy"])
        .output()
        .is_ok_and(|output| output.status.success());
    if !there {
        println!("skipped: python3 with scipy is not installed");
        return;
    }
    let motion = se3::exp(&Vector6::new(0.1, -0.2, 0.3, 0.7, -0.4, 1.1));
    let from: Vec<Vector3<f64>> = (0..7)
        .map(|i| {
            Vector3::new(
                (1.3 * f64::from(i)).sin(),
                (2.1 * f64::from(i)).cos(),
                0.1 * f64::from(i),
            )
        })
        .collect();
    let to: Vec<Vector3<f64>> = from
        .iter()
        .enumerate()
        .map(|(i, p)| motion.apply(p) + Vector3::new(1e-3, -2e-3, 1e-3) * (i as f64).sin())
        .collect();
    let rows: Vec<String> = from
        .iter()
        .zip(&to)
        .map(|(a, b)| format!("{} {} {} {} {} {}", a.x, a.y, a.z, b.x, b.y, b.z))
        .collect();
    let output = Command::new("python3")
        .args(["-c", SCRIPT, &rows.join(";")])
        .output()
        .expect("python3 was there");
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let numbers: Vec<f64> = String::from_utf8_lossy(&output.stdout)
        .split_whitespace()
        .map(|word| word.parse().expect("a number"))
        .collect();
    let found = kabsch::align(&from, &to, &[1.0; 7]).expect("sound points");
    for (i, theirs) in numbers[..9].iter().enumerate() {
        let ours = found.pose.rotation[(i / 3, i % 3)];
        assert!((ours - theirs).abs() < 1e-9, "{i}: {ours} {theirs}");
    }
    for (ours, theirs) in [
        (stats::student_quantile(0.975, 7.3), numbers[9]),
        (stats::chi_square_quantile(0.95, 3), numbers[10]),
        (stats::chi_square_survival(30.0, 17), numbers[11]),
    ] {
        assert!((ours / theirs - 1.0).abs() < 1e-8, "{ours} {theirs}");
    }
}
