//! Lines, rectangles and words, written as SVG or painted as PNG. Its letters come with the program, so a
//! machine without fonts paints the same picture.

use embedded_graphics::mono_font::{iso_8859_1, MonoFont, MonoTextStyle};
use embedded_graphics::pixelcolor::BinaryColor;
use embedded_graphics::prelude::{
    Dimensions, DrawTarget, Drawable, OriginDimensions, Pixel, Point, Size,
};
use embedded_graphics::text::Text;
use std::fmt::Write;
use tiny_skia::{
    LineCap, LineJoin, Paint, PathBuilder, Pixmap, PremultipliedColorU8, Rect, Stroke, StrokeDash,
    Transform,
};

/// Red, green, blue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Color(pub u8, pub u8, pub u8);

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

/// Pixels of the PNG to a pixel of the scene.
const SCALE: f32 = 1.5;

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

    /// As PNG.
    ///
    /// # Errors
    /// In words, where the picture can't be encoded (a size of zero).
    pub fn to_png(&self) -> Result<Vec<u8>, String> {
        let (width, height) = (
            (self.width * SCALE).ceil() as u32,
            (self.height * SCALE).ceil() as u32,
        );
        let mut pixmap = Pixmap::new(width, height)
            .ok_or_else(|| format!("a picture of {width} x {height} pixels can't be made"))?;
        pixmap.fill(tiny_skia::Color::WHITE);
        for item in &self.items {
            paint(&mut pixmap, item);
        }
        // White and opaque all over: premultiplied is plain.
        let rgb: Vec<u8> = pixmap
            .pixels()
            .iter()
            .flat_map(|p| [p.red(), p.green(), p.blue()])
            .collect();
        let mut out = Vec::new();
        let mut encoder = png::Encoder::new(&mut out, width, height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header().map_err(|e| e.to_string())?;
        writer.write_image_data(&rgb).map_err(|e| e.to_string())?;
        writer.finish().map_err(|e| e.to_string())?;
        Ok(out)
    }
}

fn hex(Color(r, g, b): Color) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
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

fn paint(pixmap: &mut Pixmap, item: &Item) {
    let transform = Transform::from_scale(SCALE, SCALE);
    let mut brush = Paint {
        anti_alias: true,
        ..Paint::default()
    };
    match item {
        Item::Line {
            points,
            width,
            color,
            dashed,
        } => {
            brush.set_color_rgba8(color.0, color.1, color.2, 255);
            let mut path = PathBuilder::new();
            for (i, (x, y)) in points.iter().enumerate() {
                if i == 0 {
                    path.move_to(*x, *y);
                } else {
                    path.line_to(*x, *y);
                }
            }
            let stroke = Stroke {
                width: *width,
                line_cap: LineCap::Butt,
                line_join: LineJoin::Round,
                dash: if *dashed {
                    StrokeDash::new(vec![5.0, 3.0], 0.0)
                } else {
                    None
                },
                ..Stroke::default()
            };
            // A path of one point has no length: nothing to paint.
            if let Some(path) = path.finish() {
                pixmap.stroke_path(&path, &brush, &stroke, transform, None);
            }
        }
        Item::Rectangle {
            x,
            y,
            width,
            height,
            color,
        } => {
            brush.set_color_rgba8(color.0, color.1, color.2, 255);
            if let Some(rect) = Rect::from_xywh(*x, *y, *width, *height) {
                pixmap.fill_rect(rect, &brush, transform, None);
            }
        }
        Item::Text {
            x,
            y,
            text,
            anchor,
            bold,
            color,
        } => {
            let font: &MonoFont<'_> = if *bold {
                &iso_8859_1::FONT_9X18_BOLD
            } else {
                &iso_8859_1::FONT_8X13
            };
            let drawn = Text::new(
                text,
                Point::zero(),
                MonoTextStyle::new(font, BinaryColor::On),
            );
            let width = drawn.bounding_box().size.width as f32;
            let shift = match anchor {
                Anchor::Start => 0.0,
                Anchor::Middle => width / 2.0,
                Anchor::End => width,
            };
            let at = Point::new(
                (x * SCALE - shift).round() as i32,
                (y * SCALE).round() as i32,
            );
            let drawn = Text::new(text, at, MonoTextStyle::new(font, BinaryColor::On));
            // The target's error type has no value.
            let Ok(_) = drawn.draw(&mut Letters {
                pixmap,
                color: *color,
            });
        }
    }
}

/// Paints letters into a picture.
struct Letters<'p> {
    pixmap: &'p mut Pixmap,
    color: Color,
}

impl OriginDimensions for Letters<'_> {
    fn size(&self) -> Size {
        Size::new(self.pixmap.width(), self.pixmap.height())
    }
}

impl DrawTarget for Letters<'_> {
    type Color = BinaryColor;
    type Error = core::convert::Infallible;

    fn draw_iter<I>(&mut self, pixels: I) -> Result<(), Self::Error>
    where
        I: IntoIterator<Item = Pixel<Self::Color>>,
    {
        let (width, height) = (self.pixmap.width(), self.pixmap.height());
        let Color(r, g, b) = self.color;
        let Some(color) = PremultipliedColorU8::from_rgba(r, g, b, 255) else {
            return Ok(());
        };
        let buffer = self.pixmap.pixels_mut();
        for Pixel(point, on) in pixels {
            let (Ok(x), Ok(y)) = (u32::try_from(point.x), u32::try_from(point.y)) else {
                continue;
            };
            if on.is_on() && x < width && y < height {
                buffer[(y * width + x) as usize] = color;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_forms_show_what_was_drawn() {
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
        let png = scene.to_png().unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(png))
            .read_info()
            .unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width, info.height), (150, 75));
        let at =
            |x: usize, y: usize| <[u8; 3]>::try_from(&pixels[(y * 150 + x) * 3..][..3]).unwrap();
        assert_eq!(at(10, 10), [1, 2, 3]);
        assert_eq!(at(90, 15), [255, 0, 0]);
        assert_eq!(at(149, 74), [255, 255, 255]);
        assert!(pixels.chunks(3).any(|p| p == [0, 0, 255]), "no letters");
        assert!(Scene::new(0.0, 0.0).to_png().is_err());
    }
}
