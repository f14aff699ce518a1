//! The commands of a tutorial, read from its page, for the tests that execute them.
//!
//! A comment before a block of code says what is special about its commands:
//! `<!-- test: code 5 -->` (the exit code), `<!-- test: code 5, goes on -->` (the next commands run
//! meanwhile), `<!-- test: until Ctrl-C -->` (ended at the end of the page). A block of `text` has
//! lines that the command before it prints; a block of another language is not for the test.
// Each test takes a part of it.
#![allow(dead_code)]

/// A command of a page.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// What stands after `cargo forcectl`.
    pub words: Vec<String>,
    /// Where its standard output goes, with `>`.
    pub into: Option<String>,
    pub codes: Vec<i32>,
    pub goes_on: bool,
    pub until_ctrl_c: bool,
    /// Lines of what it prints, in their order; there are others between them.
    pub prints: Vec<String>,
}

/// The commands of a page.
pub fn steps(page: &str) -> Vec<Step> {
    let mut found: Vec<Step> = Vec::new();
    let mut special = "";
    let mut block = None;
    for line in page.lines() {
        if let Some(comment) = line.strip_prefix("<!-- test: ") {
            special = comment.trim_end_matches(" -->");
        } else if let Some(language) = line.strip_prefix("```") {
            if block.take().is_some() {
                special = "";
            } else {
                block = Some(language);
            }
        } else if block == Some("sh") {
            found.push(step(line, special));
        } else if block == Some("text") {
            let last = found.last_mut().expect("a command comes before it");
            last.prints.push(line.to_owned());
        }
    }
    found
}

fn step(line: &str, special: &str) -> Step {
    let call = line.strip_prefix("cargo forcectl ");
    let call = call.unwrap_or_else(|| panic!("`{line}` is no call of forcectl"));
    let (call, into) = match call.split_once(" > ") {
        Some((call, file)) => (call, Some(file.to_owned())),
        None => (call, None),
    };
    let numbers = special
        .split(|c: char| !c.is_ascii_digit())
        .filter_map(|word| word.parse().ok());
    let mut codes: Vec<i32> = numbers.collect();
    let until_ctrl_c = special.contains("until Ctrl-C");
    if codes.is_empty() {
        codes.push(if until_ctrl_c { 130 } else { 0 });
    }
    Step {
        words: call.split_whitespace().map(str::to_owned).collect(),
        into,
        codes,
        goes_on: special.contains("goes on"),
        until_ctrl_c,
        prints: Vec::new(),
    }
}
