//! Names of the catalogue that fit what another law makes.

use crate::noise::Noise;
use residual::{analyse, spec::Spec, Data, Report, Verdict};

const ROWS: usize = 1500;
const LOGS: usize = 5;

/// One row: the angle, the speed, and a flow above 0.
struct Row {
    angle: f64,
    speed: f64,
    flow: f64,
}

/// The analysis of five logs of 30 s in which the angle moves by `reach` to both sides, with a
/// force that the model lacks beside noise of 0.1 N.
fn report(reach: f64, force: impl Fn(&Row) -> f64) -> Report {
    let model = r#"
[roles]
time = { column = "t", unit = "s" }
target = { column = "y", unit = "N" }
command = { column = "c", unit = "N" }
angle = { column = "q", unit = "rad" }
velocity = { column = "v", unit = "rad/s" }
channels.flow = { column = "f", unit = "l" }

[[terms]]
name = "force"
expr = "command"
fixed = 1.0

[[terms]]
name = "zero"
expr = "1"
"#;
    let mut noise = Noise(53);
    let mut time = vec![];
    let mut columns: [Vec<f64>; 5] = Default::default();
    for log in 0..LOGS {
        for i in 0..ROWS {
            let (t, p) = (0.02 * i as f64, log as f64);
            let waves = [(0.6, 0.7, p), (0.4, 1.9, 2.0 * p + 1.0)];
            let of = |f: &dyn Fn(f64, f64, f64) -> f64| -> f64 {
                waves.iter().map(|(a, w, p)| f(*a, *w, *p)).sum()
            };
            let row = Row {
                angle: reach * of(&|a, w, p| a * (w * t + p).sin()),
                speed: reach * of(&|a, w, p| a * w * (w * t + p).cos()),
                flow: 1.02 + (1.1 * t + 3.0 * p).sin(),
            };
            let command = 3.0 + (2.3 * t + p).sin() + (0.9 * t + 2.0 * p).cos();
            time.push(t);
            let target = command + force(&row) + 0.1 * noise.next();
            let all = [command, row.angle, row.speed, row.flow, target];
            columns.iter_mut().zip(all).for_each(|(c, x)| c.push(x));
        }
    }
    let names = ["command", "angle", "velocity", "flow", "target"];
    let data = Data::from_columns(time, names.into_iter().zip(columns))
        .sequences((0..LOGS).map(|k| k * ROWS..(k + 1) * ROWS))
        .build()
        .expect("data");
    analyse(&Spec::parse(model).expect("model"), data, &mut ()).expect("analysis")
}

fn names(report: &Report) -> Vec<&str> {
    report.effects.iter().map(|e| e.name.as_str()).collect()
}

/// That nothing is found, and why an effect that improves the fit is not.
fn is_refused(report: &Report, effect: &str, reason: &str) {
    assert!(report.effects.is_empty(), "{}", report.markdown());
    assert_eq!(report.verdict, Verdict::Unknown, "{}", report.markdown());
    let own = report.improves.iter().find(|e| e.name.as_str() == effect);
    let why = own.map_or("", |e| e.unsupported.as_str());
    assert!(why.contains(reason), "{effect}: {}", report.markdown());
}

/// The sum of a spring and a weight takes the shape of a spring that hardens.
#[test]
fn a_cubic_spring_is_no_spring_and_weight() {
    let reason =
        "with no more parameters, predicts as well as all that the catalogue has over angle";
    let report = report(1.5, |row| -0.12 * row.angle.powi(3));
    is_refused(&report, "cable_stretch", reason);
}

#[test]
fn a_spring_and_a_weight_stay_where_the_angle_tells_them_apart() {
    let report = report(3.0, |row| -0.12 * row.angle - 0.2 * (row.angle + 0.4).sin());
    let mut found = names(&report);
    found.sort_unstable();
    assert_eq!(
        found,
        ["cable_stretch", "gravity_angle"],
        "{}",
        report.markdown()
    );
}

#[test]
fn dry_friction_and_damping_stay() {
    let report = report(1.5, |row| -0.1 * row.speed.signum() - 0.08 * row.speed);
    let mut found = names(&report);
    found.sort_unstable();
    assert_eq!(found, ["coulomb", "viscous"], "{}", report.markdown());
}

#[test]
fn the_root_of_a_flow_is_no_share_of_it() {
    let report = report(1.5, |row| 0.3 * row.flow.sqrt());
    is_refused(&report, "crosstalk", "it is not the law: a curve in flow");
}

#[test]
fn damping_that_depends_on_the_angle_is_no_damping() {
    let report = report(1.5, |row| -0.12 * row.speed * row.angle.cos());
    is_refused(
        &report,
        "viscous",
        "it is not the law: velocity and angle together",
    );
}
