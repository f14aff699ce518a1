//! The robot's log of a join: CSV or Parquet as text, its columns, and the UTC of its rows.

use super::{Merge, ADDED};
use crate::error::RecordError;
use crate::table::Cell;
use ::parquet::basic::{LogicalType, TimeUnit};
use ::parquet::file::reader::{FileReader, SerializedFileReader};
use ::parquet::record::Field;
use ::parquet::schema::types::ColumnDescriptor;
use residual_columns::dates;
use std::io::Read;
use std::path::Path;

/// A robot's log.
pub(super) struct Log {
    pub(super) names: Vec<String>,
    /// Whether a column holds numbers.
    pub(super) numeric: Vec<bool>,
    pub(super) rows: Vec<Vec<Cell>>,
    path: String,
}

impl Log {
    pub(super) fn read(path: &Path) -> Result<Self, RecordError> {
        let parquet = path.extension().is_some_and(|ext| ext == "parquet");
        let (names, texts) = if parquet {
            parquet_rows(path)?
        } else {
            csv_rows(path)?
        };
        let numeric: Vec<bool> = (0..names.len())
            .map(|k| {
                texts
                    .iter()
                    .all(|row| row[k].trim().is_empty() || row[k].trim().parse::<f64>().is_ok())
            })
            .collect();
        let rows = texts
            .into_iter()
            .map(|row| {
                row.into_iter()
                    .zip(&numeric)
                    .map(|(text, numeric)| match text.trim() {
                        "" => Cell::Null,
                        number if *numeric => number.parse().map_or(Cell::Null, Cell::Double),
                        _ => Cell::Text(text),
                    })
                    .collect()
            })
            .collect();
        Ok(Self {
            names,
            numeric,
            rows,
            path: path.display().to_string(),
        })
    }

    /// Refuses names with which a file would have two columns of one name: readers take one of
    /// them, or refuse the file.
    pub(super) fn check_names(&self) -> Result<(), RecordError> {
        let refused = |cause, advice| {
            Err(RecordError {
                path: self.path.clone(),
                cause,
                advice,
                of_input: true,
            })
        };
        let ours = ADDED.map(|(name, _)| name);
        let list = |names: Vec<&String>| {
            let quoted: Vec<_> = names.iter().map(|name| format!("`{name}`")).collect();
            quoted.join(", ")
        };
        let names = self.names.iter();
        let added: Vec<_> = names
            .clone()
            .filter(|name| ours.contains(&name.as_str()))
            .collect();
        if !added.is_empty() {
            return refused(
                format!("it has columns that the join adds: {}", list(added)),
                "give the log as it was before a join, or rename these columns",
            );
        }
        let twice: Vec<_> = names
            .enumerate()
            .filter(|(n, name)| self.names[..*n].contains(name))
            .map(|(_, name)| name)
            .collect();
        if !twice.is_empty() {
            return refused(
                format!("it has more than one column of the name {}", list(twice)),
                "give each column of the log its own name",
            );
        }
        Ok(())
    }

    fn column(&self, name: &str) -> Result<usize, RecordError> {
        self.names
            .iter()
            .position(|n| n == name)
            .ok_or_else(|| RecordError {
                path: self.path.clone(),
                cause: format!(
                    "it has no column `{name}`; its columns: {}",
                    self.names.join(", ")
                ),
                advice: "name the column with the time",
                of_input: true,
            })
    }

