//! The embedded rig in this process, reached by its USB port, with the USB host and the serial line
//! at hand.

use emulator::{Options, Rig, RigError};
use emulator_link::{Advanced, Injection, Report};
use emulator_usb::host::{Outcome, Request, State};
use emulator_usb::{Core, Host};
use session::link::embedded::ELF_VARIABLE;
use session::link::{Exchange, LinkError, RigControls, RigLink};
use std::path::PathBuf;
use std::time::Duration;
use wire::message::{Response, Status};
use wire::{BoardFrame, BoardMessage, Command, Decoder, HostFrame, MAX_FRAME};

/// One millisecond in nanoseconds.
pub const MS: u64 = 1_000_000;

/// See the module's page.
pub struct UsbRig {
    rig: Rig,
    /// The link that carries a session through [`RigLink`].
    pub session: Link,
    /// The far end of the other link.
    pub other: End,
}

/// The board's links.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Link {
    /// The USB port.
    Usb,
    /// USART3.
    Serial,
}

/// What the far end of a link sends and has received.
#[derive(Default)]
pub struct End {
    to_board: Vec<u8>,
    decoder: Decoder,
    next_seq: Option<u16>,
    /// Frames that never came, by gaps in their numbers.
    pub lost: u64,
    /// Frames that came damaged.
    pub bad: u64,
    /// Samples that came.
    pub samples: u64,
    /// The newest status.
    pub status: Option<Status>,
    /// Responses that came.
    pub responses: Vec<Response>,
}

impl End {
    /// Sends a command.
    ///
    /// # Panics
    /// Where it does not fit a frame.
    pub fn send(&mut self, seq: u16, command: Command) {
        let mut frame = [0; MAX_FRAME];
        let length = wire::encode(&HostFrame { seq, command }, &mut frame).expect("fits");
        self.to_board.extend(&frame[..length]);
    }

    /// Sends hello and asks for every sample.
    pub fn stream_all(&mut self) {
        let (abi, schema) = (wire::ABI_VERSION, wire::SCHEMA_HASH);
        self.send(1, Command::Hello { abi, schema });
        self.send(2, Command::Stream { decimation: 1 });
    }

    fn take(&mut self, bytes: &[u8]) {
        for byte in bytes {
            match self.decoder.push(*byte) {
                Ok(Some(frame)) => self.frame(frame),
                Ok(None) => {}
                Err(_) => self.bad += 1,
            }
        }
    }

    fn frame(&mut self, frame: BoardFrame) {
        let expected = self.next_seq.unwrap_or(frame.seq);
        self.lost += u64::from(frame.seq.wrapping_sub(expected));
        self.next_seq = Some(frame.seq.wrapping_add(1));
        match frame.message {
            BoardMessage::Samples(batch) => self.samples += batch.samples.len() as u64,
            BoardMessage::Status(status) => self.status = Some(status),
            BoardMessage::Reply(reply) => self.responses.push(reply.response),
            _ => {}
        }
    }
}

impl UsbRig {
    /// Boots the image that `FORCE_FIRMWARE_ELF` names, without a USB cable.
    ///
    /// # Panics
    /// Where there is no image or the rig does not start: there is nothing to test then.
    #[must_use]
    pub fn boot(seed: u64) -> Self {
        let elf = std::env::var_os(ELF_VARIABLE).map(PathBuf::from);
        let elf = elf.unwrap_or_else(|| panic!("{ELF_VARIABLE} is set by `cargo xtask test`"));
        let options = Options {
            seed,
            ..Options::default()
        };
        let rig = Rig::boot(&elf, options).unwrap_or_else(|error| panic!("{error}"));
        Self {
            rig,
            session: Link::Usb,
            other: End::default(),
        }
    }

    /// The same with the cable plugged in, as soon as the host has opened the port.
    ///
    /// # Panics
    /// Where it does not within a second.
    #[must_use]
    pub fn open(seed: u64) -> Self {
        let mut rig = Self::boot(seed);
        rig.plug(true);
        rig.wait_state(State::Open, 1_000);
        rig
    }

    /// The USB host and the controller's core.
    pub fn usb<R>(&mut self, act: impl FnOnce(&mut Host, &mut Core) -> R) -> R {
        self.rig.usb(act)
    }

