//! Draws the force-gauge experiment: tension over time and over cable travel, while a tip pulls cable out and lets
//! it in at constant commands. Writes `friction_loop.svg` to the folder given (default: the current one).
//!
//! `cargo run -p plant --release --example friction_loop -- target`

use plant::config::{PathConfig, SweepPath, UnitConfig};
use plant::{Plant, PlantConfig};
use std::error::Error;
use std::fmt::Write as _;

const PULLS_N: [f64; 4] = [2.2, 4.0, 8.0, 12.0];
const COLOURS: [&str; 4] = ["#0b6e99", "#2a9d4b", "#c77700", "#b3261e"];

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

/// One panel: axes with labels, and curves of column `x` against column `y`.
struct Panel {
    left: f64,
    top: f64,
    width: f64,
    height: f64,
    x: (usize, f64, f64, f64),
    y: (usize, f64, f64, f64),
}

impl Panel {
    fn place(&self, x: f64, y: f64) -> (f64, f64) {
        let (_, x0, x1, _) = self.x;
        let (_, y0, y1, _) = self.y;
        (
            self.left + (x - x0) / (x1 - x0) * self.width,
            self.top + (y1 - y) / (y1 - y0) * self.height,
        )
    }

    fn axes(&self, svg: &mut String, x_label: &str, y_label: &str) -> std::fmt::Result {
        let (left, top, width, height) = (self.left, self.top, self.width, self.height);
        writeln!(
            svg,
            r##"<rect x="{left}" y="{top}" width="{width}" height="{height}" fill="none" stroke="#444"/>"##
        )?;
        let (_, x0, x1, step) = self.x;
        for i in 0..=((x1 - x0) / step).round() as i32 {
            let value = x0 + f64::from(i) * step;
            let (x, y) = self.place(value, self.y.1);
            writeln!(
                svg,
                r#"<text x="{x}" y="{}" text-anchor="middle">{value}</text>"#,
                y + 16.0
            )?;
        }
        let (_, y0, y1, step) = self.y;
        for i in 0..=((y1 - y0) / step).round() as i32 {
            let value = y0 + f64::from(i) * step;
            let (x, y) = self.place(self.x.1, value);
            writeln!(
                svg,
                r##"<line x1="{x}" x2="{}" y1="{y}" y2="{y}" stroke="#ddd"/><text x="{}" y="{}" text-anchor="end">{value}</text>"##,
                x + width,
                x - 6.0,
                y + 4.0
            )?;
        }
        let (x, y) = (left + width / 2.0, top + height + 34.0);
        writeln!(
            svg,
            r#"<text x="{x}" y="{y}" text-anchor="middle">{x_label}</text>"#
        )?;
        writeln!(
            svg,
            r#"<text x="{left}" y="{}">{y_label}</text>"#,
            top - 8.0
        )
    }

    fn curve(&self, svg: &mut String, rows: &[Row], colour: &str) -> std::fmt::Result {
        write!(
            svg,
            r#"<polyline fill="none" stroke="{colour}" stroke-width="1.2" points=""#
        )?;
        for row in rows {
            let (x, y) = self.place(row[self.x.0], row[self.y.0]);
            write!(svg, "{x:.1},{y:.1} ")?;
        }
        writeln!(svg, r#""/>"#)
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).unwrap_or_else(|| ".".into());
    let panel = |left, top, width, x, y| Panel {
        left,
        top,
        width,
        height: 300.0,
        x,
        y,
    };
    let tension = (2, 0.0, 16.0, 2.0);
    let time = panel(60.0, 50.0, 560.0, (0, 0.0, 12.0, 2.0), tension);
    let travel = panel(690.0, 50.0, 380.0, (1, -10.0, 10.0, 5.0), tension);
    let speed = panel(
        60.0,
        430.0,
        560.0,
        (0, 0.0, 12.0, 2.0),
        (3, -10.0, 10.0, 5.0),
    );
    let mut svg = String::from(
        r##"<svg xmlns="http://www.w3.org/2000/svg" width="1100" height="790" font-family="sans-serif" font-size="12"><rect width="1100" height="790" fill="white"/>"##,
    );
    time.axes(
        &mut svg,
        "time, s",
        "cable tension, N (dashed: band of the drawn friction law)",
    )?;
    travel.axes(
        &mut svg,
        "tip travel away from the unit, mm",
        "cable tension, N",
    )?;
    speed.axes(
        &mut svg,
        "time, s",
        "cable speed at the reel, mm/s, positive winding in",
    )?;
    for (pull, colour) in PULLS_N.into_iter().zip(COLOURS) {
        let (rows, band) = sweep(pull)?;
        for level in band {
            let (x0, y) = time.place(0.0, level);
            let (x1, _) = time.place(12.0, level);
            writeln!(
                svg,
                r#"<line x1="{x0}" x2="{x1}" y1="{y}" y2="{y}" stroke="{colour}" stroke-dasharray="4 4"/>"#
            )?;
        }
        time.curve(&mut svg, &rows, colour)?;
        travel.curve(&mut svg, &rows[1500..], colour)?;
        speed.curve(&mut svg, &rows, colour)?;
        println!(
            "pull {pull:5.1} N: drawn band {:.3} to {:.3} N",
            band[0], band[1]
        );
    }
    svg.push_str("</svg>\n");
    let file = std::path::Path::new(&folder).join("friction_loop.svg");
    std::fs::write(&file, svg).map_err(|e| format!("can't write {}: {e}", file.display()))?;
    println!("wrote {}", file.display());
    Ok(())
}
