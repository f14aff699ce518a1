//! Plots of residuals as small SVG pictures.

use crate::report::{num, Plot};
use crate::stats::quantile_sorted;
use std::fmt::Write as _;

/// Inside of a panel, and the room around it.
const W: f64 = 300.0;
const H: f64 = 230.0;
const LEFT: f64 = 62.0;
const TOP: f64 = 30.0;
const BELOW: f64 = 62.0;

/// Where the RMS after is less than this share of that before, it gets a panel on its own scale.
const SMALL: f64 = 0.35;

/// Round ticks over a range.
fn ticks(lo: f64, hi: f64) -> Vec<f64> {
    let raw = (hi - lo) / 5.0;
    let base = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .iter()
        .map(|m| m * base)
        .find(|s| *s >= raw)
        .unwrap_or(raw);
    let first = (lo / step).ceil() as i64;
    let last = (hi / step).floor() as i64;
    (first..=last).map(|k| k as f64 * step).collect()
}

fn label(x: f64) -> String {
    if x != 0.0 && (x.abs() < 1e-3 || x.abs() >= 1e5) {
        format!("{x:.0e}")
    } else {
        let s = format!("{x:.4}");
        let s = s.trim_end_matches('0').trim_end_matches('.');
        if s == "-0" { "0" } else { s }.to_string()
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

/// Draws one panel at `ox`.
fn panel(
    s: &mut String,
    p: &Plot,
    (ox, column, title): (f64, usize, &str),
    (x0, x1): (f64, f64),
    (y0, y1): (f64, f64),
) {
    let values = if column == 1 { &p.before } else { &p.after };
    let px = |x: f64| ox + (x - x0) / (x1 - x0) * W;
    let py = |y: f64| TOP + (y1 - y) / (y1 - y0) * H;
    let inside = |x: f64, y: f64| x >= x0 && x <= x1 && y >= y0 && y <= y1;
    let _ = write!(
        s,
        "<text x=\"{ox:.1}\" y=\"18\" font-weight=\"bold\">{title}: RMS {}</text>",
        num(p.rms[column - 1])
    );
    for t in ticks(x0, x1) {
        let x = px(t);
        let _ = write!(s, "<path d=\"M{x:.1} {TOP}v{H}\" stroke=\"#eee\"/><text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>", TOP + H + 14.0, label(t));
    }
    for t in ticks(y0, y1) {
        let (y, colour) = (py(t), if t == 0.0 { "#999" } else { "#eee" });
        let _ = write!(s, "<path d=\"M{ox:.1} {y:.1}h{W}\" stroke=\"{colour}\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>", ox - 4.0, y + 4.0, label(t));
    }
    // Points as strokes of no length with round ends: a tenth of the size of circles.
    let dots: String =
        p.x.iter()
            .zip(values)
            .filter(|(x, y)| inside(**x, **y))
            .map(|(x, y)| format!("M{:.1} {:.1}h0", px(*x), py(*y)))
            .collect();
    let _ = write!(s, "<path d=\"{dots}\" stroke=\"#4878a8\" stroke-opacity=\"0.45\" stroke-width=\"2.6\" stroke-linecap=\"round\"/>");
    let line: Vec<String> = p
        .means
        .iter()
        .filter(|m| inside(m[0], m[column]))
        .map(|m| format!("{:.1},{:.1}", px(m[0]), py(m[column])))
        .collect();
    let _ = write!(
        s,
        "<polyline points=\"{}\" fill=\"none\" stroke=\"#c03020\" stroke-width=\"1.8\"/><path d=\"M{ox:.1} {TOP}h{W}v{H}h-{W}z\" fill=\"none\" stroke=\"#888\"/>",
        line.join(" ")
    );
    let name: String = if p.against.chars().count() > 52 {
        p.against.chars().take(49).chain("...".chars()).collect()
    } else {
        p.against.clone()
    };
    let _ = write!(
        s,
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
        ox + W / 2.0,
        TOP + H + 32.0,
        escape(&name)
    );
}

/// Panels before and after on the same scales, and after on its own scale where it is much smaller:
/// points, means of bins, axes, legend.
pub(crate) fn residuals(p: &Plot, unit: &str) -> String {
    let x = range(&p.x, 0.002, 0.04);
    let y = range(&[p.before.as_slice(), &p.after].concat(), 0.002, 0.06);
    let y = (y.0.min(0.0), y.1.max(0.0));
    let mut panels = vec![(1, "before", y), (2, "after", y)];
    if p.rms[1] < SMALL * p.rms[0] {
        panels.push((2, "after, own scale", range(&p.after, 0.01, 0.2)));
    }
    let (width, height) = (panels.len() as f64 * (W + LEFT) + 12.0, TOP + H + BELOW);
    let mut s = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" font-family=\"sans-serif\" font-size=\"11\"><rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>",
    );
    for (k, (column, title, y)) in panels.into_iter().enumerate() {
        let ox = LEFT + k as f64 * (W + LEFT);
        panel(&mut s, p, (ox, column, title), x, y);
    }
    let (middle, base) = (TOP + H / 2.0, TOP + H + 52.0);
    let _ = write!(s, "<text x=\"14\" y=\"{middle:.1}\" transform=\"rotate(-90 14 {middle:.1})\" text-anchor=\"middle\">residual, {}</text>", escape(unit));
    let _ = write!(s, "<path d=\"M{LEFT} {0:.1}h0\" stroke=\"#4878a8\" stroke-width=\"5\" stroke-linecap=\"round\"/><text x=\"{1:.1}\" y=\"{2:.1}\">rows, thinned</text><path d=\"M{3:.1} {0:.1}h22\" stroke=\"#c03020\" stroke-width=\"1.8\"/><text x=\"{4:.1}\" y=\"{2:.1}\">mean of all rows in at most 30 bins</text></svg>", base - 4.0, LEFT + 8.0, base, LEFT + 96.0, LEFT + 124.0);
    s
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_is_small_and_names_its_axes() {
        let x: Vec<f64> = (0..50_000).map(|i| f64::from(i % 997)).collect();
        let before: Vec<f64> = x.iter().map(|x| (x / 40.0).sin() - 2.0).collect();
        let after: Vec<f64> = before.iter().map(|b| 0.05 * (b + 2.0)).collect();
        let s = residuals(&Plot::new("speed <b>, deg/s", &x, &before, &after), "N");
        assert!(s.len() < 60_000, "{}", s.len());
        for part in [
            "residual, N",
            "speed &lt;b&gt;, deg/s",
            "before: RMS",
            "own scale",
        ] {
            assert!(s.contains(part), "{part}");
        }
        let flat = residuals(&Plot::new("x", &[1.0; 50], &[0.0; 50], &[0.0; 50]), "N");
        assert!(!flat.contains("NaN") && !flat.contains("inf"));
    }
}
