//! The documents as a book with a search: `cargo xtask book`, by mdBook.
//!
//! mdBook takes pages from one folder only. README, CONTRIBUTING and others stand in the root,
//! where code hosts look for them. So the pages are copied into the target directory as they lie
//! here, and `docs/SUMMARY.md` becomes theirs.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use crate::process::{self, Sees};
use crate::report::{say, Failure, Result};
use crate::workspace::Workspace;

/// What pages link to: the folders whole, of the root the Markdown files.
const FOLDERS: [&str; 3] = ["docs", "host-cli/examples", "python/examples"];

/// Builds the book into `target/book`. Arguments go to `mdbook build`.
///
/// # Errors
/// When mdBook is not installed or fails, or a file can't be copied.
pub fn build(workspace: &Workspace, arguments: &[OsString]) -> Result<()> {
    let program = process::find_program("mdbook").ok_or_else(|| {
        Failure::new("mdbook is not installed").remedy("cargo install mdbook --locked")
    })?;
    let source = workspace.target().join("book-source");
    let book = workspace.target().join("book");
    stage(workspace.root(), &source)
        .map_err(|e| Failure::new(format!("{} can't be written: {e}", source.display())))?;
    process::run(
        process::command(program, Sees::CompilerAndFlags)
            .arg("build")
            .arg(&source)
            .arg("--dest-dir")
            .arg(&book)
            .args(arguments),
    )?;
    say(format!("{}", book.join("index.html").display()));
    Ok(())
}

/// Lays out what mdBook reads: `book.toml`, and in `pages` the documents with the summary above
/// them.
fn stage(root: &Path, source: &Path) -> std::io::Result<()> {
    if source.exists() {
        fs::remove_dir_all(source)?;
    }
    let pages = source.join("pages");
    for folder in FOLDERS {
        copy(&root.join(folder), &pages.join(folder))?;
    }
    for file in files(root)? {
        if file.extension().is_some_and(|extension| extension == "md") {
            fs::copy(&file, pages.join(file.file_name().unwrap_or_default()))?;
        }
    }
    for file in ["book.toml", "book.css"] {
        fs::rename(pages.join("docs").join(file), source.join(file))?;
    }
    let summary = fs::read_to_string(pages.join("docs/SUMMARY.md"))?;
    fs::remove_file(pages.join("docs/SUMMARY.md"))?;
    fs::write(pages.join("SUMMARY.md"), from_root(&summary))
}

/// The summary of `docs/` with its links as the folder above sees them.
fn from_root(summary: &str) -> String {
    summary.replace("](", "](docs/").replace("](docs/../", "](")
}

/// Copies a folder.
fn copy(from: &Path, to: &Path) -> std::io::Result<()> {
    fs::create_dir_all(to)?;
    for entry in from.read_dir()? {
        let entry = entry?;
        let to = to.join(entry.file_name());
        if entry.file_type()?.is_dir() {
            copy(&entry.path(), &to)?;
        } else {
            fs::copy(entry.path(), to)?;
        }
    }
    Ok(())
}

/// The files of a folder, without those below it.
fn files(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in folder.read_dir()? {
        let entry = entry?;
        if entry.file_type()?.is_file() {
            found.push(entry.path());
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_book_has_every_page_where_its_links_lead() {
        let folder = tempfile::tempdir().unwrap();
        let source = folder.path().join("book");
        stage(Workspace::locate().root(), &source).unwrap();
        assert!(source.join("book.toml").is_file());
        let pages = source.join("pages");
        let summary = fs::read_to_string(pages.join("SUMMARY.md")).unwrap();
        assert!(summary.contains("](README.md)") && summary.contains("](docs/wiring.md)"));
        let mut links = summary.split("](").skip(1);
        assert!(links.all(|rest| pages.join(rest.split(')').next().unwrap()).is_file()));
    }
}
