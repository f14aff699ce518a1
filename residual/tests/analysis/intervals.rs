//! Intervals of parameters: as wide as the data are vague.

use crate::rig::{simulate, Excitation};
use residual::{analyse, spec::Spec, Data, Report};
use residual_columns::stats::Rng;

const LATE_S: f64 = 0.03;
const DAMPING: f64 = 0.05;
const FRICTION: f64 = 0.04;

/// One row before the target is formed: the command now and when it acts, velocity, and friction
/// that turns over gradually.
struct Row {
    command: f64,
    late: f64,
    velocity: f64,
    turning: f64,
}

/// The 95 % intervals of damping and delay from six runs. The command changes when the motion does:
/// `together` is the share of the command's slope in the velocity.
fn intervals(only: &str, together: f64, target: impl Fn(&Row) -> f64) -> [Option<[f64; 2]>; 2] {
    let (runs, rows, dt) = (6, 1500, 0.02);
    let mut rng = Rng::new(3);
    let mut columns = vec![Vec::new(); 4];
    for run in 0..runs {
        let w = 1.0 + 0.07 * f64::from(run);
        let command = |t: f64| 3.0 + (1.1 * w * t).sin() + 0.5 * (2.9 * w * t).sin();
        let slope = |t: f64| 1.1 * w * (1.1 * w * t).cos() + 1.45 * w * (2.9 * w * t).cos();
        let (mut springs, mut angle) = ([0.0; 2], 0.0);
        for i in 0..rows {
            let t = f64::from(i) * dt;
            let velocity = together * slope(t) + (0.7 * w * t).cos() + (4.3 * w * t).sin();
            let dx: f64 = velocity * dt;
            // Two springs that slip, one far softer than the other.
            for (spring, distance) in springs.iter_mut().zip([0.05, 0.6]) {
                *spring = f64::clamp(*spring + 2.0 * dx / distance, -1.0, 1.0);
            }
            angle += dx;
            let row = Row {
                command: command(t),
                late: command(t - LATE_S),
                velocity,
                turning: 0.5 * (springs[0] + springs[1]),
            };
            let noise = 0.03 * rng.normal();
            let values = [target(&row) + noise, row.command, velocity, angle];
            columns.iter_mut().zip(values).for_each(|(c, v)| c.push(v));
        }
    }
    let model = format!(
        "[roles]\ntime = {{ column = \"t\", unit = \"s\" }}\ntarget = {{ column = \"y\", unit = \"N\" }}\n\
         command = {{ column = \"c\", unit = \"N\" }}\nvelocity = {{ column = \"v\", unit = \"rad/s\" }}\n\
         angle = {{ column = \"q\", unit = \"rad\" }}\n\
         [selection]\nonly = [{only}]\n\
         [[terms]]\nname = \"tension\"\nexpr = \"command\"\nfixed = 1.0\n"
    );
    let rows = rows as usize;
    let time = (0..columns[0].len()).map(|i| (i % rows) as f64 * dt);
    let names = ["target", "command", "velocity", "angle"];
    let data = Data::from_columns(time.collect(), names.into_iter().zip(columns))
        .sequences((0..runs as usize).map(|run| run * rows..(run + 1) * rows))
        .build()
        .unwrap();
    let report = analyse(&Spec::parse(&model).unwrap(), data, &mut ()).unwrap();
    ["damping", "delay"].map(|name| report.effects.iter().find_map(|e| e.ci.get(name).copied()))
}

fn width(interval: Option<[f64; 2]>) -> f64 {
    let [low, high] = interval.expect("the effect is found");
    high - low
}

/// Where the command changes with the motion, damping is known as well as the delay, and no better.
#[test]
fn an_interval_is_wider_where_another_effect_is_late_by_an_unknown_time() {
    let both = |together: f64| {
        let target = |r: &Row| r.late + DAMPING * r.velocity;
        intervals("\"viscous\", \"delay\"", together, target)[0]
    };
    let alone = |together: f64| {
        let target = |r: &Row| r.command + DAMPING * r.velocity;
        intervals("\"viscous\"", together, target)[0]
    };
    let apart = width(both(0.0)) / width(alone(0.0));
    let together = width(both(3.0)) / width(alone(3.0));
    assert!(apart < 1.3, "{apart}");
    assert!(together > 2.0, "{together}");
}

/// The catalogue of this test has friction that changes at once only.
#[test]
fn an_interval_allows_for_friction_that_turns_over_otherwise() {
    let target = |r: &Row| r.late + FRICTION * r.turning;
    let [_, delay] = intervals("\"coulomb\", \"delay\"", 1.0, target);
    let [low, high] = delay.expect("the delay is found");
    assert!(low <= LATE_S && LATE_S <= high, "{low} to {high}");
    assert!(high - low < 0.5 * LATE_S, "{low} to {high}");
}

/// Width of the interval of an offset in noise, over the size of the noise.
fn of_slow(slow: f64) -> f64 {
    let report: Report = simulate(
        &Excitation {
            slow,
            ..Excitation::default()
        },
        3.0,
        &mut |_| 1.0,
    );
    let offset = report.effects.iter().find(|e| e.name == "offset");
    let [low, high] = offset.expect("the offset is found").ci["offset"];
    high - low
}

#[test]
fn slow_noise_makes_intervals_wider() {
    let (white, slow) = (of_slow(0.0), of_slow(0.9));
    assert!(slow > 2.0 * white, "{white} {slow}");
}

/// A drift that differs from sequence to sequence only: five sequences say that much and no more.
#[test]
fn what_differs_from_sequence_to_sequence_makes_intervals_wider() {
    let of_drift = |drift: f64| {
        let (runs, rows) = (5, 1000);
        let mut rng = Rng::new(5);
        let levels: Vec<f64> = (0..runs).map(|_| 0.5 + drift * rng.normal()).collect();
        let target = (0..runs * rows)
            .map(|i| levels[i / rows] + 0.05 * rng.normal())
            .collect();
        let time = (0..runs * rows).map(|i| (i % rows) as f64 * 0.01).collect();
        let command = (0..runs * rows).map(|i| (i as f64 * 0.02).sin()).collect();
        let model = "roles.time = { column = \"t\", unit = \"s\" }\n\
             roles.target = { column = \"y\", unit = \"N\" }\n\
             roles.command = { column = \"u\", unit = \"N\" }\n\
             [selection]\nonly = [\"offset\"]\n\
             [[terms]]\nname = \"gain\"\nexpr = \"command\"\n";
        let data = Data::from_columns(time, [("command", command), ("target", target)])
            .sequences((0..runs).map(|run| run * rows..(run + 1) * rows))
            .build()
            .unwrap();
        let spec = Spec::parse(model).unwrap();
        let report = analyse(&spec, data, &mut ()).unwrap();
        let [low, high] = report.effects[0].ci["offset"];
        (high - low, levels.iter().sum::<f64>() / runs as f64, report)
    };
    let (same, ..) = of_drift(0.0);
    let (wide, mean, report) = of_drift(0.1);
    assert!(wide > 10.0 * same, "{same} {wide}");
    // Twice Student's quantile for four degrees of freedom times the error of the mean of five
    // levels, about.
    let [low, high] = report.effects[0].ci["offset"];
    assert!(
        low < mean && mean < high && wide > 0.1 && wide < 0.5,
        "{low} {high} {mean}"
    );
}
