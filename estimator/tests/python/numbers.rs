//! Numbers that Python reads.

use std::path::Path;

/// Writes numbers as little-endian f32.
pub fn write(folder: &Path, name: &str, values: &[f32]) {
    let bytes: Vec<u8> = values
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .collect();
    std::fs::write(folder.join(name), bytes).expect("a file");
}
