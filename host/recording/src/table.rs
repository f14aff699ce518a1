//! Tables of a recording: one declaration gives the struct, its JSON form, its JSON schema, its
//! Parquet columns and its rows of docs/recording-columns.md.

use serde::{Deserialize, Serialize};
use serde_json::{json, Value as Json};

/// A time in UTC as Foxglove's schemas have it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize)]
pub struct Utc {
    /// Seconds since 1970.
    pub sec: u32,
    /// Nanoseconds of that second.
    pub nsec: u32,
}

impl Utc {
    /// From nanoseconds since 1970.
    #[must_use]
    pub const fn from_ns(ns: u64) -> Self {
        Self {
            sec: (ns / 1_000_000_000) as u32,
            nsec: (ns % 1_000_000_000) as u32,
        }
    }

    /// Nanoseconds since 1970.
    #[must_use]
    pub const fn ns(self) -> u64 {
        self.sec as u64 * 1_000_000_000 + self.nsec as u64
    }
}

/// Kind of a Parquet column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// 64-bit floating point.
    Double,
    /// 32-bit integer.
    Int32,
    /// 64-bit integer.
    Int64,
    /// Nanoseconds since 1970, UTC.
    Timestamp,
    /// Text.
    Text,
}

impl Kind {
    /// Name in docs/recording-columns.md.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Double => "double",
            Self::Int32 => "int32",
            Self::Int64 => "int64",
            Self::Timestamp => "timestamp",
            Self::Text => "text",
        }
    }
}

/// A value in a column.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// [`Kind::Double`].
    Double(f64),
    /// [`Kind::Int32`].
    Int32(i32),
    /// [`Kind::Int64`] and [`Kind::Timestamp`].
    Int64(i64),
    /// [`Kind::Text`].
    Text(String),
    /// Missing.
    Null,
}

/// What can be a field of a row.
pub trait Value {
    /// Kind of its columns.
    const KIND: Kind;
    /// Whether it may be missing.
    const OPTIONAL: bool = false;
    /// What its columns append to the field's name: one empty text for a single column.
    const SUFFIXES: &'static [&'static str] = &[""];
    /// Its JSON schema.
    fn schema() -> Json;
    /// Its cells, one for each suffix.
    fn cells(&self, out: &mut Vec<Cell>);
}

impl Value for f64 {
    const KIND: Kind = Kind::Double;
    fn schema() -> Json {
        json!({"type": "number"})
    }
    fn cells(&self, out: &mut Vec<Cell>) {
        out.push(Cell::Double(*self));
    }
}

impl Value for i32 {
    const KIND: Kind = Kind::Int32;
    fn schema() -> Json {
        json!({"type": "integer"})
    }
    fn cells(&self, out: &mut Vec<Cell>) {
        out.push(Cell::Int32(*self));
    }
}

impl Value for u64 {
    const KIND: Kind = Kind::Int64;
    fn schema() -> Json {
        json!({"type": "integer", "minimum": 0})
    }
    fn cells(&self, out: &mut Vec<Cell>) {
        out.push(Cell::Int64(i64::try_from(*self).unwrap_or(i64::MAX)));
    }
}

impl Value for Utc {
    const KIND: Kind = Kind::Timestamp;
    fn schema() -> Json {
        json!({
            "type": "object",
            "title": "time",
            "required": ["sec", "nsec"],
            "additionalProperties": false,
            "properties": {
                "sec": {"type": "integer", "minimum": 0},
                "nsec": {"type": "integer", "minimum": 0, "maximum": 999_999_999},
            },
        })
    }
    fn cells(&self, out: &mut Vec<Cell>) {
        out.push(Cell::Int64(i64::try_from(self.ns()).unwrap_or(i64::MAX)));
    }
}

impl Value for String {
    const KIND: Kind = Kind::Text;
    fn schema() -> Json {
        json!({"type": "string"})
    }
    fn cells(&self, out: &mut Vec<Cell>) {
        out.push(Cell::Text(self.clone()));
    }
}

/// A list of doubles of fixed length: an array in JSON, a column for each element in Parquet.
macro_rules! vector {
    ($length:literal, $suffixes:expr) => {
        impl Value for [f64; $length] {
            const KIND: Kind = Kind::Double;
            const SUFFIXES: &'static [&'static str] = $suffixes;
            fn schema() -> Json {
                json!({"type": "array", "items": {"type": "number"}, "minItems": $length, "maxItems": $length})
            }
            fn cells(&self, out: &mut Vec<Cell>) {
                out.extend(self.iter().map(|value| Cell::Double(*value)));
            }
        }
    };
}
vector!(3, &["_x", "_y", "_z"]);
vector!(6, &["_1", "_2", "_3", "_4", "_5", "_6"]);

