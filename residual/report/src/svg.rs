//! Plots of residuals as small SVG pictures.

use super::plot::Plot;
use residual_columns::format::num;
use residual_columns::stats::quantile_sorted;
use std::fmt::Write as _;

/// Width and height of a panel's inside, in pixels, as all lengths here.
const W: f64 = 290.0;
const H: f64 = 220.0;
/// Margins of a panel.
const LEFT: f64 = 66.0;
const TOP: f64 = 30.0;
const RIGHT: f64 = 18.0;
const BELOW: f64 = 46.0;
/// Height of the legend.
const LEGEND: f64 = 24.0;

/// Where the RMS after is less than this share of that before, it gets a panel on its own scale.
const SMALL: f64 = 0.35;

/// An empty stretch of the x axis longer than this share of it breaks the line of means.
const EMPTY: f64 = 0.25;

/// Colours of points and means.
pub(super) const POINTS: &str = "#4878a8";
pub(super) const MEANS: &str = "#c03020";

/// Text of the legend.
pub(super) const POINTS_ARE: &str = "rows, thinned";
pub(super) const MEANS_ARE: &str = "mean of all rows, by bins";

/// Round step of about three to six ticks over a range, and the decimals that it needs.
fn tick_step(lo: f64, hi: f64) -> (f64, i32) {
    let raw = (hi - lo) / 6.0;
    let power = raw.log10().floor();
    let base = 10f64.powf(power);
    let (step, extra) = [(1.0, 0), (2.0, 0), (2.5, 1), (5.0, 0), (10.0, -1)]
        .into_iter()
        .find(|(m, _)| m * base >= raw)
        .unwrap_or((10.0, -1));
    (step * base, extra - power as i32)
}

/// Ticks over a range, with their labels.
fn ticks(lo: f64, hi: f64) -> Vec<(f64, String)> {
    let (step, decimals) = tick_step(lo, hi);
    let (first, last) = ((lo / step).ceil() as i64, (hi / step).floor() as i64);
    (first..=last)
        .map(|k| k as f64 * step)
        .map(|x| (x, label(x, lo.abs().max(hi.abs()), decimals)))
        .collect()
}

/// A tick's label, to `decimals` places; in powers of ten where the axis reaches no further than
/// 1e-3, or beyond 1e5.
fn label(x: f64, reach: f64, decimals: i32) -> String {
    if x == 0.0 {
        "0".into()
    } else if (1e-3..1e5).contains(&reach) {
        format!("{x:.*}", decimals.max(0) as usize)
    } else {
        let places = (x.abs().log10() + 1e-9).floor() as i32 + decimals;
        format!("{x:.*e}", places.max(0) as usize)
    }
}

