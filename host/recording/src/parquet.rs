//! Parquet files from the MCAP file: at the end of a recording, or later with
//! `forcectl recording export`.
//!
//! The clocks of each row are computed anew, from the readings before and after it. Each file is
//! finished on its own: it is written beside its place and moved there when it is complete.

use super::error::RecordError;
use super::read::{mcap_of, End, Entry, Reader};
use super::rows::{ClockRow, CounterRow, CycleRow, EventRow, SampleRow, FAULT};
use super::table::{Cell, Kind, Row, Table};
use super::times::Clocks;
use files::Part;
use parquet::basic::{Compression, LogicalType, Repetition, TimeUnit, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int32Type, Int64Type};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::reader::SerializedFileReader;
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use parquet::schema::types::Type;
use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Rows of a row group.
const ROWS: usize = 65_536;

/// What an export did.
#[derive(Debug)]
pub struct Exported {
    /// Files that are complete, with their rows.
    pub files: Vec<(PathBuf, u64)>,
    /// Files that are not, with the reason.
    pub failures: Vec<RecordError>,
    /// How the MCAP file ended.
    pub end: End,
}

/// Writes the Parquet files of a recording to a folder. `recording` names the MCAP file or its
/// folder.
#[must_use]
pub fn export(recording: &Path, folder: &Path) -> Exported {
    let path = mcap_of(recording);
    let mut exported = Exported {
        files: Vec::new(),
        failures: Vec::new(),
        end: End::Unknown,
    };
    let (clocks, pairs) = match Clocks::read(&path) {
        Ok(found) => found,
        Err(error) => {
            exported.failures.push(error);
            return exported;
        }
    };
    let mut outputs = Outputs {
        clocks,
        folder: folder.to_owned(),
        open: BTreeMap::new(),
        failures: Vec::new(),
    };
    match Reader::open(&path) {
        Err(error) => exported.failures.push(error),
        Ok(mut reader) => {
            for entry in reader.by_ref() {
                if let Entry::Message { topic, data, .. } = entry {
                    outputs.take(&topic, &data);
                }
            }
            exported.end = reader.end().clone();
        }
    }
    exported.failures.append(&mut outputs.failures);
    for (_, output) in std::mem::take(&mut outputs.open) {
        let Some(output) = output else { continue };
        let path = output.path.clone();
        match output.finish(&pairs) {
            Ok(rows) => exported.files.push((path, rows)),
            Err(error) => exported.failures.push(error),
        }
    }
    exported
}

/// Whether a file is Parquet with its footer, which is at the end.
///
/// # Errors
/// Why not.
pub(super) fn readable(path: &Path) -> Result<(), String> {
    let file = files::open(path).map_err(|error| error.to_string())?;
    SerializedFileReader::new(file).map_err(|error| error.to_string())?;
    Ok(())
}

/// Files that are being written, by topic; `None`: one that failed.
struct Outputs {
    clocks: Clocks,
    folder: PathBuf,
    open: BTreeMap<&'static str, Option<Output>>,
    failures: Vec<RecordError>,
}

impl Outputs {
    fn take(&mut self, topic: &str, data: &[u8]) {
        if topic == SampleRow::TABLE.topic {
            self.row::<SampleRow>(data, |row, clocks| {
                row.set_times(clocks.of_board(row.board_s));
            });
        } else if topic == CycleRow::TABLE.topic {
            self.row::<CycleRow>(data, host_time);
        } else if topic == CounterRow::TABLE.topic {
            self.row::<CounterRow>(data, host_time);
        } else if topic == EventRow::TABLE.topic {
            self.row::<EventRow>(data, |row, clocks| {
                // 0: there was no reading of the board's clock yet, and the host's time is the one
                // that is known.
                if row.name == FAULT && row.board_s > 0.0 {
                    row.set_times(clocks.of_board(row.board_s));
                } else {
                    host_time(row, clocks);
                }
                row.timestamp = row.utc;
            });
        } else if topic == ClockRow::TABLE.topic {
            self.row::<ClockRow>(data, |row, clocks| clocks.refine(row));
        }
    }

    fn row<R: Row>(&mut self, data: &[u8], refine: impl Fn(&mut R, &Clocks)) {
        let table = R::TABLE;
        let path = self.folder.join(table.file);
        let open = || Output::create(&path, &table);
        let output = self
            .open
            .entry(table.topic)
            .or_insert_with(|| open().map_err(|error| self.failures.push(error)).ok());
        let Some(writing) = output else { return };
        let written = serde_json::from_slice::<R>(data)
            .map_err(|error| RecordError::unreadable(&path, &error))
            .and_then(|mut row| {
                refine(&mut row, &self.clocks);
                writing.push(row.cells())
            });
        if let Err(error) = written {
            self.failures.push(error);
            *output = None;
        }
    }
}

fn host_time<R: Row>(row: &mut R, clocks: &Clocks) {
    row.set_times(clocks.of_host(row.times().host_s));
}

/// Names and kinds of columns, and whether they may be missing.
pub(super) type Columns = Vec<(String, Kind, bool)>;

