//! Frames: postcard, then a CRC-32 (ISO-HDLC, little endian), then COBS, then one zero byte.
//!
//! A zero byte ends a frame and occurs nowhere else, so a receiver synchronises again after any
//! damage at the next zero. The decoder counts discarded frames and never panics.

use crc::{Crc, CRC_32_ISO_HDLC};
use serde::{de::DeserializeOwned, Serialize};

/// Longest frame on the wire, with its COBS overhead and closing zero, in bytes.
pub const MAX_FRAME: usize = 384;

/// Longest payload (postcard and CRC) whose COBS form fits into [`MAX_FRAME`]: COBS adds a byte per
/// 254 begun, and the zero ends the frame.
const MAX_PAYLOAD: usize = MAX_FRAME - 3;

const CRC32: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// CRC-32 (ISO-HDLC) of some bytes: of frames, and of configurations.
#[must_use]
pub fn crc32(bytes: &[u8]) -> u32 {
    CRC32.checksum(bytes)
}

/// What is wrong with a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameError {
    /// No room for it, in the buffer given or within [`MAX_FRAME`].
    TooLong,
    /// The COBS code points outside the frame.
    Cobs,
    /// The CRC is another: bytes were lost or changed.
    Crc,
    /// The CRC fits but the bytes are no message of this version.
    Message,
}

impl core::fmt::Display for FrameError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::TooLong => "frame is longer than 384 bytes",
            Self::Cobs => "frame is not COBS",
            Self::Crc => "frame's CRC does not match (bytes lost, or another baud rate)",
            Self::Message => "frame holds no message of this protocol version",
        })
    }
}

impl core::error::Error for FrameError {}

/// Encodes a message as a whole frame into `out`; returns its length, closing zero included.
///
/// # Errors
/// [`FrameError::TooLong`] where `out` is too short ([`MAX_FRAME`] bytes always do).
pub fn encode<T: Serialize>(message: &T, out: &mut [u8]) -> Result<usize, FrameError> {
    let mut payload = [0; MAX_PAYLOAD];
    let room = MAX_PAYLOAD - 4;
    let length = postcard::to_slice(message, &mut payload[..room])
        .map_err(|_| FrameError::TooLong)?
        .len();
    // Without an index: this is part of the board's sample path, which has no panic.
    let (message, rest) = payload
        .split_at_mut_checked(length)
        .ok_or(FrameError::TooLong)?;
    let crc = crc32(message).to_le_bytes();
    *rest.first_chunk_mut().ok_or(FrameError::TooLong)? = crc;
    let payload = payload.get(..length + 4).ok_or(FrameError::TooLong)?;
    let length = cobs::try_encode(payload, out).map_err(|_| FrameError::TooLong)?;
    *out.get_mut(length).ok_or(FrameError::TooLong)? = 0;
    Ok(length + 1)
}

/// Collects bytes and hands out messages.
#[derive(Debug, Clone)]
pub struct Decoder {
    buffer: [u8; MAX_FRAME],
    length: usize,
    overrun: bool,
    bad: u32,
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Decoder {
    /// An empty decoder.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            buffer: [0; MAX_FRAME],
            length: 0,
            overrun: false,
            bad: 0,
        }
    }

    /// Frames discarded so far.
    #[must_use]
    pub const fn bad_frames(&self) -> u32 {
        self.bad
    }

    /// Takes one byte; a message comes with the zero that ends its frame. Empty frames are silence:
    /// a sender may put a zero first to end whatever was on the line before.
    ///
    /// # Errors
    /// What is wrong with the frame that this byte ended; the next frame starts clean.
    pub fn push<T: DeserializeOwned>(&mut self, byte: u8) -> Result<Option<T>, FrameError> {
        if byte != 0 {
            match self.buffer.get_mut(self.length) {
                Some(slot) => {
                    *slot = byte;
                    self.length += 1;
                }
                None => self.overrun = true,
            }
            return Ok(None);
        }
        let length = core::mem::take(&mut self.length);
        let overrun = core::mem::take(&mut self.overrun);
        if length == 0 {
            return Ok(None);
        }
        let result = if overrun {
            Err(FrameError::TooLong)
        } else {
            parse(&mut self.buffer[..length])
        };
        if result.is_err() {
            self.bad = self.bad.saturating_add(1);
        }
        result.map(Some)
    }
}

