//! Pictures of the page as SVG: estimate and truth over time, error by load.

use crate::model::{for_each_row, Bilinear};
use crate::protocol::Inputs;
use crate::results::Results;
use crate::score::fit;
use crate::split::Apart;
use scene::{color, Axes, Scene, BLACK};

/// Loads and the speed that are drawn over time.
const LEVELS: [u8; 3] = [1, 5, 9];
const SPEED: u8 = 2;
/// Every so many rows is drawn.
const THIN: usize = 5;
/// Rows further apart are two strokes.
const GAP: usize = 20;

/// A stretch of points.
type Stroke = Vec<(f64, f64)>;

/// A chart with its heading and axes, and room for a legend beside it.
fn chart(heading: &str, x: (f64, f64), y: (f64, f64), words: [&str; 2]) -> (Scene, Axes) {
    let mut scene = Scene::new(1120.0, 440.0);
    let axes = Axes {
        left: 60.0,
        top: 60.0,
        width: 780.0,
        height: 320.0,
        x,
        y,
    };
    scene.heading((axes.left, 24.0), heading);
    axes.grid(&mut scene);
    axes.draw(&mut scene, words[1], words[0]);
    (scene, axes)
}

/// Truth and estimate of three loads that the training did not have, causal, over time.
#[must_use]
pub fn over_time(results: &Results) -> String {
    let (mut scene, axes) = chart(
        "Torque at the jaw, loads of 20, 60 and 100 % at 0.3 Hz, none of them trained on",
        (1.0, 19.0),
        (-145.0, 0.0),
        ["time, s", "torque, mN·m"],
    );
    let kinds = [(BLACK, "measured"), (color(1), "estimated, causal")];
    for (n, (color, name)) in kinds.into_iter().enumerate() {
        axes.legend(&mut scene, n, name, color);
    }
    let labels = results.set.labels();
    for level in LEVELS {
        let train: Vec<usize> = (0..labels.len())
            .filter(|run| labels[*run].1 != level)
            .collect();
        let weights = fit(Apart::Level, &labels, &results.set.causal, &train);
        let run = labels.iter().position(|label| *label == (SPEED, level));
        let (Some(weights), Some(run)) = (weights, run) else {
            continue;
        };
        let (truth, estimate) = curves(results, run, &Bilinear::new(weights));
        for (strokes, (color, _)) in [truth, estimate].into_iter().zip(kinds) {
            for stroke in strokes {
                scene.line(&axes.at(stroke), 1.0, color, false);
            }
        }
    }
    scene.to_svg()
}

/// Truth and estimate of a run, in strokes.
fn curves(results: &Results, run: usize, model: &Bilinear) -> (Vec<Stroke>, Vec<Stroke>) {
    let scored = &results.set.scored[run];
    let (mut truth, mut estimate) = (vec![Stroke::new()], vec![Stroke::new()]);
    let (mut number, mut last) = (0, None);
    for_each_row(
        &results.set.runs[run],
        scored,
        Inputs::Causal,
        |features, torque| {
            let row = scored.rows[number];
            number += 1;
            if last.is_some_and(|last| row - last > GAP) {
                truth.push(Stroke::new());
                estimate.push(Stroke::new());
            }
            last = Some(row);
            if row.is_multiple_of(THIN) {
                let t = row as f64 / crate::data::RATE_HZ;
                if let (Some(a), Some(b)) = (truth.last_mut(), estimate.last_mut()) {
                    a.push((t, torque));
                    b.push((t, model.value(&features.row())));
                }
            }
        },
    );
    (truth, estimate)
}

/// Error by the load that was left out.
#[must_use]
pub fn by_load(results: &Results) -> String {
    let causal = &results.splits[results.causal];
    let filtered = &results.splits[results.filtered];
    let (mut scene, axes) = chart(
        "Error by the load that was left out",
        (5.0, 105.0),
        (0.0, 8.0),
        ["load, % of the load motor's current", "RMSE, mN·m"],
    );
    let curves = [
        (
            &filtered.level,
            2,
            "load left out, the publication's filter",
        ),
        (&causal.level, 0, "load left out, causal"),
        (
            &causal.level_and_speed,
            1,
            "load and speed left out, causal",
        ),
    ];
    for (n, (figure, hue, name)) in curves.into_iter().enumerate() {
        let error = |level: u8| {
            let part = figure.part(|l| l.level == level)?;
            Some((10.0 * (f64::from(level) + 1.0), part))
        };
        let points = axes.at((0..10).filter_map(error));
        scene.line(&points, 2.0, color(hue), false);
        scene.points(&points, 6.0, color(hue), 1.0);
        axes.legend(&mut scene, n, name, color(hue));
    }
    scene.to_svg()
}
