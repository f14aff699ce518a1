//! A small rig for the tests of the catalogue: eight runs of 40 s at 50 rows a second, smooth
//! random motion, a command that wanders and steps, coloured and white noise.

use residual::analyse;
use residual::Report;
use residual::Verdict;
use residual_columns::frame::Frame;
use residual_columns::stats::Rng;
use residual_effects::Context;
use residual_fit::problem::Problem;
use residual_log::data::Data;
use residual_log::spec::Spec;
use residual_search::model::{Fit, Fitted, Model};
use residual_search::scan::Scan;

/// One row of the simulated rig, before the target is formed.
pub struct Row<'a> {
    pub first: bool,
    pub group: u32,
    pub dt: f64,
    pub elapsed: f64,
    pub command: f64,
    pub velocity: f64,
    pub acceleration: f64,
    pub angle: f64,
    pub pose: f64,
    pub temperature: f64,
    pub neighbour: f64,
    wander: &'a [(f64, f64, f64)],
}

impl Row<'_> {
    /// The command at another time of the run.
    pub fn command_at(&self, t: f64) -> f64 {
        command(self.wander, t)
    }
}

fn command(w: &[(f64, f64, f64)], t: f64) -> f64 {
    3.0 + w.iter().map(|(a, f, p)| a * (f * t + p).sin()).sum::<f64>()
}

/// What differs from the usual run.
#[derive(Clone)]
pub struct Excitation {
    pub declare_coulomb: bool,
    pub stops: bool,
    pub metres: bool,
    /// Whether the motion repeats every 2.5 s: a sine of 0.4 Hz, cut at both ends.
    pub repeats: bool,
    /// Whether a controller on the measured target drives the command, with the setpoint logged.
    pub closed: bool,
    pub seed: u64,
    /// RMS of the noise.
    pub noise: f64,
    /// Share of the noise's variance that is slow.
    pub slow: f64,
}

impl Default for Excitation {
    fn default() -> Self {
        Excitation {
            declare_coulomb: false,
            stops: false,
            metres: false,
            repeats: false,
            closed: false,
            seed: 1,
            noise: 0.1,
            slow: 0.3,
        }
    }
}

/// Shape of the simulated data: groups, rows in each, step in s.
const SHAPE: (u32, usize, f64) = (8, 2000, 0.02);

/// Runs `visit` over the rows of every group.
pub fn rows_of(x: &Excitation, visit: &mut dyn FnMut(&Row)) {
    let (groups, rows, dt) = SHAPE;
    let mut rng = Rng::new(x.seed);
    for group in 0..groups {
        let mut draw = |n: usize, a: f64, lo: f64, hi: f64| -> Vec<(f64, f64, f64)> {
            (0..n)
                .map(|_| {
                    (
                        a * (0.5 + rng.uniform()),
                        lo * (hi / lo).powf(rng.uniform()),
                        rng.uniform() * 6.3,
                    )
                })
                .collect()
        };
        let wander = draw(5, 0.45, 0.3, 9.0);
        let motion = draw(4, 0.5, 0.5, 5.0);
        let poses = draw(2, 0.5, 0.1, 0.8);
        let other = draw(4, 0.6, 0.2, 6.0);
        let warm = draw(2, 1.5, 0.03, 0.2);
        let mut angle = 0.0;
        for i in 0..rows {
            let t = i as f64 * dt;
            let mut v: f64 = motion.iter().map(|(a, f, p)| a * (f * t + p).sin()).sum();
            let acceleration: f64 = motion
                .iter()
                .map(|(a, f, p)| a * f * (f * t + p).cos())
                .sum();
            if x.repeats {
                v = (std::f64::consts::TAU * 0.4 * t).sin().clamp(-0.7, 0.7);
            }
            if x.stops && (t * 0.7 + f64::from(group)).sin() > 0.3 {
                v = 0.0;
            }
            angle += 6.0 * v * dt;
            visit(&Row {
                first: i == 0,
                group,
                dt,
                elapsed: t,
                command: command(&wander, t),
                velocity: v,
                acceleration,
                angle,
                pose: poses.iter().map(|(a, f, p)| a * (f * t + p).sin()).sum(),
                temperature: 25.0
                    + warm
                        .iter()
                        .map(|(a, f, p)| a * (f * t + p).sin())
                        .sum::<f64>(),
                neighbour: other.iter().map(|(a, f, p)| a * (f * t + p).sin()).sum(),
                wander: &wander,
            });
        }
    }
}

/// Calls `look` with what the effects know of columns, whose first is the target, in runs of `rows`
/// rows 0.02 s apart.
pub fn knowing(spec: &str, columns: &[(&str, Vec<f64>)], rows: usize, look: impl FnOnce(&Context)) {
    let n = columns[0].1.len();
    let time = (0..n).map(|i| 0.02 * i as f64).collect();
    let named = columns
        .iter()
        .map(|(name, c)| (name.to_string(), c.clone()));
    let runs = (0..n / rows).map(|k| k * rows..(k + 1) * rows).collect();
    let frame = Frame::new(named.collect(), time, runs);
    let fold: Vec<u32> = (0..n).map(|i| (i / rows) as u32).collect();
    let problem = Problem::new(frame, &vec![true; n], &fold, 8, 1);
    let spec = Spec::parse(spec).expect("the test model is valid");
    let model = Model::declared(&spec).expect("its terms are valid");
    let fit = Fit::new(&problem, &model).expect("its terms can be fitted");
    let fitted = Fitted { model, fit };
    look(&Scan::new(&problem, &spec, "command", &fitted).context());
}

