//! Tables of numbers in Parquet: written as a whole, read column by column.

use files::Part;
use parquet::basic::Compression;
use parquet::column::reader::ColumnReader;
use parquet::data_type::DoubleType;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use std::path::Path;
use std::sync::Arc;

/// Rows of a row group.
const GROUP: usize = 65_536;

/// Why a table could not be written or read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{path}: {cause}")]
pub struct TableError {
    /// File.
    pub path: String,
    /// What went wrong.
    pub cause: String,
}

pub(super) fn failed(path: &Path, cause: impl std::fmt::Display) -> TableError {
    TableError {
        path: path.display().to_string(),
        cause: cause.to_string(),
    }
}

/// Columns of 64-bit numbers; NaN stands for a value that is not there and is written as null.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    names: Vec<String>,
    columns: Vec<Vec<f64>>,
}

impl Table {
    /// An empty table.
    #[must_use]
    pub fn new(names: Vec<String>) -> Self {
        Self {
            columns: vec![Vec::new(); names.len()],
            names,
        }
    }

    /// Names of the columns.
    #[must_use]
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Adds a row, a value for each column.
    pub fn push(&mut self, row: &[f64]) {
        for (column, value) in self.columns.iter_mut().zip(row) {
            column.push(*value);
        }
    }

    /// A row, a value for each column.
    ///
    /// # Panics
    /// There is no such row.
    #[must_use]
    pub fn row(&self, row: usize) -> Vec<f64> {
        self.columns.iter().map(|column| column[row]).collect()
    }

    /// Number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, Vec::len)
    }

    /// A column.
    #[must_use]
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        let index = self.names.iter().position(|n| n == name)?;
        self.columns.get(index).map(Vec::as_slice)
    }

    /// Adds rows.
    pub fn extend(&mut self, rows: impl IntoIterator<Item = Vec<f64>>) {
        for row in rows {
            self.push(&row);
        }
    }

    /// Keeps the first `rows` rows.
    pub fn truncate(&mut self, rows: usize) {
        for column in &mut self.columns {
            column.truncate(rows);
        }
    }

    /// Writes the rows to a file, which is there whole or as it was before.
    ///
    /// # Errors
    /// [`TableError`].
    pub fn write(&self, path: &Path, metadata: &[(&str, String)]) -> Result<(), TableError> {
        let write = || -> Result<(), Box<dyn std::error::Error>> {
            let fields: String = (self.names.iter())
                .map(|name| format!("optional double {name}; "))
                .collect();
            let schema = Arc::new(parse_message_type(&format!("message row {{ {fields} }}"))?);
            let metadata = metadata
                .iter()
                .map(|(key, value)| KeyValue::new((*key).to_owned(), value.clone()))
                .collect();
            let properties = WriterProperties::builder()
                .set_compression(Compression::SNAPPY)
                .set_key_value_metadata(Some(metadata))
                .build();
            let (part, file) = Part::begin(path)?;
            let mut writer = SerializedFileWriter::new(file, schema, Arc::new(properties))?;
            let mut start = 0;
            while start < self.rows() {
                let end = (start + GROUP).min(self.rows());
                let mut group = writer.next_row_group()?;
                for column in &self.columns {
                    let Some(mut out) = group.next_column()? else {
                        break;
                    };
                    let part = &column[start..end];
                    let there: Vec<f64> = part.iter().copied().filter(|v| !v.is_nan()).collect();
                    let levels: Vec<i16> = part.iter().map(|v| i16::from(!v.is_nan())).collect();
                    out.typed::<DoubleType>()
                        .write_batch(&there, Some(&levels), None)?;
                    out.close()?;
                }
                group.close()?;
                start = end;
            }
            Ok(part.finish(writer.into_inner()?)?)
        };
        write().map_err(|error| failed(path, format!("cannot be written: {error}")))
    }

    /// Reads a file whose columns are all numbers.
    ///
    /// # Errors
    /// [`TableError`].
    pub fn read(path: &Path) -> Result<Self, TableError> {
        let read = || -> Result<Self, Box<dyn std::error::Error>> {
            let reader = SerializedFileReader::new(files::open(path)?)?;
            let schema = reader.metadata().file_metadata().schema_descr_ptr();
            let names = schema.columns().iter().map(|c| c.name().to_owned());
            let mut table = Self::new(names.collect());
            for g in 0..reader.num_row_groups() {
                let group = reader.get_row_group(g)?;
                let rows = usize::try_from(group.metadata().num_rows())?;
                for (i, column) in table.columns.iter_mut().enumerate() {
                    let ColumnReader::DoubleColumnReader(mut from) = group.get_column_reader(i)?
                    else {
                        return Err("a column holds no numbers".into());
                    };
                    let (mut values, mut levels) = (Vec::new(), Vec::new());
                    let mut read = 0;
                    while read < rows {
                        let (records, _, _) =
                            from.read_records(rows - read, Some(&mut levels), None, &mut values)?;
                        if records == 0 {
                            break;
                        }
                        read += records;
                    }
                    let mut there = values.into_iter();
                    column.extend(levels.iter().map(|level| {
                        if *level == 1 {
                            there.next().unwrap_or(f64::NAN)
                        } else {
                            f64::NAN
                        }
                    }));
                }
            }
            Ok(table)
        };
        read().map_err(|error| failed(path, format!("cannot be read: {error}")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_reads_back_with_its_gaps() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.parquet");
        let mut table = Table::new(vec!["a".to_owned(), "b".to_owned()]);
        for n in 0..70_000 {
            let b = if n % 3 == 0 { f64::NAN } else { f64::from(n) };
            table.push(&[f64::from(n) * 0.5, b]);
        }
        table.write(&path, &[("key", "value".to_owned())]).unwrap();
        let back = Table::read(&path).unwrap();
        assert_eq!(back.rows(), 70_000);
        assert_eq!(back.column("a"), table.column("a"));
        let b = back.column("b").unwrap();
        assert!(b[69_999].is_nan() && b[69_998] == 69_998.0);
        let error = Table::read(&folder.path().join("none")).unwrap_err();
        assert!(
            error.to_string().contains("none: cannot be read"),
            "{error}"
        );
    }
}
