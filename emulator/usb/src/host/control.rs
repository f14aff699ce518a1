//! Control transfers: SETUP, data and status stage (USB 2.0 section 8.5.3).

use super::{Host, PATIENCE_NS, SILENT_TRIES};
use crate::core::{Core, Handshake, InResponse};

/// A control transfer as the host is asked for it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Request {
    /// bmRequestType.
    pub kind: u8,
    /// bRequest.
    pub request: u8,
    /// wValue.
    pub value: u16,
    /// wIndex.
    pub index: u16,
    /// wLength.
    pub length: u16,
    /// Data stage of a transfer to the device; may be shorter than `length`.
    pub data: Vec<u8>,
    /// Ends after this many bytes of the data stage, without a status stage.
    pub abandon_after: Option<usize>,
}

impl Request {
    /// A transfer that reads `length` bytes.
    #[must_use]
    pub const fn read(kind: u8, request: u8, value: u16, index: u16, length: u16) -> Self {
        Self {
            kind: kind | 0x80,
            request,
            value,
            index,
            length,
            data: Vec::new(),
            abandon_after: None,
        }
    }

    /// A transfer that writes `data`.
    #[must_use]
    pub fn write(kind: u8, request: u8, value: u16, index: u16, data: &[u8]) -> Self {
        Self {
            kind,
            request,
            value,
            index,
            length: data.len() as u16,
            data: data.to_vec(),
            abandon_after: None,
        }
    }

    fn is_read(&self) -> bool {
        self.kind & 0x80 != 0
    }

    fn setup(&self) -> [u8; 8] {
        let [value, index, length] = [self.value, self.index, self.length].map(u16::to_le_bytes);
        [
            self.kind,
            self.request,
            value[0],
            value[1],
            index[0],
            index[1],
            length[0],
            length[1],
        ]
    }
}

/// What became of a control transfer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Outcome {
    /// It is complete; the bytes that the device sent.
    Done(Vec<u8>),
    /// The device refused it.
    Stalled,
    /// The device answered NAK for five seconds.
    TimedOut,
    /// The device did not answer, or broke the protocol.
    Broken(String),
    /// The device went away.
    Detached,
    /// The host ended it, as asked.
    Abandoned,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    Setup,
    DataIn,
    DataOut,
    StatusIn,
    StatusOut,
}

/// A control transfer under way.
#[derive(Debug)]
pub(super) struct Transfer {
    pub id: u32,
    pub request: Request,
    stage: Stage,
    received: Vec<u8>,
    sent: usize,
    data1: bool,
    /// A token of this stage was sent already: the next one waits for an answer other than NAK.
    asked: bool,
    silent: u8,
    deadline: u64,
    /// Largest packet of endpoint 0.
    max_packet: usize,
}

impl Transfer {
    pub fn new(id: u32, request: Request) -> Self {
        Self {
            id,
            request,
            stage: Stage::Setup,
            received: Vec::new(),
            sent: 0,
            data1: true,
            asked: false,
            silent: 0,
            deadline: 0,
            max_packet: 8,
        }
    }

    pub fn begin(&mut self, now: u64, max_packet: usize) {
        self.max_packet = max_packet;
        self.deadline = now + PATIENCE_NS;
    }

    pub fn deadline(&self) -> u64 {
        self.deadline
    }

    /// Payload of the next packet to the device.
    fn chunk(&self) -> &[u8] {
        let end = (self.sent + self.max_packet).min(self.request.data.len());
        &self.request.data[self.sent..end]
    }

    /// Bytes of the transaction that comes next, for its duration.
    pub fn bytes(&self) -> usize {
        match self.stage {
            Stage::Setup => 8,
            Stage::DataOut => self.chunk().len(),
            Stage::DataIn => usize::from(self.request.length).min(self.max_packet),
            Stage::StatusIn | Stage::StatusOut => 0,
        }
    }

    /// Whether a transaction has a point now: the device would not answer NAK, or it was not asked
    /// yet.
    pub fn is_ready(&self, core: &Core, address: u8) -> bool {
        !self.asked
            || match self.stage {
                Stage::Setup => true,
                Stage::DataIn | Stage::StatusIn => core.responds_in(address, 0),
                Stage::DataOut => core.responds_out(address, 0, self.chunk().len()),
                Stage::StatusOut => core.responds_out(address, 0, 0),
            }
    }

    fn enter(&mut self, stage: Stage) {
        self.stage = stage;
        self.asked = false;
        self.silent = 0;
    }

    /// The device's silence; the end of the transfer after three.
    fn silence(&mut self) -> Option<Outcome> {
        self.silent += 1;
        let stage = self.stage;
        (self.silent >= SILENT_TRIES)
            .then(|| Outcome::Broken(format!("no answer in the stage {stage:?}")))
    }

