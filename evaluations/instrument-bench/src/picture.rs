//! Pictures of the page as SVG: estimate and truth over time, error by load.

use crate::model::{for_each_row, Bilinear};
use crate::protocol::Inputs;
use crate::results::Results;
use crate::score::fit;
use crate::split::Apart;
use plotters::prelude::*;
use plotters::style::RelativeSize;

const SIZE: (u32, u32) = (900, 420);
/// Okabe and Ito's palette: also distinguishable for colour-blind readers.
const BLUE: RGBColor = RGBColor(0x00, 0x72, 0xB2);
const ORANGE: RGBColor = RGBColor(0xD5, 0x5E, 0x00);
const GREEN: RGBColor = RGBColor(0x00, 0x9E, 0x73);
const DARK: RGBColor = RGBColor(0x22, 0x22, 0x22);
/// Loads and the speed that are drawn over time.
const LEVELS: [u8; 3] = [1, 5, 9];
const SPEED: u8 = 2;
/// Every so many rows is drawn.
const THIN: usize = 5;
/// Rows further apart are two strokes.
const GAP: usize = 20;

/// A stretch of points.
type Stroke = Vec<(f64, f64)>;

fn words(error: impl std::fmt::Display) -> String {
    format!("the picture can't be drawn: {error}")
}

/// Truth and estimate of three loads that the training did not have, causal, over time.
///
/// # Errors
/// The drawing library's words.
pub fn over_time(results: &Results) -> Result<String, String> {
    let mut strokes: Vec<(Vec<Stroke>, Vec<Stroke>)> = Vec::new();
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
        strokes.push(curves(results, run, &Bilinear::new(weights)));
    }
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        area.fill(&WHITE).map_err(words)?;
        let mut chart = ChartBuilder::on(&area)
            .caption(
                "Torque at the jaw, loads of 20, 60 and 100 % at 0.3 Hz, none of them trained on",
                ("sans-serif", 15),
            )
            .margin(10)
            .x_label_area_size(40)
            .y_label_area_size(60)
            .build_cartesian_2d(1.0..19.0, -145.0..0.0)
            .map_err(words)?;
        chart
            .configure_mesh()
            .x_desc("time, s")
            .y_desc("torque, mN·m")
            .light_line_style(TRANSPARENT)
            .draw()
            .map_err(words)?;
        for (style, which, name) in [(DARK, 0, "measured"), (ORANGE, 1, "estimated, causal")] {
            let all = strokes
                .iter()
                .flat_map(|s| if which == 0 { &s.0 } else { &s.1 });
            for (number, stroke) in all.enumerate() {
                let drawn = chart
                    .draw_series(LineSeries::new(
                        stroke.iter().copied(),
                        style.stroke_width(1),
                    ))
                    .map_err(words)?;
                if number == 0 {
                    drawn
                        .label(name)
                        .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], style));
                }
            }
        }
        legend(&mut chart)?;
        area.present().map_err(words)?;
    }
    Ok(svg)
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
///
/// # Errors
/// The drawing library's words.
pub fn by_load(results: &Results) -> Result<String, String> {
    let causal = &results.splits[results.causal];
    let filtered = &results.splits[results.filtered];
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        area.fill(&WHITE).map_err(words)?;
        let mut chart = ChartBuilder::on(&area)
            .caption("Error by the load that was left out", ("sans-serif", 15))
            .margin(10)
            .x_label_area_size(40)
            .y_label_area_size(60)
            .build_cartesian_2d(5.0..105.0, 0.0..8.0)
            .map_err(words)?;
        chart
            .configure_mesh()
            .x_desc("load, % of the load motor's current")
            .y_desc("RMSE, mN·m")
            .light_line_style(TRANSPARENT)
            .draw()
            .map_err(words)?;
        for (style, figure, name) in [
            (
                GREEN,
                &filtered.level,
                "one load left out, the publication's filter",
            ),
            (BLUE, &causal.level, "one load left out, causal"),
            (
                ORANGE,
                &causal.level_and_speed,
                "load and speed left out, causal",
            ),
        ] {
            let points: Stroke = (0..10u8)
                .filter_map(|level| {
                    Some((
                        10.0 * (f64::from(level) + 1.0),
                        figure.part(|l| l.level == level)?,
                    ))
                })
                .collect();
            chart
                .draw_series(LineSeries::new(points, style.stroke_width(2)).point_size(3))
                .map_err(words)?
                .label(name)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], style));
        }
        legend(&mut chart)?;
        area.present().map_err(words)?;
    }
    Ok(svg)
}

/// A chart over two linear axes.
type Chart<'a, 'b> = ChartContext<
    'a,
    SVGBackend<'b>,
    Cartesian2d<plotters::coord::types::RangedCoordf64, plotters::coord::types::RangedCoordf64>,
>;

fn legend<'a, 'b: 'a>(chart: &mut Chart<'a, 'b>) -> Result<(), String> {
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .legend_area_size(RelativeSize::Width(0.03))
        .background_style(WHITE.mix(0.8))
        .border_style(DARK)
        .draw()
        .map_err(words)
}
