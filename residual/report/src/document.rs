//! The report as a list of parts, which the writers turn into Markdown and HTML. The sections
//! themselves are in `sections.rs`.

use super::plot::Plot;
use super::Report;

/// A part of the document. Texts may hold `` `code` ``, `**bold**` and ` -> ` for an arrow.
pub(super) enum Part {
    /// Heading of the document.
    Title(String),
    /// The verdict.
    Verdict {
        /// What it says.
        text: String,
        /// Classes of its banner: the word of the verdict, and `partly` where the answer is not
        /// whole.
        class: String,
    },
    /// Heading of a section.
    Heading(String),
    /// A paragraph.
    Text(String),
    /// A table.
    Table {
        /// Its head.
        head: Vec<String>,
        /// Its rows, each as long as the head.
        rows: Vec<Vec<String>>,
    },
    /// A plot.
    Picture {
        /// Name of its file in the folder of the report.
        file: String,
        /// What it shows.
        plot: Box<Plot>,
        /// The text below it.
        caption: String,
    },
}

impl Part {
    /// A table.
    pub(super) fn table(head: &[&str], rows: Vec<Vec<String>>) -> Part {
        Part::Table {
            head: head.iter().map(ToString::to_string).collect(),
            rows,
        }
    }
}

impl Report {
    /// The title of the report, or a general one if the model file has none.
    pub(super) fn heading(&self) -> String {
        if self.title.is_empty() {
            "Residual analysis".into()
        } else {
            self.title.clone()
        }
    }

    /// The whole document.
    pub(super) fn document(&self) -> Vec<Part> {
        let mut out = vec![
            Part::Title(self.heading()),
            Part::Verdict {
                text: format!("**Verdict: `{}`.** {}", self.verdict.word(), self.summary()),
                class: self.banner(),
            },
            Part::Text(self.data()),
            Part::Text(self.guidance()),
        ];
        out.extend(self.errors());
        for i in 0..self.effects.len() {
            out.extend(self.effect(i));
        }
        out.extend(self.unsupported());
        out.extend(self.ambiguities());
        out.extend(self.unexplained());
        out.extend(self.not_material());
        out.extend(self.declared_terms());
        out.extend(self.scan());
        out.extend(self.tests_of_residual());
        out.extend(self.data_checks());
        out.push(Part::Heading("Files in this folder".into()));
        out.push(Part::Text(
            "`MODEL.extended.toml`: the model file with the effects added; an analysis of the same data with it reproduces the final fit. \
             `MODEL.frozen.toml`: the same with every coefficient fixed; use it on other data to test the model on rows that it was never fitted to. \
             `report.json`: all results in full precision.".into(),
        ));
        out
    }

    /// Classes of the banner: the colour of the verdict only where the answer is whole.
    fn banner(&self) -> String {
        let word = self.verdict.word();
        if self.is_whole() {
            word.into()
        } else {
            format!("{word} partly")
        }
    }

    /// The reduction of the held-out RMSE from which an effect counts, as a percentage.
    pub(super) fn material(&self) -> String {
        format!(
            "{} %",
            (1e4 * self.extended.selection.material).round() / 100.0
        )
    }
}
