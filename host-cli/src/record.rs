//! Recording: every sample and every control cycle, with the configuration and its hash.
//!
//! A recording is a folder:
//!
//! | file | what |
//! | --- | --- |
//! | `samples.parquet` | one row a sample: raw codes, and the same in SI units |
//! | `cycles.parquet` | one row a control cycle (set-force) |
//! | `run.mcap` | both as JSON messages, for Foxglove and the mcap tools |
//! | `configuration.json` | rig file, the six configurations in force, their CRC, the rig file's hash |
//!
//! The Parquet files carry the same configuration in their key-value metadata, the MCAP file in its
//! metadata record, so a file that went its own way still knows what it was recorded with.

use crate::calibrate::applied::Steady;
use crate::force::metrics::Step;
use crate::rigfile::{board_crc, RigFile};
use crate::session::TimedSample;
use mcap::records::MessageHeader;
use parquet::basic::Compression;
use parquet::data_type::{DoubleType, Int32Type};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use parquet::schema::parser::parse_message_type;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use wire::message::{Sample, UnitConfig};
use wire::UNITS;

/// Rows of a row group.
const ROWS: usize = 65_536;

/// Why a recording could not be written.
#[derive(Debug, thiserror::Error)]
#[error("recording {path}: {cause}; check the folder and the space on the disk")]
pub struct RecordError {
    /// File.
    pub path: String,
    /// What went wrong.
    pub cause: String,
}

/// A sample as it is recorded: raw codes and SI units.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SampleRow {
    /// DRDY edge, board time, s.
    pub t_s: f64,
    /// Unit, from 1.
    pub unit: i32,
    /// ADC code.
    pub adc_code: i32,
    /// Encoder position, counts (lowest 32 bits).
    pub encoder_counts: i32,
    /// DAC code.
    pub dac_code: i32,
    /// [`wire::message::flags`].
    pub flags: i32,
    /// DRDY edge to DAC word, s.
    pub latency_s: f64,
    /// Load-cell force, unfiltered, along the cell's axis, N.
    pub load_cell_n: f64,
    /// Cable travel since the counter's zero, positive winding in, m.
    pub travel_m: f64,
    /// DAC output, V.
    pub dac_v: f64,
    /// Cable tension after the filter, N.
    pub tension_n: f64,
    /// Setpoint in force, N.
    pub setpoint_n: f64,
    /// Proportional term, N.
    pub p_n: f64,
    /// Integral term, N.
    pub i_n: f64,
    /// Derivative and damping terms, N.
    pub d_n: f64,
    /// Feedforward, N.
    pub ff_n: f64,
    /// Force at the tip as the board computes it, N.
    pub tip_force_n: f64,
}

/// Volts of a DAC7731 code at +-10 V (straight binary, 0x8000 is 0 V).
fn dac_v(code: u16) -> f64 {
    (f64::from(code) - 32_768.0) * 20.0 / 65_536.0
}

impl SampleRow {
    /// From a sample and the configuration its unit had.
    #[must_use]
    pub fn new(timed: &TimedSample, configs: &[UnitConfig; UNITS]) -> Self {
        let s: &Sample = &timed.sample;
        let (scale_n, zero, travel_m) =
            configs.get(usize::from(s.unit)).map_or((0.0, 0, 0.0), |c| {
                (
                    f64::from(c.scale_pn_per_count) * 1e-12,
                    c.zero_code,
                    f64::from(c.travel_nm_per_count) * 1e-9,
                )
            });
        let tenth_mn = |value: i32| f64::from(value) * 1e-4;
        Self {
            t_s: timed.t_us as f64 * 1e-6,
            unit: i32::from(s.unit) + 1,
            adc_code: s.adc_code,
            encoder_counts: s.encoder_counts,
            dac_code: i32::from(s.dac_code),
            flags: i32::from(s.flags),
            latency_s: f64::from(s.latency_us) * 1e-6,
            load_cell_n: (f64::from(s.adc_code) - f64::from(zero)) * scale_n,
            travel_m: f64::from(s.encoder_counts) * travel_m,
            dac_v: dac_v(s.dac_code),
            tension_n: tenth_mn(s.tension),
            setpoint_n: tenth_mn(s.setpoint),
            p_n: tenth_mn(s.p),
            i_n: tenth_mn(s.i),
            d_n: tenth_mn(s.d),
            ff_n: tenth_mn(s.ff),
            tip_force_n: f64::from(s.tip_force_mn) * 1e-3,
        }
    }
}

