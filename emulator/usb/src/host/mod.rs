//! The host at the other end of the cable: host controller, USB stack and the CDC-ACM class driver.
//!
//! It does what hosts do in the order of USB 2.0 section 9.1.2: debounce, reset, the first eight
//! bytes of the device descriptor, a second reset, SET_ADDRESS, all descriptors, SET_CONFIGURATION.
//! The class driver then opens the port: SET_LINE_CODING and SET_CONTROL_LINE_STATE (PSTN 1.2
//! section 6.3). Bytes go by the bulk pipes while the port is open.
//!
//! One transaction at a time is on the bus. It takes the bits of its packets and the overhead of
//! USB 2.0 table 5-9 at 12 Mbit/s. A token that the device would answer with NAK is not repeated
//! again and again: the host waits until the answer is another one, which is what a host that
//! repeats it without pause sees, some microseconds later.
//!
//! Tests use [`Host::request`] for any control transfer, [`Host::write_packet`] for packets of any
//! length, and the switches for cable, suspend, reading and opening.

mod bus;
mod control;
mod enumeration;
#[cfg(test)]
mod tests;

use crate::core::Core;
use control::Transfer;
pub use control::{Outcome, Request};
pub use enumeration::Device;
use enumeration::Enumeration;
use std::collections::VecDeque;

/// Nanoseconds in a millisecond.
const MS: u64 = 1_000_000;
/// Debounce after an attachment (USB 2.0 section 7.1.7.3, TATTDB).
const DEBOUNCE_NS: u64 = 100 * MS;
/// Reset of a root port; at least 10 ms (section 7.1.7.5, TDRST).
const RESET_NS: u64 = 15 * MS;
/// Recovery after a reset or a resume (TRSTRCY, TRSMRCY).
const RECOVERY_NS: u64 = 10 * MS;
/// Recovery after SET_ADDRESS (section 9.2.6.3).
const ADDRESS_NS: u64 = 2 * MS;
/// Resume signalling (section 7.1.7.7, TDRSMDN).
const RESUME_NS: u64 = 20 * MS;
/// Idle bus until a device must suspend (section 7.1.7.6).
const IDLE_NS: u64 = 3 * MS;
/// A control transfer is given up then (section 9.2.6.1 demands 5 s of devices).
const PATIENCE_NS: u64 = 5_000 * MS;
/// Attempts of an enumeration before the host ignores the device.
const ATTEMPTS: u8 = 3;
/// Transactions without an answer until the host gives up (section 8.7.1).
const SILENT_TRIES: u8 = 3;

/// What the host is about to do with the port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// Nothing is attached.
    Off,
    Debounce(u64),
    Reset(u64),
    Recovery(u64),
    Running,
    Suspended,
    Resuming(u64),
    /// The device did not enumerate.
    GaveUp,
}

/// How far the host came with the device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// No device at the port, or no cable.
    Detached,
    /// Between attachment and configuration.
    Enumerating,
    /// Configured, the serial port is closed.
    Configured,
    /// The serial port is open.
    Open,
    /// The bus is suspended.
    Suspended,
    /// The device did not enumerate; see [`Host::log`].
    Failed,
}

/// A bulk or interrupt pipe.
#[derive(Debug, Clone, Copy, Default)]
struct Pipe {
    number: usize,
    max_packet: usize,
    data1: bool,
    halted: bool,
    silent: u8,
}

/// A transaction on the bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Transaction {
    Control,
    BulkOut,
    BulkIn,
    Notification,
}

/// Counts of the bulk pipes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Packets from the device.
    pub packets_in: u64,
    /// Bytes from the device.
    pub bytes_in: u64,
    /// Packets of length zero from the device.
    pub empty_in: u64,
    /// Packets from the device with the PID of the one before: taken for repeated, and dropped.
    pub repeated_in: u64,
    /// Packets to the device.
    pub packets_out: u64,
    /// Bytes to the device.
    pub bytes_out: u64,
}