    /// UTC of each row, ns since 1970.
    pub(super) fn times(&self, options: &Merge<'_>) -> Result<Vec<u64>, RecordError> {
        let shift_ns = (options.shift_s * 1e9) as i64;
        let columns: Vec<usize> = options
            .time
            .split('+')
            .map(|name| self.column(name.trim()))
            .collect::<Result<_, _>>()?;
        self.rows
            .iter()
            .enumerate()
            .map(|(n, row)| {
                let cells: Vec<&Cell> = columns.iter().map(|k| &row[*k]).collect();
                let time = utc_ns(&cells);
                let unclear = match time {
                    Err(NoTime::NoZone) => Some((
                        "a time without a zone",
                        "write the zone behind each time: Z for UTC, +01:00 for an hour more than UTC",
                    )),
                    Err(NoTime::Unsure) => Some((
                        "a date whose day and month may be exchanged",
                        "write the year first: 2026-03-04",
                    )),
                    _ => None,
                };
                if let Some((what, advice)) = unclear {
                    return Err(RecordError {
                        path: self.path.clone(),
                        cause: format!("row {} has {what} in `{}`: {cells:?}", n + 1, options.time),
                        advice,
                        of_input: true,
                    });
                }
                time.ok()
                    .and_then(|ns| u64::try_from(ns.checked_add(shift_ns)?).ok())
                    .ok_or_else(|| RecordError {
                        path: self.path.clone(),
                        cause: format!(
                            "row {} has no time in `{}` that is a UTC of this century{}: {:?}",
                            n + 1,
                            options.time,
                            match options.shift_s {
                                0.0 => String::new(),
                                s => format!(" with a shift of {s} s"),
                            },
                            cells
                        ),
                        advice: "give UTC or ROS time (s, ms, us or ns since 1970, or RFC 3339); a time since the start of the log can't be joined",
                        of_input: true,
                    })
            })
            .collect()
    }
}

/// Why cells are no time.
#[derive(Debug, PartialEq, Eq)]
enum NoTime {
    /// A date and a time of day, of a zone that is not told.
    NoZone,
    /// A date whose day and month may be exchanged.
    Unsure,
    Other,
}

/// 2000 and 2100, s since 1970.
const CENTURY: std::ops::Range<f64> = 946_684_800.0..4_102_444_800.0;

/// UTC of a cell, or of seconds and nanoseconds, or of a date and a time of day, ns since 1970.
fn utc_ns(cells: &[&Cell]) -> Result<i64, NoTime> {
    match cells {
        [Cell::Double(secs), Cell::Double(nsecs)]
            if CENTURY.contains(secs) && (0.0..=1e9).contains(nsecs) =>
        {
            Ok(*secs as i64 * 1_000_000_000 + *nsecs as i64)
        }
        [Cell::Double(value)] => [1e9, 1e6, 1e3, 1.0]
            .iter()
            .find(|scale| CENTURY.contains(&(value * *scale * 1e-9)))
            .map(|scale| {
                // A double of seconds is good to 0.2 us: whole seconds and the rest apart.
                let per_second = 1e9 / scale;
                let whole = (value / per_second).floor();
                whole as i64 * 1_000_000_000 + ((value - whole * per_second) * scale).round() as i64
            })
            .ok_or(NoTime::Other),
        [Cell::Text(text)] => utc_of_text(text.trim()),
        [Cell::Text(date), Cell::Text(time)] => {
            utc_of_text(&format!("{} {}", date.trim(), time.trim()))
        }
        _ => Err(NoTime::Other),
    }
}

/// UTC of a date, a time of day and their zone, ns since 1970.
fn utc_of_text(text: &str) -> Result<i64, NoTime> {
    let stamp = dates::stamp(text).filter(|stamp| stamp.kind == dates::Kind::Both);
    match stamp.ok_or(NoTime::Other)? {
        stamp if stamp.unsure => Err(NoTime::Unsure),
        stamp if !CENTURY.contains(&(stamp.seconds as f64)) => Err(NoTime::Other),
        stamp if stamp.zoned => Ok(stamp.seconds * 1_000_000_000 + i64::from(stamp.nanoseconds)),
        _ => Err(NoTime::NoZone),
    }
}

type Texts = (Vec<String>, Vec<Vec<String>>);