const SAMPLE_SCHEMA: &str = "message sample {
    required double t_s; required int32 unit;
    required int32 adc_code; required int32 encoder_counts; required int32 dac_code; required int32 flags;
    required double latency_s; required double load_cell_n; required double travel_m; required double dac_v;
    required double tension_n; required double setpoint_n;
    required double p_n; required double i_n; required double d_n; required double ff_n;
    required double tip_force_n;
}";

/// A value of a column.
#[derive(Debug, Clone, Copy)]
enum Cell {
    I(i32),
    F(f64),
    /// Missing where `None`.
    O(Option<f64>),
}

fn sample_cells(r: &SampleRow) -> Vec<Cell> {
    use Cell::{F, I};
    vec![
        F(r.t_s),
        I(r.unit),
        I(r.adc_code),
        I(r.encoder_counts),
        I(r.dac_code),
        I(r.flags),
        F(r.latency_s),
        F(r.load_cell_n),
        F(r.travel_m),
        F(r.dac_v),
        F(r.tension_n),
        F(r.setpoint_n),
        F(r.p_n),
        F(r.i_n),
        F(r.d_n),
        F(r.ff_n),
        F(r.tip_force_n),
    ]
}

fn cycle_schema() -> String {
    let mut schema = "message cycle { required double t_s; ".to_owned();
    for (kind, name, labels) in [
        ("required", "tip_m", &["x", "y", "z"][..]),
        ("required", "commanded_n", &["x", "y", "z"]),
        ("required", "estimated_n", &["x", "y", "z"]),
        ("optional", "applied_n", &["x", "y", "z"]),
        (
            "required",
            "tension_setpoint_n",
            &["1", "2", "3", "4", "5", "6"],
        ),
        (
            "required",
            "measured_tension_n",
            &["1", "2", "3", "4", "5", "6"],
        ),
        (
            "optional",
            "true_tension_n",
            &["1", "2", "3", "4", "5", "6"],
        ),
    ] {
        for label in labels {
            schema.push_str(&format!("{kind} double {name}_{label}; "));
        }
    }
    schema.push('}');
    schema
}

fn cycle_cells(s: &Step) -> Vec<Cell> {
    let mut cells = vec![Cell::F(s.t_s)];
    let required =
        |values: &[f64], cells: &mut Vec<Cell>| cells.extend(values.iter().map(|v| Cell::F(*v)));
    required(s.tip_m.as_slice(), &mut cells);
    required(s.commanded_n.as_slice(), &mut cells);
    required(s.estimated_n.as_slice(), &mut cells);
    cells.extend((0..3).map(|i| Cell::O(s.applied_n.map(|f| f[i]))));
    required(&s.tension_setpoint_n, &mut cells);
    required(&s.measured_tension_n, &mut cells);
    cells.extend((0..UNITS).map(|i| Cell::O(s.true_tension_n.map(|t| t[i]))));
    cells
}

/// A Parquet file that is filled row by row.
struct Table {
    path: PathBuf,
    writer: SerializedFileWriter<File>,
    columns: Vec<Vec<Cell>>,
}

impl Table {
    fn create(path: PathBuf, schema: &str) -> Result<Self, RecordError> {
        let open = || -> Result<_, Box<dyn std::error::Error>> {
            let schema = Arc::new(parse_message_type(schema)?);
            let columns = vec![Vec::new(); schema.get_fields().len()];
            let properties = WriterProperties::builder()
                .set_compression(Compression::SNAPPY)
                .build();
            let writer =
                SerializedFileWriter::new(File::create(&path)?, schema, Arc::new(properties))?;
            Ok((writer, columns))
        };
        let (writer, columns) = open().map_err(|error| failed(&path, &error))?;
        Ok(Self {
            path,
            writer,
            columns,
        })
    }

