//! Two axes with round ticks, where values lie between them, and a legend beside them.

use crate::{Anchor, Color, Scene, GRAY};

/// Range of the finite values, a little wider; never empty.
#[must_use]
pub fn range(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let (low, high) = values
        .into_iter()
        .filter(|v| v.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
            (l.min(v), h.max(v))
        });
    if high > low {
        let margin = 0.02 * (high - low);
        (low - margin, high + margin)
    } else if low.is_finite() {
        (low - 0.5, low + 0.5)
    } else {
        (0.0, 1.0)
    }
}

/// Two axes: where their inside lies, and their ranges.
#[derive(Debug, Clone, PartialEq)]
pub struct Axes {
    /// Left edge, px.
    pub left: f32,
    /// Upper edge, px.
    pub top: f32,
    /// Width, px.
    pub width: f32,
    /// Height, px.
    pub height: f32,
    /// Values at the left and right edge.
    pub x: (f64, f64),
    /// Values at the lower and upper edge.
    pub y: (f64, f64),
}

impl Axes {
    /// Right edge, px.
    #[must_use]
    pub fn right(&self) -> f32 {
        self.left + self.width
    }

    /// Lower edge, px.
    #[must_use]
    pub fn bottom(&self) -> f32 {
        self.top + self.height
    }

    /// Where a value of x lies.
    #[must_use]
    pub fn at_x(&self, v: f64) -> f32 {
        self.left + ((v - self.x.0) / (self.x.1 - self.x.0)) as f32 * self.width
    }

    /// Where a value of y lies.
    #[must_use]
    pub fn at_y(&self, v: f64) -> f32 {
        self.top + self.height - ((v - self.y.0) / (self.y.1 - self.y.0)) as f32 * self.height
    }

    /// Where points lie.
    pub fn at(&self, points: impl IntoIterator<Item = (f64, f64)>) -> Vec<(f32, f32)> {
        let place = |(x, y)| (self.at_x(x), self.at_y(y));
        points.into_iter().map(place).collect()
    }

    /// Frame, ticks with their labels, a title, and the words of the x axis.
    pub fn draw(&self, scene: &mut Scene, title: &str, x_words: &str) {
        let (left, top, right, bottom) = (self.left, self.top, self.right(), self.bottom());
        let corners = [
            (left, top),
            (right, top),
            (right, bottom),
            (left, bottom),
            (left, top),
        ];
        scene.line(&corners, 0.8, GRAY, false);
        for (v, label) in ticks(self.x) {
            let x = self.at_x(v);
            scene.line(&[(x, bottom), (x, bottom + 4.0)], 0.8, GRAY, false);
            scene.text((x, bottom + 17.0), Anchor::Middle, &label);
        }
        for (v, label) in ticks(self.y) {
            let y = self.at_y(v);
            scene.line(&[(left - 4.0, y), (left, y)], 0.8, GRAY, false);
            scene.text((left - 7.0, y + 4.0), Anchor::End, &label);
        }
        let middle = left + 0.5 * self.width;
        scene.text((middle, bottom + 36.0), Anchor::Middle, x_words);
        scene.text((left, top - 9.0), Anchor::Start, title);
    }

    /// Lines at the ticks of both axes.
    pub fn grid(&self, scene: &mut Scene) {
        for (v, _) in ticks(self.x) {
            let x = self.at_x(v);
            scene.line(&[(x, self.top), (x, self.bottom())], 0.5, GRAY, false);
        }
        for (v, _) in ticks(self.y) {
            let y = self.at_y(v);
            scene.line(&[(self.left, y), (self.right(), y)], 0.5, GRAY, false);
        }
    }

    /// The `n`-th line of the legend to the right.
    pub fn legend(&self, scene: &mut Scene, n: usize, name: &str, color: Color) {
        let (x, y) = (self.right() + 12.0, self.top + 14.0 + 18.0 * n as f32);
        scene.line(&[(x, y - 4.0), (x + 20.0, y - 4.0)], 2.0, color, false);
        scene.text((x + 26.0, y), Anchor::Start, name);
    }
}

