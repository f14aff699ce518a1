//! Draws one joint that moves, stands and turns round while a force pulls at the tip: the command
//! torque follows the contact force while the joint moves and not while it stands. Writes
//! `dead-zone.svg` to the folder given (default: the current one) and prints how much of the force
//! the torque shows.
//!
//! `cargo run -p robot --example reversal -- docs/images [SEED]`

use robot::arm::{commanded_efforts, ArmConfig, VirtualArm};
use robot::trajectory::Trajectory;
use scene::{color, range, Axes, Color, Scene};
use std::error::Error;
use std::f64::consts::TAU;

/// Grid of the simulation, s.
const H: f64 = 50e-6;
/// The shoulder moves up, stands, moves down: ends of the three parts, s.
const PARTS_S: [f64; 3] = [10.0, 16.0, 26.0];
/// Torque that the force asks of the shoulder: amplitude N·m, period s.
const CONTACT: (f64, f64) = (0.30, 1.6);
/// Window of the smoothed torque, s.
const WINDOW_S: f64 = 0.15;

/// Time s, shoulder's speed mrad/s, contact torque N·m, command torque without its slow part N·m.
struct Row {
    t_s: f64,
    speed: f64,
    contact: f64,
    command: f64,
}

fn simulate(seed: u64) -> Result<Vec<Row>, Box<dyn Error>> {
    let mut arm = VirtualArm::new(&ArmConfig::default(), seed)?;
    for _ in 0..20_000 {
        arm.step(H, true, [0.0; 3]);
    }
    let start = arm.target().position;
    let up = [start[0] + 0.16, start[1], start[2]];
    let mut rows = Vec::new();
    let mut next = 0;
    for step in 0..(PARTS_S[2] / H) as u64 {
        let t_s = step as f64 * H;
        if next < 3 && t_s >= [0.0, PARTS_S[0], PARTS_S[1]][next] {
            arm.follow(match next {
                0 => Trajectory::between(start, up, PARTS_S[0]),
                1 => Trajectory::standing(up),
                _ => Trajectory::between(up, start, PARTS_S[2] - PARTS_S[1]),
            });
            next += 1;
        }
        // A force across the shoulder's lever, of which the shoulder feels the sine.
        let truth = arm.truth();
        let along = arm.direction_of_joint(0);
        let lever: f64 = along.iter().map(|a| a * a).sum::<f64>().sqrt();
        let wanted = CONTACT.0 * libm::sin(TAU * t_s / CONTACT.1);
        let force = along.map(|a| a / lever * wanted / lever);
        arm.step(H, true, force);
        if step % 20 == 0 {
            rows.push(Row {
                t_s,
                speed: truth.joint_rates[0] * 1e3,
                contact: truth.contact_effort[0],
                command: commanded_efforts(arm.message())[0],
            });
        }
    }
    smooth(&mut rows);
    Ok(rows)
}

/// Running mean over the window.
fn smooth(rows: &mut [Row]) {
    let half = (WINDOW_S * 500.0) as usize;
    let mut sums = vec![0.0];
    for row in rows.iter() {
        sums.push(sums[sums.len() - 1] + row.command);
    }
    for i in 0..rows.len() {
        let (from, to) = (i.saturating_sub(half), (i + half).min(rows.len() - 1));
        rows[i].command = (sums[to + 1] - sums[from]) / (to + 1 - from) as f64;
    }
}