    /// Plugs the cable in or pulls it.
    pub fn plug(&mut self, plugged: bool) {
        self.usb(|host, core| host.set_cable(core, plugged));
    }

    /// Lets milliseconds pass.
    ///
    /// # Panics
    /// Where the engine stops.
    pub fn run(&mut self, ms: u64) {
        for _ in 0..ms {
            self.step(&[], MS).unwrap_or_else(|error| panic!("{error}"));
        }
    }

    /// Lets time pass. `to_board` goes by the session's link; the bytes that come back by it are in
    /// the result.
    fn step(&mut self, to_board: &[u8], duration_ns: u64) -> Result<Advanced, RigError> {
        let to_other = std::mem::take(&mut self.other.to_board);
        let (by_usb, by_serial) = match self.session {
            Link::Usb => (to_board, to_other.as_slice()),
            Link::Serial => (to_other.as_slice(), to_board),
        };
        self.rig.usb(|host, _| host.write(by_usb));
        let mut advanced = self.rig.advance(duration_ns, by_serial)?;
        match self.session {
            Link::Usb => self.other.take(&std::mem::take(&mut advanced.from_board)),
            Link::Serial => {
                let bytes = self.usb(|host, _| host.take_read());
                self.other.take(&bytes);
            }
        }
        Ok(advanced)
    }

    /// Waits for a state of the host.
    ///
    /// # Panics
    /// When it does not come.
    pub fn wait_state(&mut self, state: State, within_ms: u64) {
        for _ in 0..within_ms {
            if self.usb(|host, _| host.state()) == state {
                return;
            }
            self.run(1);
        }
        let log = self.usb(|host, _| host.log().to_vec());
        panic!("the host is not {state:?} within {within_ms} ms: {log:?}");
    }

    /// Executes a control transfer.
    ///
    /// # Panics
    /// Where it is not over after six seconds: the host itself gives up earlier.
    pub fn control(&mut self, request: Request) -> Outcome {
        let id = self.usb(|host, _| host.request(request));
        for _ in 0..6_000 {
            if let Some(outcome) = self.usb(|host, _| host.take_outcome(id)) {
                return outcome;
            }
            self.run(1);
        }
        panic!("a control transfer without an end");
    }

    /// Reads a descriptor.
    pub fn descriptor(&mut self, kind: u8, index: u8, length: u16) -> Outcome {
        let value = u16::from(kind) << 8 | u16::from(index);
        self.control(Request::read(
            0,
            6,
            value,
            if kind == 3 { 0x409 } else { 0 },
            length,
        ))
    }

    /// The rig's figures; the latencies since the last call.
    ///
    /// # Panics
    /// Where the engine stops.
    pub fn report(&mut self) -> Report {
        self.rig.report().unwrap_or_else(|error| panic!("{error}"))
    }

    /// The rig itself.
    pub fn rig(&mut self) -> &mut Rig {
        &mut self.rig
    }
}

impl RigLink for UsbRig {
    fn name(&self) -> String {
        "the embedded rig's USB port".to_owned()
    }

    fn exchange(&mut self, to_board: &[u8], duration: Duration) -> Result<Exchange, LinkError> {
        let duration_ns = u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX);
        let mut advanced = self
            .step(to_board, duration_ns)
            .map_err(|error| LinkError::Refused(error.to_string()))?;
        if self.session == Link::Usb {
            advanced.from_board = self.usb(|host, _| host.take_read());
        }
        Ok(advanced.into())
    }

    fn booted_here(&self) -> bool {
        true
    }

    fn controls(&mut self) -> Option<&mut dyn RigControls> {
        Some(self)
    }
}

impl RigControls for UsbRig {
    fn robot(&mut self, moving: bool) -> Result<(), LinkError> {
        self.rig.set_robot_moving(moving);
        Ok(())
    }

    fn inject(&mut self, injection: Injection) -> Result<(), LinkError> {
        let done = self.rig.inject(injection);
        done.map_err(|error| LinkError::Refused(error.to_string()))
    }

    fn report(&mut self) -> Result<Report, LinkError> {
        Ok(UsbRig::report(self))
    }

    fn seed(&self) -> u64 {
        self.rig.seed()
    }
}
