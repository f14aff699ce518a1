//! Tension error of six controllers on the plant while the robot's tip moves; for tuning.
//!
//! `cargo run -p control --example tension_loop -- ff=0 ki=30 ea=3000`
//!
//! Prints RMS over all cables, the worst cable's RMS and the largest error, in N. Keys: `kp`, `ki`, `kd`,
//! `damping` (N, s, m), `ff` (0 or 1), `reversal` (um), `corner` (Hz) or `average` (samples), `slew` (N/s);
//! `coulomb` (N), `gain`, `viscous` (N s/m), `ripple` (N, motor's order 1); of the plant `ea` (cable, N), `breakaway`
//! (ratio), `presliding` (um), `level` (friction, factor), and what it does beyond the model: `more_coulomb` (N), `more_viscous` (N s/m),
//! `more_ripple` (N), `more_gain` (part), `delay` (ms); `seconds`, `seeds`.

#[path = "../tests/common/rig.rs"]
mod rig;

use control::Config;
use plant::effects::{AmplifierGain, CommandDelay, Coulomb, Effect, Periodic, Shaft, Viscous};
use std::process::ExitCode;
use wire::message::FilterChoice;

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let mut wire = Config::nominal();
    let mut plant = plant::PlantConfig::default();
    let (mut seconds, mut seeds) = (20.0, 1);
    for arg in &args {
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
            "breakaway" => plant.friction.breakaway_ratio = value,
            "level" => {
                plant.friction.coulomb_n *= value;
                plant.friction.per_load *= value;
            }
            "presliding" => plant.friction.presliding_m = value * 1e-6,
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
    let errors: Vec<(f64, f64)> = (1..=seeds)
        .flat_map(|seed| rig::tension_errors(plant.clone(), seed, &wire, seconds))
        .collect();
    let rms = (errors.iter().map(|(r, _)| r * r).sum::<f64>() / errors.len() as f64).sqrt();
    let worst = errors.iter().map(|e| e.0).fold(0.0, f64::max);
    let peak = errors.iter().map(|e| e.1).fold(0.0, f64::max);
    println!(
        "{} rms {rms:.4} worst {worst:.4} peak {peak:.3}",
        args.join(" ")
    );
    ExitCode::SUCCESS
}
