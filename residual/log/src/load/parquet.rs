//! Parquet logs: every flat numeric or boolean column, by row groups. Times, durations and decimals
//! are converted as their types say: to seconds, and to the number that is meant.

use super::{arrow, Table};
use parquet::basic::{ConvertedType, LogicalType, TimeUnit, Type};
use parquet::column::reader::{get_typed_column_reader, ColumnReader};
use parquet::data_type::{BoolType, DataType, DoubleType, FloatType, Int32Type, Int64Type};
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::schema::types::ColumnDescriptor;
use residual_columns::error::Error;
use std::path::Path;

/// Appends one column chunk; nulls become NaN.
fn append<T: DataType>(
    reader: ColumnReader,
    rows: usize,
    optional: bool,
    out: &mut Vec<f64>,
    f: impl Fn(&T::T) -> f64,
) -> Result<(), String> {
    let mut reader = get_typed_column_reader::<T>(reader);
    let mut done = 0;
    while done < rows {
        let mut values = Vec::new();
        let mut defined = Vec::new();
        let (records, ..) = reader
            .read_records(
                rows - done,
                if optional { Some(&mut defined) } else { None },
                None,
                &mut values,
            )
            .map_err(|e| e.to_string())?;
        if records == 0 {
            return Err("a column chunk ends early".into());
        }
        if optional {
            let mut next = values.iter();
            out.extend(defined.iter().map(|d| {
                if *d > 0 {
                    next.next().map_or(f64::NAN, &f)
                } else {
                    f64::NAN
                }
            }));
        } else {
            out.extend(values.iter().map(&f));
        }
        done += records;
    }
    Ok(())
}

/// What a column's type says of its numbers.
struct Meaning {
    /// Factor to the value, in s for a time.
    factor: f64,
    /// Whether 32 or 64 bits have no sign.
    unsigned: bool,
    /// The type in words, where it is one of time.
    time: Option<&'static str>,
}

fn meaning(column: &ColumnDescriptor, durations: &[(String, f64)]) -> Meaning {
    let time = |factor, words| Meaning {
        factor,
        unsigned: false,
        time: Some(words),
    };
    let plain = |factor, unsigned| Meaning {
        factor,
        unsigned,
        time: None,
    };
    if let Some((_, factor)) = durations.iter().find(|(name, _)| name == column.name()) {
        return time(*factor, "a duration");
    }
    let scale = |unit: &TimeUnit| match unit {
        TimeUnit::MILLIS => 1e-3,
        TimeUnit::MICROS => 1e-6,
        TimeUnit::NANOS => 1e-9,
    };
    match column.logical_type_ref() {
        Some(LogicalType::Timestamp(t)) => return time(scale(&t.unit), "a timestamp"),
        Some(LogicalType::Time(t)) => return time(scale(&t.unit), "a time of day"),
        _ => {}
    }
    match column.converted_type() {
        ConvertedType::TIMESTAMP_MILLIS => time(1e-3, "a timestamp"),
        ConvertedType::TIMESTAMP_MICROS => time(1e-6, "a timestamp"),
        ConvertedType::TIME_MILLIS => time(1e-3, "a time of day"),
        ConvertedType::TIME_MICROS => time(1e-6, "a time of day"),
        ConvertedType::DATE => time(86_400.0, "a date"),
        ConvertedType::DECIMAL => plain(10f64.powi(-column.type_scale()), false),
        ConvertedType::UINT_32 | ConvertedType::UINT_64 => plain(1.0, true),
        _ => plain(1.0, false),
    }
}

/// Reads one Parquet log.
pub(super) fn read(path: &Path) -> Result<Table, Error> {
    let fail = |e: String| {
        let codec = e.rsplit_once("Disabled feature at compile time: ");
        Error::io(path, match codec {
            Some((_, codec)) => format!(
                "it is compressed with {codec}, which is not read; write it with snappy, zstd, gzip or none (in pandas: to_parquet(path, compression=\"snappy\"))"
            ),
            None => format!("cannot be read as Parquet: {e}; copy or write the file again"),
        })
    };
    let file = files::open(path).map_err(|e| Error::io(path, e))?;
    let reader = SerializedFileReader::new(file).map_err(|e| fail(e.to_string()))?;
    let schema = reader.metadata().file_metadata().schema_descr_ptr();
    let metadata = reader.metadata().file_metadata().key_value_metadata();
    let durations = metadata
        .and_then(|all| all.iter().find(|entry| entry.key == arrow::KEY))
        .and_then(|entry| entry.value.as_deref())
        .map_or(vec![], arrow::durations);
    let mut table = Table::default();
    for (c, column) in schema.columns().iter().enumerate() {
        let kind = column.physical_type();
        if column.max_rep_level() > 0
            || column.max_def_level() > 1
            || !matches!(
                kind,
                Type::DOUBLE | Type::FLOAT | Type::INT32 | Type::INT64 | Type::BOOLEAN
            )
        {
            continue;
        }
        let optional = column.max_def_level() == 1;
        let meaning = meaning(column, &durations);
        let factor = meaning.factor;
        let mut out = Vec::new();
        for g in 0..reader.num_row_groups() {
            let group = reader.get_row_group(g).map_err(|e| fail(e.to_string()))?;
            let rows = group.metadata().num_rows() as usize;
            let chunk = group
                .get_column_reader(c)
                .map_err(|e| fail(e.to_string()))?;
            match kind {
                Type::DOUBLE => append::<DoubleType>(chunk, rows, optional, &mut out, |x| *x),
                Type::FLOAT => {
                    append::<FloatType>(chunk, rows, optional, &mut out, |x| f64::from(*x))
                }
                Type::INT32 if meaning.unsigned => {
                    append::<Int32Type>(chunk, rows, optional, &mut out, |x| f64::from(*x as u32))
                }
                Type::INT64 if meaning.unsigned => {
                    append::<Int64Type>(chunk, rows, optional, &mut out, |x| *x as u64 as f64)
                }
                Type::INT32 => {
                    append::<Int32Type>(chunk, rows, optional, &mut out, |x| f64::from(*x) * factor)
                }
                Type::INT64 => {
                    append::<Int64Type>(chunk, rows, optional, &mut out, |x| *x as f64 * factor)
                }
                _ => {
                    append::<BoolType>(chunk, rows, optional, &mut out, |x| f64::from(u8::from(*x)))
                }
            }
            .map_err(|e| fail(format!("column `{}`: {e}", column.name())))?;
        }
        if let Some(words) = meaning.time {
            table.times.push((column.name().to_string(), words));
        }
        table.names.push(column.name().to_string());
        table.columns.push(out);
    }
    if table.names.is_empty() {
        return Err(fail("no flat numeric column".into()));
    }
    Ok(table)
}