    fn push(&mut self, cells: Vec<Cell>) -> Result<(), RecordError> {
        for (column, cell) in self.columns.iter_mut().zip(cells) {
            column.push(cell);
        }
        if self
            .columns
            .first()
            .is_some_and(|column| column.len() >= ROWS)
        {
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
            for column in &mut self.columns {
                if let Some(mut writer) = group.next_column()? {
                    write_column(&mut writer, column)?;
                    writer.close()?;
                }
                column.clear();
            }
            group.close()?;
            Ok(())
        };
        write().map_err(|error| failed(&self.path, &error))
    }

    fn finish(mut self, configuration: &BTreeMap<String, String>) -> Result<(), RecordError> {
        self.flush()?;
        for (key, value) in configuration {
            self.writer
                .append_key_value_metadata(KeyValue::new(key.clone(), value.clone()));
        }
        self.writer
            .close()
            .map(|_| ())
            .map_err(|error| failed(&self.path, &error))
    }
}

fn write_column(
    writer: &mut SerializedColumnWriter<'_>,
    column: &[Cell],
) -> parquet::errors::Result<()> {
    match column.first() {
        Some(Cell::I(_)) => {
            let values: Vec<i32> = column
                .iter()
                .filter_map(|c| if let Cell::I(v) = c { Some(*v) } else { None })
                .collect();
            writer
                .typed::<Int32Type>()
                .write_batch(&values, None, None)?;
        }
        Some(Cell::F(_)) => {
            let values: Vec<f64> = column
                .iter()
                .filter_map(|c| if let Cell::F(v) = c { Some(*v) } else { None })
                .collect();
            writer
                .typed::<DoubleType>()
                .write_batch(&values, None, None)?;
        }
        _ => {
            let there = |c: &Cell| if let Cell::O(v) = c { *v } else { None };
            let values: Vec<f64> = column.iter().filter_map(there).collect();
            let levels: Vec<i16> = column
                .iter()
                .map(|c| i16::from(there(c).is_some()))
                .collect();
            writer
                .typed::<DoubleType>()
                .write_batch(&values, Some(&levels), None)?;
        }
    }
    Ok(())
}

fn failed(path: &Path, cause: &dyn std::fmt::Display) -> RecordError {
    RecordError {
        path: path.display().to_string(),
        cause: cause.to_string(),
    }
}

/// A topic of the MCAP file.
struct Topic {
    channel: u16,
    sequence: u32,
}

/// An open recording. [`Recorder::finish`] completes it; a recording that was never finished lacks its footers.
pub struct Recorder {
    folder: PathBuf,
    rig: RigFile,
    configs: [UnitConfig; UNITS],
    samples: Table,
    cycles: Table,
    mcap: mcap::Writer<BufWriter<File>>,
    sample_topic: Topic,
    cycle_topic: Topic,
    /// For the uncertainty of the force.
    steady: Steady,
    newest_ns: u64,
    rows: u64,
}

impl std::fmt::Debug for Recorder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Recorder")
            .field("folder", &self.folder)
            .field("rows", &self.rows)
            .finish_non_exhaustive()
    }
}