    /// Executes the next transaction; the end of the transfer, if it was the last one.
    pub fn transact(&mut self, core: &mut Core, address: u8) -> Option<Outcome> {
        self.asked = true;
        match self.stage {
            Stage::Setup => match core.setup(address, self.request.setup()) {
                Handshake::Ack => {
                    self.enter(match (self.request.length, self.request.is_read()) {
                        (0, _) => Stage::StatusIn,
                        (_, true) => Stage::DataIn,
                        (_, false) => Stage::DataOut,
                    });
                    None
                }
                _ => self.silence(),
            },
            Stage::DataIn => self.data_in(core, address),
            Stage::DataOut => self.data_out(core, address),
            Stage::StatusIn => match core.in_token(address, 0) {
                InResponse::Data { bytes, data1 } => {
                    core.acknowledged(0, bytes.len());
                    Some(if bytes.is_empty() && data1 {
                        Outcome::Done(Vec::new())
                    } else {
                        Outcome::Broken(format!(
                            "status stage of {} bytes, DATA{}",
                            bytes.len(),
                            u8::from(data1)
                        ))
                    })
                }
                InResponse::Nak => None,
                InResponse::Stall => Some(Outcome::Stalled),
                InResponse::Silence => self.silence(),
            },
            Stage::StatusOut => match core.out(address, 0, true, &[]) {
                Handshake::Ack => Some(Outcome::Done(std::mem::take(&mut self.received))),
                Handshake::Nak => None,
                Handshake::Stall => Some(Outcome::Stalled),
                Handshake::Silence => self.silence(),
            },
        }
    }

    fn data_in(&mut self, core: &mut Core, address: u8) -> Option<Outcome> {
        match core.in_token(address, 0) {
            InResponse::Data { data1, bytes } => {
                core.acknowledged(0, bytes.len());
                if data1 != self.data1 {
                    return Some(Outcome::Broken(
                        "a packet of the data stage has the wrong PID".to_owned(),
                    ));
                }
                self.data1 = !self.data1;
                self.received.extend(&bytes);
                let length = usize::from(self.request.length);
                if self.received.len() > length {
                    return Some(Outcome::Broken(format!(
                        "{} bytes instead of {length}",
                        self.received.len()
                    )));
                }
                if self
                    .request
                    .abandon_after
                    .is_some_and(|after| self.received.len() >= after)
                {
                    return Some(Outcome::Abandoned);
                }
                if bytes.len() < self.max_packet || self.received.len() == length {
                    self.enter(Stage::StatusOut);
                }
                None
            }
            InResponse::Nak => None,
            InResponse::Stall => Some(Outcome::Stalled),
            InResponse::Silence => self.silence(),
        }
    }

    fn data_out(&mut self, core: &mut Core, address: u8) -> Option<Outcome> {
        let chunk = self.chunk().to_vec();
        match core.out(address, 0, self.data1, &chunk) {
            Handshake::Ack => {
                self.data1 = !self.data1;
                self.sent += chunk.len();
                if self
                    .request
                    .abandon_after
                    .is_some_and(|after| self.sent >= after)
                {
                    return Some(Outcome::Abandoned);
                }
                if self.sent >= self.request.data.len() {
                    self.enter(Stage::StatusIn);
                }
                None
            }
            Handshake::Nak => None,
            Handshake::Stall => Some(Outcome::Stalled),
            Handshake::Silence => self.silence(),
        }
    }
}

impl Host {
    /// A control transfer is over.
    pub(super) fn finish(&mut self, core: &mut Core, outcome: Outcome) {
        let Some(transfer) = self.transfer.take() else {
            return;
        };
        if matches!(outcome, Outcome::Done(_)) {
            self.follow(&transfer.request);
        }
        if transfer.id == 0 {
            self.enumerated(core, &transfer.request, outcome);
        } else if self.opening == Some(transfer.id) {
            self.opening = None;
            self.opened(&transfer.request, outcome);
        } else {
            self.outcomes.push((transfer.id, outcome));
        }
        if self.phase == super::Phase::Running {
            self.start_next(core);
        }
    }

    /// The host's own data PIDs follow the requests that reset the device's (USB 2.0 sections
    /// 9.1.1.5 and 9.4.5).
    fn follow(&mut self, request: &Request) {
        match (request.kind, request.request) {
            (0x00, 9) => {
                for pipe in [&mut self.bulk_in, &mut self.bulk_out, &mut self.notify] {
                    pipe.data1 = false;
                    pipe.halted = false;
                }
            }
            (0x02, 1) if request.value == 0 => {
                let number = usize::from(request.index & 0xF);
                let is_in = request.index & 0x80 != 0;
                let pipe = match (is_in, number) {
                    (true, n) if n == self.bulk_in.number => &mut self.bulk_in,
                    (true, n) if n == self.notify.number => &mut self.notify,
                    (false, n) if n == self.bulk_out.number => &mut self.bulk_out,
                    _ => return,
                };
                pipe.data1 = false;
                pipe.halted = false;
            }
            _ => {}
        }
    }
}
