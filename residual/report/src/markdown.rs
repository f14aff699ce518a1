//! `report.md`: the document as Markdown.

use super::document::Part;
use super::Report;

impl Report {
    /// The text of `report.md`; its pictures are files beside it.
    pub fn markdown(&self) -> String {
        self.document().iter().map(part).collect()
    }
}

fn part(part: &Part) -> String {
    match part {
        Part::Title(t) => format!("# {t}\n\n"),
        Part::Verdict { text: t, .. } | Part::Text(t) => format!("{t}\n\n"),
        Part::Heading(t) => format!("## {t}\n\n"),
        Part::Table { head, rows } => {
            let mut t = line(head) + &format!("|{}\n", "---|".repeat(head.len()));
            t.extend(rows.iter().map(|cells| line(cells)));
            t + "\n"
        }
        Part::Picture { file, caption, .. } => format!("![residual]({file})\n\n{caption}\n\n"),
    }
}

/// A line of a table.
fn line(cells: &[String]) -> String {
    let cells: Vec<String> = cells.iter().map(|c| c.replace('|', "\\|")).collect();
    format!("| {} |\n", cells.join(" | "))
}
