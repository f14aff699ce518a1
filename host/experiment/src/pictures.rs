//! Pictures of an experiment: maps of how often something occurred, histograms, curves.

use scene::{color, range, shade, Axes, Scene};

/// Cells of a map along each side.
const CELLS: usize = 30;
/// Shades of a map.
const SHADES: f64 = 8.0;
/// Bins of a histogram.
const BINS: usize = 45;
/// Inside of a panel, px.
const SIDE: f32 = 230.0;
/// Width of a wide panel.
const WIDE: f32 = 860.0;
const HIGH: f32 = 200.0;
/// Margins of a panel.
const LEFT: f32 = 70.0;
const TOP: f32 = 34.0;
const RIGHT: f32 = 20.0;
const BELOW: f32 = 52.0;
/// Height of the title.
const TITLE: f32 = 34.0;

/// Values with the words of their axis.
#[derive(Debug, Clone)]
pub struct Axis {
    /// Words with the unit.
    pub words: String,
    /// Values, row by row.
    pub values: Vec<f64>,
}

impl Axis {
    /// An axis.
    #[must_use]
    pub fn new(words: &str, values: Vec<f64>) -> Self {
        Self {
            words: words.to_owned(),
            values,
        }
    }
}

/// Maps of how often pairs of values occurred, three in a row; the darker, the more often
/// (logarithmic).
#[must_use]
pub fn maps(title: &str, pairs: &[(&Axis, &Axis)]) -> Scene {
    let columns = 3;
    let rows = pairs.len().div_ceil(columns);
    let (w, h) = (LEFT + SIDE + RIGHT, TOP + SIDE + BELOW);
    let mut scene = Scene::new(w * columns as f32, TITLE + h * rows as f32);
    scene.heading((LEFT, 22.0), title);
    for (n, (x, y)) in pairs.iter().enumerate() {
        let axes = Axes {
            left: (n % columns) as f32 * w + LEFT,
            top: TITLE + (n / columns) as f32 * h + TOP,
            width: SIDE,
            height: SIDE,
            x: range(x.values.iter().copied()),
            y: range(y.values.iter().copied()),
        };
        let counts = cells((&x.values, axes.x), (&y.values, axes.y));
        let most = f64::from(counts.iter().copied().max().unwrap_or(1).max(1));
        let size = SIDE / CELLS as f32;
        let level = |count: u32| (f64::from(count).ln_1p() / most.ln_1p() * SHADES).ceil();
        for (row, counts) in counts.chunks(CELLS).enumerate() {
            let top = axes.top + SIDE - (row + 1) as f32 * size;
            let mut column = 0;
            // Neighbours of one shade are one rectangle: a small file.
            for run in counts.chunk_by(|a, b| level(*a) == level(*b)) {
                let left = axes.left + column as f32 * size;
                column += run.len();
                if run[0] > 0 {
                    let width = run.len() as f32 * size;
                    let color = shade(level(run[0]) / SHADES);
                    // A little larger, so that no seam shows.
                    scene.rectangle(left, top, width + 0.3, size + 0.3, color);
                }
            }
        }
        axes.draw(&mut scene, &y.words, &x.words);
    }
    scene
}

/// Values and the range that the cells divide.
type Values<'a> = (&'a [f64], (f64, f64));

/// How often pairs fall into each cell.
fn cells((x, x_range): Values, (y, y_range): Values) -> Vec<u32> {
    let mut counts = vec![0; CELLS * CELLS];
    let place = |v: f64, (low, high): (f64, f64)| {
        let cell = (v - low) / (high - low) * CELLS as f64;
        (cell >= 0.0 && cell < CELLS as f64).then_some(cell as usize)
    };
    for (x, y) in x.iter().zip(y) {
        if let (Some(cx), Some(cy)) = (place(*x, x_range), place(*y, y_range)) {
            counts[cy * CELLS + cx] += 1;
        }
    }
    counts
}

/// Share of the cells of a map that are visited.
#[must_use]
pub fn visited(x: &[f64], y: &[f64]) -> f64 {
    let (x_range, y_range) = (range(x.iter().copied()), range(y.iter().copied()));
    let counts = cells((x, x_range), (y, y_range));
    counts.iter().filter(|count| **count > 0).count() as f64 / counts.len() as f64
}

/// A panel of a tall picture.
#[derive(Debug, Clone)]
pub enum Panel {
    /// Shares of values in bins.
    Histogram {
        /// Title with the unit of x.
        title: String,
        /// Words of the x axis.
        x_words: String,
        /// Name and values of each.
        sets: Vec<(String, Vec<f64>)>,
    },
    /// Values over time.
    Curves {
        /// Title with the unit.
        title: String,
        /// Time, s.
        t_s: Vec<f64>,
        /// Name and values of each.
        sets: Vec<(String, Vec<f64>)>,
    },
}