fn csv_rows(path: &Path) -> Result<Texts, RecordError> {
    let unreadable = |error: csv::Error| RecordError {
        path: path.display().to_string(),
        cause: error.to_string(),
        advice: "give a CSV file with a header line, or Parquet",
        of_input: true,
    };
    let mut bytes = Vec::new();
    (files::open(path).and_then(|mut file| file.read_to_end(&mut bytes)))
        .map_err(|error| unreadable(error.into()))?;
    // The header has no number: a semicolon or a tab in it separates, and numbers then have a
    // decimal comma, or a point as well.
    let head = bytes.split(|b| *b == b'\n').next().unwrap_or(&[]);
    let has = |sign: u8| head.contains(&sign);
    let separator = [b';', b'\t']
        .into_iter()
        .find(|sign| has(*sign) && !has(b','));
    let mut reader = csv::ReaderBuilder::new()
        .delimiter(separator.unwrap_or(b','))
        .from_reader(bytes.as_slice());
    let names = reader.headers().map_err(unreadable)?;
    let names = names
        .iter()
        .map(|name| name.trim().trim_start_matches('\u{feff}').to_owned());
    let names = names.collect();
    let cell = |text: &str| match separator {
        Some(_) => with_point(text),
        None => text.to_owned(),
    };
    let rows = reader
        .records()
        .map(|record| Ok(record?.iter().map(cell).collect()))
        .collect::<Result<_, csv::Error>>()
        .map_err(unreadable)?;
    Ok((names, rows))
}

/// A number with a decimal comma with a point; other text as it is.
fn with_point(text: &str) -> String {
    let point = text.trim().replacen(',', ".", 1);
    match point.parse::<f64>() {
        Ok(_) => point,
        Err(_) => text.to_owned(),
    }
}

fn parquet_rows(path: &Path) -> Result<Texts, RecordError> {
    let unreadable = |error: &dyn std::fmt::Display| RecordError {
        path: path.display().to_string(),
        cause: error.to_string(),
        advice: "give a Parquet file with flat columns, or CSV",
        of_input: true,
    };
    let file = files::open(path).map_err(|error| unreadable(&error))?;
    let reader = SerializedFileReader::new(file).map_err(|error| unreadable(&error))?;
    let schema = reader.metadata().file_metadata().schema_descr();
    let columns = schema.columns().iter();
    if let Some(nested) = columns
        .map(|c| c.path())
        .find(|path| path.parts().len() > 1)
    {
        return Err(unreadable(&format!(
            "the column `{}` has parts",
            nested.string()
        )));
    }
    let names = schema
        .columns()
        .iter()
        .map(|column| column.name().to_owned())
        .collect();
    let local: Vec<Option<u64>> = schema.columns().iter().map(|c| local_ns(c)).collect();
    let mut rows = Vec::new();
    for row in reader
        .get_row_iter(None)
        .map_err(|error| unreadable(&error))?
    {
        let row = row.map_err(|error| unreadable(&error))?;
        rows.push(
            row.get_column_iter()
                .zip(&local)
                .map(|((_, field), local)| match local {
                    Some(unit_ns) => text_of_local(field, *unit_ns),
                    None => text_of(field),
                })
                .collect(),
        );
    }
    Ok((names, rows))
}

/// Unit of a column of times without a zone, ns; `None` of any other column.
fn local_ns(column: &ColumnDescriptor) -> Option<u64> {
    match column.logical_type_ref()? {
        LogicalType::Timestamp(time) if !time.is_adjusted_to_u_t_c => Some(match time.unit {
            TimeUnit::MILLIS => 1_000_000,
            TimeUnit::MICROS => 1_000,
            TimeUnit::NANOS => 1,
        }),
        _ => None,
    }
}

/// A time without a zone, as CSV has one.
fn text_of_local(field: &Field, unit_ns: u64) -> String {
    let value = match field {
        Field::TimestampMillis(value) | Field::TimestampMicros(value) | Field::Long(value) => {
            *value
        }
        other => return text_of(other),
    };
    match u64::try_from(value)
        .ok()
        .and_then(|v| v.checked_mul(unit_ns))
    {
        Some(ns) => {
            let time = std::time::UNIX_EPOCH + std::time::Duration::from_nanos(ns);
            let text = humantime::format_rfc3339_nanos(time).to_string();
            text.trim_end_matches('Z').to_owned()
        }
        None => text_of(field),
    }
}

