//! `report.json`: writing it, and reading it back. docs/residual/report-json.md lists the keys.

use super::{Report, SCHEMA_VERSION};
use residual_columns::error::Error;
use serde::{de, Deserialize, Deserializer, Serialize};
use serde_json::ser::Formatter;
use serde_json::{Serializer, Value};
use std::io;
use std::path::Path;

/// What to do about a report that cannot be read.
const REMEDY: &str = "run the analysis again with this version";

impl Report {
    /// The text of `report.json`.
    ///
    /// # Errors
    /// [`Error::Model`] if the extended model cannot be written as TOML.
    pub fn json(&self) -> Result<String, Error> {
        let failed = |e: &dyn std::fmt::Display| Error::model(format!("as TOML: {e}"));
        let mut out = Vec::new();
        let mut serializer = Serializer::with_formatter(&mut out, Layout::default());
        // Nothing else can fail when writing to memory.
        self.serialize(&mut serializer).map_err(|e| failed(&e))?;
        out.push(b'\n');
        String::from_utf8(out).map_err(|e| failed(&e))
    }

    /// Reads a `report.json` of this version of the library. Numbers that were not finite, which
    /// JSON holds as `null`, come back as NaN; everything else is as it was written.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be read or is not such a report: not JSON, another
    /// `schema_version`, or keys that are missing or have another type.
    ///
    /// ```no_run
    /// let report = residual_report::Report::read("found/report.json".as_ref())?;
    /// println!("{}", report.summary());
    /// # Ok::<(), residual_columns::error::Error>(())
    /// ```
    pub fn read(path: &Path) -> Result<Report, Error> {
        let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, e))?;
        Report::from_json(&text).map_err(|why| Error::io(path, why))
    }

    /// Reads the text of a `report.json`; the error says what is wrong.
    fn from_json(text: &str) -> Result<Report, String> {
        let value: Value = serde_json::from_str(text)
            .map_err(|e| format!("not JSON ({e}), so it is not a report of an analysis"))?;
        check_version(value.get("schema_version"))?;
        serde_json::from_value(value).map_err(|e| format!("not a complete report: {e}; {REMEDY}"))
    }
}

/// Refuses every version of the keys but this library's.
fn check_version(version: Option<&Value>) -> Result<(), String> {
    let Some(version) = version else {
        return Err(format!(
            "no schema_version, so this is not a report of an analysis, or one of an old version; {REMEDY}"
        ));
    };
    match version.as_u64() {
        Some(v) if v == u64::from(SCHEMA_VERSION) => Ok(()),
        Some(v) if v > u64::from(SCHEMA_VERSION) => Err(format!(
            "schema_version {v} is newer than {SCHEMA_VERSION}, which is what this version of the analysis reads; \
             read it with the version that wrote it, or {REMEDY}"
        )),
        _ => Err(format!(
            "schema_version {version} is not {SCHEMA_VERSION}, which is what this version of the analysis reads; {REMEDY}"
        )),
    }
}

/// For serde: a schema version that this library reads.
pub(super) fn known_version<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u32, D::Error> {
    let version = u32::deserialize(deserializer)?;
    check_version(Some(&version.into())).map_err(de::Error::custom)?;
    Ok(version)
}

/// For serde: a model file as its TOML text.
pub(super) mod toml_text {
    use residual_log::spec::Spec;
    use serde::{de, ser, Deserialize, Deserializer, Serializer};

    /// Writes the text.
    pub fn serialize<S: Serializer>(spec: &Spec, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&toml::to_string(spec).map_err(ser::Error::custom)?)
    }

    /// Reads and checks the text.
    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Spec, D::Error> {
        Spec::parse(&String::deserialize(deserializer)?).map_err(de::Error::custom)
    }
}

/// Layout of `report.json`: each key and each object of a list begins a line; lists of numbers or
/// texts stay on one line, as those of a plot have a thousand numbers.
#[derive(Default)]
struct Layout {
    /// The lists and objects that are open, and whether something in them began a line.
    open: Vec<(Kind, bool)>,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    List,
    Object,
}

impl Layout {
    /// Begins a line for something in the innermost list or object.
    fn line<W: ?Sized + io::Write>(&mut self, writer: &mut W) -> io::Result<()> {
        if let Some((_, lines)) = self.open.last_mut() {
            *lines = true;
        }
        self.indent(writer)
    }

    fn indent<W: ?Sized + io::Write>(&self, writer: &mut W) -> io::Result<()> {
        write!(writer, "\n{:width$}", "", width = 2 * self.open.len())
    }

    /// Closes the innermost list or object.
    fn close<W: ?Sized + io::Write>(&mut self, writer: &mut W, bracket: &[u8]) -> io::Result<()> {
        if self.open.pop().is_some_and(|(_, lines)| lines) {
            self.indent(writer)?;
        }
        writer.write_all(bracket)
    }
}