/// Some three to six round values in a range, with their labels.
fn ticks((low, high): (f64, f64)) -> Vec<(f64, String)> {
    let raw = (high - low) / 6.0;
    if raw.is_nan() || raw <= 0.0 {
        return Vec::new();
    }
    let power = raw.log10().floor();
    let base = 10f64.powf(power);
    let (factor, more) = [(1.0, 0), (2.0, 0), (2.5, 1), (5.0, 0)]
        .into_iter()
        .find(|(factor, _)| factor * base >= raw)
        .unwrap_or((10.0, -1));
    let (step, decimals) = (factor * base, more - power as i32);
    let (first, last) = ((low / step).ceil() as i64, (high / step).floor() as i64);
    (first..=last)
        .map(|n| n as f64 * step)
        .map(|v| (v, label(v, low.abs().max(high.abs()), decimals)))
        .collect()
}

/// A tick's label to `decimals` places; in powers of ten where the axis reaches no further than
/// 1e-3, or beyond 1e5.
fn label(value: f64, reach: f64, decimals: i32) -> String {
    if (1e-3..1e5).contains(&reach) {
        format!("{value:.*}", decimals.max(0) as usize)
    } else if value == 0.0 {
        "0".to_owned()
    } else {
        let places = (value.abs().log10() + 1e-9).floor() as i32 + decimals;
        format!("{value:.*e}", places.max(0) as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::BLACK;

    #[test]
    fn ticks_are_some_and_round_and_their_labels_tell_them() {
        let labels = |x| -> Vec<String> { ticks(x).into_iter().map(|(_, label)| label).collect() };
        assert_eq!(
            labels((0.0, 1.0)),
            ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]
        );
        assert_eq!(labels((-2.5, 5.0)), ["-2", "0", "2", "4"]);
        for (low, high) in [
            (0.0, 1.3),
            (-5.4, 5.4),
            (0.0, 0.004),
            (-3e-5, 8e-4),
            (2.0, 2.0021),
            (-4e6, 9e6),
            (0.0, 13.0),
            (1e-3, 2e3),
        ] {
            let ticks = ticks((low, high));
            assert!((3..=7).contains(&ticks.len()), "{low} {high} {ticks:?}");
            for (v, label) in &ticks {
                assert!((low..=high).contains(v));
                let shown: f64 = label.parse().unwrap();
                assert!((shown - v).abs() < 1e-3 * (high - low), "{ticks:?}");
            }
        }
        assert!(ticks((1.0, 1.0)).is_empty() && ticks((f64::NAN, 1.0)).is_empty());
    }

    #[test]
    fn a_range_is_never_empty() {
        assert_eq!(range([f64::NAN]), (0.0, 1.0));
        assert_eq!(range([2.0, 2.0]), (1.5, 2.5));
        assert_eq!(range([0.0, 100.0]), (-2.0, 102.0));
    }

    #[test]
    fn axes_place_values_and_have_names() {
        let axes = Axes {
            left: 10.0,
            top: 20.0,
            width: 100.0,
            height: 50.0,
            x: (0.0, 1.0),
            y: (0.0, 10.0),
        };
        assert_eq!(
            axes.at([(0.5, 10.0), (1.0, 0.0)]),
            [(60.0, 20.0), (110.0, 70.0)]
        );
        let mut scene = Scene::new(200.0, 100.0);
        axes.grid(&mut scene);
        axes.draw(&mut scene, "force, N", "time, s");
        axes.legend(&mut scene, 0, "cable 1", BLACK);
        let svg = scene.to_svg();
        for words in ["force, N", "time, s", "cable 1", ">0.2<", ">8<"] {
            assert!(svg.contains(words), "{words}: {svg}");
        }
    }
}
