//! Logs of an arm that is made up, for `forcectl estimate`.

use robot::kinematics::{forward, to_crtk};
use std::fmt::Write as _;
use std::path::Path;

/// Joints of the arm at a time.
pub struct Joints {
    pub position: [f64; 3],
    pub velocity: [f64; 3],
    pub effort: [f64; 3],
    /// Force along y, N.
    pub force: f64,
}

/// A moving arm with a force along y, of which the efforts tell a part.
pub fn joints(t: f64, trial: u32, force_n: f64) -> Joints {
    let phase = f64::from(trial) * 1.7;
    let angle = |amplitude: f64, rate: f64| {
        let at = rate * t + phase;
        (amplitude * at.sin(), amplitude * rate * at.cos())
    };
    let moves = [angle(0.3, 0.9), angle(0.25, 1.3), angle(0.03, 0.7)];
    let q = [0.7 + moves[0].0, 1.4 + moves[1].0, 0.38 + moves[2].0];
    let force = force_n * (0.31 * t + 2.0 * phase).sin();
    let effort = |joint: usize| {
        let friction = 0.4 * (moves[joint].1 / 0.02).tanh();
        friction + [0.2, -0.3, 0.5][joint] * force + 0.6 * q[1].sin()
    };
    Joints {
        position: q,
        velocity: moves.map(|(_, rate)| rate),
        effort: [effort(0), effort(1), effort(2)],
        force,
    }
}

/// A log of `seconds` of it at 50 Hz. `but`: columns that it lacks.
pub fn log(folder: &Path, trial: u32, seconds: u32, force_n: f64, but: &[&str]) {
    std::fs::create_dir_all(folder).unwrap();
    let mut columns: Vec<(&str, Vec<f64>)> = Vec::new();
    for k in 0..seconds * 50 {
        let t = f64::from(k) * 0.02;
        let Joints {
            position: q,
            velocity,
            effort,
            force,
        } = joints(t, trial, force_n);
        let tip = to_crtk(forward(&[q[0], q[1], q[2], 0.0, 0.0, 0.0]).position_m);
        let row = [
            ("t_s", t),
            ("joint_position_1", q[0]),
            ("joint_position_2", q[1]),
            ("joint_position_3", q[2]),
            ("joint_velocity_1", velocity[0]),
            ("joint_velocity_2", velocity[1]),
            ("joint_velocity_3", velocity[2]),
            ("joint_effort_1", effort[0]),
            ("joint_effort_2", effort[1]),
            ("joint_effort_3", effort[2]),
            ("force_x_n", 0.0),
            ("force_y_n", force),
            ("force_z_n", 0.0),
            ("tip_x_m", tip.x),
            ("tip_y_m", tip.y),
            ("tip_z_m", tip.z),
            ("quality", 1.0),
            ("trial", f64::from(trial)),
        ];
        if columns.is_empty() {
            columns = row.map(|(name, _)| (name, Vec::new())).into();
            columns.retain(|(name, _)| !but.contains(name));
        }
        for (name, values) in &mut columns {
            let of = row.iter().find(|(n, _)| n == name);
            values.push(of.expect("a column of the row").1);
        }
    }
    let names: Vec<&str> = columns.iter().map(|(name, _)| *name).collect();
    let mut text = names.join(",") + "\n";
    for k in 0..columns[0].1.len() {
        let cells: Vec<String> = columns.iter().map(|(_, v)| v[k].to_string()).collect();
        writeln!(text, "{}", cells.join(",")).unwrap();
    }
    std::fs::write(folder.join(format!("trial-{trial}.csv")), text).unwrap();
    // What an experiment's data card tells of robot and force.
    let card = r#"{"experiment": {"robot": {"kind": "virtual", "seed": 1}, "force": {"kind": "one_axis", "axis": [0, 1, 0]}}}"#;
    std::fs::write(folder.join("card.json"), card).unwrap();
}

/// Three trials of 30 s.
pub fn day(folder: &Path, force_n: f64, but: &[&str]) {
    for trial in 1..4 {
        log(folder, trial, 30, force_n, but);
    }
}
