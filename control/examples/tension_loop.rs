//! Tension error of six controllers on the plant while the robot's tip moves; for tuning.
//!
//! `cargo run -p control --example tension_loop -- ff=0 ki=30 ea=3000`
//!
//! Prints RMS over all cables, the worst cable's RMS and the largest error, in N. Keys: `kp`,
//! `ki`, `leaky`, `kd`, `damping` (N, s, m), `ff` (0 or 1), `reversal` (um), `corner` (Hz) or
//! `average` (samples), `slew` (N/s); `coulomb` (N), `per_load` (N per N), `offset` (N), `gain`,
//! `viscous` (N s/m), `ripple` (N, motor's order 1); of the plant `ea` (cable, N), `gives` (robot,
//! mm/N), `speed` (robot, mm/s), `breakaway` (ratio), `presliding` (um), `level` (friction,
//! factor), and what it does beyond the model: `more_coulomb` (N), `more_viscous` (N s/m),
//! `more_ripple` (N), `more_gain` (part), `delay` (ms); of what the host knows of the robot `pose`
//! (noise of a dVRK's poses, um) or `raven` (1); `seconds`, `seeds`, `from` (first seed).
//!
//! `table` alone, or with `seconds`, `seeds`, `from`: plants that differ from the declared one by
//! what the host knows of the robot, and how long steps of force take while the tip moves.

#[path = "../tests/common/plants.rs"]
mod plants;
#[path = "../tests/common/preview.rs"]
mod preview;
#[path = "../tests/common/rig.rs"]
mod rig;

use control::unit::Drive;
use control::Config;
use plant::effects::{AmplifierGain, CommandDelay, Coulomb, Effect, Periodic, Shaft, Viscous};
use plant::PlantConfig;
use preview::{Host, Poses};
use std::process::ExitCode;
use wire::message::{FilterChoice, UnitConfig};

/// RMS over all cables, RMS of the worst, largest error, N, over seeds.
fn figures(
    plant: &PlantConfig,
    wire: &UnitConfig,
    poses: Option<Poses>,
    (from, seeds, seconds): (u64, u64, f64),
) -> (f64, f64, f64) {
    let errors: Vec<(f64, f64)> = (from..from + seeds)
        .flat_map(|seed| {
            let mut host = None;
            rig::errors_with(plant.clone(), seed, wire, seconds, |rig| {
                if let Some(poses) = poses {
                    host.get_or_insert_with(|| Host::new(poses, rig, seed))
                        .step(rig);
                }
            })
        })
        .collect();
    let rms = (errors.iter().map(|(r, _)| r * r).sum::<f64>() / errors.len() as f64).sqrt();
    let worst = errors.iter().map(|e| e.0).fold(0.0, f64::max);
    (rms, worst, errors.iter().map(|e| e.1).fold(0.0, f64::max))
}

/// Force that counts as settled, and for how long an error has to stay within it, as in
/// `host/force/src/metrics.rs`.
const BAND_N: f64 = 0.125;
const HOLD_S: f64 = 0.5;

/// Steps of all six tensions by 2.5 N, up and down, while the tip moves: how long each takes until
/// no tension is further off than the band for half a second, s. The setpoints ramp as the host's
/// do.
fn settling(seed: u64, steps: u32, poses: Option<Poses>) -> Vec<f64> {
    const SLEW_N_PER_S: f64 = 20.0;
    const EVERY_S: f64 = 2.0;
    let mut rig = rig::Rig::new(PlantConfig::default(), seed, &Config::nominal());
    let mut host = poses.map(|poses| Host::new(poses, &rig, seed));
    let start = rig.time_s();
    let mut held = 3.0;
    let mut last_off = 0.0;
    let mut times = Vec::new();
    for unit in &mut rig.units {
        unit.drive = Drive::Follow;
    }
    rig.plant.set_robot_moving(true);
    while times.len() < steps as usize {
        let t = rig.time_s() - start;
        let step = ((t - 4.0) / EVERY_S).max(0.0);
        let goal = if (step as u32).is_multiple_of(2) {
            3.0
        } else {
            5.5
        };
        let goal = if t < 4.0 { 3.0 } else { 8.5 - goal };
        let ramp = SLEW_N_PER_S * rig::STEP_US as f64 * 1e-6;
        held += f64::clamp(goal - held, -ramp, ramp);
        rig.units.iter_mut().for_each(|unit| unit.setpoint_n = held);
        if let Some(host) = &mut host {
            host.step(&mut rig);
        }
        rig.advance(|_, _, _| {});
        if t < 4.0 {
            continue;
        }
        let since = step.fract() * EVERY_S;
        if step as usize > times.len() {
            times.push(last_off);
            last_off = 0.0;
        }
        let worst = (0..6)
            .map(|i| (rig.plant.tension_n(i) - goal).abs())
            .fold(0.0, f64::max);
        // As the metrics see it: half a second within the band ends it.
        if worst > BAND_N && since - last_off < HOLD_S {
            last_off = since;
        }
    }
    times
}

