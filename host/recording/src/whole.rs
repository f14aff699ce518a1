//! Whether the files of a recording's folder are there, can be read, and are as they were recorded.

use super::folder::sha256;
use super::format::{JSON_FILE, MCAP_FILE, SUMS_FILE, TABLES};
use super::parquet;
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::Path;

/// What a folder lacks beside its MCAP file, in words. Each topic with messages has a table.
pub(super) fn problems(folder: &Path, messages: &BTreeMap<String, u64>) -> Vec<String> {
    let there = |name: &str| folder.join(name).is_file();
    let tables = TABLES.iter().map(|table| (table.topic, table.file));
    let tables = tables.filter(|(topic, _)| messages.contains_key(*topic));
    let (whole, missing): (Vec<&str>, Vec<&str>) =
        tables.map(|(_, file)| file).partition(|name| there(name));
    let mut problems = Vec::new();
    let export = format!(
        "`forcectl recording export {}` writes the tables from {MCAP_FILE}",
        folder.display()
    );
    if !missing.is_empty() {
        let part = missing.iter().any(|name| there(&format!("{name}.part")));
        problems.push(format!(
            "missing: {}{}; {export}",
            missing.join(", "),
            if part {
                " (a .part is there: the recorder was ended while it wrote it)"
            } else {
                ""
            }
        ));
    }
    for name in &whole {
        if let Err(error) = parquet::readable(&folder.join(name)) {
            problems.push(format!("{name} can't be read: {error}; {export}"));
        }
    }
    if !there(JSON_FILE) {
        problems.push(format!(
            "missing: {JSON_FILE}; {MCAP_FILE} holds the rig file and the configurations as well"
        ));
    }
    let mut files = vec![MCAP_FILE, JSON_FILE];
    files.extend(whole);
    files.retain(|name| there(name));
    sums(folder, &files, &missing, &mut problems);
    problems
}

/// Compares with the hashes. `files` have to be among them; that the tables of `told` are missing
/// was told already.
pub(super) fn sums(folder: &Path, files: &[&str], told: &[&str], problems: &mut Vec<String>) {
    let (text, lacks) = match files::read_text(&folder.join(SUMS_FILE)) {
        Ok(text) => (text, None),
        Err(error) if error.kind() == ErrorKind::NotFound => {
            (String::new(), Some(format!("missing: {SUMS_FILE}")))
        }
        Err(error) => {
            let lacks = format!("{SUMS_FILE} can't be read: {error}");
            (String::new(), Some(lacks))
        }
    };
    let listed: Vec<_> = text.lines().filter_map(|l| l.split_once("  ")).collect();
    for (hash, name) in &listed {
        match sha256(&folder.join(name)) {
            Ok(is) if is == *hash => {}
            Ok(_) => problems.push(format!(
                "{name} is not the file that was recorded: its hash differs from {SUMS_FILE}"
            )),
            Err(_) if told.contains(name) => {}
            Err(_) => problems.push(format!("{name} is missing, which {SUMS_FILE} lists")),
        }
    }
    let unlisted = |file: &&str| listed.iter().all(|(_, name)| name != file);
    let unlisted: Vec<&str> = files.iter().copied().filter(unlisted).collect();
    if !unlisted.is_empty() {
        // Hashes that a check made would vouch for files that were changed before it.
        problems.push(format!(
            "{}; whether {} changed since the recording is not known. For later changes, \
             `cd {} && sha256sum run.mcap configuration.json *.parquet > {SUMS_FILE}` lists the files as they are now",
            lacks.unwrap_or_else(|| format!("{SUMS_FILE} does not list all files")),
            unlisted.join(", "),
            folder.display()
        ));
    }
}
