//! Lines, rectangles and text of a picture, written as SVG.

mod axes;

pub use axes::{label, tick, ticks};
use std::fmt::Write;

/// Red, green, blue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Color(pub u8, pub u8, pub u8);

/// Okabe and Ito's palette: also distinguishable for colour-blind readers.
pub const COLORS: [Color; 6] = [
    Color(0x00, 0x72, 0xB2),
    Color(0xD5, 0x5E, 0x00),
    Color(0x00, 0x9E, 0x73),
    Color(0xCC, 0x79, 0xA7),
    Color(0xE6, 0x9F, 0x00),
    Color(0x56, 0xB4, 0xE9),
];
/// Text and frames.
pub const BLACK: Color = Color(0x22, 0x22, 0x22);
/// Lines of a grid.
pub const GRAY: Color = Color(0xB8, 0xB8, 0xB8);
/// A band that counts as good.
pub const BAND: Color = Color(0xE4, 0xF2, 0xEC);

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

#[derive(Debug, Clone, PartialEq)]
enum Item {
    Line {
        points: Vec<(f32, f32)>,
        width: f32,
        color: Color,
        dashed: bool,
    },
    Rectangle {
        x: f32,
        y: f32,
        width: f32,
        height: f32,
        color: Color,
    },
    Text {
        x: f32,
        y: f32,
        text: String,
        anchor: Anchor,
        bold: bool,
        color: Color,
    },
}

/// A picture on white. Coordinates in pixels, y downwards.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    width: f32,
    height: f32,
    items: Vec<Item>,
}

impl Scene {
    /// An empty picture.
    #[must_use]
    pub const fn new(width: f32, height: f32) -> Self {
        Self {
            width,
            height,
            items: Vec::new(),
        }
    }

    /// A line through points.
    pub fn line(&mut self, points: &[(f32, f32)], width: f32, color: Color, dashed: bool) {
        self.items.push(Item::Line {
            points: points.to_vec(),
            width,
            color,
            dashed,
        });
    }

    /// A filled rectangle.
    pub fn rectangle(&mut self, x: f32, y: f32, width: f32, height: f32, color: Color) {
        self.items.push(Item::Rectangle {
            x,
            y,
            width,
            height,
            color,
        });
    }

    /// A line of text on a baseline.
    pub fn text(&mut self, x: f32, y: f32, text: &str, anchor: Anchor, bold: bool, color: Color) {
        self.items.push(Item::Text {
            x,
            y,
            text: text.to_owned(),
            anchor,
            bold,
            color,
        });
    }

    /// As SVG.
    #[must_use]
    pub fn to_svg(&self) -> String {
        let (w, h) = (self.width, self.height);
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}\" height=\"{h}\" viewBox=\"0 0 {w} {h}\" font-family=\"sans-serif\" font-size=\"12\">\n<rect width=\"{w}\" height=\"{h}\" fill=\"#ffffff\"/>\n"
        );
        for item in &self.items {
            // Writing to a String cannot fail.
            let _ = write_item(&mut svg, item);
        }
        svg.push_str("</svg>\n");
        svg
    }
}

fn hex(Color(r, g, b): Color) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

fn escaped(text: &str) -> String {
    // XML has no place for control characters.
    text.replace(char::is_control, "\u{fffd}")
        .replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

fn write_item(svg: &mut String, item: &Item) -> std::fmt::Result {
    match item {
        Item::Line {
            points,
            width,
            color,
            dashed,
        } => {
            let dash = if *dashed { " stroke-dasharray=\"5 3\"" } else { "" };
            write!(svg, "<polyline fill=\"none\" stroke=\"{}\" stroke-width=\"{width}\"{dash} points=\"", hex(*color))?;
            for (x, y) in points {
                write!(svg, "{x:.1},{y:.1} ")?;
            }
            svg.push_str("\"/>\n");
        }
        Item::Rectangle {
            x,
            y,
            width,
            height,
            color,
        } => writeln!(svg, "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" fill=\"{}\"/>", hex(*color))?,
        Item::Text {
            x,
            y,
            text,
            anchor,
            bold,
            color,
        } => {
            let anchor = match anchor {
                Anchor::Start => "start",
                Anchor::Middle => "middle",
                Anchor::End => "end",
            };
            let weight = if *bold { " font-weight=\"bold\"" } else { "" };
            writeln!(svg, "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\"{weight} fill=\"{}\">{}</text>", hex(*color), escaped(text))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_picture_shows_what_was_drawn() {
        let mut scene = Scene::new(100.0, 50.0);
        scene.rectangle(0.0, 0.0, 20.0, 20.0, Color(1, 2, 3));
        scene.line(&[(30.0, 10.0), (90.0, 10.0)], 4.0, Color(255, 0, 0), false);
        scene.text(
            50.0,
            40.0,
            "a < b & c",
            Anchor::Middle,
            false,
            Color(0, 0, 255),
        );
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
