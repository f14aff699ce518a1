//! Durations in Parquet logs. Parquet has no such type: the file holds plain numbers, and the unit
//! is in the Arrow schema that writers with Arrow add as a base64 text of an encapsulated
//! FlatBuffers message.

use base64::{engine::general_purpose::STANDARD, Engine};

/// The key of that text in a file.
pub(super) const KEY: &str = "ARROW:schema";

/// Numbers of the format: the message is a schema, the type of a field is a duration.
const SCHEMA: u8 = 1;
const DURATION: u8 = 18;

/// Columns that are durations, with the seconds of one unit. Nothing where the text is not what it
/// should be.
pub(super) fn durations(text: &str) -> Vec<(String, f64)> {
    let bytes = STANDARD.decode(text).ok();
    bytes
        .and_then(|bytes| columns(&Buffer(&bytes)))
        .unwrap_or_default()
}

fn columns(bytes: &Buffer) -> Option<Vec<(String, f64)>> {
    // A mark that older writers leave out, the length, the message.
    let start = if bytes.u32(0)? == u32::MAX { 8 } else { 4 };
    let message = bytes.at(start)?;
    if bytes.u8(bytes.field(message, 1)?)? != SCHEMA {
        return None;
    }
    let schema = bytes.at(bytes.field(message, 2)?)?;
    let fields = bytes.at(bytes.field(schema, 1)?)?;
    let mut found = Vec::new();
    for i in 0..bytes.u32(fields)? as usize {
        let field = bytes.at(fields + 4 + 4 * i)?;
        let kind = bytes.field(field, 2).and_then(|p| bytes.u8(p));
        if kind != Some(DURATION) {
            continue;
        }
        let name = bytes.text(bytes.at(bytes.field(field, 0)?)?)?;
        let duration = bytes.at(bytes.field(field, 3)?)?;
        // Left out it is the default, milliseconds.
        let unit = match bytes.field(duration, 0) {
            Some(place) => bytes.u16(place)?,
            None => 1,
        };
        let seconds = [1.0, 1e-3, 1e-6, 1e-9];
        found.push((name, *seconds.get(usize::from(unit))?));
    }
    Some(found)
}

/// Little-endian FlatBuffers; no place is trusted.
struct Buffer<'a>(&'a [u8]);

impl Buffer<'_> {
    fn bytes<const N: usize>(&self, at: usize) -> Option<[u8; N]> {
        self.0.get(at..at.checked_add(N)?)?.try_into().ok()
    }

    fn u8(&self, at: usize) -> Option<u8> {
        self.0.get(at).copied()
    }

    fn u16(&self, at: usize) -> Option<u16> {
        self.bytes(at).map(u16::from_le_bytes)
    }

    fn u32(&self, at: usize) -> Option<u32> {
        self.bytes(at).map(u32::from_le_bytes)
    }

    /// Where the offset at a place points.
    fn at(&self, place: usize) -> Option<usize> {
        place.checked_add(self.u32(place)? as usize)
    }

    /// Where the field `n` of a table is; `None` if it is left out.
    fn field(&self, table: usize, n: usize) -> Option<usize> {
        let back = i32::from_le_bytes(self.bytes(table)?);
        let fields = usize::try_from(i64::try_from(table).ok()? - i64::from(back)).ok()?;
        let entry = 4 + 2 * n;
        if entry + 2 > usize::from(self.u16(fields)?) {
            return None;
        }
        match self.u16(fields + entry)? {
            0 => None,
            offset => Some(table + usize::from(offset)),
        }
    }

    fn text(&self, at: usize) -> Option<String> {
        let length = self.u32(at)? as usize;
        let bytes = self.0.get(at + 4..(at + 4).checked_add(length)?)?;
        String::from_utf8(bytes.to_vec()).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As pyarrow 26 writes it: columns force_n, speed_rad_s and command_n of doubles, time_s of
    /// durations in µs.
    const WRITTEN: &str = "/////xABAAAQAAAAAAAKAAwABgAFAAgACgAAAAABBAAMAAAACAAIAAAABAAIAAAABAAAAAQAAACsAAAAaAAAADQAAAAEAAAAdP///wAAAQMQAAAAGAAAAAQAAAAAAAAABwAAAGZvcmNlX24AYv///wAAAgCg////AAABAxAAAAAcAAAABAAAAAAAAAALAAAAc3BlZWRfcmFkX3MAkv///wAAAgDQ////AAABAxAAAAAcAAAABAAAAAAAAAAJAAAAY29tbWFuZF9uAAAAwv///wAAAgAQABQACAAGAAcADAAAABAAEAAAAAAAARIQAAAAIAAAAAQAAAAAAAAABgAAAHRpbWVfcwAAAAAGAAgABgAGAAAAAAACAA==";

    #[test]
    fn a_duration_has_its_unit() {
        assert_eq!(durations(WRITTEN), [("time_s".to_string(), 1e-6)]);
    }

    #[test]
    fn a_damaged_schema_is_none_and_no_panic() {
        for end in 0..WRITTEN.len() {
            durations(&WRITTEN[..end]);
        }
        for at in 0..WRITTEN.len() {
            for c in ["A", "/", "x"] {
                let mut text = WRITTEN.to_string();
                text.replace_range(at..=at, c);
                durations(&text);
            }
        }
        assert!(durations("not base64!").is_empty());
    }
}