/// Panels below each other.
#[must_use]
pub fn tall(title: &str, panels: &[Panel]) -> Scene {
    let h = TOP + HIGH + BELOW;
    let mut scene = Scene::new(LEFT + WIDE + 120.0, TITLE + h * panels.len() as f32);
    scene.heading((LEFT, 22.0), title);
    for (n, panel) in panels.iter().enumerate() {
        let top = TITLE + n as f32 * h + TOP;
        match panel {
            Panel::Histogram {
                title,
                x_words,
                sets,
            } => histogram(&mut scene, top, title, x_words, sets),
            Panel::Curves { title, t_s, sets } => curves(&mut scene, top, title, t_s, sets),
        }
    }
    scene
}

fn histogram(scene: &mut Scene, top: f32, title: &str, x_words: &str, sets: &[(String, Vec<f64>)]) {
    let x = range(sets.iter().flat_map(|(_, v)| v.iter().copied()));
    let shares: Vec<Vec<f64>> = sets.iter().map(|(_, v)| bins(v, x)).collect();
    let most = shares.iter().flatten().copied().fold(0.0, f64::max);
    let axes = Axes {
        left: LEFT,
        top,
        width: WIDE,
        height: HIGH,
        x,
        y: (0.0, if most > 0.0 { 1.05 * most } else { 1.0 }),
    };
    for (n, ((name, _), shares)) in sets.iter().zip(&shares).enumerate() {
        let width = (x.1 - x.0) / BINS as f64;
        let mut points = Vec::new();
        for (i, share) in shares.iter().enumerate() {
            let from = x.0 + width * i as f64;
            points.extend([(from, *share), (from + width, *share)]);
        }
        scene.line(&axes.at(points), 1.6, color(n), false);
        axes.legend(scene, n, name, color(n));
    }
    axes.draw(scene, title, x_words);
}

/// Share of the values in each bin, per cent.
fn bins(values: &[f64], x: (f64, f64)) -> Vec<f64> {
    let mut counts = vec![0.0; BINS];
    let mut all = 0.0_f64;
    for value in values.iter().filter(|v| v.is_finite()) {
        let bin = ((value - x.0) / (x.1 - x.0) * BINS as f64) as usize;
        counts[bin.min(BINS - 1)] += 1.0;
        all += 1.0;
    }
    counts.iter().map(|c| 100.0 * c / all.max(1.0)).collect()
}

/// Most points of a curve.
const POINTS: usize = 1500;

fn curves(scene: &mut Scene, top: f32, title: &str, t_s: &[f64], sets: &[(String, Vec<f64>)]) {
    let axes = Axes {
        left: LEFT,
        top,
        width: WIDE,
        height: HIGH,
        x: range(t_s.iter().copied()),
        y: range(sets.iter().flat_map(|(_, v)| v.iter().copied())),
    };
    for (n, (name, values)) in sets.iter().enumerate() {
        let stride = t_s.len().div_ceil(POINTS).max(1);
        let points = (t_s.iter().copied().zip(values.iter().copied()))
            .step_by(stride)
            .filter(|(_, v)| v.is_finite());
        scene.line(&axes.at(points), 1.2, color(n), false);
        axes.legend(scene, n, name, color(n));
    }
    axes.draw(scene, title, "time in the trial, s");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_shows_where_values_were_and_how_often() {
        let x: Vec<f64> = (0..1000).map(|n| f64::from(n % 10)).collect();
        let y: Vec<f64> = (0..1000).map(|n| f64::from(n / 500)).collect();
        assert!((visited(&x, &y) - 20.0 / (CELLS * CELLS) as f64).abs() < 1e-12);
        let (x, y) = (Axis::new("a, m", x), Axis::new("b, m", y));
        let svg = maps("title", &[(&x, &y)]).to_svg();
        // Two rows of ten cells with gaps between, and the background.
        assert_eq!(svg.matches("<rect").count(), 21, "{svg}");
        assert!(svg.contains("a, m") && svg.contains("title"));
    }

    #[test]
    fn shares_add_up_and_nothing_is_no_division_by_zero() {
        let shares = bins(&[0.0, 0.1, 0.9, 1.0, f64::NAN], (0.0, 1.0));
        assert!((shares.iter().sum::<f64>() - 100.0).abs() < 1e-9);
        assert_eq!(bins(&[], (0.0, 1.0)).iter().sum::<f64>(), 0.0);
        let nothing = Panel::Curves {
            title: "nothing".to_owned(),
            t_s: Vec::new(),
            sets: vec![("a".to_owned(), vec![f64::NAN])],
        };
        assert!(tall("t", &[nothing]).to_svg().ends_with("</svg>\n"));
    }
}