/// Least squares of the command's change against the contact torque with a quadratic drift taken
/// out: the share that shows.
fn share(rows: &[Row]) -> f64 {
    // The command works against the contact: a sine at the contact's period, by correlation over
    // whole periods.
    let periods = ((rows[rows.len() - 1].t_s - rows[0].t_s) / CONTACT.1).floor();
    let end = rows[0].t_s + periods * CONTACT.1;
    let used: Vec<&Row> = rows.iter().filter(|row| row.t_s < end).collect();
    let amplitude = |value: fn(&Row) -> f64| {
        let n = used.len() as f64;
        let mean = used.iter().map(|row| value(row)).sum::<f64>() / n;
        let (mut s, mut c) = (0.0, 0.0);
        for row in &used {
            let (sin, cos) = libm::sincos(TAU * row.t_s / CONTACT.1);
            s += (value(row) - mean) * sin * 2.0 / n;
            c += (value(row) - mean) * cos * 2.0 / n;
        }
        libm::hypot(s, c)
    };
    amplitude(|row| row.command) / amplitude(|row| row.contact)
}

/// A panel over the whole time with one curve; shaded where the joint stands.
fn panel(
    scene: &mut Scene,
    rows: &[Row],
    (top, height): (f32, f32),
    words: [&str; 2],
    color: Color,
    value: impl Fn(&Row) -> f64,
) {
    let axes = Axes {
        left: 70.0,
        top,
        width: 770.0,
        height,
        x: (0.0, PARTS_S[2]),
        y: range(rows.iter().map(&value)),
    };
    let stands = axes.at_x(PARTS_S[0]);
    let width = axes.at_x(PARTS_S[1]) - stands;
    scene.rectangle(stands, top, width, height, STANDING);
    axes.grid(scene);
    axes.draw(scene, words[0], words[1]);
    let points = rows.iter().step_by(20).map(|row| (row.t_s, value(row)));
    scene.line(&axes.at(points), 1.3, color, false);
}

/// Part in which the joint stands.
const STANDING: Color = Color(0xf3, 0xe9, 0xd8);

fn draw(rows: &[Row]) -> Scene {
    let mut scene = Scene::new(860.0, 560.0);
    let standing: Vec<f64> = rows
        .iter()
        .filter(|row| (PARTS_S[0]..PARTS_S[1]).contains(&row.t_s))
        .map(|row| row.command)
        .collect();
    let middle = standing.iter().sum::<f64>() / standing.len() as f64;
    panel(
        &mut scene,
        rows,
        (30.0, 110.0),
        [
            "speed of the shoulder, mrad/s (shaded: the joint stands)",
            "",
        ],
        color(0),
        |r| r.speed,
    );
    panel(
        &mut scene,
        rows,
        (190.0, 110.0),
        ["contact torque at the shoulder, sign turned, N·m", ""],
        color(2),
        |r| -r.contact,
    );
    panel(
        &mut scene,
        rows,
        (350.0, 160.0),
        [
            "torque command of the arm's software, mean over 0.3 s, less its value at standstill, N·m",
            "time, s",
        ],
        color(1),
        |r| r.command - middle,
    );
    scene
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().unwrap_or_else(|| ".".to_owned());
    let seed = arguments.next().map_or(Ok(1), |text| text.parse())?;
    let rows = simulate(seed)?;
    let part = |from: f64, to: f64| {
        let begin = rows.partition_point(|row| row.t_s < from);
        let end = rows.partition_point(|row| row.t_s < to);
        &rows[begin..end]
    };
    println!("share of the contact torque that the command shows, seed {seed}:");
    println!("  moving up    {:4.0} %", 100.0 * share(part(2.0, 8.5)));
    println!("  standing     {:4.0} %", 100.0 * share(part(11.0, 15.9)));
    println!("  moving down  {:4.0} %", 100.0 * share(part(18.0, 24.5)));
    let step = part(4.5, 6.1).iter().map(|r| r.command).sum::<f64>() / part(4.5, 6.1).len() as f64
        - part(20.5, 22.1).iter().map(|r| r.command).sum::<f64>() / part(20.5, 22.1).len() as f64;
    println!("command moving up less moving down at the same place: {step:.2} N·m");
    let path = std::path::Path::new(&folder).join("dead-zone.svg");
    std::fs::write(&path, draw(&rows).to_svg())?;
    println!("{}", path.display());
    Ok(())
}
