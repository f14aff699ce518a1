//! The view as an SVG file: what a terminal of [`COLUMNS`] by [`ROWS`] shows.

use super::view::View;
use ratatui::backend::TestBackend;
use ratatui::buffer::{Buffer, Cell};
use ratatui::style::{Color, Modifier};
use ratatui::Terminal;
use std::fmt::Write as _;

/// Size of the picture in characters.
pub const COLUMNS: u16 = 110;
/// See [`COLUMNS`].
pub const ROWS: u16 = 22;
/// Size of a character, px.
const CELL: (f64, f64) = (8.4, 17.0);
/// Edge around the text, px.
const MARGIN: f64 = 10.0;
const BACKGROUND: &str = "#14181d";
const FOREGROUND: &str = "#d8dee4";

/// The picture.
pub fn svg(view: &View<'_>) -> String {
    // Memory is no terminal that could fail.
    let Ok(mut terminal) = Terminal::new(TestBackend::new(COLUMNS, ROWS));
    let Ok(_) = terminal.draw(|frame| view.draw(frame));
    of_buffer(terminal.backend().buffer())
}

/// What makes a character look as it does.
#[derive(PartialEq, Clone, Copy)]
struct Look {
    color: &'static str,
    back: Option<&'static str>,
    bold: bool,
}

fn look(cell: &Cell) -> Look {
    let color = match cell.fg {
        Color::Red => "#ff6b6b",
        Color::Green => "#6bd68a",
        Color::Yellow => "#f2c14e",
        Color::Cyan => "#5bc8dc",
        _ if cell.modifier.contains(Modifier::DIM) => "#7d8894",
        _ => FOREGROUND,
    };
    let reversed = cell.modifier.contains(Modifier::REVERSED);
    Look {
        color: if reversed { BACKGROUND } else { color },
        back: reversed.then_some(color),
        bold: cell.modifier.contains(Modifier::BOLD),
    }
}

/// A buffer as SVG, one text for each run of equal characters.
fn of_buffer(buffer: &Buffer) -> String {
    let (width, height) = (buffer.area.width, buffer.area.height);
    let mut out = String::new();
    let (w, h) = (
        f64::from(width) * CELL.0 + 2.0 * MARGIN,
        f64::from(height) * CELL.1 + 2.0 * MARGIN,
    );
    row!(
        out,
        r#"<svg xmlns="http://www.w3.org/2000/svg" width="{w:.0}" height="{h:.0}" viewBox="0 0 {w:.0} {h:.0}" font-family="DejaVu Sans Mono, Menlo, Consolas, monospace" font-size="14">"#
    );
    row!(
        out,
        r#"<rect width="100%" height="100%" fill="{BACKGROUND}"/>"#
    );
    for y in 0..height {
        let mut x = 0;
        while x < width {
            let start = x;
            let first = look(&buffer[(x, y)]);
            let mut text = String::new();
            while x < width && look(&buffer[(x, y)]) == first {
                text.push_str(buffer[(x, y)].symbol());
                x += 1;
            }
            run(&mut out, &text, (start, y), x - start, first);
        }
    }
    out.push_str("</svg>\n");
    out
}

fn run(out: &mut String, text: &str, (x, y): (u16, u16), columns: u16, look: Look) {
    let left = MARGIN + f64::from(x) * CELL.0;
    let top = MARGIN + f64::from(y) * CELL.1;
    let length = f64::from(columns) * CELL.0;
    if let Some(back) = look.back {
        row!(
            out,
            r#"<rect x="{left:.1}" y="{top:.1}" width="{length:.1}" height="{}" fill="{back}"/>"#,
            CELL.1
        );
    }
    if text.trim().is_empty() {
        return;
    }
    let escaped = text
        .replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;");
    let weight = if look.bold {
        r#" font-weight="bold""#
    } else {
        ""
    };
    row!(
        out,
        r#"<text x="{left:.1}" y="{:.1}" textLength="{length:.1}" lengthAdjust="spacingAndGlyphs" fill="{}"{weight} xml:space="preserve">{escaped}</text>"#,
        top + 0.78 * CELL.1,
        look.color
    );
}
