//! Comments are as narrow as the code: rustfmt wraps code and leaves comments as they are.

use std::fs;

use crate::report::{Failure, Result};
use crate::workspace::Workspace;

/// Columns of a comment line, rustfmt's own width.
const COLUMNS: usize = 100;

/// # Errors
/// Lists each comment line that is wider, with file and line.
pub fn check(workspace: &Workspace) -> Result<()> {
    let mut wide = Vec::new();
    for file in workspace.files(".rs") {
        let text = fs::read_to_string(&file).map_err(|error| {
            Failure::new(format!("{} can't be read: {error}", workspace.show(&file)))
        })?;
        let lines = (1..).zip(text.lines()).filter(|(_, line)| is_wide(line));
        wide.extend(lines.map(|(n, _)| format!("{}:{n}", workspace.show(&file))));
    }
    if wide.is_empty() {
        return Ok(());
    }
    Err(Failure::new(format!(
        "{} comment lines are wider than {COLUMNS} columns:\n  {}",
        wide.len(),
        wide.join("\n  ")
    ))
    .remedy("break them; tables and drawings may be wider"))
}

/// Whether a line is a comment that is too wide. Tables, drawings, formulas (columns of their own)
/// and JSON can't be broken.
fn is_wide(line: &str) -> bool {
    let Some(comment) = line.trim_start().strip_prefix("//") else {
        return false;
    };
    let text = comment.trim_start_matches(['/', '!']).trim();
    line.chars().count() > COLUMNS
        && !(text.starts_with(['|', '"', '{']) || text.contains('─') || text.contains("  "))
}

#[cfg(test)]
mod tests {
    use super::is_wide;

    #[test]
    fn prose_is_wide_and_tables_and_drawings_are_not() {
        let words = "word ".repeat(20);
        assert!(is_wide(&format!("    // {words}")));
        assert!(is_wide(&format!("//! {words}")));
        assert!(!is_wide(&format!("//! | {words} |")));
        assert!(!is_wide(&format!("//! a ─▶ {words}")));
        assert!(!is_wide(&format!("//! a   b {words}")));
        assert!(!is_wide(&format!("let x = {words}")));
        assert!(!is_wide(&format!("// {}", "x".repeat(97))));
    }
}
