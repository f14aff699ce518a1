//! Plots of residuals as small SVG pictures.

use crate::report::Plot;
use std::fmt::Write as _;

const W: f64 = 340.0;
const H: f64 = 240.0;
const LEFT: f64 = 56.0;
const TOP: f64 = 28.0;

/// Round ticks over a range.
fn ticks(lo: f64, hi: f64) -> Vec<f64> {
    let raw = (hi - lo) / 4.0;
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
        s.trim_end_matches('0').trim_end_matches('.').to_string()
    }
}

/// Two panels, before and after, on the same scales: points, binned means, axes.
pub(crate) fn residuals(p: &Plot, unit: &str) -> String {
    let finite = |v: &[f64]| -> Vec<f64> {
        let mut v: Vec<f64> = v.iter().copied().filter(|x| x.is_finite()).collect();
        v.sort_by(f64::total_cmp);
        v
    };
    let xs = finite(&p.x);
    let ys = finite(&p.before);
    let q = crate::stats::quantile_sorted;
    let (mut x0, mut x1) = (q(&xs, 0.002), q(&xs, 0.998));
    let (mut y0, mut y1) = (q(&ys, 0.002), q(&ys, 0.998));
    if x1 <= x0 {
        (x0, x1) = (x0 - 1.0, x0 + 1.0);
    }
    if y1 <= y0 {
        (y0, y1) = (y0 - 1.0, y0 + 1.0);
    }
    let (dx, dy) = (0.04 * (x1 - x0), 0.06 * (y1 - y0));
    (x0, x1, y0, y1) = (x0 - dx, x1 + dx, (y0 - dy).min(-dy), (y1 + dy).max(dy));
    let total_w = 2.0 * (W + LEFT) + 20.0;
    let mut s = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {total_w} {}\" font-family=\"sans-serif\" font-size=\"11\"><rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>",
        H + TOP + 44.0
    );
    for (k, (title, values, column)) in [("before", &p.before, 1), ("after", &p.after, 2)]
        .into_iter()
        .enumerate()
    {
        let ox = LEFT + k as f64 * (W + LEFT);
        let px = |x: f64| ox + (x - x0) / (x1 - x0) * W;
        let py = |y: f64| TOP + (y1 - y) / (y1 - y0) * H;
        let _ = write!(
            s,
            "<text x=\"{:.1}\" y=\"16\" font-weight=\"bold\">{title}</text>",
            ox
        );
        let _ = write!(s, "<rect x=\"{ox:.1}\" y=\"{TOP}\" width=\"{W}\" height=\"{H}\" fill=\"none\" stroke=\"#888\"/>");
        for t in ticks(x0, x1) {
            let x = px(t);
            let _ = write!(s, "<line x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{TOP}\" y2=\"{:.1}\" stroke=\"#eee\"/><text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>", TOP + H, TOP + H + 14.0, label(t));
        }
        for t in ticks(y0, y1) {
            let y = py(t);
            let _ = write!(s, "<line x1=\"{ox:.1}\" x2=\"{:.1}\" y1=\"{y:.1}\" y2=\"{y:.1}\" stroke=\"#eee\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>", ox + W, ox - 4.0, y + 4.0, label(t));
        }
        for (x, y) in p.x.iter().zip(values) {
            if *x >= x0 && *x <= x1 && *y >= y0 && *y <= y1 {
                let _ = write!(s, "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"1.3\" fill=\"#4878a8\" fill-opacity=\"0.35\"/>", px(*x), py(*y));
            }
        }
        let line: Vec<String> = p
            .means
            .iter()
            .filter(|m| m[0] >= x0 && m[0] <= x1 && m[column] >= y0 && m[column] <= y1)
            .map(|m| format!("{:.1},{:.1}", px(m[0]), py(m[column])))
            .collect();
        let _ = write!(
            s,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"#c03020\" stroke-width=\"1.8\"/>",
            line.join(" ")
        );
        let name = p
            .against
            .replace('&', "&amp;")
            .replace('<', "&lt;")
            .replace('>', "&gt;");
        let short: String = if name.chars().count() > 52 {
            name.chars().take(49).chain("...".chars()).collect()
        } else {
            name
        };
        let _ = write!(
            s,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{short}</text>",
            ox + W / 2.0,
            TOP + H + 32.0
        );
    }
    let _ = write!(s, "<text x=\"12\" y=\"{:.1}\" transform=\"rotate(-90 12 {:.1})\" text-anchor=\"middle\">residual, {unit}</text></svg>", TOP + H / 2.0, TOP + H / 2.0);
    s
}
