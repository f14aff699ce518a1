//! Draws one joint that moves, stands and turns round while a force pulls at the tip: the command torque follows the contact
//! force while the joint moves and not while it stands. Writes `dead-zone.svg` to the folder given (default: the current one)
//! and prints how much of the force the torque shows.
//!
//! `cargo run --release -p robot --example reversal -- docs/images [SEED]`

use robot::arm::{commanded_efforts, ArmConfig, VirtualArm};
use robot::trajectory::Trajectory;
use std::error::Error;
use std::f64::consts::TAU;
use std::fmt::Write as _;

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
        let wanted = CONTACT.0 * (TAU * t_s / CONTACT.1).sin();
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

/// Least squares of the command's change against the contact torque with a quadratic drift taken out: the share that shows.
fn share(rows: &[Row]) -> f64 {
    // The command works against the contact: a sine at the contact's period, by correlation over whole periods.
    let periods = ((rows[rows.len() - 1].t_s - rows[0].t_s) / CONTACT.1).floor();
    let end = rows[0].t_s + periods * CONTACT.1;
    let used: Vec<&Row> = rows.iter().filter(|row| row.t_s < end).collect();
    let amplitude = |value: fn(&Row) -> f64| {
        let n = used.len() as f64;
        let mean = used.iter().map(|row| value(row)).sum::<f64>() / n;
        let (mut s, mut c) = (0.0, 0.0);
        for row in &used {
            let (sin, cos) = (TAU * row.t_s / CONTACT.1).sin_cos();
            s += (value(row) - mean) * sin * 2.0 / n;
            c += (value(row) - mean) * cos * 2.0 / n;
        }
        s.hypot(c)
    };
    amplitude(|row| row.command) / amplitude(|row| row.contact)
}

const WIDTH: f64 = 860.0;
const LEFT: f64 = 70.0;
const RIGHT: f64 = 20.0;

/// A colour and the value that is drawn in it.
type Line<'a> = (&'a str, &'a dyn Fn(&Row) -> f64);

/// A panel with its lines.
fn panel(
    svg: &mut String,
    rows: &[Row],
    top: f64,
    height: f64,
    title: &str,
    lines: &[Line],
) -> std::fmt::Result {
    let values = || lines.iter().flat_map(|(_, value)| rows.iter().map(value));
    let (low, high) = (
        values().fold(f64::MAX, f64::min),
        values().fold(f64::MIN, f64::max),
    );
    let (low, high) = (low - 0.05 * (high - low), high + 0.05 * (high - low));
    let x = |t: f64| LEFT + t / PARTS_S[2] * (WIDTH - LEFT - RIGHT);
    let y = |v: f64| top + height * (high - v) / (high - low);
    writeln!(
        svg,
        r##"<rect x="{}" y="{top}" width="{}" height="{height}" fill="#f3e9d8"/>"##,
        x(PARTS_S[0]),
        x(PARTS_S[1]) - x(PARTS_S[0])
    )?;
    writeln!(
        svg,
        r##"<rect x="{LEFT}" y="{top}" width="{}" height="{height}" fill="none" stroke="#888"/>"##,
        WIDTH - LEFT - RIGHT
    )?;
    writeln!(
        svg,
        r##"<text x="{LEFT}" y="{}">{title}</text>"##,
        top - 6.0
    )?;
    let step = nice((high - low) / 4.0);
    let mut tick = (low / step).ceil() * step;
    while tick <= high {
        writeln!(
            svg,
            r##"<line x1="{LEFT}" x2="{}" y1="{1}" y2="{1}" stroke="#ddd"/><text x="{2}" y="{3}" text-anchor="end">{tick:.1}</text>"##,
            WIDTH - RIGHT,
            y(tick),
            LEFT - 6.0,
            y(tick) + 4.0
        )?;
        tick += step;
    }
    for (colour, value) in lines {
        write!(
            svg,
            r##"<polyline fill="none" stroke="{colour}" stroke-width="1.3" points=""##
        )?;
        for row in rows.iter().step_by(20) {
            write!(svg, "{:.1},{:.1} ", x(row.t_s), y(value(row)))?;
        }
        writeln!(svg, r##""/>"##)?;
    }
    Ok(())
}

/// 1, 2 or 5 times a power of ten, at least `value`.
fn nice(value: f64) -> f64 {
    let ten = 10_f64.powf(value.log10().floor());
    [1.0, 2.0, 5.0, 10.0]
        .map(|n| n * ten)
        .into_iter()
        .find(|n| *n >= value)
        .unwrap_or(value)
}

fn draw(rows: &[Row]) -> Result<String, std::fmt::Error> {
    let mut svg = String::new();
    writeln!(
        svg,
        r##"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} 520" font-family="sans-serif" font-size="13"><rect width="100%" height="100%" fill="white"/>"##
    )?;
    let standing: Vec<f64> = rows
        .iter()
        .filter(|row| (PARTS_S[0]..PARTS_S[1]).contains(&row.t_s))
        .map(|row| row.command)
        .collect();
    let middle = standing.iter().sum::<f64>() / standing.len() as f64;
    panel(
        &mut svg,
        rows,
        30.0,
        110.0,
        "speed of the shoulder, mrad/s (shaded: the joint stands)",
        &[("#0b6e99", &|r: &Row| r.speed)],
    )?;
    panel(
        &mut svg,
        rows,
        170.0,
        110.0,
        "contact torque at the shoulder, sign turned, N·m",
        &[("#2a9d4b", &|r: &Row| -r.contact)],
    )?;
    panel(
        &mut svg,
        rows,
        310.0,
        160.0,
        "torque command of the arm's software, mean over 0.3 s, less its value at standstill, N·m",
        &[("#b3261e", &|r: &Row| r.command - middle)],
    )?;
    for t in (0..=26).step_by(2) {
        let x = LEFT + f64::from(t) / PARTS_S[2] * (WIDTH - LEFT - RIGHT);
        writeln!(
            svg,
            r##"<text x="{x}" y="488" text-anchor="middle">{t}</text>"##
        )?;
    }
    writeln!(
        svg,
        r##"<text x="{}" y="508" text-anchor="middle">time, s</text></svg>"##,
        WIDTH / 2.0
    )?;
    Ok(svg)
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
    std::fs::write(&path, draw(&rows)?)?;
    println!("{}", path.display());
    Ok(())
}
