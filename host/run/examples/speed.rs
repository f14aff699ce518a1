//! How many seconds of the fast rig pass in a second of the clock.
//!
//! `cargo run --release -p run --example speed [SECONDS]`
//!
//! Prints two figures, each with the prescribed path and with the virtual arm: the rig alone (six
//! units sample, the machine supervises, the robot moves), and a whole run as `forcectl` does it,
//! with the host's allocation and controller at 100 Hz. The second factor counts the processor's
//! time instead of the clock's (Linux): what the run would reach with a core of its own.

use core_sim::Options;
use rig::Rig;
use robot::arm::ArmConfig;
use robot::trajectory::{Trajectory, TrajectoryConfig};
use run::NoopObserver;
use session::link::fast::FastRig;
use session::link::RigLink;
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// Time that the processor has spent on this thread, s; `None` where the system does not tell.
fn processor_s() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    let ns: f64 = text.split_whitespace().next()?.parse().ok()?;
    Some(ns * 1e-9)
}

/// Measures time on the clock and of the processor.
struct Stopwatch {
    began: Instant,
    processor_s: Option<f64>,
}

impl Stopwatch {
    fn start() -> Self {
        Self {
            began: Instant::now(),
            processor_s: processor_s(),
        }
    }

    /// How `seconds` of the rig compare with the time since the start.
    fn compare(&self, seconds: f64) -> String {
        let wall_s = self.began.elapsed().as_secs_f64();
        let processor = self
            .processor_s
            .zip(processor_s())
            .map_or_else(String::new, |(from, to)| {
                format!(", {:6.1} x by processor time", seconds / (to - from))
            });
        format!(
            "{seconds:7.1} s of the rig in {wall_s:5.2} s: {:6.1} x real time{processor}",
            seconds / wall_s
        )
    }
}

/// A rig with an arm that has reached the start of a trajectory.
fn rig(seed: u64, seconds: f64, arm: bool) -> Result<FastRig, String> {
    let trajectory = TrajectoryConfig {
        duration_s: seconds + 60.0,
        ..TrajectoryConfig::default()
    };
    let trajectory = Trajectory::new(&trajectory, seed).map_err(|error| error.to_string())?;
    let config = ArmConfig {
        start: trajectory.at(0.0).position,
        ..ArmConfig::default()
    };
    let mut rig = FastRig::with(Options {
        seed,
        robot: arm.then_some(config),
        ..Options::default()
    })
    .map_err(|error| error.to_string())?;
    if let Some(arm) = rig.arm_mut() {
        arm.follow(trajectory);
    }
    Ok(rig)
}

fn whole(seconds: f64, arm: bool) -> Result<(), String> {
    let file = Rig::built_in().map_err(|error| error.to_string())?;
    let mut link = rig(1, seconds, arm)?;
    let watch = Stopwatch::start();
    let options = run::Options::new([0.0, 2.5, 0.0], seconds);
    let outcome = run::set_force(&mut link, &file, &options, &mut NoopObserver)
        .map_err(|error| error.to_string())?;
    let passed = link
        .exchange(&[], Duration::ZERO)
        .map_err(|error| error.to_string())?
        .now_ns;
    let metrics = outcome.metrics.ok_or("the run was too short")?;
    println!(
        "whole run, {:<18} {}; tension RMS, worst cable {:.3} N, steady force error {:.3} N",
        if arm {
            "virtual arm,"
        } else {
            "prescribed path,"
        },
        watch.compare(passed as f64 * 1e-9),
        metrics.tension_rms_n.iter().copied().fold(0.0, f64::max),
        metrics.tip_force_error_n,
    );
    Ok(())
}

/// The rig without a host: converters sample, the machine supervises, the robot moves.
fn alone(seconds: f64, arm: bool) -> Result<(), String> {
    let mut link = rig(1, seconds, arm)?;
    let watch = Stopwatch::start();
    let error = |error: session::link::LinkError| error.to_string();
    if let Some(controls) = link.controls() {
        controls.robot(true).map_err(error)?;
    }
    for _ in 0..(seconds * 100.0) as u64 {
        link.exchange(&[], Duration::from_millis(10))
            .map_err(error)?;
    }
    println!(
        "no host,   {:<18} {}",
        if arm {
            "virtual arm,"
        } else {
            "prescribed path,"
        },
        watch.compare(seconds)
    );
    Ok(())
}

fn main() -> ExitCode {
    let seconds = match std::env::args().nth(1).map(|text| text.parse::<f64>()) {
        None => 60.0,
        Some(Ok(seconds)) if (1.0..=36_000.0).contains(&seconds) => seconds,
        Some(_) => {
            eprintln!("usage: speed [SECONDS], 1 to 36000");
            return ExitCode::from(2);
        }
    };
    for arm in [false, true] {
        if let Err(error) = alone(seconds, arm).and_then(|()| whole(seconds, arm)) {
            eprintln!("{error}");
            return ExitCode::FAILURE;
        }
    }
    ExitCode::SUCCESS
}
