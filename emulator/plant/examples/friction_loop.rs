//! Draws the force-gauge experiment: tension over time and over cable travel, while a tip pulls
//! cable out and lets it in at constant commands. Writes `friction_loop.svg` to the folder given
//! (default: the current one).
//!
//! `cargo run -p plant --release --example friction_loop -- target`

use plant::config::{PathConfig, SweepPath, UnitConfig};
use plant::{Plant, PlantConfig};
use scene::{color, Axes, Scene};
use std::error::Error;

const PULLS_N: [f64; 4] = [2.2, 4.0, 8.0, 12.0];

/// Time s, travel mm, tension N, reel speed mm/s.
type Row = [f64; 4];

fn sweep(pull_n: f64) -> Result<(Vec<Row>, [f64; 2]), Box<dyn Error>> {
    let mut config = PlantConfig::default();
    let center = config.robot.workspace_center_m;
    config.units = vec![UnitConfig {
        position_m: [center[0] + 0.4, center[1], center[2]],
        axis_tilt_rad: [0.0; 2],
    }];
    config.robot.path = PathConfig::Sweep(SweepPath {
        direction: [-1.0, 0.0, 0.0],
        amplitude_m: 0.008,
        speed_m_per_s: 0.005,
    });
    let volts = pull_n / config.drive.tension_per_current_n_per_a() / config.amplifier.gain_a_per_v;
    let mut plant = Plant::new(config, 1)?;
    plant.set_amplifier_power(true);
    plant.set_amplifier_volts(0, volts)?;
    plant.advance_to(500_000_000);
    plant.set_robot_moving(true);
    let mut rows = Vec::new();
    for tick in 0..5_600_u64 {
        plant.advance_to(tick * 2_000_000);
        let travel = plant.tip_position_m()[0] - center[0];
        rows.push([
            tick as f64 * 2e-3,
            -1e3 * travel,
            plant.tension_n(0),
            plant.reel_rad_per_s(0) * 10.0,
        ]);
    }
    let p = plant.parameters(0);
    let middle = p.offset_n + p.gain * pull_n;
    let half = p.coulomb_n + p.per_load * pull_n;
    Ok((rows, [middle - half, middle + half]))
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).unwrap_or_else(|| ".".into());
    let axes = |left, top, width, x, y| Axes {
        left,
        top,
        width,
        height: 300.0,
        x,
        y,
    };
    let tension_n = (0.0, 16.0);
    let time = axes(60.0, 50.0, 560.0, (0.0, 12.0), tension_n);
    let travel = axes(690.0, 50.0, 380.0, (-10.0, 10.0), tension_n);
    let speed = axes(60.0, 430.0, 560.0, (0.0, 12.0), (-10.0, 10.0));
    let mut scene = Scene::new(1100.0, 790.0);
    for (axes, title, x_words) in [
        (
            &time,
            "cable tension, N (dashed: band of the drawn friction law)",
            "time, s",
        ),
        (
            &travel,
            "cable tension, N",
            "tip travel away from the unit, mm",
        ),
        (
            &speed,
            "cable speed at the reel, mm/s, positive winding in",
            "time, s",
        ),
    ] {
        axes.grid(&mut scene);
        axes.draw(&mut scene, title, x_words);
    }
    for (n, pull) in PULLS_N.into_iter().enumerate() {
        let color = color(n);
        let (rows, band) = sweep(pull)?;
        for level in band {
            scene.line(&time.at([(0.0, level), (12.0, level)]), 1.0, color, true);
        }
        let mut curve = |axes: &Axes, rows: &[Row], x: usize, y: usize| {
            let points = axes.at(rows.iter().map(|row| (row[x], row[y])));
            scene.line(&points, 1.2, color, false);
        };
        curve(&time, &rows, 0, 2);
        curve(&travel, &rows[1500..], 1, 2);
        curve(&speed, &rows, 0, 3);
        println!(
            "pull {pull:5.1} N: drawn band {:.3} to {:.3} N",
            band[0], band[1]
        );
    }
    let file = std::path::Path::new(&folder).join("friction_loop.svg");
    std::fs::write(&file, scene.to_svg())
        .map_err(|e| format!("can't write {}: {e}", file.display()))?;
    println!("wrote {}", file.display());
    Ok(())
}