impl<T: Value> Value for Option<T> {
    const KIND: Kind = T::KIND;
    const OPTIONAL: bool = true;
    const SUFFIXES: &'static [&'static str] = T::SUFFIXES;
    fn schema() -> Json {
        T::schema()
    }
    fn cells(&self, out: &mut Vec<Cell>) {
        match self {
            Some(value) => value.cells(out),
            None => out.extend(T::SUFFIXES.iter().map(|_| Cell::Null)),
        }
    }
}

/// A field of a table.
#[derive(Debug)]
pub struct Field {
    /// Name.
    pub name: &'static str,
    /// Unit; empty for a number without one.
    pub unit: &'static str,
    /// What it is.
    pub meaning: &'static str,
    /// Kind of its columns.
    pub kind: Kind,
    /// Whether it may be missing.
    pub optional: bool,
    /// Suffixes of its columns.
    pub suffixes: &'static [&'static str],
    /// Its JSON schema.
    pub schema: fn() -> Json,
}

impl Field {
    /// Names of its columns.
    pub fn columns(&self) -> impl Iterator<Item = String> + '_ {
        self.suffixes
            .iter()
            .map(move |suffix| format!("{}{suffix}", self.name))
    }
}

/// A table: topic of the MCAP file and Parquet file.
#[derive(Debug, Clone, Copy)]
pub struct Table {
    /// Topic; the part that all have in common where there are several.
    pub topic: &'static str,
    /// Topics of the MCAP file: one, or one for each unit. A plot draws a line through all messages
    /// of a topic.
    pub topics: &'static [&'static str],
    /// Name of the schema.
    pub schema_name: &'static str,
    /// Parquet file.
    pub file: &'static str,
    /// What a row is.
    pub row: &'static str,
    /// Fields.
    pub fields: &'static [Field],
}

impl Table {
    /// JSON schema of its messages. What may be missing is left out of a message, because viewers
    /// want one type a field.
    #[must_use]
    pub fn json_schema(&self) -> Json {
        let properties: serde_json::Map<_, _> = self
            .fields
            .iter()
            .map(|field| {
                let mut schema = (field.schema)();
                let unit = if field.unit.is_empty() {
                    String::new()
                } else {
                    format!(", {}", field.unit)
                };
                schema["description"] = format!("{}{unit}", field.meaning).into();
                (field.name.to_owned(), schema)
            })
            .collect();
        let required: Vec<_> = self
            .fields
            .iter()
            .filter(|field| !field.optional)
            .map(|field| field.name)
            .collect();
        json!({
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "title": self.schema_name,
            "description": self.row,
            "type": "object",
            "additionalProperties": false,
            "required": required,
            "properties": properties,
        })
    }

    /// Its columns: name, kind, whether it may be missing.
    #[must_use]
    pub fn columns(&self) -> Vec<(String, Kind, bool)> {
        self.fields
            .iter()
            .flat_map(|field| {
                field
                    .columns()
                    .map(|name| (name, field.kind, field.optional))
            })
            .collect()
    }
}

/// A column of numbers: name, unit, what it is.
pub type Column = (&'static str, &'static str, &'static str);

/// A table of numbers that a run adds to those of a recording, for example its robot's states.
#[derive(Debug, Clone, Copy)]
pub struct ColumnTable {
    /// Topic.
    pub topic: &'static str,
    /// Name of the schema.
    pub schema_name: &'static str,
    /// What a row is.
    pub row: &'static str,
    /// Columns; the time `utc` is not among them.
    pub columns: &'static [Column],
}

impl ColumnTable {
    /// JSON schema of its messages. A number that is not there is left out.
    #[must_use]
    pub fn json_schema(&self) -> Json {
        let mut properties = serde_json::Map::from_iter([("utc".to_owned(), Utc::schema())]);
        properties.extend(self.columns.iter().map(|(name, unit, meaning)| {
            let schema = json!({"type": "number", "description": format!("{meaning}, {unit}")});
            ((*name).to_owned(), schema)
        }));
        json!({
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "title": self.schema_name,
            "description": self.row,
            "type": "object",
            "additionalProperties": false,
            "required": ["utc"],
            "properties": properties,
        })
    }

    /// A message; `values` has one for each column, NaN where there is none.
    #[must_use]
    pub fn message(&self, utc: Utc, values: &[f64]) -> Json {
        let mut fields = serde_json::Map::from_iter([("utc".to_owned(), json!(utc))]);
        for ((name, ..), value) in self.columns.iter().zip(values) {
            // Not a number and the infinite ones have no JSON.
            if let Some(number) = serde_json::Number::from_f64(*value) {
                fields.insert((*name).to_owned(), number.into());
            }
        }
        fields.into()
    }

    /// The values of a message, NaN where there is none; `None` where it is no message of this
    /// table.
    #[must_use]
    pub fn values(&self, message: &[u8]) -> Option<Vec<f64>> {
        let fields: serde_json::Map<String, Json> = serde_json::from_slice(message).ok()?;
        let value = |name| fields.get(name).and_then(Json::as_f64).unwrap_or(f64::NAN);
        Some(self.columns.iter().map(|(name, ..)| value(*name)).collect())
    }
}

/// A row of a table.
pub trait Row: Serialize + for<'de> Deserialize<'de> {
    /// Its table.
    const TABLE: Table;
    /// Its topic, one of [`Table::topics`].
    fn topic(&self) -> &'static str;
    /// Its cells, in the order of the columns.
    fn cells(&self) -> Vec<Cell>;
    /// When it was, in the clocks of host (s) and board (s), for [`Row::set_times`].
    fn times(&self) -> Times;
    /// Puts better times in.
    fn set_times(&mut self, times: Times);
}

/// The three clocks of a row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Times {
    /// UTC.
    pub utc: Utc,
    /// Host, s.
    pub host_s: f64,
    /// Board, s.
    pub board_s: f64,
}

