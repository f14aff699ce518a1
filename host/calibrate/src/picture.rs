//! Pictures of a calibration: residuals of readings and points, feasible forces over the workspace.

use scene::{color, Anchor, Color, Scene, BAND, GRAY};

const BLUE: Color = color(0);
const RED: Color = color(1);
const ROW: f32 = 16.0;

/// A value with its name and what is to be expected of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Bar {
    /// Name of the row.
    pub label: String,
    /// Value.
    pub value: f64,
    /// Standard deviation to be expected; bars beyond three of it are red.
    pub sd: f64,
}

/// Bars to both sides of zero, one row each, on a band of two standard deviations.
#[must_use]
pub fn bars(title: &str, unit: &str, bars: &[Bar]) -> Scene {
    let (left, width) = (190.0, 560.0);
    let height = 60.0 + ROW * bars.len() as f32 + 30.0;
    let mut scene = Scene::new(left + width + 120.0, height);
    scene.heading((16.0, 24.0), title);
    let reach = bars
        .iter()
        .map(|b| b.value.abs().max(3.0 * b.sd))
        .filter(|v| v.is_finite())
        .fold(f64::MIN_POSITIVE, f64::max);
    let middle = left + width / 2.0;
    let at = |value: f64| middle + (value / reach) as f32 * width / 2.0;
    let bottom = 50.0 + ROW * bars.len() as f32;
    for (i, bar) in bars.iter().enumerate() {
        let top = 50.0 + ROW * i as f32;
        let band = at(2.0 * bar.sd) - middle;
        scene.rectangle(middle - band, top, 2.0 * band, ROW, BAND);
        scene.text((left - 10.0, top + 12.0), Anchor::End, &bar.label);
        let color = if bar.value.abs() > 3.0 * bar.sd {
            RED
        } else {
            BLUE
        };
        let (a, b) = (at(bar.value).min(middle), at(bar.value).max(middle));
        scene.rectangle(a, top + 3.0, (b - a).max(1.0), ROW - 6.0, color);
        let text = format!("{:+.3}", bar.value);
        scene.text((left + width + 10.0, top + 12.0), Anchor::Start, &text);
    }
    scene.line(&[(middle, 50.0), (middle, bottom)], 1.0, GRAY, false);
    for (value, anchor) in [
        (-reach, Anchor::Start),
        (0.0, Anchor::Middle),
        (reach, Anchor::End),
    ] {
        let text = format!("{value:.3} {unit}");
        scene.text((at(value), bottom + 18.0), anchor, &text);
    }
    scene
}

/// A map of values over a plane: `values[row][column]`, rows upwards; NaN leaves a square empty.
#[derive(Debug, Clone, PartialEq)]
pub struct Map {
    /// Heading.
    pub title: String,
    /// Names of the axes to the right and upwards.
    pub axes: (&'static str, &'static str),
    /// Middle of the first and last square along both, mm.
    pub span_mm: [(f64, f64); 2],
    /// Values.
    pub values: Vec<Vec<f64>>,
}

