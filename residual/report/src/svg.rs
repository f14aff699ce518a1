//! Plots of residuals as small pictures.

use super::plot::Plot;
use super::words::{behind, titled};
use residual_columns::format::num;
use residual_columns::stats::quantile_sorted;
use scene::{Anchor, Axes, Color, Scene, GRAY};

/// Width and height of a panel's inside, in pixels, as all lengths here.
const W: f32 = 290.0;
const H: f32 = 220.0;
/// Margins of a panel.
const LEFT: f32 = 66.0;
const TOP: f32 = 30.0;
const RIGHT: f32 = 18.0;
const BELOW: f32 = 46.0;
/// Height of the legend.
const LEGEND: f32 = 24.0;

/// Where the RMS after is less than this share of that before, it gets a panel on its own scale.
const SMALL: f64 = 0.35;

/// An empty stretch of the x axis longer than this share of it breaks the line of means.
const EMPTY: f64 = 0.25;

/// Colours of points and means.
pub(super) const POINTS: Color = Color(0x48, 0x78, 0xa8);
pub(super) const MEANS: Color = Color(0xc0, 0x30, 0x20);

/// Behind words.
const WHITE: Color = Color(0xff, 0xff, 0xff);

/// Text of the legend.
pub(super) const POINTS_ARE: &str = "rows, thinned";
pub(super) const MEANS_ARE: &str = "mean of all rows, by bins";

/// Range of the values, a share `out` left out at each end, with a margin; never empty.
fn range(v: &[f64], out: f64, margin: f64) -> (f64, f64) {
    let mut v: Vec<f64> = v.iter().copied().filter(|x| x.is_finite()).collect();
    v.sort_by(f64::total_cmp);
    let (lo, hi) = (quantile_sorted(&v, out), quantile_sorted(&v, 1.0 - out));
    if hi > lo {
        (lo - margin * (hi - lo), hi + margin * (hi - lo))
    } else {
        (lo - 1.0, lo + 1.0)
    }
}

/// A panel: which column it shows (1 before, 2 after), its title, its range of y.
struct Panel {
    column: usize,
    title: String,
    y: (f64, f64),
}

/// Panels before and after on the same scales, and after on its own scale where it is much smaller;
/// and the range of x.
fn panels(p: &Plot, unit: &str) -> (Vec<Panel>, (f64, f64)) {
    let covering = |(lo, hi): (f64, f64), columns: &[usize]| {
        p.means
            .iter()
            .flat_map(|m| columns.iter().map(|c| m[*c]))
            .fold((lo.min(0.0), hi.max(0.0)), |(lo, hi), m| {
                (lo.min(m), hi.max(m))
            })
    };
    let y = covering(
        range(&[p.before.as_slice(), &p.after].concat(), 0.005, 0.1),
        &[1, 2],
    );
    let panel = |column: usize, y: (f64, f64)| Panel {
        column,
        title: format!(
            "{}: RMS {}{}",
            p.names[column - 1],
            num(p.rms[column - 1]),
            behind(unit)
        ),
        y,
    };
    let mut out = vec![panel(1, y), panel(2, y)];
    if p.rms[1] < SMALL * p.rms[0] {
        out.push(Panel {
            column: 2,
            title: format!("{}, own scale", p.names[1]),
            y: covering(range(&p.after, 0.01, 0.2), &[2]),
        });
    }
    (out, range(&p.x, 0.002, 0.04))
}

/// The means as lines, broken where a long stretch of the axis has no rows.
fn lines(p: &Plot, (x0, x1): (f64, f64)) -> Vec<&[[f64; 3]]> {
    let mut x: Vec<f64> = p.x.clone();
    x.sort_by(f64::total_cmp);
    let empty = |a: f64, b: f64| {
        x.windows(2)
            .filter(|w| w[1] > a && w[0] < b)
            .any(|w| w[1].min(b) - w[0].max(a) > EMPTY * (x1 - x0))
    };
    p.means
        .chunk_by(|a, b| !empty(a[0], b[0]))
        .collect::<Vec<_>>()
}

/// Draws one panel, its inside from `left` on.
fn draw(scene: &mut Scene, p: &Plot, panel: &Panel, left: f32, x: (f64, f64)) {
    let column = panel.column;
    let values = if column == 1 { &p.before } else { &p.after };
    let axes = Axes {
        left,
        top: TOP,
        width: W,
        height: H,
        x,
        y: panel.y,
    };
    let within = |v: f64, (low, high): (f64, f64)| v >= low && v <= high;
    let inside = |at: &(f64, f64)| within(at.0, axes.x) && within(at.1, axes.y);
    axes.grid(scene);
    if inside(&(x.0, 0.0)) {
        let zero = axes.at_y(0.0);
        scene.line(&[(left, zero), (axes.right(), zero)], 1.0, GRAY, false);
    }
    let all = p.x.iter().copied().zip(values.iter().copied());
    let dots = axes.at(all.filter(inside));
    scene.points(&dots, 2.6, POINTS, 0.45);
    for line in lines(p, x) {
        let means = axes.at(line.iter().map(|m| (m[0], m[column])).filter(inside));
        scene.line(&means, 1.8, MEANS, false);
        scene.points(&means, 3.6, MEANS, 1.0);
    }
    let outside = p.x.len() - dots.len();
    if outside > 0 {
        let text = format!("{outside} of {} points outside", p.x.len());
        scene.rectangle(axes.right() - 165.0, TOP + 1.0, 164.0, 17.0, WHITE);
        scene.text((axes.right() - 5.0, TOP + 14.0), Anchor::End, &text);
    }
    scene.heading((left, 18.0), &panel.title);
    axes.draw(scene, "", &shortened(&p.against, 44));
}

