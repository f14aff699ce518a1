//! Drains the firmware's RTT up-channel 0, as a debug probe would.
//!
//! Control block (SEGGER, "RTT protocol"): 16 bytes of name, number of up and down buffers, then
//! per up-buffer name pointer, buffer pointer, size, write offset, read offset, flags. The probe
//! writes only the read offset.

use crate::engine::{EngineError, Memory};

const NAME: &[u8] = b"SEGGER RTT";
const UP_0: u32 = 24;

/// Takes what channel 0 of the control block at `at` holds. Nothing while the firmware has not set
/// it up.
///
/// # Errors
/// The engine cannot go on.
pub fn drain(memory: &mut dyn Memory, at: u32) -> Result<Vec<u8>, EngineError> {
    let header = memory.read(at, 48)?;
    let word =
        |n: usize| u32::from_le_bytes([header[n], header[n + 1], header[n + 2], header[n + 3]]);
    let (buffer, size, write, read) = (word(28), word(32), word(36), word(40));
    if !header.starts_with(NAME) || size == 0 || size > 1 << 16 || write >= size || read >= size {
        return Ok(Vec::new());
    }
    if write == read {
        return Ok(Vec::new());
    }
    let mut bytes = Vec::new();
    if write < read {
        bytes.extend(memory.read(buffer + read, (size - read) as usize)?);
        bytes.extend(memory.read(buffer, write as usize)?);
    } else {
        bytes.extend(memory.read(buffer + read, (write - read) as usize)?);
    }
    memory.write(at + UP_0 + 16, &write.to_le_bytes())?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A controller that is nothing but memory.
    struct Bare(Vec<u8>);

    impl Memory for Bare {
        fn read(&mut self, address: u32, length: usize) -> Result<Vec<u8>, EngineError> {
            let at = address as usize;
            Ok(self.0[at..at + length].to_vec())
        }

        fn write(&mut self, address: u32, bytes: &[u8]) -> Result<(), EngineError> {
            let at = address as usize;
            self.0[at..at + bytes.len()].copy_from_slice(bytes);
            Ok(())
        }
    }

    #[test]
    fn the_ring_is_emptied_across_its_end() {
        let mut memory = Bare(vec![0; 128]);
        memory.0[..10].copy_from_slice(NAME);
        for (at, word) in [(16, 1u32), (28, 64), (32, 8), (36, 2), (40, 6)] {
            memory.0[at..at + 4].copy_from_slice(&word.to_le_bytes());
        }
        memory.0[64..72].copy_from_slice(b"cdxxxxab");
        assert_eq!(drain(&mut memory, 0).unwrap(), b"abcd");
        assert_eq!(memory.0[40], 2);
        assert!(drain(&mut memory, 0).unwrap().is_empty());
    }

    #[test]
    fn a_block_that_is_not_set_up_is_left_alone() {
        let mut memory = Bare(vec![0xA5; 128]);
        assert!(drain(&mut memory, 0).unwrap().is_empty());
        assert_eq!(memory.0, vec![0xA5; 128]);
    }
}