/// A value as text; a number with all of its digits.
fn text_of(field: &Field) -> String {
    match field {
        Field::Null => String::new(),
        Field::Str(text) => text.clone(),
        Field::Double(value) => format!("{value:?}"),
        Field::Float(value) => format!("{value:?}"),
        Field::TimestampMillis(value) | Field::TimestampMicros(value) => value.to_string(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn utc(text: &str) -> Result<i64, NoTime> {
        utc_ns(&[&Cell::Text(text.into())])
    }

    #[test]
    fn a_time_of_another_zone_is_converted() {
        let ns = 1_795_640_363_877_021_589;
        for text in [
            "2026-11-25T20:59:23.877021589Z",
            "2026-11-25T21:59:23.877021589+01:00",
            "2026-11-25 21:59:23.877021589+0100",
            "2026-11-25T22:59:23.877021589 +02",
            "2026-11-25T17:29:23.877021589-03:30",
            "2026-11-25 20:59:23.877021589 UTC",
            "25.11.2026 21:59:23.877021589+01:00",
        ] {
            assert_eq!(utc(text), Ok(ns), "{text}");
        }
        // Midnight between the zones.
        assert_eq!(
            utc("2026-11-26T00:30:00+01:00"),
            utc("2026-11-25T23:30:00Z")
        );
        let date = Cell::Text("2026-11-25".into());
        let time = Cell::Text("21:59:23.877021589+01:00".into());
        assert_eq!(utc_ns(&[&date, &time]), Ok(ns));
    }

    #[test]
    fn a_time_without_a_zone_is_none() {
        for text in ["2026-11-25 20:59:23.877021", "2026-11-25T20:59:23"] {
            assert_eq!(utc(text), Err(NoTime::NoZone), "{text}");
        }
        for text in ["11/3/2026 20:59:23Z", "3/11/2026 8:59:23 PM"] {
            assert_eq!(utc(text), Err(NoTime::Unsure), "{text}");
        }
        assert!(utc("25/11/2026 20:59:23Z").is_ok());
        for text in [
            "",
            "12.5",
            "2026-11-25T20:59:23+",
            "2026-11-25T20:59:23+1",
            "2026-11-25T20:59:23 CET",
            "2026-11-25T20:59:23+25:00",
            "20:59:23",
            "2026-13-25T20:59:23Z",
            "9999-11-25T20:59:23Z",
        ] {
            assert_eq!(utc(text), Err(NoTime::Other), "{text}");
        }
    }

    #[test]
    fn numbers_beyond_all_times_are_refused() {
        let double = Cell::Double;
        for nsecs in [-1.0, 2e9, 1e300, f64::INFINITY, f64::NAN] {
            let cells = [&double(1.8e9), &double(nsecs)];
            assert_eq!(utc_ns(&cells), Err(NoTime::Other), "{nsecs}");
        }
        let cells = [&double(1.8e9), &double(5.0)];
        assert_eq!(utc_ns(&cells), Ok(1_800_000_000_000_000_005));
        // A shift beyond what a time holds.
        let log = Log {
            names: vec!["t".to_owned()],
            numeric: vec![true],
            rows: vec![vec![double(1.8e9)]],
            path: "log.csv".to_owned(),
        };
        let options = |shift_s| Merge {
            recording: Path::new(""),
            log: Path::new(""),
            time: "t",
            shift_s,
            log_error_s: 0.0,
            out: Path::new(""),
        };
        for shift_s in [1e300, f64::INFINITY, -1e300, -2e9] {
            let error = log.times(&options(shift_s)).unwrap_err().to_string();
            assert!(error.contains("with a shift of"), "{error}");
        }
        assert_eq!(
            log.times(&options(-1.5)),
            Ok(vec![1_799_999_998_500_000_000])
        );
    }

    #[test]
    fn names_of_columns_are_refused_where_a_file_would_have_one_twice() {
        let log = |names: &[&str]| Log {
            names: names.iter().map(|&name| name.to_owned()).collect(),
            numeric: vec![true; names.len()],
            rows: Vec::new(),
            path: "log.csv".to_owned(),
        };
        assert_eq!(log(&["t", "q", ""]).check_names(), Ok(()));
        let error = log(&["t", "q", "q", "f", "f"]).check_names().unwrap_err();
        assert!(error.to_string().contains("`q`, `f`;"), "{error}");
        let error = log(&["t", "log_utc", "rig_phase"]).check_names();
        let error = error.unwrap_err().to_string();
        assert!(error.starts_with("log.csv: "), "{error}");
        assert!(error.contains("`log_utc`, `rig_phase`;"), "{error}");
    }

    #[test]
    fn a_parquet_log_with_parts_is_refused() {
        use ::parquet::data_type::DoubleType;
        use ::parquet::file::writer::SerializedFileWriter;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.parquet");
        let schema =
            "message row { required group pose { required double x; required double y; } }";
        let schema = ::parquet::schema::parser::parse_message_type(schema).unwrap();
        let file = std::fs::File::create(&path).unwrap();
        let mut writer =
            SerializedFileWriter::new(file, schema.into(), Default::default()).unwrap();
        let mut group = writer.next_row_group().unwrap();
        while let Some(mut column) = group.next_column().unwrap() {
            let column_writer = column.typed::<DoubleType>();
            column_writer.write_batch(&[1.0], None, None).unwrap();
            column.close().unwrap();
        }
        group.close().unwrap();
        writer.close().unwrap();
        let error = Log::read(&path).err().unwrap().to_string();
        assert!(error.contains("`pose.x` has parts"), "{error}");
    }

    #[test]
    fn times_without_a_zone_in_parquet_are_no_utc() {
        use ::parquet::data_type::Int64Type;
        use ::parquet::file::writer::SerializedFileWriter;
        let folder = tempfile::tempdir().unwrap();
        let read = |name: &str, kind: &str, value: i64| {
            let path = folder.path().join(name);
            let schema = format!("message row {{ required int64 t ({kind}); }}");
            let schema = ::parquet::schema::parser::parse_message_type(&schema).unwrap();
            let file = std::fs::File::create(&path).unwrap();
            let mut writer =
                SerializedFileWriter::new(file, schema.into(), Default::default()).unwrap();
            let mut group = writer.next_row_group().unwrap();
            let mut column = group.next_column().unwrap().unwrap();
            let column_writer = column.typed::<Int64Type>();
            column_writer.write_batch(&[value], None, None).unwrap();
            column.close().unwrap();
            group.close().unwrap();
            writer.close().unwrap();
            let log = Log::read(&path).unwrap();
            utc_ns(&[&log.rows[0][0]])
        };
        let us = 1_772_618_400_123_000;
        for (kind, value) in [
            ("TIMESTAMP(MILLIS,false)", us / 1_000),
            ("TIMESTAMP(MICROS,false)", us),
            ("TIMESTAMP(NANOS,false)", us * 1_000),
        ] {
            assert_eq!(
                read("local.parquet", kind, value),
                Err(NoTime::NoZone),
                "{kind}"
            );
        }
        let utc = read("utc.parquet", "TIMESTAMP(MICROS,true)", us);
        assert_eq!(utc, Ok(us * 1_000));
    }

    #[test]
    fn semicolons_and_decimal_commas_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        std::fs::write(
            &path,
            "\u{feff}time;q;note\n1795640363,877022;-0,5;a, b\n1795640364;1.5;c\n",
        )
        .unwrap();
        let (names, rows) = csv_rows(&path).unwrap();
        assert_eq!(names, ["time", "q", "note"]);
        assert_eq!(rows[0], ["1795640363.877022", "-0.5", "a, b"]);
        assert_eq!(rows[1], ["1795640364", "1.5", "c"]);
    }
}