impl Recorder {
    /// Begins a recording in a folder, which is made where it isn't there.
    ///
    /// # Errors
    /// [`RecordError`]; also where the folder holds a recording already, which is never overwritten.
    pub fn create(folder: &Path, rig: &RigFile) -> Result<Self, RecordError> {
        std::fs::create_dir_all(folder).map_err(|error| failed(folder, &error))?;
        let path = |name: &str| folder.join(name);
        if path("run.mcap").exists() || path("samples.parquet").exists() {
            return Err(failed(
                folder,
                &"it holds a recording already; give another folder",
            ));
        }
        let mcap_path = path("run.mcap");
        let open = || -> Result<_, Box<dyn std::error::Error>> {
            let file = BufWriter::new(File::create(&mcap_path)?);
            let mut writer = mcap::WriteOptions::new()
                .compression(None)
                .library("forcectl")
                .create(file)?;
            let topic = |writer: &mut mcap::Writer<_>,
                         name: &str,
                         fields: &[String]|
             -> mcap::McapResult<Topic> {
                let properties: BTreeMap<_, _> = fields
                    .iter()
                    .map(|f| (f.clone(), serde_json::json!({})))
                    .collect();
                let schema =
                    serde_json::json!({"type": "object", "title": name, "properties": properties});
                let schema =
                    writer.add_schema(name, "jsonschema", schema.to_string().as_bytes())?;
                let channel =
                    writer.add_channel(schema, &format!("/{name}"), "json", &BTreeMap::new())?;
                Ok(Topic {
                    channel,
                    sequence: 0,
                })
            };
            let fields = |schema: &str| -> Vec<String> {
                schema
                    .split(['{', ';'])
                    .filter_map(|field| field.split_whitespace().nth(2))
                    .filter(|f| *f != "sample")
                    .map(str::to_owned)
                    .collect()
            };
            let sample_topic = topic(&mut writer, "sample", &fields(SAMPLE_SCHEMA))?;
            let cycle_topic = topic(&mut writer, "cycle", &fields(&cycle_schema()))?;
            Ok((writer, sample_topic, cycle_topic))
        };
        let (mcap, sample_topic, cycle_topic) =
            open().map_err(|error| failed(&mcap_path, &error))?;
        Ok(Self {
            folder: folder.to_owned(),
            rig: rig.clone(),
            configs: rig.units.map(|unit| unit.to_wire()),
            samples: Table::create(path("samples.parquet"), SAMPLE_SCHEMA)?,
            cycles: Table::create(path("cycles.parquet"), &cycle_schema())?,
            mcap,
            sample_topic,
            cycle_topic,
            steady: Steady::default(),
            newest_ns: 0,
            rows: 0,
        })
    }

    /// The configuration in force, zeros included; samples from now on are converted with it.
    pub fn configured(&mut self, configs: &[UnitConfig; UNITS]) {
        self.configs = *configs;
    }

    /// Records samples.
    ///
    /// # Errors
    /// [`RecordError`].
    pub fn samples(&mut self, samples: &[TimedSample]) -> Result<(), RecordError> {
        for timed in samples {
            let row = SampleRow::new(timed, &self.configs);
            self.newest_ns = timed.t_us.saturating_mul(1000);
            self.samples.push(sample_cells(&row))?;
            write_message(&mut self.mcap, &mut self.sample_topic, self.newest_ns, &row)
                .map_err(|error| failed(&self.folder.join("run.mcap"), &error))?;
            self.rows += 1;
        }
        Ok(())
    }

    /// Records a control cycle.
    ///
    /// # Errors
    /// [`RecordError`].
    pub fn cycle(&mut self, step: &Step) -> Result<(), RecordError> {
        self.steady.add(step);
        self.cycles.push(cycle_cells(step))?;
        write_message(&mut self.mcap, &mut self.cycle_topic, self.newest_ns, step)
            .map_err(|error| failed(&self.folder.join("run.mcap"), &error))
    }