/// The declared model: force is command, with Coulomb friction if the excitation says so.
fn model(x: &Excitation) -> Spec {
    let unit = if x.metres { "m/s" } else { "rad/s" };
    let friction = if x.declare_coulomb {
        "[[terms]]\nname = \"f\"\nexpr = \"sign(velocity)\"\n"
    } else {
        ""
    };
    let setpoint = if x.closed {
        "setpoint = { column = \"s\", unit = \"N\" }\n"
    } else {
        ""
    };
    let angle = if x.metres {
        ""
    } else {
        "angle = { column = \"angle\", unit = \"rad\" }\n"
    };
    Spec::parse(&format!(
        "[roles]\ntime = {{ column = \"t\" }}\ntarget = {{ column = \"y\", unit = \"N\" }}\n\
         command = {{ column = \"c\", unit = \"N\" }}\nvelocity = {{ column = \"v\", unit = \"{unit}\" }}\n{angle}{setpoint}\
         temperature = {{ column = \"T\", unit = \"K\" }}\npose.pose_a = {{ column = \"p\", unit = \"rad\" }}\n\
         channels.neighbour = {{ column = \"n\", unit = \"N\" }}\n\
         [[terms]]\nname = \"tension\"\nexpr = \"command\"\nfixed = 1.0\n{friction}"
    ))
    .expect("the test model is valid")
}

/// Simulates with `effect` added to the declared model, scaled by `scale`.
pub fn simulate(x: &Excitation, scale: f64, effect: &mut dyn FnMut(&Row) -> f64) -> Report {
    let (groups, rows, _) = SHAPE;
    let mut rng = Rng::new(x.seed ^ 0x0d15_ea5e);
    let names = [
        "setpoint",
        "command",
        "velocity",
        "angle",
        "pose_a",
        "temperature",
        "neighbour",
        "target",
    ];
    let mut cols: Vec<Vec<f64>> = names.iter().map(|_| vec![]).collect();
    let mut time = vec![];
    let white = x.noise * (1.0 - x.slow).sqrt();
    let rho = 0.98f64;
    let mut slow = 0.0;
    let (mut integral, mut correction) = (0.0, 0.0);
    rows_of(x, &mut |row| {
        if row.first {
            slow = 0.0;
            (integral, correction) = (0.0, 0.0);
        }
        let setpoint = row.command;
        let row = &Row {
            command: setpoint + correction,
            ..*row
        };
        slow = rho * slow + (1.0 - rho * rho).sqrt() * rng.normal();
        let v = row.velocity;
        let friction = if x.declare_coulomb { dry(v) } else { 0.0 };
        let y = row.command
            + friction
            + scale * effect(row)
            + white * rng.normal()
            + x.noise * x.slow.sqrt() * slow;
        if x.closed {
            let error: f64 = setpoint - y;
            integral += 3.0 * error * row.dt;
            correction = 0.2 * error + integral;
        }
        let values = [
            setpoint,
            row.command,
            v,
            row.angle,
            row.pose,
            row.temperature,
            row.neighbour,
            y,
        ];
        cols.iter_mut().zip(values).for_each(|(c, v)| c.push(v));
        time.push(row.elapsed);
    });
    let sequences = (0..groups as usize).map(|g| g * rows..(g + 1) * rows);
    let data = Data::from_columns(time, names.iter().copied().zip(cols))
        .sequences(sequences)
        .build()
        .expect("the simulated columns are valid");
    analyse(&model(x), data, &mut ()).expect("the analysis runs")
}

/// Dry friction of the rig.
fn dry(velocity: f64) -> f64 {
    if velocity == 0.0 {
        0.0
    } else {
        -0.6 * velocity.signum()
    }
}

/// A characteristic of the sensor, here what it adds to a force, must be the only effect: it
/// changes the declared friction as well.
pub fn acts_on_all_force(effect: &str, mut f: impl FnMut(f64, &Row) -> f64) {
    let excitation = Excitation {
        declare_coulomb: true,
        ..Excitation::default()
    };
    let report = simulate(&excitation, 1.0, &mut |s| f(s.command + dry(s.velocity), s));
    let found: Vec<_> = report
        .effects
        .iter()
        .map(|e| (e.name.as_str(), e.form.contains("all force")))
        .collect();
    assert_eq!(found, [(effect, true)], "{}", report.markdown());
    assert_eq!(report.verdict, Verdict::Effect, "{}", report.markdown());
}

/// The effect must be named first, and bring the error down to the noise.
pub fn names(effect: &str, f: impl FnMut(&Row) -> f64) {
    names_with(effect, Excitation::default(), f);
}

/// As [`names`], with another excitation.
pub fn names_with(effect: &str, x: Excitation, mut f: impl FnMut(&Row) -> f64) {
    let report = simulate(&x, 1.0, &mut f);
    let found: Vec<&str> = report.effects.iter().map(|e| e.name.as_str()).collect();
    assert_eq!(
        found.first().copied(),
        Some(effect),
        "{}\n{}",
        report.summary(),
        report.markdown()
    );
    assert!(
        matches!(report.verdict, Verdict::Effect | Verdict::Several)
            || effect == "backlash" && report.verdict == Verdict::NotIdentifiable,
        "{}",
        report.markdown()
    );
    assert!(
        report.last.heldout_rmse < 1.12 * x.noise,
        "{}",
        report.markdown()
    );
}
