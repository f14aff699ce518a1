//! The page on the measured data of the thesis rig: `cargo xtask residual-report`.
//!
//! Runs every analysis and writes the figures into the marked blocks of a page, so that no figure
//! in it is typed by hand, and the plots into a folder beside it, named like the page. What the
//! figures mean is the page's own text.
//!
//! | file | concern |
//! |---|---|
//! | `arguments.rs`, `data.rs` | the command line, and where the data are; xtask includes both |
//! | `models.rs`, `recording.rs` | the model files, and the original layouts |
//! | `page.rs` | the marked blocks of the page |
//! | `text.rs` | what the blocks have in common |
//! | `gauge.rs`, `moving.rs`, `closed_loop.rs` | the analyses |

/// The command line.
pub mod arguments;
mod closed_loop;
/// Where the data are.
pub mod data;
mod gauge;
/// The model files.
pub mod models;
mod moving;
/// The page.
pub mod page;
/// The original layout of closed-loop runs.
pub mod recording;
mod text;

use data::Data;
use page::Page;
use residual::{Console, Error};
use std::path::Path;

/// Analyses the data and writes the page and its plots.
///
/// # Errors
/// Any [`Error`] of an analysis; [`Error::Io`] if the page cannot be read, lacks a block, or a file
/// cannot be written. Then nothing is written.
pub fn write(data: &Data, path: &Path) -> Result<(), Error> {
    let page = Page::read(path)?;
    let mut out = page::Content::default();
    let console = &mut Console::default();
    let moving = moving::moving_rows(data, &mut out, console)?;
    gauge::all_rows(data, &mut out, console)?;
    gauge::compensated(data, &moving, &mut out, console)?;
    closed_loop::closed_loop(data, &mut out, console)?;
    page.write(&out)
}
