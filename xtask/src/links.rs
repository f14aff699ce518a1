//! Checks what the project's own documents point at: links to files and headings, and paths of the
//! workspace in code (`control/src/pid.rs`).

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::report::{Failure, Result};
use crate::workspace::Workspace;

/// Checks every Markdown file of the workspace and returns how many links and paths were looked at.
///
/// # Errors
/// Lists each broken link or path with file and line.
pub fn check(workspace: &Workspace) -> Result<usize> {
    let files = workspace.files(".md");
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
        let mut note = |link: &Link, reason: Option<&str>| {
            count += 1;
            if let Some(reason) = reason {
                let (place, target) = (workspace.show(file), &link.target);
                broken.push(format!("{place}:{}: {target} {reason}", link.line));
            }
        };
        for link in links(&texts[file]) {
            if !link.target.contains("://") && !link.target.starts_with("mailto:") {
                note(&link, problem(&texts, file, folder, &link.target));
            }
        }
        for path in paths(&texts[file], workspace.root()) {
            let gone = !workspace.root().join(&path.target).exists();
            note(&path, gone.then_some("doesn't exist"));
        }
    }
    for page in left_out(&texts, workspace.root()) {
        broken.push(format!(
            "{} is not in docs/SUMMARY.md",
            workspace.show(page)
        ));
    }
    if broken.is_empty() {
        Ok(count)
    } else {
        Err(Failure::new(format!(
            "{} broken links or paths:\n  {}",
            broken.len(),
            broken.join("\n  ")
        )))
    }
}

/// Pages below `docs/` that the book's summary does not list.
fn left_out<'a>(texts: &'a HashMap<PathBuf, String>, root: &Path) -> Vec<&'a PathBuf> {
    let docs = root.join("docs");
    let summary = docs.join("SUMMARY.md");
    let listed = texts.get(&summary).map_or("", String::as_str);
    let listed: Vec<_> = links(listed).iter().map(|l| docs.join(&l.target)).collect();
    let pages = texts.keys().filter(|page| page.starts_with(&docs));
    let mut missing: Vec<_> = pages
        .filter(|page| **page != summary && !listed.contains(page))
        .collect();
    missing.sort();
    missing
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
    for (line, row) in unfenced(text) {
        // Every second piece between backticks is code.
        for prose in row.split('`').step_by(2) {
            for rest in prose.split("](").skip(1) {
                if let Some((target, _)) = rest.split_once(')') {
                    let target = target.split_whitespace().next().unwrap_or_default();
                    let target = target.to_string();
                    found.push(Link { target, line });
                }
            }
        }
    }
    found
}

/// The words between backticks that begin with a folder of the root and hold nothing to fill in.
fn paths(text: &str, root: &Path) -> Vec<Link> {
    // What git ignores is there on some machines only.
    let ignored = fs::read_to_string(root.join(".gitignore")).unwrap_or_default();
    let other: Vec<&str> = [".", ".."]
        .into_iter()
        .chain(ignored.lines().filter_map(|line| line.strip_prefix('/')))
        .collect();
    let plain = |c: char| c.is_alphanumeric() || "_-./".contains(c);
    let is_path = |word: &str| {
        let folder = word.split_once('/').map_or("", |(folder, _)| folder);
        let ours = !folder.is_empty() && !other.contains(&folder) && root.join(folder).is_dir();
        ours && word.chars().all(plain)
    };
    let mut found = Vec::new();
    for (line, row) in unfenced(text) {
        for code in row.split('`').skip(1).step_by(2) {
            for word in code.split_whitespace().filter(|word| is_path(word)) {
                let target = word.to_string();
                found.push(Link { target, line });
            }
        }
    }
    found
}

/// The lines outside blocks of code, numbered from 1.
fn unfenced(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut fenced = false;
    text.lines().enumerate().filter_map(move |(index, line)| {
        if line.trim_start().starts_with("```") {
            fenced = !fenced;
        }
        (!fenced).then_some((index + 1, line))
    })
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
    let headings = unfenced(text).filter(|(_, line)| line.starts_with('#'));
    headings.map(|(_, line)| line.trim_start_matches('#').trim())
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
    fn paths_are_found_in_code() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let text = "`src/main.rs`, src/a.rs, `src/gone.rs 1`, `src/$x`, `lab/x`, `src`";
        let targets: Vec<_> = paths(text, root).into_iter().map(|l| l.target).collect();
        assert_eq!(targets, ["src/main.rs", "src/gone.rs"]);
    }

    #[test]
    fn what_a_command_writes_is_no_path_of_the_project() {
        let root = tempfile::tempdir().unwrap();
        for folder in ["forcectl-out", "docs"] {
            fs::create_dir(root.path().join(folder)).unwrap();
        }
        fs::write(root.path().join(".gitignore"), "/target\n/forcectl-out\n").unwrap();
        let text = "`forcectl-out/set-force.svg`, `docs/gone.md`";
        let found = paths(text, root.path());
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].target, "docs/gone.md");
    }

    #[test]
    fn pages_outside_the_summary_are_told() {
        let text = |name: &str, text: &str| (PathBuf::from(name), text.to_string());
        let texts = HashMap::from([
            text("/docs/SUMMARY.md", "- [A](a.md)\n  - [B](b/b.md)\n"),
            text("/docs/a.md", ""),
            text("/docs/b/b.md", ""),
            text("/docs/c.md", ""),
            text("/README.md", ""),
        ]);
        assert_eq!(left_out(&texts, Path::new("/")), [Path::new("/docs/c.md")]);
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
