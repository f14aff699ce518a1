//! The I2C half of the firmware: the bus scheduler of the image, and its transactions on the
//! emulated board's bus.

use crate::timing::{transfer_ns, HANDLER_NS};
use board::bus::{Bus, Event, Sink, Transfer, TransferError, Work};
use board::clocks;
use control::{Micros, UnitIndex, UnitSet};
use emulator::board::Board;
use emulator::wiring;

/// Events for the superloop, in the order in which they occurred.
#[derive(Debug, Clone, Default)]
pub(crate) struct Events(pub Vec<Event>);

impl Sink for Events {
    fn event(&mut self, event: Event) {
        self.0.push(event);
    }
}

/// What the bus is doing.
#[derive(Debug, Clone, Copy)]
enum Busy {
    /// A transaction that ends at this time.
    Transfer(u64, Transfer),
    /// A step of a recovery that is over at this time.
    Step(u64),
}

/// See the module's page.
#[derive(Debug, Clone)]
pub(crate) struct Sensors {
    bus: Bus,
    busy: Option<Busy>,
    /// Units whose DRDY is high.
    drdy: UnitSet,
    /// Levels that a recovery has put on the lines.
    scl: bool,
    start: UnitSet,
    stop: UnitSet,
    pub events: Events,
}

/// Board time.
pub(crate) const fn micros(t_ns: u64) -> Micros {
    Micros((t_ns / 1_000) as u32)
}

impl Sensors {
    pub fn new() -> Self {
        Self {
            bus: Bus::new(),
            busy: None,
            drdy: UnitSet::default(),
            scl: true,
            start: UnitSet::default(),
            stop: UnitSet::default(),
            events: Events::default(),
        }
    }

    /// The controller's half after a reset: the lines keep their levels.
    pub fn reset(&self) -> Self {
        Self {
            drdy: self.drdy,
            ..Self::new()
        }
    }

    /// As the firmware's `start_sensor`: takes effect with the next tick.
    pub fn request_start(&mut self, unit: UnitIndex) {
        self.stop.remove(unit);
        self.start.insert(unit);
    }

    /// As the firmware's `stop_sensor`.
    pub fn request_stop(&mut self, unit: UnitIndex) {
        self.start.remove(unit);
        self.stop.insert(unit);
    }

    /// When the transaction or step in progress ends.
    pub fn due(&self) -> Option<u64> {
        match self.busy? {
            Busy::Transfer(at, _) | Busy::Step(at) => Some(at),
        }
    }

    /// Takes what the board has changed on the DRDY lines; rising edges go to the scheduler.
    pub fn edges(&mut self, board: &mut Board, t_ns: u64) {
        if !board.has_drives() {
            return;
        }
        let mut rose = UnitSet::default();
        for (pin, level) in board.take_drives() {
            let Some((unit, _)) = UnitIndex::zip(wiring::DRDY).find(|(_, drdy)| *drdy == pin)
            else {
                continue;
            };
            if level == Some(true) {
                if self.drdy.insert(unit) {
                    rose.insert(unit);
                }
            } else {
                self.drdy.remove(unit);
            }
        }
        for unit in rose.iter() {
            self.bus
                .drdy(unit, micros(t_ns + HANDLER_NS), &mut self.events);
        }
        if rose != UnitSet::default() {
            self.work(board, t_ns);
        }
    }

    /// The millisecond: units to start and stop, deadlines, lost edges.
    pub fn tick(&mut self, board: &mut Board, t_ns: u64) {
        let now = micros(t_ns);
        for unit in std::mem::take(&mut self.stop).iter() {
            self.bus.stop(unit);
        }
        for unit in std::mem::take(&mut self.start).iter() {
            self.bus.start(unit, now);
        }
        self.bus.tick(now, self.drdy, &mut self.events);
        // A transaction past its deadline was given up there.
        if !self.bus.is_busy() && matches!(self.busy, Some(Busy::Transfer(..))) {
            self.busy = None;
            board.i2c_stop();
        }
        self.work(board, t_ns);
    }

    /// Ends what is due at `t_ns`.
    pub fn advance(&mut self, board: &mut Board, t_ns: u64) {
        match self.busy {
            Some(Busy::Transfer(at, transfer)) if at <= t_ns => {
                self.busy = None;
                let result = transact(board, t_ns, &transfer);
                self.bus.finished(result, micros(t_ns), &mut self.events);
                self.edges(board, t_ns);
                self.work(board, t_ns);
            }
            Some(Busy::Step(at)) if at <= t_ns => {
                self.busy = None;
                self.bus.stepped(!board.sda_held());
                self.work(board, t_ns);
            }
            _ => {}
        }
    }

    /// Executes the scheduler's next action.
    fn work(&mut self, board: &mut Board, t_ns: u64) {
        if self.busy.is_some() {
            return;
        }
        let step_ns = u64::from(clocks::RECOVERY_STEP_US) * 1_000;
        while let Some(work) = self.bus.next(micros(t_ns), &mut self.events) {
            match work {
                Work::Transfer(transfer) => {
                    let begin = t_ns + HANDLER_NS;
                    // A START can't leave the controller while SDA is low: the deadline ends it.
                    let duration = if board.sda_held() {
                        2 * u64::from(clocks::I2C_DEADLINE_US) * 1_000
                    } else {
                        transfer_ns(transfer.write_len, transfer.read_len)
                    };
                    board.i2c_begins(begin, transfer.address);
                    self.busy = Some(Busy::Transfer(begin + duration, transfer));
                    return;
                }
                Work::TakeLines | Work::GiveLines => self.scl = true,
                Work::Lines { scl, sda: _ } => {
                    if scl && !self.scl {
                        board.scl_pulse();
                    }
                    self.scl = scl;
                    self.busy = Some(Busy::Step(t_ns + step_ns));
                    return;
                }
                Work::MuxReset { low } => {
                    board.mux_reset(low);
                    self.busy = Some(Busy::Step(t_ns + step_ns));
                    return;
                }
            }
        }
    }
}

/// The bytes of a transaction, all at its end.
fn transact(board: &mut Board, t_ns: u64, transfer: &Transfer) -> Result<[u8; 3], TransferError> {
    let mut read = [0; 3];
    if board.sda_held() {
        return Err(TransferError::Bus);
    }
    if transfer.write_len > 0 {
        if !board.i2c_start(t_ns, transfer.address, false) {
            return Err(TransferError::Nack);
        }
        for byte in &transfer.write[..usize::from(transfer.write_len)] {
            if !board.i2c_write(t_ns, *byte) {
                board.i2c_stop();
                return Err(TransferError::Nack);
            }
        }
    }
    if transfer.read_len > 0 {
        if !board.i2c_start(t_ns, transfer.address, true) {
            return Err(TransferError::Nack);
        }
        for byte in &mut read[..usize::from(transfer.read_len)] {
            *byte = board.i2c_read(t_ns);
        }
    }
    board.i2c_stop();
    Ok(read)
}