/// At most `most` characters of a text.
fn shortened(text: &str, most: usize) -> String {
    if text.chars().count() > most {
        text.chars()
            .take(most - 3)
            .chain("...".chars())
            .collect::<String>()
    } else {
        text.to_string()
    }
}

/// A picture with the name of its y axis.
fn open(width: f32, height: f32, p: &Plot, unit: &str) -> Scene {
    let mut scene = Scene::new(width, height);
    let y = titled(&p.value, unit);
    scene.describe(&format!("{y} against {}", p.against));
    scene.upward_text((14.0, TOP + H / 2.0), &y);
    scene
}

impl Plot {
    /// The picture as SVG: all panels side by side, with a legend. There are panels before and
    /// after on one scale, and the one after again on its own scale where it is much smaller.
    /// `unit` is the target's.
    pub fn svg(&self, unit: &str) -> String {
        let (panels, x) = panels(self, unit);
        let height = TOP + H + BELOW + LEGEND;
        let width = panels.len() as f32 * (LEFT + W) + RIGHT;
        let mut scene = open(width, height, self, unit);
        for (k, panel) in panels.iter().enumerate() {
            draw(&mut scene, self, panel, LEFT + k as f32 * (W + LEFT), x);
        }
        let (base, line) = (height - 8.0, height - 12.5);
        scene.points(&[(LEFT, line)], 6.0, POINTS, 1.0);
        scene.text((LEFT + 9.0, base), Anchor::Start, POINTS_ARE);
        scene.line(
            &[(LEFT + 112.0, line), (LEFT + 134.0, line)],
            1.8,
            MEANS,
            false,
        );
        scene.text((LEFT + 140.0, base), Anchor::Start, MEANS_ARE);
        scene.to_svg()
    }
}

/// Each panel as a picture of its own, so that a narrow page can put them below each other. They
/// have no legend: the page has it.
pub(super) fn separate(p: &Plot, unit: &str) -> Vec<String> {
    let (panels, x) = panels(p, unit);
    panels
        .iter()
        .map(|panel| {
            let mut scene = open(LEFT + W + RIGHT, TOP + H + BELOW, p, unit);
            draw(&mut scene, p, panel, LEFT, x);
            scene.to_svg()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_is_small_and_names_its_axes() {
        let x: Vec<f64> = (0..50_000).map(|i| f64::from(i % 997)).collect();
        let before: Vec<f64> = x.iter().map(|x| (x / 40.0).sin() - 2.0).collect();
        let after: Vec<f64> = before.iter().map(|b| 0.05 * (b + 2.0)).collect();
        let plot = Plot::new("speed <b>, deg/s", &x, &before, &after);
        let s = plot.svg("N");
        assert!(s.len() < 60_000, "{}", s.len());
        let each = separate(&plot, "N");
        assert_eq!(each.len(), 3);
        for part in ["residual, N", "speed &lt;b&gt;, deg/s"] {
            assert!(s.contains(part), "{part}");
            assert!(each.iter().all(|s| s.contains(part)), "{part}");
        }
        let rms = format!("RMS {} N", num(plot.rms[1]));
        for (s, part) in each.iter().zip(["before: RMS", "after: RMS", "own scale"]) {
            assert!(s.contains(part), "{part}");
        }
        assert!(each[1].contains(&rms) && s.contains(MEANS_ARE) && s.contains("own scale"));
        let flat = Plot::new("x", &[1.0; 50], &[0.0; 50], &[0.0; 50]).svg("N");
        assert!(!flat.contains("NaN") && !flat.contains("inf"));
    }

    #[test]
    fn what_an_axis_leaves_out_is_said() {
        let n = 1000;
        let x: Vec<f64> = (0..n).map(f64::from).collect();
        let mut y: Vec<f64> = x.iter().map(|x| (0.37 * x).sin()).collect();
        assert!(!Plot::new("x", &x, &y, &y).svg("N").contains("outside"));
        y[500] = 1e3;
        let s = Plot::new("x", &x, &y, &y).svg("N");
        assert!(s.contains("1 of 1000 points outside"), "{s}");
    }

    #[test]
    fn the_line_of_means_ends_where_rows_end() {
        let spread = |gap: f64| {
            let x: Vec<f64> = (0..400)
                .map(|i| f64::from(i % 200) / 200.0 + f64::from(i / 200) * (1.0 + gap))
                .collect();
            let y: Vec<f64> = x.iter().map(|x| x.sin()).collect();
            lines(&Plot::new("x", &x, &y, &y), range(&x, 0.002, 0.04)).len()
        };
        assert_eq!((spread(0.1), spread(3.0)), (1, 2));
    }
}