/// See the module's page.
#[derive(Debug)]
pub struct Host {
    now: u64,
    cable: bool,
    attached: bool,
    phase: Phase,
    idle_since: u64,
    frame: u64,
    busy_until: u64,
    flight: Option<(Transaction, u64)>,
    /// Direction of the last bulk transaction: both take turns.
    last_in: bool,
    address: u8,
    attempts: u8,
    enumeration: Option<Enumeration>,
    transfer: Option<Transfer>,
    waiting: VecDeque<Transfer>,
    outcomes: Vec<(u32, Outcome)>,
    next_id: u32,
    device: Option<Device>,
    bulk_in: Pipe,
    bulk_out: Pipe,
    notify: Pipe,
    notify_at: u64,
    wants_open: bool,
    open: bool,
    /// The request that opens or closes the port, while it is under way.
    opening: Option<u32>,
    reading: bool,
    to_device: VecDeque<Vec<u8>>,
    from_device: Vec<u8>,
    counts: Counts,
    log: Vec<(u64, String)>,
}

impl Default for Host {
    fn default() -> Self {
        Self::new()
    }
}

impl Host {
    /// A host without a cable. It opens the port of every serial device.
    #[must_use]
    pub fn new() -> Self {
        Self {
            now: 0,
            cable: false,
            attached: false,
            phase: Phase::Off,
            idle_since: 0,
            frame: 0,
            busy_until: 0,
            flight: None,
            last_in: false,
            address: 0,
            attempts: 0,
            enumeration: None,
            transfer: None,
            waiting: VecDeque::new(),
            outcomes: Vec::new(),
            next_id: 1,
            device: None,
            bulk_in: Pipe::default(),
            bulk_out: Pipe::default(),
            notify: Pipe::default(),
            notify_at: 0,
            wants_open: true,
            open: false,
            opening: None,
            reading: true,
            to_device: VecDeque::new(),
            from_device: Vec::new(),
            counts: Counts::default(),
            log: Vec::new(),
        }
    }

    /// Plugs the cable in or pulls it.
    pub fn set_cable(&mut self, core: &mut Core, plugged: bool) {
        self.cable = plugged;
        core.set_vbus(plugged);
    }

    /// Suspends the bus, or resumes it.
    pub fn set_suspended(&mut self, core: &mut Core, suspended: bool) {
        match (suspended, self.phase) {
            (true, Phase::Running) => {
                self.phase = Phase::Suspended;
                self.idle_since = self.now;
                self.flight = None;
            }
            (false, Phase::Suspended) => {
                self.phase = Phase::Resuming(self.now + RESUME_NS);
                core.resume();
            }
            _ => {}
        }
    }

    /// Opens the serial port, or closes it. An open port is opened again after every enumeration.
    pub fn set_open(&mut self, open: bool) {
        self.wants_open = open;
    }

    /// Whether the host asks for data while the port is open.
    pub fn set_reading(&mut self, reading: bool) {
        self.reading = reading;
    }

    /// Sends bytes, in packets as large as the pipe allows.
    pub fn write(&mut self, bytes: &[u8]) {
        for packet in bytes.chunks(self.bulk_out.max_packet.clamp(8, 64)) {
            self.to_device.push_back(packet.to_vec());
        }
    }

    /// Sends one packet as it is, of any length up to the pipe's.
    pub fn write_packet(&mut self, bytes: &[u8]) {
        self.to_device.push_back(bytes.to_vec());
    }

    /// Packets that the device has not taken yet.
    #[must_use]
    pub fn waiting_to_device(&self) -> usize {
        self.to_device.len()
    }

