//! Pictures: lines, rectangles, points and text, panels with axes, written as SVG.

mod axes;

pub use axes::{range, Axes};
use std::fmt::{Display, Formatter};

/// Red, green, blue; shown as `#rrggbb`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Color(pub u8, pub u8, pub u8);

impl Display for Color {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        write!(f, "#{:02x}{:02x}{:02x}", self.0, self.1, self.2)
    }
}

/// The `n`-th color of curves: Okabe and Ito's palette, which colour-blind readers can distinguish
/// too, then gray and brown, and so on from the start.
#[must_use]
pub const fn color(n: usize) -> Color {
    const COLORS: [Color; 8] = [
        Color(0x00, 0x72, 0xB2),
        Color(0xD5, 0x5E, 0x00),
        Color(0x00, 0x9E, 0x73),
        Color(0xCC, 0x79, 0xA7),
        Color(0xE6, 0x9F, 0x00),
        Color(0x56, 0xB4, 0xE9),
        Color(0x88, 0x88, 0x88),
        Color(0x8C, 0x56, 0x4B),
    ];
    COLORS[n % COLORS.len()]
}

/// Text and frames.
pub const BLACK: Color = Color(0x22, 0x22, 0x22);
/// Lines of a grid.
pub const GRAY: Color = Color(0xB8, 0xB8, 0xB8);
/// A band that counts as good.
pub const BAND: Color = Color(0xE4, 0xF2, 0xEC);

/// White to dark blue, from 0 to 1.
#[must_use]
pub fn shade(part: f64) -> Color {
    let mix = |from: f64, to: f64| (from + (to - from) * part.clamp(0.0, 1.0)).round() as u8;
    Color(mix(222.0, 8.0), mix(235.0, 48.0), mix(247.0, 107.0))
}

/// Which point of a text is given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    /// Its start.
    Start,
    /// Its middle.
    Middle,
    /// Its end.
    End,
}

/// A picture on white. Coordinates in pixels, y downwards.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    width: f32,
    height: f32,
    /// What is told to who does not see it.
    words: String,
    items: Vec<String>,
}

impl Scene {
    /// An empty picture.
    #[must_use]
    pub const fn new(width: f32, height: f32) -> Self {
        Self {
            width,
            height,
            words: String::new(),
            items: Vec::new(),
        }
    }

    /// Says what the picture shows, for readers that do not see it.
    pub fn describe(&mut self, words: &str) {
        words.clone_into(&mut self.words);
    }

    /// A line through points.
    pub fn line(&mut self, points: &[(f32, f32)], width: f32, color: Color, dashed: bool) {
        let dash = if dashed {
            r#" stroke-dasharray="5 3""#
        } else {
            ""
        };
        let points: String = points
            .iter()
            .map(|(x, y)| format!("{x:.1},{y:.1} "))
            .collect();
        self.items.push(format!(
            r#"<polyline fill="none" stroke="{color}" stroke-width="{width}"{dash} points="{points}"/>"#
        ));
    }

    /// Round points of this diameter; `opacity` from 0 to 1.
    pub fn points(&mut self, points: &[(f32, f32)], diameter: f32, color: Color, opacity: f32) {
        // Strokes of no length with round ends take a tenth of the text of circles.
        let points: String = points
            .iter()
            .map(|(x, y)| format!("M{x:.1} {y:.1}h0"))
            .collect();
        self.items.push(format!(
            r#"<path d="{points}" stroke="{color}" stroke-opacity="{opacity}" stroke-width="{diameter}" stroke-linecap="round"/>"#
        ));
    }

    /// A filled rectangle.
    pub fn rectangle(&mut self, x: f32, y: f32, width: f32, height: f32, color: Color) {
        self.items.push(format!(
            r#"<rect x="{x:.1}" y="{y:.1}" width="{width:.1}" height="{height:.1}" fill="{color}"/>"#
        ));
    }

    /// A line of text on a baseline, in black.
    pub fn text(&mut self, at: (f32, f32), anchor: Anchor, text: &str) {
        self.colored_text(at, anchor, text, BLACK);
    }

    /// A line of text on a baseline.
    pub fn colored_text(&mut self, at: (f32, f32), anchor: Anchor, text: &str, color: Color) {
        self.write_text(at, anchor, text, color, "");
    }

    /// A heading that starts here.
    pub fn heading(&mut self, at: (f32, f32), text: &str) {
        self.write_text(at, Anchor::Start, text, BLACK, r#" font-weight="bold""#);
    }

    /// A line of text from below to above, its middle here.
    pub fn upward_text(&mut self, (x, y): (f32, f32), text: &str) {
        let turned = format!(r#" transform="rotate(-90 {x:.1} {y:.1})""#);
        self.write_text((x, y), Anchor::Middle, text, BLACK, &turned);
    }

    fn write_text(&mut self, at: (f32, f32), anchor: Anchor, text: &str, color: Color, more: &str) {
        if text.is_empty() {
            return;
        }
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let ((x, y), text) = (at, escaped(text));
        self.items.push(format!(
            r#"<text x="{x:.1}" y="{y:.1}" text-anchor="{anchor}"{more} fill="{color}">{text}</text>"#
        ));
    }

    /// As SVG.
    #[must_use]
    pub fn to_svg(&self) -> String {
        let (w, h, items) = (self.width, self.height, self.items.join("\n"));
        let label = match self.words.as_str() {
            "" => String::new(),
            words => format!(
                r#" role="img" aria-label="{}""#,
                escaped(words).replace('"', "&quot;")
            ),
        };
        format!(
            r##"<svg xmlns="http://www.w3.org/2000/svg" width="{w}" height="{h}" viewBox="0 0 {w} {h}"{label} font-family="sans-serif" font-size="12"><rect width="{w}" height="{h}" fill="#ffffff"/>
{items}
</svg>
"##
        )
    }
}

fn escaped(text: &str) -> String {
    // XML has no place for control characters.
    text.replace(char::is_control, "\u{fffd}")
        .replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_picture_shows_what_was_drawn() {
        let mut scene = Scene::new(100.0, 50.0);
        scene.rectangle(0.0, 0.0, 20.0, 20.0, Color(1, 2, 3));
        scene.line(&[(30.0, 10.0), (90.0, 10.0)], 4.0, Color(255, 0, 0), false);
        scene.text((50.0, 40.0), Anchor::Middle, "a < b & c");
        let svg = scene.to_svg();
        assert!(svg.contains("a &lt; b &amp; c"), "{svg}");
        assert!(svg.contains("#010203") && svg.ends_with("</svg>\n"));
        assert!(svg.contains("points=\"30.0,10.0 90.0,10.0 \""), "{svg}");
        assert!(
            svg.contains("x=\"50.0\" y=\"40.0\" text-anchor=\"middle\""),
            "{svg}"
        );
    }
}
