//! Parquet logs: every flat numeric or boolean column, by row groups.

use super::Table;
use crate::error::Error;
use parquet::basic::Type;
use parquet::column::reader::{get_typed_column_reader, ColumnReader};
use parquet::data_type::{BoolType, DataType, DoubleType, FloatType, Int32Type, Int64Type};
use parquet::file::reader::{FileReader, SerializedFileReader};
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

/// Reads one Parquet log.
pub(super) fn read(path: &Path) -> Result<Table, Error> {
    let fail = |e: String| {
        Error::io(
            path,
            format!("cannot be read as Parquet: {e}; copy or write the file again"),
        )
    };
    let file = std::fs::File::open(path).map_err(|e| Error::io(path, e))?;
    let reader = SerializedFileReader::new(file).map_err(|e| fail(e.to_string()))?;
    let schema = reader.metadata().file_metadata().schema_descr_ptr();
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
                Type::INT32 => {
                    append::<Int32Type>(chunk, rows, optional, &mut out, |x| f64::from(*x))
                }
                Type::INT64 => append::<Int64Type>(chunk, rows, optional, &mut out, |x| *x as f64),
                _ => {
                    append::<BoolType>(chunk, rows, optional, &mut out, |x| f64::from(u8::from(*x)))
                }
            }
            .map_err(|e| fail(format!("column `{}`: {e}", column.name())))?;
        }
        table.names.push(column.name().to_string());
        table.columns.push(out);
    }
    if table.names.is_empty() {
        return Err(fail("no flat numeric column".into()));
    }
    Ok(table)
}
