//! How much faster than real time the default rig runs on this machine, on one core.
//!
//! `cargo run -p plant --release --example throughput`

use plant::{Plant, PlantConfig};
use std::error::Error;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let mut plant = Plant::new(PlantConfig::default(), 1)?;
    plant.set_amplifier_power(true);
    plant.set_robot_moving(true);
    for unit in 0..plant.units() {
        plant.set_amplifier_volts(unit, 0.4)?;
    }
    let (start, seconds) = (Instant::now(), 60_u64);
    let mut sum = 0.0;
    // Six units at 320 samples a second, each reading its bridge.
    for sample in 1..=seconds * 1920 {
        plant.advance_to(sample * 1_000_000_000 / 1920);
        sum += plant.bridge_v_per_v((sample % 6) as usize);
    }
    let wall = start.elapsed().as_secs_f64();
    println!(
        "{seconds} s of {} units in {wall:.3} s: {:.0} times real time (mean bridge output {:.6} mV/V)",
        plant.units(),
        seconds as f64 / wall,
        1e3 * sum / (seconds * 1920) as f64
    );
    Ok(())
}