fn escape(s: &str) -> String {
    s.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

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
            "{}: RMS {} {unit}",
            p.names[column - 1],
            num(p.rms[column - 1])
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

/// Draws one panel at `ox`.
fn draw(s: &mut String, p: &Plot, panel: &Panel, ox: f64, (x0, x1): (f64, f64)) {
    let column = panel.column;
    let (y0, y1) = panel.y;
    let values = if column == 1 { &p.before } else { &p.after };
    let px = |x: f64| ox + (x - x0) / (x1 - x0) * W;
    let py = |y: f64| TOP + (y1 - y) / (y1 - y0) * H;
    let inside = |x: f64, y: f64| x >= x0 && x <= x1 && y >= y0 && y <= y1;
    let _ = write!(
        s,
        "<text x=\"{ox:.1}\" y=\"18\" font-weight=\"bold\">{}</text>",
        escape(&panel.title)
    );
    for (t, label) in ticks(x0, x1) {
        let x = px(t);
        let _ = write!(s, "<path d=\"M{x:.1} {TOP}v{H}\" stroke=\"#eee\"/><text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{label}</text>", TOP + H + 16.0);
    }
    for (t, label) in ticks(y0, y1) {
        let (y, colour) = (py(t), if t == 0.0 { "#999" } else { "#eee" });
        let _ = write!(s, "<path d=\"M{ox:.1} {y:.1}h{W}\" stroke=\"{colour}\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>", ox - 5.0, y + 4.5);
    }
    // Points as strokes of no length with round ends: a tenth of the size of circles.
    let dots: Vec<String> =
        p.x.iter()
            .zip(values)
            .filter(|(x, y)| inside(**x, **y))
            .map(|(x, y)| format!("M{:.1} {:.1}h0", px(*x), py(*y)))
            .collect();
    let _ = write!(s, "<path d=\"{}\" stroke=\"{POINTS}\" stroke-opacity=\"0.45\" stroke-width=\"2.6\" stroke-linecap=\"round\"/>", dots.concat());
    for line in lines(p, (x0, x1)) {
        let at: Vec<(f64, f64)> = line
            .iter()
            .filter(|m| inside(m[0], m[column]))
            .map(|m| (px(m[0]), py(m[column])))
            .collect();
        let points: Vec<String> = at.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
        let marks: String = at
            .iter()
            .map(|(x, y)| format!("M{x:.1} {y:.1}h0"))
            .collect();
        let _ = write!(s, "<polyline points=\"{}\" fill=\"none\" stroke=\"{MEANS}\" stroke-width=\"1.8\"/><path d=\"{marks}\" stroke=\"{MEANS}\" stroke-width=\"3.6\" stroke-linecap=\"round\"/>", points.join(" "));
    }
    let outside = p.x.len() - dots.len();
    if outside > 0 {
        let _ = write!(s, "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\" font-size=\"11\" fill=\"#666\" stroke=\"#fff\" stroke-width=\"3\" paint-order=\"stroke\">{outside} of {} points outside</text>", ox + W - 5.0, TOP + 14.0, p.x.len());
    }
    let _ = write!(
        s,
        "<path d=\"M{ox:.1} {TOP}h{W}v{H}h-{W}z\" fill=\"none\" stroke=\"#888\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
        ox + W / 2.0,
        TOP + H + 36.0,
        escape(&shortened(&p.against, 44))
    );
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

/// Start of a picture and the name of its y axis.
fn open(width: f64, height: f64, p: &Plot, unit: &str) -> String {
    let y = format!("{}, {unit}", p.value);
    let middle = TOP + H / 2.0;
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" role=\"img\" aria-label=\"{} against {}\" font-family=\"sans-serif\" font-size=\"13\"><rect width=\"100%\" height=\"100%\" fill=\"#fff\"/><text x=\"14\" y=\"{middle:.1}\" transform=\"rotate(-90 14 {middle:.1})\" text-anchor=\"middle\">{}</text>",
        escape(&y).replace('"', "&quot;"),
        escape(&p.against).replace('"', "&quot;"),
        escape(&y)
    )
}

impl Plot {
    /// The picture as SVG: all panels side by side, with a legend. There are panels before and
    /// after on one scale, and the one after again on its own scale where it is much smaller.
    /// `unit` is the target's.
    pub fn svg(&self, unit: &str) -> String {
        side_by_side(self, unit)
    }
}

/// All panels side by side, with a legend.
fn side_by_side(p: &Plot, unit: &str) -> String {
    let (panels, x) = panels(p, unit);
    let height = TOP + H + BELOW + LEGEND;
    let width = panels.len() as f64 * (LEFT + W) + RIGHT;
    let mut s = open(width, height, p, unit);
    for (k, panel) in panels.iter().enumerate() {
        draw(&mut s, p, panel, LEFT + k as f64 * (W + LEFT), x);
    }
    let base = height - 8.0;
    let _ = write!(s, "<path d=\"M{LEFT} {0:.1}h0\" stroke=\"{POINTS}\" stroke-width=\"6\" stroke-linecap=\"round\"/><text x=\"{1:.1}\" y=\"{base:.1}\">{POINTS_ARE}</text><path d=\"M{2:.1} {0:.1}h22\" stroke=\"{MEANS}\" stroke-width=\"1.8\"/><text x=\"{3:.1}\" y=\"{base:.1}\">{MEANS_ARE}</text></svg>", base - 4.5, LEFT + 9.0, LEFT + 112.0, LEFT + 140.0);
    s
}

/// Each panel as a picture of its own, so that a narrow page can put them below each other. They
/// have no legend: the page has it.
pub(super) fn separate(p: &Plot, unit: &str) -> Vec<String> {
    let (panels, x) = panels(p, unit);
    panels
        .iter()
        .map(|panel| {
            let mut s = open(LEFT + W + RIGHT, TOP + H + BELOW, p, unit);
            draw(&mut s, p, panel, LEFT, x);
            s + "</svg>"
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
        let s = side_by_side(&plot, "N");
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
        let flat = side_by_side(&Plot::new("x", &[1.0; 50], &[0.0; 50], &[0.0; 50]), "N");
        assert!(!flat.contains("NaN") && !flat.contains("inf"));
    }

    #[test]
    fn what_an_axis_leaves_out_is_said() {
        let n = 1000;
        let x: Vec<f64> = (0..n).map(f64::from).collect();
        let mut y: Vec<f64> = x.iter().map(|x| (0.37 * x).sin()).collect();
        assert!(!side_by_side(&Plot::new("x", &x, &y, &y), "N").contains("outside"));
        y[500] = 1e3;
        let s = side_by_side(&Plot::new("x", &x, &y, &y), "N");
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

    #[test]
    fn ticks_are_some_and_their_labels_differ() {
        for (lo, hi) in [
            (0.0, 1.3),
            (-5.4, 5.4),
            (0.0, 0.004),
            (-3e-5, 8e-4),
            (2.0, 2.0021),
            (-4e6, 9e6),
            (0.0, 13.0),
        ] {
            let t = ticks(lo, hi);
            assert!((3..=7).contains(&t.len()), "{lo} {hi} {t:?}");
            for (x, label) in &t {
                let shown: f64 = label.parse().unwrap();
                assert!((shown - x).abs() < 1e-3 * (hi - lo), "{lo} {hi} {t:?}");
            }
        }
    }
}