    /// Completes the files; returns how many samples they hold.
    ///
    /// # Errors
    /// [`RecordError`].
    pub fn finish(mut self) -> Result<u64, RecordError> {
        let configs = serde_json::to_value(self.configs).unwrap_or_default();
        let rig = serde_json::to_value(&self.rig).unwrap_or_default();
        let crc = format!("{:08x}", board_crc(&self.configs));
        let mut configuration = BTreeMap::from([
            (
                "forcectl_version".to_owned(),
                env!("CARGO_PKG_VERSION").to_owned(),
            ),
            ("wire_abi".to_owned(), wire::ABI_VERSION.to_string()),
            ("rig_hash_sha256".to_owned(), self.rig.hash()),
            ("rig".to_owned(), rig.to_string()),
            ("board_config_crc32".to_owned(), crc),
            ("board_config".to_owned(), configs.to_string()),
        ]);
        if let Some(record) = self.rig.calibration.as_deref() {
            // As it was in force, with covariances, and what it says of the force that was held.
            let uncertainty = self.steady.uncertainty(record);
            for (key, text) in [
                ("calibration", serde_json::to_string(record)),
                ("force_uncertainty", serde_json::to_string(&uncertainty)),
            ] {
                configuration.insert(key.to_owned(), text.unwrap_or_default());
            }
        }
        let mcap_path = self.folder.join("run.mcap");
        let metadata = mcap::records::Metadata {
            name: "configuration".to_owned(),
            metadata: configuration.clone(),
        };
        self.mcap
            .write_metadata(&metadata)
            .map_err(|error| failed(&mcap_path, &error))?;
        self.mcap
            .finish()
            .map_err(|error| failed(&mcap_path, &error))?;
        let json_path = self.folder.join("configuration.json");
        let mut json: serde_json::Map<String, serde_json::Value> = configuration
            .iter()
            .map(|(k, v)| (k.clone(), v.clone().into()))
            .collect();
        json.insert("rig".to_owned(), rig);
        json.insert("board_config".to_owned(), configs);
        let text = serde_json::to_string_pretty(&json).unwrap_or_default();
        std::fs::write(&json_path, text).map_err(|error| failed(&json_path, &error))?;
        self.samples.finish(&configuration)?;
        self.cycles.finish(&configuration)?;
        Ok(self.rows)
    }
}