fn table(seeds: (u64, u64, f64)) {
    let known = [
        ("encoder alone", None),
        ("Raven, 1 kHz", Some(Poses::RAVEN)),
        ("100 Hz, no noise", Some(Poses::dvrk(0.0, 0.0))),
        ("100 Hz, 2 um", Some(Poses::dvrk(2e-6, 0.0))),
        ("2 um, 0.1 ms", Some(Poses::dvrk(2e-6, 100.0))),
        ("2 um, 1 ms", Some(Poses::dvrk(2e-6, 1_000.0))),
        ("100 Hz, 5 um", Some(Poses::dvrk(5e-6, 0.0))),
        ("100 Hz, 8 um", Some(Poses::dvrk(8e-6, 0.0))),
        ("100 Hz, 10 um", Some(Poses::dvrk(1e-5, 0.0))),
    ];
    println!("RMS of all cables / worst cable / largest error, N");
    for (name, plant) in plants::all() {
        println!("{name}");
        for (known, poses) in known {
            let (rms, worst, peak) = figures(&plant, &Config::nominal(), poses, seeds);
            println!("  {known:16} {rms:.4} / {worst:.4} / {peak:.3}");
        }
    }
    println!(
        "steps of force while the tip moves: longest, s, and how many of 30 take longer than 0.5 s"
    );
    for (known, poses) in known {
        let times: Vec<f64> = (seeds.0..seeds.0 + 5)
            .flat_map(|seed| settling(seed, 6, poses))
            .collect();
        let longest = times.iter().fold(0.0, |a: f64, b| a.max(*b));
        let late = times.iter().filter(|t| **t > 0.5).count();
        println!("  {known:16} {longest:.3}   {late}");
    }
}

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let mut wire = Config::nominal();
    let mut plant = plant::PlantConfig::default();
    let (mut seconds, mut seeds, mut from) = (20.0, 1, 1);
    let mut poses = None;
    for arg in args.iter().filter(|arg| *arg != "table") {
        let Some((key, Ok(value))) = arg.split_once('=').map(|(k, v)| (k, v.parse::<f64>())) else {
            eprintln!(
                "{arg}: expected key=number; see the head of this example's source for the keys"
            );
            return ExitCode::from(2);
        };
        let q16 = (value * 65_536.0) as i32;
        match key {
            "kp" => wire.kp_q16 = q16,
            "ki" => wire.ki_q16 = q16,
            "leaky" => wire.leaky_ki_q16 = q16,
            "kd" => wire.kd_q16 = q16,
            "damping" => wire.damping_q16 = q16,
            "ff" => wire.friction_feedforward = value > 0.0,
            "reversal" => wire.reversal_nm = (value * 1e3) as i32,
            "corner" => {
                wire.filter = FilterChoice::LowPass {
                    corner_chz: (value * 100.0) as u16,
                }
            }
            "average" => wire.filter = FilterChoice::MovingAverage(value as u8),
            "slew" => wire.slew_un_per_s = (value * 1e6) as i32,
            "coulomb" => wire.coulomb_un = (value * 1e6) as i32,
            "per_load" => wire.coulomb_load_q16 = q16,
            "offset" => wire.friction_offset_un = (value * 1e6) as i32,
            "gain" => wire.friction_gain_q16 = q16,
            "viscous" => wire.viscous_q16 = q16,
            "ripple" => {
                // Counts fall while winding in, so the plant's rising angle is their falling one.
                let per_turn = -4_294_967_296.0 / 4_000.0;
                wire.ripples[0].periods_per_count_q32 = per_turn as i32;
                wire.ripples[0].amplitude_un = (value * 1e6) as i32;
            }
            "more_coulomb" => plant.effects.push(Effect::Coulomb(Coulomb {
                units: vec![],
                constant_n: value,
                per_load: 0.0,
            })),
            "more_viscous" => plant.effects.push(Effect::Viscous(Viscous {
                units: vec![],
                coefficient_n_s_per_m: value,
            })),
            "more_ripple" => plant.effects.push(Effect::Periodic(Periodic {
                units: vec![],
                shaft: Shaft::Motor,
                order: 1.0,
                amplitude_n: value,
                phase_rad: 0.0,
            })),
            "more_gain" => plant.effects.push(Effect::AmplifierGain(AmplifierGain {
                units: vec![],
                relative_error: value,
            })),
            "delay" => plant.effects.push(Effect::CommandDelay(CommandDelay {
                units: vec![],
                delay_s: value * 1e-3,
            })),
            "ea" => plant.cable.axial_stiffness_n = value,
            "speed" => {
                if let plant::config::PathConfig::Random(path) = &mut plant.robot.path {
                    path.rms_speed_m_per_s = value * 1e-3;
                }
            }
            "gives" => plant.robot.tip_compliance_m_per_n = value * 1e-3,
            "breakaway" => plant.friction.breakaway_ratio = value,
            "level" => {
                plant.friction.coulomb_n *= value;
                plant.friction.per_load *= value;
            }
            "presliding" => plant.friction.presliding_m = value * 1e-6,
            "pose" => poses = Some(Poses::dvrk(value * 1e-6, 0.0)),
            "raven" => poses = (value > 0.0).then_some(Poses::RAVEN),
            "from" => from = value as u64,
            "seconds" => seconds = value,
            "seeds" => seeds = value as u64,
            _ => {
                eprintln!("{key}: is not a key; see the head of this example's source");
                return ExitCode::from(2);
            }
        }
    }
    if let Err(e) = Config::from_wire(&wire) {
        eprintln!("{e}");
        return ExitCode::from(2);
    }
    let seeds = (from, seeds, seconds);
    if args.iter().any(|arg| arg == "table") {
        table(seeds);
        return ExitCode::SUCCESS;
    }
    let (rms, worst, peak) = figures(&plant, &wire, poses, seeds);
    println!(
        "{} rms {rms:.4} worst {worst:.4} peak {peak:.3}",
        args.join(" ")
    );
    ExitCode::SUCCESS
}
