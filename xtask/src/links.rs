//! Checks the links between the project's own documents: files and headings that are gone.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::report::{Failure, Result};
use crate::workspace::Workspace;

/// Checks every Markdown file of the workspace and returns how many links were looked at.
///
/// # Errors
/// Lists each broken link with file and line.
pub fn check(workspace: &Workspace) -> Result<usize> {
    let mut files = Vec::new();
    collect(workspace.root(), &mut files);
    files.sort();
    let mut texts = HashMap::new();
    for file in &files {
        let text = fs::read_to_string(file).map_err(|error| {
            Failure::new(format!("{} can't be read: {error}", workspace.show(file)))
        })?;
        texts.insert(file.clone(), text);
    }
    let mut count = 0;
    let mut broken = Vec::new();
    for file in &files {
        let folder = file.parent().unwrap_or(workspace.root());
        for link in links(&texts[file]) {
            if link.target.contains("://") || link.target.starts_with("mailto:") {
                continue;
            }
            count += 1;
            if let Some(reason) = problem(&texts, file, folder, &link.target) {
                broken.push(format!(
                    "{}:{}: {} {reason}",
                    workspace.show(file),
                    link.line,
                    link.target
                ));
            }
        }
    }
    if broken.is_empty() {
        Ok(count)
    } else {
        Err(Failure::new(format!(
            "{} broken links:\n  {}",
            broken.len(),
            broken.join("\n  ")
        )))
    }
}

/// Markdown files below a folder, leaving out build products and hidden folders.
fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    let Ok(entries) = folder.read_dir() else {
        return;
    };
    for entry in entries.flatten() {
        let path = entry.path();
        let name = entry.file_name();
        let name = name.to_string_lossy();
        if name.starts_with('.') || name == "target" || name == "data" {
            continue;
        }
        if path.is_dir() {
            collect(&path, files);
        } else if name.ends_with(".md") {
            files.push(path);
        }
    }
}

/// A link and the line it starts on.
#[derive(Debug, PartialEq, Eq)]
struct Link {
    target: String,
    line: usize,
}

/// The targets of `[text](target)` outside code.
fn links(text: &str) -> Vec<Link> {
    let mut found = Vec::new();
    let mut fenced = false;
    for (index, line) in text.lines().enumerate() {
        if line.trim_start().starts_with("```") {
            fenced = !fenced;
        }
        if fenced {
            continue;
        }
        // Every second piece between backticks is code.
        for prose in line.split('`').step_by(2) {
            for rest in prose.split("](").skip(1) {
                if let Some((target, _)) = rest.split_once(')') {
                    let target = target.split_whitespace().next().unwrap_or_default();
                    found.push(Link {
                        target: target.to_string(),
                        line: index + 1,
                    });
                }
            }
        }
    }
    found
}

/// What is wrong with a link, if anything.
fn problem(
    texts: &HashMap<PathBuf, String>,
    file: &Path,
    folder: &Path,
    target: &str,
) -> Option<&'static str> {
    let (path, anchor) = target.split_once('#').unwrap_or((target, ""));
    let linked = if path.is_empty() {
        file.to_path_buf()
    } else {
        folder.join(path)
    };
    if !linked.exists() {
        return Some("doesn't exist");
    }
    if anchor.is_empty() {
        return None;
    }
    let same = |other: &Path| matches!((other.canonicalize(), linked.canonicalize()), (Ok(a), Ok(b)) if a == b);
    let text = texts
        .iter()
        .find(|(other, _)| same(other))
        .map(|(_, text)| text)?;
    let known = headings(text).any(|heading| slug(heading) == anchor);
    (!known).then_some("names a heading that does not exist")
}

/// The headings of a Markdown text.
fn headings(text: &str) -> impl Iterator<Item = &str> {
    let mut fenced = false;
    text.lines().filter_map(move |line| {
        if line.trim_start().starts_with("```") {
            fenced = !fenced;
        }
        (!fenced && line.starts_with('#')).then(|| line.trim_start_matches('#').trim())
    })
}

/// The anchor that code forges make of a heading.
fn slug(heading: &str) -> String {
    heading
        .to_lowercase()
        .chars()
        .filter_map(|c| match c {
            ' ' => Some('-'),
            c if c.is_alphanumeric() || c == '-' || c == '_' => Some(c),
            _ => None,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_are_found_outside_code() {
        let text =
            "See [a](a.md) and [b](b.md#top \"title\").\n```\n[c](c.md)\n```\n`x[i](y)` [d](d)";
        let targets: Vec<_> = links(text)
            .into_iter()
            .map(|link| (link.target, link.line))
            .collect();
        assert_eq!(
            targets,
            [
                ("a.md".to_string(), 1),
                ("b.md#top".to_string(), 1),
                ("d".to_string(), 5)
            ]
        );
    }

    #[test]
    fn headings_become_anchors() {
        assert_eq!(slug("The firmware's time"), "the-firmwares-time");
        assert_eq!(slug("Faults: unit or board"), "faults-unit-or-board");
        let text = "# One\n```\n# no heading\n```\n## Two";
        assert_eq!(headings(text).collect::<Vec<_>>(), ["One", "Two"]);
    }

    #[test]
    fn missing_files_and_headings_are_reported() {
        let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
        let file = manifest.join("Cargo.toml");
        let texts = HashMap::from([(file.clone(), "# Known heading\n".to_string())]);
        let check = |target: &str| problem(&texts, &file, manifest, target);
        assert_eq!(check("src/main.rs"), None);
        assert_eq!(check("src/no-such-file.rs"), Some("doesn't exist"));
        assert_eq!(check("#known-heading"), None);
        assert_eq!(check("Cargo.toml#known-heading"), None);
        assert_eq!(
            check("#unknown"),
            Some("names a heading that does not exist")
        );
    }
}