/// Undoes COBS in place, checks the CRC, reads the message.
fn parse<T: DeserializeOwned>(frame: &mut [u8]) -> Result<T, FrameError> {
    let length = cobs::decode_in_place(frame).map_err(|_| FrameError::Cobs)?;
    let (payload, crc) = frame[..length]
        .split_last_chunk::<4>()
        .ok_or(FrameError::Crc)?;
    if crc32(payload) != u32::from_le_bytes(*crc) {
        return Err(FrameError::Crc);
    }
    match postcard::take_from_bytes(payload) {
        Ok((message, [])) => Ok(message),
        _ => Err(FrameError::Message),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::*;
    use proptest::prelude::*;

    fn status() -> Status {
        Status {
            t_us: u32::MAX,
            state: u8::MAX,
            fault: u16::MAX,
            fault_detail: u32::MAX,
            estop_closed: true,
            units: [UnitStatus {
                state: u8::MAX,
                fault: u16::MAX,
                fault_detail: u32::MAX,
                samples: u32::MAX,
                missed: u32::MAX,
                spikes: u32::MAX,
                failed_reads: u16::MAX,
                period_us: u16::MAX,
                tension_un: i32::MIN,
                adc_code: i32::MIN,
                encoder_counts: i32::MIN,
            }; crate::UNITS],
            tip_force_un: [i32::MIN; 3],
            alive_withheld: true,
            config_crc: u32::MAX,
            setpoint_age_ms: u16::MAX,
            frames_dropped: u32::MAX,
            frames_bad: u32::MAX,
            bus_recoveries: u16::MAX,
            sleep_permille: u16::MAX,
            queue_high_water: u8::MAX,
        }
    }

    fn decode<T: DeserializeOwned>(
        decoder: &mut Decoder,
        bytes: &[u8],
    ) -> std::vec::Vec<Result<T, FrameError>> {
        bytes
            .iter()
            .filter_map(|byte| decoder.push(*byte).transpose())
            .collect()
    }

    extern crate std;

    /// The worst case of every message has to fit: checked on those that could come near.
    #[test]
    fn the_longest_messages_fit() {
        let sample = Sample {
            unit: 255,
            dt_us: u16::MAX,
            adc_code: i32::MIN,
            encoder_counts: i32::MIN,
            dac_code: u16::MAX,
            latency_us: u16::MAX,
            tension: i32::MIN,
            setpoint: i32::MIN,
            p: i32::MIN,
            i: i32::MIN,
            d: i32::MIN,
            ff: i32::MIN,
            tip_force_mn: u16::MAX,
            flags: 255,
        };
        let messages = [
            BoardMessage::Reply(Reply {
                seq: u16::MAX,
                response: Response::Status(status()),
            }),
            BoardMessage::Samples(Batch {
                t_us: u32::MAX,
                samples: [sample; BATCH].into_iter().collect(),
            }),
        ];
        for message in messages {
            let frame = BoardFrame {
                seq: u16::MAX,
                message,
            };
            let mut out = [0; MAX_FRAME];
            let length = encode(&frame, &mut out).expect("fits");
            let back = decode::<BoardFrame>(&mut Decoder::new(), &out[..length]);
            assert_eq!(back, [Ok(frame)]);
        }
    }

    #[test]
    fn a_buffer_that_is_too_short_is_refused() {
        let frame = HostFrame {
            seq: 1,
            command: Command::Arm,
        };
        for length in 0..7 {
            assert_eq!(
                encode(&frame, &mut [0; 16][..length]),
                Err(FrameError::TooLong),
                "{length}"
            );
        }
    }

    #[test]
    fn a_damaged_frame_is_counted_and_the_next_one_read() {
        let frame = HostFrame {
            seq: 7,
            command: Command::Zero { units: 0b11_1111 },
        };
        let mut good = [0; MAX_FRAME];
        let length = encode(&frame, &mut good).unwrap();
        for position in 0..length - 1 {
            for bit in 0..8 {
                let mut line = std::vec::Vec::from(&good[..length]);
                line[position] ^= 1 << bit;
                line.extend_from_slice(&good[..length]);
                let mut decoder = Decoder::new();
                let out = decode::<HostFrame>(&mut decoder, &line);
                assert_eq!(out.last(), Some(&Ok(frame.clone())));
                assert!(
                    out[..out.len() - 1].iter().all(Result::is_err),
                    "a flipped bit went through"
                );
                assert!(decoder.bad_frames() >= 1);
            }
        }
    }

    #[test]
    fn a_frame_too_long_is_dropped_whole() {
        let mut decoder = Decoder::new();
        let out = decode::<HostFrame>(&mut decoder, &[&[1u8; 1000][..], &[0]].concat());
        assert_eq!(out, [Err(FrameError::TooLong)]);
        assert_eq!(decoder.bad_frames(), 1);
    }

    proptest! {
        #[test]
        fn any_bytes_do_no_harm(bytes in proptest::collection::vec(any::<u8>(), 0..4096)) {
            let mut decoder = Decoder::new();
            let out = decode::<HostFrame>(&mut decoder, &bytes);
            let bad = out.iter().filter(|r| r.is_err()).count();
            prop_assert_eq!(bad as u32, decoder.bad_frames());
        }

        #[test]
        fn setpoints_survive_any_chunking(
            seq: u16, valid_ms: u16, tension: [i32; crate::UNITS], cos: [i32; crate::UNITS],
            direction: [[i16; 3]; crate::UNITS],
            reel: [Option<i32>; crate::UNITS], noise in proptest::collection::vec(1u8.., 0..40)
        ) {
            let units = core::array::from_fn(|n| UnitSetpoint { tension_un: tension[n], inv_cos_q16: cos[n], direction_q14: direction[n], reel_um_per_s: reel[n] });
            let frame = HostFrame { seq, command: Command::Setpoints { valid_ms, units } };
            let mut out = [0; MAX_FRAME];
            let length = encode(&frame, &mut out).unwrap();
            prop_assert_eq!(out[..length].iter().filter(|b| **b == 0).count(), 1);
            // Line noise before, ended by a zero: the frame still arrives.
            let line = [&noise[..], &[0], &out[..length]].concat();
            let back = decode::<HostFrame>(&mut Decoder::new(), &line);
            prop_assert_eq!(back.last(), Some(&Ok(frame)));
        }
    }
}