impl Formatter for Layout {
    fn begin_array<W: ?Sized + io::Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.open.push((Kind::List, false));
        writer.write_all(b"[")
    }

    fn end_array<W: ?Sized + io::Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.close(writer, b"]")
    }

    fn begin_object<W: ?Sized + io::Write>(&mut self, writer: &mut W) -> io::Result<()> {
        if self
            .open
            .last()
            .is_some_and(|(kind, _)| *kind == Kind::List)
        {
            self.line(writer)?;
        }
        self.open.push((Kind::Object, false));
        writer.write_all(b"{")
    }

    fn end_object<W: ?Sized + io::Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.close(writer, b"}")
    }

    fn begin_object_key<W: ?Sized + io::Write>(
        &mut self,
        writer: &mut W,
        first: bool,
    ) -> io::Result<()> {
        if !first {
            writer.write_all(b",")?;
        }
        self.line(writer)
    }

    fn begin_object_value<W: ?Sized + io::Write>(&mut self, writer: &mut W) -> io::Result<()> {
        writer.write_all(b": ")
    }
}

#[cfg(test)]
mod tests {
    use super::super::example;
    use super::*;
    use std::collections::BTreeSet;

    const PAGE: &str = include_str!("../../../docs/residual/report-json.md");

    #[test]
    fn a_report_that_was_written_is_read_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let report = example::report();
        report.write(folder.path()).unwrap();
        let read = Report::read(&folder.path().join("report.json")).unwrap();
        assert_eq!(read, report);
        assert_eq!(read.html(), report.html());
        assert_eq!(read.frozen().unwrap(), report.frozen().unwrap());
    }

    #[test]
    fn what_is_not_a_number_is_read_as_nan() {
        let mut report = example::report();
        report.structure[0].p_value = f64::NAN;
        report.effects[0]
            .ci
            .insert("x".into(), [0.5, f64::INFINITY]);
        let read = Report::from_json(&report.json().unwrap()).unwrap();
        assert!(read.structure[0].p_value.is_nan());
        let [low, high] = read.effects[0].ci["x"];
        assert!(low == 0.5 && high.is_nan());
    }

    #[test]
    fn reports_of_other_versions_and_other_files_are_refused_with_the_reason() {
        let good = example::report().json().unwrap();
        let version = format!("\"schema_version\": {SCHEMA_VERSION}");
        assert!(good.contains(&version), "{good}");
        let newer = SCHEMA_VERSION + 1;
        let with = |text: &str| good.replace(&version, text);
        for (text, part) in [
            (
                with(&format!("\"schema_version\": {newer}")),
                format!("{newer} is newer"),
            ),
            (with("\"schema_version\": 0"), "0 is not".into()),
            (with("\"schema_version\": \"1\""), "\"1\" is not".into()),
            (with("\"version\": 1"), "no schema_version".into()),
            ("[1, 2]".into(), "no schema_version".into()),
            ("t,y\n0,1\n".into(), "not JSON".into()),
            (
                good.replace("\"rows\": 100", "\"rows\": \"all\""),
                "not a complete report".into(),
            ),
            (
                good.replace("\"verdict\"", "\"answer\""),
                "missing field `verdict`".into(),
            ),
            (good.replace("expr = ", "xpr = "), "xpr".into()),
            (good.clone(), String::new()),
        ] {
            match Report::from_json(&text) {
                Err(why) => assert!(!part.is_empty() && why.contains(&part), "{part}: {why}"),
                Ok(_) => assert!(part.is_empty(), "{part}: was read"),
            }
        }
        // The types themselves refuse it as well, without the checks of the whole file.
        let error = serde_json::from_str::<Report>(&with(&format!("\"schema_version\": {newer}")));
        assert!(error.unwrap_err().to_string().contains("newer"));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("report.json");
        let error = Report::read(&path).unwrap_err();
        assert!(error.exit_code() == 3 && error.to_string().contains("report.json"));
    }

    /// Paths of all keys, as `effects[].params.NAME`.
    fn keys(value: &Value, path: &str, out: &mut BTreeSet<String>) {
        match value {
            Value::Object(map) => {
                for (key, value) in map {
                    let named = ["params", "units", "ci"].iter().any(|n| path.ends_with(n));
                    let key = if named { "NAME" } else { key };
                    let path = format!("{path}{}{key}", if path.is_empty() { "" } else { "." });
                    keys(value, &path, out);
                }
            }
            Value::Array(items) if items.iter().any(Value::is_object) => {
                items
                    .iter()
                    .for_each(|item| keys(item, &format!("{path}[]"), out));
            }
            _ => {
                out.insert(path.into());
            }
        }
    }

    #[test]
    fn the_page_lists_every_key_and_no_other() {
        let value: Value = serde_json::from_str(&example::report().json().unwrap()).unwrap();
        let mut written = BTreeSet::new();
        keys(&value, "", &mut written);
        let listed: BTreeSet<String> = PAGE
            .lines()
            .filter_map(|line| line.strip_prefix("| `")?.split_once('`'))
            .map(|(key, _)| key.to_string())
            .collect();
        assert_eq!(listed, written);
        let version = format!("The current version is {SCHEMA_VERSION}.");
        assert!(PAGE.contains(&version), "{version}");
    }

    #[test]
    fn each_object_begins_a_line_and_lists_of_numbers_do_not() {
        let text = example::report().json().unwrap();
        assert!(
            text.starts_with("{\n  \"schema_version\": 1,\n  \"title\": \"Example\",\n"),
            "{text}"
        );
        assert!(
            text.contains("\n  \"files\": [\"a.csv\",\"b.csv\"],\n"),
            "{text}"
        );
        assert!(
            text.contains("\n  \"effects\": [\n    {\n      \"name\": \"coulomb\",\n"),
            "{text}"
        );
        assert!(text.ends_with("\n}\n"), "{text}");
    }
}