/// The topics of a table.
macro_rules! topics {
    ($topic:literal) => {
        &[$topic]
    };
    ($topic:literal $topics:ident) => {
        &$topics
    };
}
pub(super) use topics;

/// Declares a table with its row. Every row begins with the three clocks and the phase.
macro_rules! table {
    (
        $(#[$meta:meta])*
        $row:ident { $topic:literal $(as $topics:ident by $number:ident)?, $schema:literal, $file:literal, $what:literal }
        $( $field:ident: $type:ty, $unit:literal, $meaning:literal; )*
    ) => {
        $(#[$meta])*
        #[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
        pub struct $row {
            #[doc = "When it was, UTC."]
            pub utc: $crate::table::Utc,
            #[doc = "The same time by the host's clock, s."]
            pub host_s: f64,
            #[doc = "The same time by the board's clock, s."]
            pub board_s: f64,
            #[doc = "Phase of the run."]
            pub phase: String,
            $(
                #[doc = concat!($meaning, " (", $unit, ")")]
                #[serde(skip_serializing_if = "crate::table::Absent::is_absent")]
                pub $field: $type,
            )*
        }

        impl $crate::table::Row for $row {
            const TABLE: $crate::table::Table = $crate::table::Table {
                topic: $topic,
                topics: $crate::table::topics!($topic $($topics)?),
                schema_name: $schema,
                file: $file,
                row: $what,
                fields: &[
                    $crate::table::field::<$crate::table::Utc>("utc", "", "time in UTC"),
                    $crate::table::field::<f64>("host_s", "s", "the same time by the host's monotonic clock, from when the link was opened"),
                    $crate::table::field::<f64>("board_s", "s", "the same time by the board's clock, from its boot"),
                    $crate::table::field::<String>("phase", "", "phase of the run"),
                    $( $crate::table::field::<$type>(stringify!($field), $unit, $meaning), )*
                ],
            };

            fn topic(&self) -> &'static str {
                // From 1; what is of no unit of the rig is kept with the nearest.
                let number: i32 = [$(self.$number,)? 1][0];
                let index = usize::try_from(number.saturating_sub(1)).unwrap_or(0);
                Self::TABLE.topics[index.min(Self::TABLE.topics.len() - 1)]
            }

            fn cells(&self) -> Vec<$crate::table::Cell> {
                use $crate::table::Value;
                let mut out = Vec::new();
                self.utc.cells(&mut out);
                self.host_s.cells(&mut out);
                self.board_s.cells(&mut out);
                self.phase.cells(&mut out);
                $( self.$field.cells(&mut out); )*
                out
            }

            fn times(&self) -> $crate::table::Times {
                $crate::table::Times { utc: self.utc, host_s: self.host_s, board_s: self.board_s }
            }

            fn set_times(&mut self, times: $crate::table::Times) {
                self.utc = times.utc;
                self.host_s = times.host_s;
                self.board_s = times.board_s;
            }
        }
    };
}
pub(super) use table;

/// A row of a table that was at a time ([`super::rows::At`]): its own fields; clocks and phase come
/// from there.
macro_rules! row {
    ($row:ident, $at:expr, { $($field:ident: $value:expr),* $(,)? }) => {{
        let at = $at;
        $row {
            utc: at.times.utc,
            host_s: at.times.host_s,
            board_s: at.times.board_s,
            phase: at.phase.to_owned(),
            $($field: $value),*
        }
    }};
}
pub(super) use row;

/// A field of a type.
#[must_use]
pub const fn field<T: Value>(
    name: &'static str,
    unit: &'static str,
    meaning: &'static str,
) -> Field {
    Field {
        name,
        unit,
        meaning,
        kind: T::KIND,
        optional: T::OPTIONAL,
        suffixes: T::SUFFIXES,
        schema: T::schema,
    }
}

/// Whether a value is left out of a message.
pub trait Absent {
    /// `true` for what is missing.
    fn is_absent(&self) -> bool {
        false
    }
}

impl Absent for f64 {}
impl Absent for i32 {}
impl Absent for u64 {}
impl Absent for Utc {}
impl Absent for String {}
impl<const N: usize> Absent for [f64; N] {}
impl<T> Absent for Option<T> {
    fn is_absent(&self) -> bool {
        self.is_none()
    }
}