/// The Parquet schema of columns.
fn parquet_schema(columns: &Columns) -> parquet::errors::Result<Type> {
    let mut fields = Vec::with_capacity(columns.len());
    for (name, kind, optional) in columns {
        let (physical, logical) = match kind {
            Kind::Double => (Physical::DOUBLE, None),
            Kind::Int32 => (Physical::INT32, None),
            Kind::Int64 => (Physical::INT64, None),
            Kind::Timestamp => (
                Physical::INT64,
                Some(LogicalType::timestamp(true, TimeUnit::NANOS)),
            ),
            Kind::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
        };
        let repetition = if *optional {
            Repetition::OPTIONAL
        } else {
            Repetition::REQUIRED
        };
        let field = Type::primitive_type_builder(name, physical)
            .with_repetition(repetition)
            .with_logical_type(logical)
            .build()?;
        fields.push(Arc::new(field));
    }
    Type::group_type_builder("row").with_fields(fields).build()
}

/// A Parquet file that is filled row by row.
pub(super) struct Output {
    path: PathBuf,
    part: Part,
    writer: SerializedFileWriter<File>,
    kinds: Vec<(Kind, bool)>,
    columns: Vec<Vec<Cell>>,
    rows: u64,
}

impl Output {
    fn create(path: &Path, table: &Table) -> Result<Self, RecordError> {
        Self::with_columns(path, table.columns())
    }

    /// The same with any columns.
    pub(super) fn with_columns(path: &Path, columns: Columns) -> Result<Self, RecordError> {
        let open = || -> Result<_, Box<dyn std::error::Error>> {
            let schema = Arc::new(parquet_schema(&columns)?);
            let properties = WriterProperties::builder()
                .set_compression(Compression::SNAPPY)
                .build();
            let (part, file) = Part::begin(path)?;
            let writer = SerializedFileWriter::new(file, schema, Arc::new(properties))?;
            Ok((part, writer))
        };
        let (part, writer) = open().map_err(|error| RecordError::new(path, &error))?;
        let kinds: Vec<_> = columns
            .iter()
            .map(|(_, kind, optional)| (*kind, *optional))
            .collect();
        Ok(Self {
            path: path.to_owned(),
            part,
            writer,
            columns: vec![Vec::new(); kinds.len()],
            kinds,
            rows: 0,
        })
    }

    pub(super) fn push(&mut self, cells: Vec<Cell>) -> Result<(), RecordError> {
        for (column, cell) in self.columns.iter_mut().zip(cells) {
            column.push(cell);
        }
        self.rows += 1;
        if (self.rows as usize).is_multiple_of(ROWS) {
            self.flush()?;
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), RecordError> {
        if self.columns.first().is_none_or(Vec::is_empty) {
            return Ok(());
        }
        let mut write = || -> parquet::errors::Result<()> {
            let mut group = self.writer.next_row_group()?;
            for (column, kind) in self.columns.iter_mut().zip(&self.kinds) {
                if let Some(mut writer) = group.next_column()? {
                    write_column(&mut writer, *kind, column)?;
                    writer.close()?;
                }
                column.clear();
            }
            group.close()?;
            Ok(())
        };
        write().map_err(|error| RecordError::new(&self.path, &error))
    }

    pub(super) fn finish(mut self, pairs: &BTreeMap<String, String>) -> Result<u64, RecordError> {
        self.flush()?;
        for (key, value) in pairs {
            self.writer
                .append_key_value_metadata(KeyValue::new(key.clone(), value.clone()));
        }
        let file = self
            .writer
            .into_inner()
            .map_err(|error| RecordError::new(&self.path, &error))?;
        let finished = self.part.finish(file);
        finished.map_err(|error| RecordError::new(&self.path, &error))?;
        Ok(self.rows)
    }
}

fn write_column(
    writer: &mut SerializedColumnWriter<'_>,
    (kind, optional): (Kind, bool),
    column: &[Cell],
) -> parquet::errors::Result<()> {
    let levels: Vec<i16> = column
        .iter()
        .map(|cell| i16::from(*cell != Cell::Null))
        .collect();
    let levels = optional.then_some(levels.as_slice());
    match kind {
        Kind::Double => {
            let values: Vec<f64> = column
                .iter()
                .filter_map(|cell| match cell {
                    Cell::Double(value) => Some(*value),
                    _ => None,
                })
                .collect();
            writer
                .typed::<DoubleType>()
                .write_batch(&values, levels, None)?;
        }
        Kind::Int32 => {
            let values: Vec<i32> = column
                .iter()
                .filter_map(|cell| match cell {
                    Cell::Int32(value) => Some(*value),
                    _ => None,
                })
                .collect();
            writer
                .typed::<Int32Type>()
                .write_batch(&values, levels, None)?;
        }
        Kind::Int64 | Kind::Timestamp => {
            let values: Vec<i64> = column
                .iter()
                .filter_map(|cell| match cell {
                    Cell::Int64(value) => Some(*value),
                    _ => None,
                })
                .collect();
            writer
                .typed::<Int64Type>()
                .write_batch(&values, levels, None)?;
        }
        Kind::Text => {
            let values: Vec<ByteArray> = column
                .iter()
                .filter_map(|cell| match cell {
                    Cell::Text(value) => Some(ByteArray::from(value.as_str())),
                    _ => None,
                })
                .collect();
            writer
                .typed::<ByteArrayType>()
                .write_batch(&values, levels, None)?;
        }
    }
    Ok(())
}