    /// The bytes that the device has sent since the last call.
    pub fn take_read(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.from_device)
    }

    /// Queues a control transfer to the device. Its number, for [`Self::take_outcome`].
    pub fn request(&mut self, request: Request) -> u32 {
        let id = self.next_id;
        self.next_id += 1;
        self.waiting.push_back(Transfer::new(id, request));
        id
    }

    /// What became of a control transfer, once it is over.
    pub fn take_outcome(&mut self, id: u32) -> Option<Outcome> {
        let found = self.outcomes.iter().position(|(of, _)| *of == id)?;
        Some(self.outcomes.swap_remove(found).1)
    }

    /// How far the host came with the device.
    #[must_use]
    pub fn state(&self) -> State {
        match self.phase {
            Phase::Off => State::Detached,
            Phase::GaveUp => State::Failed,
            Phase::Suspended | Phase::Resuming(_) => State::Suspended,
            _ if self.device.is_none() => State::Enumerating,
            _ if self.open => State::Open,
            _ => State::Configured,
        }
    }

    /// The device, once it is configured.
    #[must_use]
    pub fn device(&self) -> Option<&Device> {
        self.device.as_ref()
    }

    /// Counts of the bulk pipes since power-on.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// What happened, with its time in nanoseconds.
    #[must_use]
    pub fn log(&self) -> &[(u64, String)] {
        &self.log
    }

    fn note(&mut self, what: String) {
        self.log.push((self.now, what));
    }

    fn sees_device(&self, core: &Core) -> bool {
        self.cable && core.pull_up()
    }

    /// When the host does something next, in nanoseconds; never in the past.
    #[must_use]
    pub fn next_event(&self, core: &Core) -> Option<u64> {
        if self.attached != self.sees_device(core) {
            return Some(self.now);
        }
        let idle = || {
            let waits = core.pull_up() && !core.is_suspended();
            waits.then(|| (self.idle_since + IDLE_NS).max(self.now))
        };
        match self.phase {
            Phase::Off | Phase::Suspended => idle(),
            Phase::GaveUp => None,
            Phase::Debounce(at) | Phase::Reset(at) | Phase::Recovery(at) | Phase::Resuming(at) => {
                Some(at.max(self.now))
            }
            Phase::Running => self.next_transaction(core),
        }
    }

    /// Everything that is due by `now`, in order.
    pub fn advance(&mut self, core: &mut Core, now: u64) {
        while let Some(at) = self.next_event(core).filter(|at| *at <= now) {
            self.now = self.now.max(at);
            self.step(core);
        }
        self.now = self.now.max(now);
        let frame = self.now / MS;
        let runs = matches!(
            self.phase,
            Phase::Running | Phase::Recovery(_) | Phase::GaveUp
        );
        if runs && frame != self.frame {
            self.frame = frame;
            core.frame(frame as u16);
        }
    }

    fn step(&mut self, core: &mut Core) {
        let sees = self.sees_device(core);
        if self.attached != sees {
            self.attached = sees;
            return if sees { self.attach() } else { self.detach() };
        }
        match self.phase {
            Phase::Off | Phase::Suspended => core.idle(),
            Phase::GaveUp => {}
            Phase::Debounce(_) => self.begin_reset(core),
            Phase::Reset(_) => {
                core.reset_ends();
                self.phase = Phase::Recovery(self.now + RECOVERY_NS);
            }
            Phase::Resuming(_) => self.phase = Phase::Recovery(self.now + RECOVERY_NS),
            Phase::Recovery(_) => {
                self.phase = Phase::Running;
                self.start_next(core);
            }
            Phase::Running => self.step_running(core),
        }
    }

    fn attach(&mut self) {
        self.note("attached".to_owned());
        self.attempts = 0;
        self.phase = Phase::Debounce(self.now + DEBOUNCE_NS);
    }

    fn detach(&mut self) {
        self.note("detached".to_owned());
        self.phase = Phase::Off;
        self.idle_since = self.now;
        self.forget_device();
        let gone = self
            .transfer
            .take()
            .into_iter()
            .chain(self.waiting.drain(..));
        self.outcomes
            .extend(gone.map(|transfer| (transfer.id, Outcome::Detached)));
        self.to_device.clear();
        self.enumeration = None;
    }

    fn forget_device(&mut self) {
        self.device = None;
        self.open = false;
        self.opening = None;
        self.flight = None;
        self.address = 0;
    }

    fn begin_reset(&mut self, core: &mut Core) {
        let first = self.enumeration.is_none();
        self.forget_device();
        core.reset_begins();
        if first {
            self.enumeration = Some(Enumeration::default());
        }
        self.phase = Phase::Reset(self.now + RESET_NS);
    }

    /// Resets the bus as a host does that lost trust in the device, and enumerates it again.
    pub fn reset_bus(&mut self, core: &mut Core) {
        if self.attached {
            self.note("reset by the host".to_owned());
            self.transfer = None;
            self.enumeration = None;
            self.begin_reset(core);
        }
    }
}
