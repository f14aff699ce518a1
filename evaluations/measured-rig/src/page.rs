//! A page with marked blocks, `<!-- figures: NAME -->` to `<!-- end -->`, which are filled, and the
//! folder of plots beside it.

use residual::Error;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What a page is filled with.
#[derive(Debug, Default)]
pub struct Content {
    /// Blocks by name.
    pub blocks: BTreeMap<&'static str, String>,
    /// Pictures (SVG) by file name.
    pub plots: BTreeMap<&'static str, String>,
}

/// A page as it was read.
pub struct Page {
    path: PathBuf,
    text: String,
}

impl Page {
    /// Reads a page.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn read(path: &Path) -> Result<Page, Error> {
        Ok(Page {
            path: path.to_path_buf(),
            text: std::fs::read_to_string(path).map_err(|e| io(path, e))?,
        })
    }

    /// Writes the page with every block filled, and the plots into the folder named like the page.
    ///
    /// # Errors
    /// [`Error::Io`] if the marks of the page are not those of the blocks, or a file cannot be
    /// written.
    pub fn write(self, content: &Content) -> Result<(), Error> {
        let text = fill(&self.text, &content.blocks).map_err(|why| io(&self.path, why))?;
        let folder = self.path.with_extension("");
        std::fs::create_dir_all(&folder).map_err(|e| io(&folder, e))?;
        for (name, svg) in &content.plots {
            let path = folder.join(name);
            std::fs::write(&path, svg).map_err(|e| io(&path, e))?;
        }
        std::fs::write(&self.path, text).map_err(|e| io(&self.path, e))?;
        println!(
            "{}: {} blocks, {} plots",
            self.path.display(),
            content.blocks.len(),
            content.plots.len()
        );
        Ok(())
    }
}

fn io(path: &Path, why: impl ToString) -> Error {
    Error::Io {
        path: path.to_path_buf(),
        why: why.to_string(),
    }
}

/// Puts every block between its marks. A mark without a block, or a block without a mark, is an
/// error.
fn fill(text: &str, blocks: &BTreeMap<&'static str, String>) -> Result<String, String> {
    const OPEN: &str = "<!-- figures: ";
    const CLOSE: &str = "<!-- end -->";
    let mut out = String::new();
    let mut rest = text;
    let mut used = Vec::new();
    while let Some(at) = rest.find(OPEN) {
        let (head, tail) = rest.split_at(at + OPEN.len());
        let (name, tail) = tail
            .split_once(" -->")
            .ok_or("a mark `<!-- figures: NAME -->` is not closed")?;
        let end = tail
            .find(CLOSE)
            .ok_or(format!("block `{name}` has no `{CLOSE}`"))?;
        let block = blocks.get(name).ok_or(format!(
            "no block `{name}`; there are {}",
            blocks.keys().copied().collect::<Vec<_>>().join(", ")
        ))?;
        out.push_str(&format!("{head}{name} -->\n\n{}\n\n", block.trim_end()));
        used.push(name);
        rest = &tail[end..];
    }
    match blocks.keys().find(|b| !used.contains(b)) {
        Some(missing) => Err(format!("the page has no mark `{OPEN}{missing} -->`")),
        None => Ok(out + rest),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(text: &str) -> Result<String, String> {
        fill(text, &[("a", "new\n".to_string())].into())
    }

    #[test]
    fn blocks_are_replaced_and_the_text_around_them_stays() {
        let page = "x\n<!-- figures: a -->\nold\n<!-- end -->\ny";
        let once = filled(page).unwrap();
        assert_eq!(once, "x\n<!-- figures: a -->\n\nnew\n\n<!-- end -->\ny");
        assert_eq!(filled(&once).unwrap(), once);
    }

    #[test]
    fn marks_and_blocks_that_do_not_match_are_named() {
        for (page, part) in [
            ("nothing", "no mark `<!-- figures: a -->`"),
            ("<!-- figures: b --><!-- end -->", "no block `b`"),
            ("<!-- figures: a -->", "no `<!-- end -->`"),
            ("<!-- figures: a", "not closed"),
        ] {
            let error = filled(page).unwrap_err();
            assert!(error.contains(part), "{page}: {error}");
        }
    }
}
