//! The far ends of the controller's buses, as the engine's traits want them: thin, the board does
//! the work.

use crate::board::Board;
use rigless::chip::{i2c, spi, uart, Timeline};
use rigless::snapshot::Store;
use rigless::time::VirtualNanos;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The board, shared between the engine's thread and the rig's. They take turns, so a lock never
/// waits.
#[derive(Debug, Clone)]
pub struct Shared(Arc<Mutex<Board>>);

impl Shared {
    /// Shares `board`.
    #[must_use]
    pub fn new(board: Board) -> Self {
        Self(Arc::new(Mutex::new(board)))
    }

    /// The board, for one look.
    pub fn lock(&self) -> MutexGuard<'_, Board> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The multiplexer and what hangs behind it.
#[derive(Debug)]
pub struct SensorBus(pub Shared);

impl Store for SensorBus {}

impl i2c::Peer for SensorBus {
    fn start(&mut self, address: u8, read: bool, context: &mut Timeline<'_, '_>) -> bool {
        self.0.lock().i2c_start(context.now().0, address, read)
    }

    fn write(&mut self, byte: u8, context: &mut Timeline<'_, '_>) -> bool {
        self.0.lock().i2c_write(context.now().0, byte)
    }

    fn read(&mut self, _last: bool, context: &mut Timeline<'_, '_>) -> u8 {
        self.0.lock().i2c_read(context.now().0)
    }

    fn stop(&mut self, _context: &mut Timeline<'_, '_>) {
        self.0.lock().i2c_stop();
    }
}

/// The six DACs on one clock and data line.
#[derive(Debug)]
pub struct DacBus(pub Shared);

impl Store for DacBus {}

impl spi::Peer for DacBus {
    fn transfer(&mut self, mosi: u32, bits: u8, _context: &mut Timeline<'_, '_>) -> u32 {
        self.0.lock().spi_frame(mosi, bits);
        // MISO is not wired; the input floats high.
        u32::MAX >> (32 - u32::from(bits.clamp(1, 32)))
    }
}

/// The virtual COM port's far end.
#[derive(Debug)]
pub struct HostLine(pub Shared);

impl Store for HostLine {}

impl uart::Peer for HostLine {
    fn receive(&mut self, word: u16, context: &mut Timeline<'_, '_>) {
        self.0
            .lock()
            .sent_by_board(context.now().0, (word & 0xFF) as u8);
    }

    fn transmit(&mut self, _now: VirtualNanos) -> Option<u16> {
        self.0.lock().next_to_board().map(u16::from)
    }
}
