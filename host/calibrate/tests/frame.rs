//! Exchanged exit points and wrong frames are told from the lengths of the cables.

use calibrate::frame::{explain, Explanation};
use calibration::self_calibration::Sample;
use nalgebra::{Rotation3, Vector3};
use rig::Rig;
use wire::UNITS;

/// Samples of a rig with these exits, on a path of 40 mm about the middle of the workspace;
/// `noise_m`: of each coordinate of the tip as the host gets it.
fn run_of(exits: &[Vector3<f64>; UNITS], noise_m: f64, seed: u64) -> [Vec<Sample>; UNITS] {
    let center = Rig::built_in().unwrap().workspace.center_m;
    std::array::from_fn(|i| {
        let mut noise = random::SplitMix64::stream(seed, "pose", i);
        (0..1500)
            .map(|k| {
                let t = f64::from(k) * 0.02;
                let way = Vector3::new((1.1 * t).sin(), (1.7 * t).sin(), (2.3 * t).cos());
                let tip_m = center + way * 0.04;
                let mut error = || noise_m * noise.normal_within(3.0);
                Sample {
                    tip_m: tip_m + Vector3::new(error(), error(), error()),
                    travel_m: (exits[i] - tip_m).norm() - 0.4,
                    tension_n: 3.0,
                }
            })
            .collect()
    })
}

fn mirrored(exit: Vector3<f64>, axis: usize) -> Vector3<f64> {
    let mut exit = exit;
    exit[axis] = -exit[axis];
    exit
}

fn words_of(found: &[Explanation]) -> Vec<&str> {
    found.iter().map(|found| found.words.as_str()).collect()
}

/// The same words, and numbers of millimetres that differ by 3 at most.
fn alike(words: &str, what: &str) -> bool {
    let millimetres = |text: &str| -> Option<Vec<f64>> {
        let inside = text.split_once("shifted by (")?.1.split_once(')')?.0;
        inside.split(' ').map(|mm| mm.parse().ok()).collect()
    };
    match (millimetres(words), millimetres(what)) {
        (Some(found), Some(true_mm)) => {
            (found.iter().zip(&true_mm)).all(|(a, b)| (a - b).abs() <= 3.0)
                && words.split("shifted").next() == what.split("shifted").next()
        }
        _ => words == what,
    }
}

/// The rig file is right and the rig is `truth` of it: one explanation, the right one, with 0.1 and
/// with 1 mm of pose noise.
#[test]
fn exchanged_exits_and_wrong_frames_are_named_with_1_mm_of_pose_noise() {
    let file = Rig::built_in().unwrap().units.map(|unit| unit.exit_m);
    let turned = |axis: Vector3<f64>, degrees: f64| {
        let by = Rotation3::from_scaled_axis(axis * degrees.to_radians());
        file.map(|exit| by * exit)
    };
    let exchanged = |order: [usize; UNITS]| order.map(|at| file[at]);
    let cases: Vec<([Vector3<f64>; UNITS], &str)> = vec![
        (exchanged([1, 0, 2, 3, 4, 5]), "exits 1 and 2 exchanged"),
        (exchanged([0, 1, 5, 3, 4, 2]), "exits 3 and 6 exchanged"),
        (
            exchanged([1, 0, 3, 2, 4, 5]),
            "exits 1 and 2 exchanged; exits 3 and 4 exchanged",
        ),
        (
            exchanged([1, 2, 0, 3, 4, 5]),
            "exits 1, 2, 3 exchanged: each has to be the next one's, the last the first one's",
        ),
        (file.map(|exit| mirrored(exit, 0)), "frame mirrored in x"),
        (file.map(|exit| mirrored(exit, 1)), "frame mirrored in y"),
        (file.map(|exit| mirrored(exit, 2)), "frame mirrored in z"),
        (
            turned(Vector3::z(), 30.0),
            "frame turned by 30 degrees about z",
        ),
        (
            turned(Vector3::z(), -30.0),
            "frame turned by -30 degrees about z",
        ),
        (
            turned(Vector3::x(), 90.0),
            "frame turned by 90 degrees about x",
        ),
        (
            turned(Vector3::y(), 10.0),
            "frame turned by 10 degrees about y",
        ),
        (
            file.map(|exit| exit + Vector3::new(0.03, 0.0, 0.0)),
            "frame shifted by (30 0 0) mm",
        ),
    ];
    for (truth, what) in &cases {
        for (noise_m, seed) in [(1e-4, 1), (1e-3, 2), (1e-3, 3)] {
            let found = explain(&run_of(truth, noise_m, seed), &file, noise_m);
            let right = matches!(words_of(&found)[..], [words] if alike(words, what));
            assert!(right, "{what}, {noise_m} m: {found:?}");
        }
    }
    // A half turn has two directions.
    let found = explain(&run_of(&turned(Vector3::z(), 180.0), 1e-3, 4), &file, 1e-3);
    assert!(
        matches!(words_of(&found)[..], [w] if w.contains("180 degrees about z")),
        "{found:?}"
    );
}

/// A rig that is right has nothing to explain, and one wrong exit point is no frame.
#[test]
fn what_is_right_and_what_no_frame_explains_have_no_name() {
    let file = Rig::built_in().unwrap().units.map(|unit| unit.exit_m);
    assert_eq!(explain(&run_of(&file, 1e-3, 1), &file, 1e-3), []);
    let mut one = file;
    one[3].y += 0.15;
    one[3].x += 0.15;
    assert_eq!(explain(&run_of(&one, 1e-4, 1), &file, 1e-4), []);
    let none: [Vec<Sample>; UNITS] = std::array::from_fn(|_| Vec::new());
    assert_eq!(explain(&none, &file, 1e-3), []);
}