/// Maps beside each other on one scale of colours.
#[must_use]
pub fn maps(title: &str, unit: &str, maps: &[Map]) -> Scene {
    let (side, gap, left, top) = (300.0f32, 70.0f32, 60.0f32, 80.0f32);
    let width = left + maps.len() as f32 * (side + gap) + 100.0;
    let mut scene = Scene::new(width, top + side + 60.0);
    scene.heading((left, 28.0), title);
    let all = maps.iter().flat_map(|m| m.values.iter().flatten());
    let (low, high) = all
        .filter(|v| v.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
            (l.min(*v), h.max(*v))
        });
    let (low, high) = if low < high {
        (low, high)
    } else {
        (low - 0.5, low + 0.5)
    };
    for (k, map) in maps.iter().enumerate() {
        let x0 = left + k as f32 * (side + gap);
        scene.text((x0, top - 12.0), Anchor::Start, &map.title);
        let rows = map.values.len().max(1);
        let columns = map.values.first().map_or(1, Vec::len).max(1);
        let (w, h) = (side / columns as f32, side / rows as f32);
        for (r, row) in map.values.iter().enumerate() {
            for (c, value) in row.iter().enumerate().filter(|(_, v)| v.is_finite()) {
                let y = top + side - h * (r + 1) as f32;
                scene.rectangle(
                    x0 + w * c as f32,
                    y,
                    w,
                    h,
                    viridis((value - low) / (high - low)),
                );
            }
        }
        let text = |v: f64| format!("{v:.0}");
        let [(xa, xb), (ya, yb)] = map.span_mm;
        let base = top + side + 16.0;
        scene.text((x0, base), Anchor::Start, &text(xa));
        scene.text((x0 + side, base), Anchor::End, &text(xb));
        let name = format!("{}, mm", map.axes.0);
        scene.text((x0 + side / 2.0, base), Anchor::Middle, &name);
        scene.text((x0 - 6.0, top + side), Anchor::End, &text(ya));
        scene.text((x0 - 6.0, top + 10.0), Anchor::End, &text(yb));
        let name = format!("{}, mm", map.axes.1);
        scene.text((x0 - 6.0, top + side / 2.0), Anchor::End, &name);
    }
    let x = left + maps.len() as f32 * (side + gap) - 20.0;
    for i in 0..50u8 {
        let part = f64::from(i) / 49.0;
        let y = top + side - side * f32::from(i + 1) / 50.0;
        scene.rectangle(x, y, 20.0, side / 50.0 + 0.5, viridis(part));
    }
    for (part, value) in [(0.0f32, low), (0.5, 0.5 * (low + high)), (1.0, high)] {
        let y = top + side - side * part + 4.0;
        scene.text((x + 26.0, y), Anchor::Start, &format!("{value:.2} {unit}"));
    }
    scene
}

/// Dark blue over green to yellow: five stops of the viridis scale, legible without colour too.
fn viridis(part: f64) -> Color {
    const STOPS: [[f64; 3]; 5] = [
        [68.0, 1.0, 84.0],
        [59.0, 82.0, 139.0],
        [33.0, 145.0, 140.0],
        [94.0, 201.0, 98.0],
        [253.0, 231.0, 37.0],
    ];
    let at = part.clamp(0.0, 1.0) * 4.0;
    let i = (at as usize).min(3);
    let f = at - i as f64;
    let mix = |k: usize| (STOPS[i][k] * (1.0 - f) + STOPS[i + 1][k] * f).round() as u8;
    Color(mix(0), mix(1), mix(2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bar_far_outside_is_red_and_each_row_has_its_name() {
        let row = |label: &str, value| Bar {
            label: label.to_owned(),
            value,
            sd: 1.0,
        };
        let svg = bars(
            "residuals",
            "mN",
            &[row("line 2", 0.5), row("line 3", -9.0)],
        )
        .to_svg();
        assert!(svg.contains("line 2") && svg.contains("line 3"), "{svg}");
        assert_eq!(svg.matches("#d55e00").count(), 1);
        assert!(bars("none", "mN", &[]).to_svg().contains("none"));
        assert!(!bars("nan", "mN", &[row("x", f64::NAN)])
            .to_svg()
            .contains("inf"));
    }

    #[test]
    fn a_map_leaves_out_what_has_no_value() {
        let map = Map {
            title: "z".to_owned(),
            axes: ("x", "y"),
            span_mm: [(-10.0, 10.0), (-20.0, 20.0)],
            values: vec![vec![1.0, f64::NAN], vec![2.0, 3.0]],
        };
        let svg = maps("forces", "N", &[map]).to_svg();
        // Background, three squares, fifty of the scale.
        assert_eq!(svg.matches("<rect").count(), 1 + 3 + 50);
        assert_eq!(viridis(0.0), Color(68, 1, 84));
        assert_eq!(viridis(2.0), Color(253, 231, 37));
    }
}
