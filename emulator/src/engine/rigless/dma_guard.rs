//! What the engine's models leave out: a stream that serves a USART needs TRBUFF, and can lock up
//! without it; an SPI controller that stops.
//!
//! RM0433 rev 9 section 15.5.5 and ES0392 rev 15 2.20.4: without bufferable transfers a concurrent
//! transfer can leave the stream locked. The sheet gives no condition, so this guard takes the
//! strict view: a stream without TRBUFF whose channel of the multiplexer carries a USART's request
//! is not enabled. A stall that is injected
//! ([`Injection::StallUsart`](emulator_link::Injection::StallUsart)) locks the stream until it is
//! disabled. While SPI1 is stopped ([`Injection::StopSpi`](emulator_link::Injection::StopSpi)),
//! CSTART begins nothing.

use super::peers::Shared;
use rigless::device::{Level, RequestChange};
use rigless::soc::stm32h743::generated::dma1::Register as Dma;
use rigless::soc::stm32h743::generated::spi1::Register as Spi;
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::Arc;

const STREAMS: usize = 8;
/// Rows of a stream's registers in the DMA's layout.
const ROWS: usize = Dma::S1cr as usize - Dma::S0cr as usize;
const ENABLE: u64 = 1;
const TRBUFF: u64 = 1 << 20;
/// CSTART of SPI1_CR1 (RM0433 rev 9 section 50.11.1).
const CSTART: u64 = 1 << 9;
/// DMAMUX1's input for USART3's transmitter (RM0433 rev 9 table 124).
const USART3_TX: u8 = 46;

/// Requests that the multiplexer's channels carry, as the guards of multiplexer and controller
/// share them.
pub type Routes = Arc<[AtomicU8; STREAMS]>;

/// Whether this input of DMAMUX1 is a U(S)ART's (RM0433 rev 9 table 124).
const fn is_usart(request: u8) -> bool {
    matches!(request, 41..=46 | 63..=66 | 71..=72 | 79..=82)
}

/// The guard of one instance.
#[allow(clippy::large_enum_variant)] // one of each exists
pub enum Guard {
    /// DMAMUX1: notes what its channels carry.
    Multiplexer(Routes),
    /// DMA1: refuses and locks streams.
    Controller {
        /// What the channels carry.
        routes: Routes,
        /// The board, which knows of an injected stall.
        board: Shared,
        /// Streams that are locked, with the request that waits.
        locked: [Option<Option<RequestChange>>; STREAMS],
    },
    /// SPI1: begins nothing while it is stopped. The board knows whether it is.
    Spi(Shared),
}

/// What becomes of a register write.
pub struct Guarded {
    /// Value to write.
    pub value: u64,
    /// Why it was changed.
    pub refused: Option<&'static str>,
    /// A request that waited for its stream to be unlocked.
    pub released: Option<RequestChange>,
}

impl Guard {
    /// The guard of DMA1.
    pub fn controller(routes: Routes, board: Shared) -> Self {
        Self::Controller {
            routes,
            board,
            locked: [None; STREAMS],
        }
    }

    /// A write of `value` to the register in this row of the instance's layout.
    pub fn write(&mut self, row: usize, value: u64) -> Guarded {
        let mut guarded = Guarded {
            value,
            refused: None,
            released: None,
        };
        match self {
            Self::Multiplexer(routes) => {
                if let Some(route) = routes.get(row) {
                    route.store((value & 0x7F) as u8, Ordering::Relaxed);
                }
            }
            Self::Spi(board) => {
                if row == Spi::Cr1 as usize && board.lock().is_spi_stopped() {
                    guarded.value &= !CSTART;
                }
            }
            Self::Controller { routes, locked, .. } => {
                let Some(stream) = control_register(row) else {
                    return guarded;
                };
                let request = routes[stream].load(Ordering::Relaxed);
                if value & ENABLE == 0 {
                    guarded.released = locked[stream].take().flatten();
                } else if value & TRBUFF == 0 && is_usart(request) {
                    guarded.value &= !ENABLE;
                    guarded.refused = Some(
                        "a stream that serves a USART needs TRBUFF (ES0392 2.20.4): not enabled",
                    );
                }
            }
        }
        guarded
    }

    /// A request that reaches the instance. `false`: its stream is locked.
    pub fn passes(&mut self, first: usize, change: &RequestChange) -> bool {
        let Self::Controller {
            routes,
            board,
            locked,
        } = self
        else {
            return true;
        };
        let Some(stream) = change.request.checked_sub(first) else {
            return true;
        };
        let Some(slot) = locked.get_mut(stream) else {
            return true;
        };
        let serves_usart3 = routes[stream].load(Ordering::Relaxed) == USART3_TX;
        if serves_usart3 && change.level == Level::High && board.lock().take_stall() {
            *slot = Some(None);
        }
        match slot {
            Some(waiting) => {
                *waiting = (change.level == Level::High).then_some(*change);
                false
            }
            None => true,
        }
    }
}

/// The stream whose control register stands in this row.
fn control_register(row: usize) -> Option<usize> {
    let from_first = row.checked_sub(Dma::S0cr as usize)?;
    (from_first % ROWS == 0).then_some(from_first / ROWS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stopped_spi_begins_nothing() {
        let plant = plant::Plant::new(plant::PlantConfig::default(), 1).unwrap();
        let board = Shared::new(crate::board::Board::new(plant, 1).unwrap());
        let mut spi = Guard::Spi(board.clone());
        let row = Spi::Cr1 as usize;
        assert_eq!(spi.write(row, CSTART | 1).value, CSTART | 1);
        (board.lock().inject(emulator_link::Injection::StopSpi(true))).unwrap();
        assert_eq!(spi.write(row, CSTART | 1).value, 1);
        assert_eq!(spi.write(Spi::Txdr as usize, CSTART).value, CSTART);
    }

    #[test]
    fn a_usart_stream_without_trbuff_is_refused() {
        let routes = Routes::default();
        let mut multiplexer = Guard::Multiplexer(routes.clone());
        multiplexer.write(1, 45);
        let board = crate::board::Board::new(
            plant::Plant::new(plant::PlantConfig::default(), 1).unwrap(),
            1,
        );
        let mut dma = Guard::controller(routes, Shared::new(board.unwrap()));
        let row = Dma::S1cr as usize;
        let refused = dma.write(row, 0x401);
        assert!(refused.refused.is_some() && refused.value == 0x400);
        let accepted = dma.write(row, 0x401 | TRBUFF);
        assert!(accepted.refused.is_none() && accepted.value & ENABLE == 1);
        // Stream 0 carries no request of a USART.
        assert!(dma.write(Dma::S0cr as usize, 0x401).refused.is_none());
    }
}
