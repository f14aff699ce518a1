//! How many seconds of the fast rig pass in a second of the clock.
//!
//! `cargo run --release -p host-cli --example speed [SECONDS]`
//!
//! Prints two figures, each with the prescribed path and with the virtual arm: the rig alone (six units sample, the machine
//! supervises, the robot moves), and a whole run as `forcectl` does it, with the host's allocation and controller at 100 Hz.

use core_sim::Options;
use host_cli::link::fast::FastRig;
use host_cli::link::RigLink;
use host_cli::rigfile::RigFile;
use host_cli::run::{self, NoopObserver};
use robot::arm::ArmConfig;
use robot::trajectory::{Trajectory, TrajectoryConfig};
use std::process::ExitCode;
use std::time::{Duration, Instant};

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

fn whole(seconds: f64, arm: bool) -> Result<f64, String> {
    let file = RigFile::built_in().map_err(|error| error.to_string())?;
    let mut link = rig(1, seconds, arm)?;
    let began = Instant::now();
    let options = run::Options::new([0.0, 2.5, 0.0], seconds);
    let outcome = run::set_force(&mut link, &file, &options, &mut NoopObserver)
        .map_err(|error| error.to_string())?;
    let wall = began.elapsed().as_secs_f64();
    let passed = link
        .exchange(&[], Duration::ZERO)
        .map_err(|error| error.to_string())?
        .now_ns;
    let metrics = outcome.metrics.ok_or("the run was too short")?;
    println!(
        "whole run, {:<18} {:7.1} s of the rig in {wall:5.2} s: {:6.1} x real time; tension RMS, worst cable {:.3} N, steady force error {:.3} N",
        if arm { "virtual arm," } else { "prescribed path," },
        passed as f64 * 1e-9,
        passed as f64 * 1e-9 / wall,
        metrics.tension_rms_n.iter().copied().fold(0.0, f64::max),
        metrics.tip_force_error_n,
    );
    Ok(passed as f64 * 1e-9 / wall)
}

/// The rig without a host: converters sample, the machine supervises, the robot moves.
fn alone(seconds: f64, arm: bool) -> Result<f64, String> {
    let mut link = rig(1, seconds, arm)?;
    let began = Instant::now();
    let error = |error: host_cli::link::LinkError| error.to_string();
    if let Some(controls) = link.controls() {
        controls.robot(true).map_err(error)?;
    }
    for _ in 0..(seconds * 100.0) as u64 {
        link.exchange(&[], Duration::from_millis(10))
            .map_err(error)?;
    }
    let wall = began.elapsed().as_secs_f64();
    println!(
        "no host,   {:<18} {seconds:7.1} s of the rig in {wall:5.2} s: {:6.1} x real time",
        if arm {
            "virtual arm,"
        } else {
            "prescribed path,"
        },
        seconds / wall
    );
    Ok(seconds / wall)
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
        if let Err(error) = alone(seconds, arm).and_then(|_| whole(seconds, arm)) {
            eprintln!("{error}");
            return ExitCode::FAILURE;
        }
    }
    ExitCode::SUCCESS
}