fn write_message(
    writer: &mut mcap::Writer<BufWriter<File>>,
    topic: &mut Topic,
    t_ns: u64,
    message: &impl Serialize,
) -> Result<(), Box<dyn std::error::Error>> {
    let header = MessageHeader {
        channel_id: topic.channel,
        sequence: topic.sequence,
        log_time: t_ns,
        publish_time: t_ns,
    };
    topic.sequence = topic.sequence.wrapping_add(1);
    writer.write_to_known_channel(&header, &serde_json::to_vec(message)?)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::RowAccessor;

    #[test]
    fn a_recording_reads_back_with_its_configuration() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path().join("record");
        let rig = RigFile::built_in().unwrap();
        let mut recorder = Recorder::create(&folder, &rig).unwrap();
        let mut configs = rig.units.map(|unit| unit.to_wire());
        configs[2].zero_code = 1000;
        recorder.configured(&configs);
        let samples: Vec<TimedSample> = (0..70_000u64)
            .map(|n| TimedSample {
                t_us: 5_000_000_000 + n * 500,
                sample: Sample {
                    unit: 2,
                    adc_code: 1000 + n as i32,
                    dac_code: 0x8000 + 3277,
                    tension: -25_000,
                    ..Sample::default()
                },
            })
            .collect();
        recorder.samples(&samples).unwrap();
        let step = Step {
            t_s: 0.01,
            tip_m: [1.0, 2.0, 3.0].into(),
            commanded_n: [0.0, 2.5, 0.0].into(),
            estimated_n: [0.1; 3].into(),
            applied_n: None,
            tension_setpoint_n: [2.0; UNITS],
            measured_tension_n: [2.1; UNITS],
            true_tension_n: Some([2.2; UNITS]),
            available: [true; UNITS],
        };
        recorder.cycle(&step).unwrap();
        assert_eq!(recorder.finish().unwrap(), 70_000);

        let reader =
            SerializedFileReader::new(File::open(folder.join("samples.parquet")).unwrap()).unwrap();
        let metadata = reader.metadata().file_metadata();
        assert_eq!(metadata.num_rows(), 70_000);
        assert_eq!(reader.metadata().num_row_groups(), 2);
        let pairs = metadata.key_value_metadata().unwrap();
        let value = |key: &str| {
            pairs
                .iter()
                .find(|p| p.key == key)
                .and_then(|p| p.value.clone())
                .unwrap()
        };
        assert_eq!(value("rig_hash_sha256"), rig.hash());
        assert_eq!(
            value("board_config_crc32"),
            format!("{:08x}", board_crc(&configs))
        );
        let row = reader
            .get_row_iter(None)
            .unwrap()
            .nth(69_999)
            .unwrap()
            .unwrap();
        assert_eq!(row.get_int(1).unwrap(), 3);
        let column = |name: &str| row.get_column_iter().position(|(n, _)| n == name).unwrap();
        assert!((row.get_double(column("t_s")).unwrap() - 5034.9995).abs() < 1e-9);
        assert!((row.get_double(column("load_cell_n")).unwrap() - 69_999.0 * 6.85e-6).abs() < 1e-9);
        assert!((row.get_double(column("dac_v")).unwrap() - 1.0).abs() < 1e-3);
        assert!((row.get_double(column("tension_n")).unwrap() + 2.5).abs() < 1e-12);

        let reader =
            SerializedFileReader::new(File::open(folder.join("cycles.parquet")).unwrap()).unwrap();
        let row = reader.get_row_iter(None).unwrap().next().unwrap().unwrap();
        let column = |name: &str| row.get_column_iter().position(|(n, _)| n == name).unwrap();
        assert!(
            row.get_double(column("applied_n_y")).is_err(),
            "missing is null"
        );
        assert_eq!(row.get_double(column("true_tension_n_6")).unwrap(), 2.2);

        let bytes = std::fs::read(folder.join("run.mcap")).unwrap();
        let messages: Vec<_> = mcap::MessageStream::new(&bytes)
            .unwrap()
            .map(Result::unwrap)
            .collect();
        assert_eq!(messages.len(), 70_001);
        let first: serde_json::Value = serde_json::from_slice(&messages[0].data).unwrap();
        assert_eq!(first["adc_code"], 1000);
        assert_eq!(messages[0].log_time, 5_000_000_000_000);
        let json: serde_json::Value =
            serde_json::from_slice(&std::fs::read(folder.join("configuration.json")).unwrap())
                .unwrap();
        assert_eq!(json["board_config"][2]["zero_code"], 1000);
        assert!(json["calibration"].is_null());

        let again = Recorder::create(&folder, &rig).unwrap_err();
        assert!(again.to_string().contains("another folder"), "{again}");
    }

    #[test]
    fn a_recording_of_a_calibrated_rig_has_calibration_and_uncertainty() {
        use crate::calibrate::base;
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path().join("record");
        let rig = RigFile::built_in().unwrap();
        let rig = base::overlay(&rig, &base::nominal(&rig, "2026-11-22"));
        let mut recorder = Recorder::create(&folder, &rig).unwrap();
        for t_s in [0.5, 2.0, 2.01] {
            let step = Step {
                t_s,
                tip_m: rig.workspace.center_m,
                commanded_n: [0.0, 2.5, 0.0].into(),
                estimated_n: [0.1; 3].into(),
                applied_n: None,
                tension_setpoint_n: [2.0; UNITS],
                measured_tension_n: [2.1; UNITS],
                true_tension_n: None,
                available: [true; UNITS],
            };
            recorder.cycle(&step).unwrap();
        }
        recorder.finish().unwrap();
        let text = std::fs::read_to_string(folder.join("configuration.json")).unwrap();
        let json: serde_json::Value = serde_json::from_str(&text).unwrap();
        let of = |key: &str| -> serde_json::Value {
            serde_json::from_str(json[key].as_str().unwrap()).unwrap()
        };
        assert_eq!(of("calibration")["rig"], rig.name.as_str());
        let found = of("force_uncertainty");
        assert!(found["radius_95_n"].as_f64().unwrap() > 0.1, "{found}");
        assert!(
            (found["parts_n"]["held"].as_f64().unwrap() - 0.1).abs() < 0.1,
            "{found}"
        );
    }
}
