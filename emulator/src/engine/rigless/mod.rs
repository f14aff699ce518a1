//! The engine: the crate `rigless`, a Cortex-M7 and an STM32H743 in Rust.
//!
//! It runs the core on a thread of its own and calls back; this module inverts the control. The
//! engine's thread waits at each stop for the next command and reports its progress, so that the
//! rig steps the engine like any other object and both sides take turns on the
//! [`Board`](crate::board::Board).

mod dma_guard;
mod i2c;
mod iwdg;
mod listener;
mod machine;
mod mcu;
pub mod peers;
mod port;
mod trap;
pub mod usb;

use super::{AtRow, Engine, EngineError, Memory, Progress, Trap};
use crate::image::{Image, FLASH_BASE};
use emulator_link::RegisterEvent;
use machine::{RigMachine, INSTRUCTION_NS};
use peers::Shared;
use rigless::emulator::{run, Driver, Host, Settled, Start, Stop};
use rigless::image::Image as Placed;
use rigless::session::Session;
use rigless::soc::{Fault, Width};
use rigless::time::VirtualNanos;
use std::sync::mpsc::{channel, Receiver, Sender};
use std::thread::JoinHandle;
use usb::SharedUsb;

/// `b .`: a branch to itself.
const HANG: u16 = 0xE7FE;
/// The run pauses before its first instruction, for the first command.
const FIRST_STOP: VirtualNanos = VirtualNanos(0);

/// A run under way.
struct Run {
    next_ns: u64,
    end_ns: u64,
    row_ns: u64,
    at_row: AtRow,
}

impl Run {
    const fn row_after(t_ns: u64, row_ns: u64, end_ns: u64) -> u64 {
        let next = (t_ns / row_ns + 1) * row_ns;
        if next < end_ns {
            next
        } else {
            end_ns
        }
    }
}

enum Command {
    Run(Run),
    Hang,
    Trap(Trap),
    BrownOut,
    FlipRegister(u32, u8),
    Read(u32, usize),
    Write(u32, Vec<u8>),
    Events,
}

enum Response {
    Progress(Progress),
    Bytes(Result<Vec<u8>, EngineError>),
    Events(Vec<RegisterEvent>),
}

/// See the module's page.
pub struct RiglessEngine {
    commands: Option<Sender<Command>>,
    answers: Receiver<Response>,
    thread: Option<JoinHandle<Result<(), String>>>,
}

impl RiglessEngine {
    /// Loads `image` into a board at power-on.
    ///
    /// # Errors
    /// The engine refuses the image or the part's description.
    pub fn boot(image: &Image, board: &Shared, usb: &SharedUsb) -> Result<Self, EngineError> {
        let placed = Placed::new(&image.path, image.bytes.clone(), None)
            .map_err(|error| EngineError(error.to_string()))?;
        let machine = RigMachine::new(board.clone(), usb.clone()).map_err(|error| {
            EngineError(format!(
                "the engine's STM32H743 is not the expected one: {error}"
            ))
        })?;
        let (commands, orders) = channel();
        let (reports, answers) = channel();
        let samples = image.samples;
        let crash_record = image.crash_record.clone();
        let thread = std::thread::Builder::new()
            .name("engine".to_owned())
            .spawn(move || {
                let session = Session::new(Box::new(machine), 0, FIRST_STOP)
                    .map_err(|error| error.to_string())?;
                let driver = Turns {
                    orders,
                    reports,
                    samples,
                    crash_record,
                    patched: Vec::new(),
                    resets: 0,
                    run: None,
                };
                let images = [placed];
                run(session, &Start::new(&images), driver)
                    .map(drop)
                    .map_err(|error| error.to_string())
            })
            .map_err(|error| EngineError(format!("cannot start the engine's thread: {error}")))?;
        let mut engine = Self {
            commands: Some(commands),
            answers,
            thread: Some(thread),
        };
        // The first answer is the stop before the first instruction.
        engine.answer()?;
        Ok(engine)
    }

    fn ask(&mut self, command: Command) -> Result<Response, EngineError> {
        let sent = self
            .commands
            .as_ref()
            .is_some_and(|commands| commands.send(command).is_ok());
        if sent {
            self.answer()
        } else {
            Err(self.autopsy())
        }
    }

    /// Asks for what has no result.
    fn order(&mut self, command: Command) -> Result<(), EngineError> {
        match self.ask(command)? {
            Response::Bytes(done) => done.map(drop),
            _ => Err(out_of_step()),
        }
    }

    fn answer(&mut self) -> Result<Response, EngineError> {
        self.answers.recv().map_err(|_| self.autopsy())
    }

    /// Why the thread is gone.
    fn autopsy(&mut self) -> EngineError {
        self.commands = None;
        let why = match self.thread.take().map(JoinHandle::join) {
            Some(Ok(Err(error))) => error,
            Some(Ok(Ok(()))) => "the firmware ended the run".to_owned(),
            Some(Err(panic)) => panic
                .downcast_ref::<String>()
                .cloned()
                .or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned()))
                .unwrap_or_else(|| "a model panicked".to_owned()),
            None => "it has ended before".to_owned(),
        };
        EngineError(format!("the engine stopped: {why}"))
    }
}

impl Drop for RiglessEngine {
    fn drop(&mut self) {
        self.commands = None;
        if let Some(thread) = self.thread.take() {
            // Its outcome was reported to the request; no receiver is left here.
            drop(thread.join());
        }
    }
}

impl Engine for RiglessEngine {
    fn name(&self) -> String {
        format!("{}, rigless 0.4.0", machine::NAME)
    }

    fn run_until(
        &mut self,
        from_ns: u64,
        t_ns: u64,
        row_ns: u64,
        at_row: AtRow,
    ) -> Result<Progress, EngineError> {
        let run = Run {
            next_ns: Run::row_after(from_ns, row_ns, t_ns),
            end_ns: t_ns,
            row_ns,
            at_row,
        };
        match self.ask(Command::Run(run))? {
            Response::Progress(progress) => Ok(progress),
            _ => Err(out_of_step()),
        }
    }

    fn hang(&mut self) -> Result<(), EngineError> {
        self.order(Command::Hang)
    }

    fn trap(&mut self, trap: Trap) -> Result<(), EngineError> {
        self.order(Command::Trap(trap))
    }

    fn brown_out(&mut self) -> Result<(), EngineError> {
        self.order(Command::BrownOut)
    }

    fn flip_register(&mut self, address: u32, bit: u8) -> Result<(), EngineError> {
        if bit > 31 || !address.is_multiple_of(4) {
            return Err(EngineError(format!(
                "bit {bit} of the register at {address:#010x}: registers are words, bits are 0 to 31"
            )));
        }
        self.order(Command::FlipRegister(address, bit))
    }

    fn flip_bit(&mut self, address: u32, bit: u8) -> Result<(), EngineError> {
        if bit > 7 {
            return Err(EngineError(format!("bit {bit} of a byte: bits are 0 to 7")));
        }
        let byte = self.read_memory(address, 1)?[0];
        self.write_memory(address, &[byte ^ 1 << bit])
    }

    fn read_memory(&mut self, address: u32, length: usize) -> Result<Vec<u8>, EngineError> {
        match self.ask(Command::Read(address, length))? {
            Response::Bytes(bytes) => bytes,
            _ => Err(out_of_step()),
        }
    }

    fn write_memory(&mut self, address: u32, bytes: &[u8]) -> Result<(), EngineError> {
        self.order(Command::Write(address, bytes.to_vec()))
    }

    fn register_events(&mut self) -> Result<Vec<RegisterEvent>, EngineError> {
        match self.ask(Command::Events)? {
            Response::Events(events) => Ok(events),
            _ => Err(out_of_step()),
        }
    }
}

fn out_of_step() -> EngineError {
    EngineError("the engine's response does not belong to the request".to_owned())
}

/// The engine's side of the turns.
struct Turns {
    orders: Receiver<Command>,
    reports: Sender<Response>,
    /// Where the hang injection acts, see [`Image::samples`](crate::image::Image::samples).
    samples: Option<u32>,
    /// Memory of the crash record.
    crash_record: Option<std::ops::Range<u32>>,
    /// Instructions replaced by the hang injection, to be put back by a reset.
    patched: Vec<(u32, u16)>,
    resets: usize,
    run: Option<Run>,
}

impl Turns {
    fn hang(&mut self, host: &mut dyn Host) -> Result<Vec<u8>, String> {
        let at = self.samples.ok_or(
            "the image has no function `Board::samples` to hang in; was it stripped, or is it another firmware?",
        )?;
        if self.patched.is_empty() {
            let before = host
                .read(at.into(), Width::W16)
                .map_err(|e| e.to_string())?;
            put(host, at, Width::W16, HANG.into())?;
            self.patched.push((at, before as u16));
        }
        Ok(Vec::new())
    }

    /// The ECC of AXI SRAM works on words of 64 bits and keeps the last one back until another is
    /// accessed (RM0433 rev 9 section 2.4), so a reset right after a write loses it. The worst
    /// case: the last word of the crash record is gone.
    fn lose_last_word(&self, host: &mut dyn Host) {
        let Some(record) = &self.crash_record else {
            return;
        };
        let last = (record.end - 1) & !7;
        for at in (last..last + 8).filter(|at| record.contains(at)) {
            put(host, at, Width::W8, 0xA5).expect("the record is in memory");
        }
    }

    fn restore_patched_code(&mut self, host: &mut dyn Host) {
        for (at, before) in self.patched.drain(..).rev() {
            put(host, at, Width::W16, before.into()).expect("it could be written before");
        }
    }
}

/// Memory through the engine's host.
struct Probe<'a>(&'a mut dyn Host);

impl Memory for Probe<'_> {
    fn read(&mut self, address: u32, length: usize) -> Result<Vec<u8>, EngineError> {
        (0..length as u64)
            .map(|n| {
                self.0
                    .read(u64::from(address) + n, Width::W8)
                    .map(|byte| byte as u8)
                    .map_err(|error| EngineError(format!("no memory at {address:#010x}: {error}")))
            })
            .collect()
    }

    fn write(&mut self, address: u32, bytes: &[u8]) -> Result<(), EngineError> {
        (address..)
            .zip(bytes)
            .try_for_each(|(at, byte)| put(self.0, at, Width::W8, (*byte).into()))
            .map_err(EngineError)
    }
}

/// Writes memory the way a debugger would, flash included.
fn put(host: &mut dyn Host, at: u32, width: Width, value: u64) -> Result<(), String> {
    let in_flash = at >= FLASH_BASE && at - FLASH_BASE < crate::image::FLASH_SIZE;
    let done = if in_flash {
        host.program(at.into(), width, value)
    } else {
        host.write(at.into(), width, value)
    };
    done.map_err(|error| format!("no memory at {at:#010x}: {error}"))
}

impl Driver<RigMachine> for Turns {
    fn on_settled(
        &mut self,
        session: &mut Session<RigMachine>,
        host: &mut dyn Host,
        settled: Settled,
    ) {
        match settled {
            Settled::Access { access, .. } => session.board_mut().mcu.accessed(&access),
            Settled::Stop(stop) => {
                session.board_mut().mcu.stopped(stop.instruction_count);
            }
            _ => {}
        }
        if session.resets().len() != self.resets {
            self.resets = session.resets().len();
            self.restore_patched_code(host);
            self.lose_last_word(host);
        }
    }

    fn on_stop(
        &mut self,
        session: &mut Session<RigMachine>,
        stop: Stop,
        host: &mut dyn Host,
    ) -> Option<VirtualNanos> {
        if let Some(error) = session.take_error() {
            panic!("{error}");
        }
        if let Some(run) = &mut self.run {
            (run.at_row)(run.next_ns, &mut Probe(host));
            if run.next_ns < run.end_ns {
                run.next_ns = Run::row_after(run.next_ns, run.row_ns, run.end_ns);
                return Some(VirtualNanos(run.next_ns.max(stop.at.0)));
            }
            self.run = None;
        }
        let ran_ns = stop.instruction_count * INSTRUCTION_NS;
        let progress = Response::Progress(Progress {
            now_ns: stop.at.0,
            instructions: stop.instruction_count,
            asleep_ns: stop.at.0.saturating_sub(ran_ns),
            resets: session.resets().len() as u32,
            last_reset: session
                .resets()
                .last()
                .map(|reset| format!("{:?}", reset.cause)),
        });
        self.reports.send(progress).ok()?;
        loop {
            let answer = match self.orders.recv().ok()? {
                Command::Run(run) => {
                    let next_ns = run.next_ns;
                    self.run = Some(run);
                    // The engine stops between two instructions, so up to one late.
                    return Some(VirtualNanos(next_ns.max(stop.at.0)));
                }
                Command::Hang => Response::Bytes(self.hang(host).map_err(EngineError)),
                Command::Trap(trap) => {
                    Response::Bytes(trap::set(trap, host, &mut self.patched).map_err(EngineError))
                }
                Command::BrownOut => {
                    session.board_mut().mcu.dip();
                    session.reset_by_pin(stop.at, stop.instruction_count, host);
                    self.resets = session.resets().len();
                    self.restore_patched_code(host);
                    Response::Bytes(Ok(Vec::new()))
                }
                Command::FlipRegister(at, bit) => {
                    let mcu = &mut session.board_mut().mcu;
                    let done = mcu.flip_register(stop.at, at.into(), bit);
                    let refused = |why| EngineError(format!("register {at:#010x}: {why}"));
                    Response::Bytes(done.map(|()| Vec::new()).map_err(refused))
                }
                Command::Read(at, length) => Response::Bytes(Probe(host).read(at, length)),
                Command::Write(at, bytes) => {
                    Response::Bytes(Probe(host).write(at, &bytes).map(|()| Vec::new()))
                }
                Command::Events => Response::Events(events(session)),
            };
            self.reports.send(answer).ok()?;
        }
    }
}

/// What the engine's session recorded, in the link's words.
fn events(session: &Session<RigMachine>) -> Vec<RegisterEvent> {
    let event = |place: String, what: String, count: u64| RegisterEvent { place, what, count };
    let mut events = Vec::new();
    for unmapped in session.unmapped() {
        events.push(event(
            format!("{:#010x}", unmapped.address),
            format!(
                "no register here; first by the instruction at {:#010x}",
                unmapped.program_counter
            ),
            1,
        ));
    }
    for (address, fault) in session.refused() {
        let place = match fault {
            Fault::Gated {
                instance, register, ..
            } => format!("{instance}.{register}"),
            _ => format!("{address:#010x}"),
        };
        events.push(event(place, fault.to_string(), 1));
    }
    for register in session.unimplemented().values() {
        events.push(event(
            format!("{}.{}", register.instance, register.register),
            format!(
                "no model behind this register; first by the instruction at {:#010x}{}",
                register.program_counter,
                (register.written)
                    .map_or_else(String::new, |value| format!(", last written {value:#010x}"))
            ),
            register.reads + register.writes,
        ));
    }
    for (address, space) in session.undefined() {
        events.push(event(
            format!("{}@{address:#010x}", space.instance),
            format!(
                "no register in this space; first by the instruction at {:#010x}",
                space.program_counter
            ),
            space.reads + space.writes,
        ));
    }
    for (instance, interrupt) in session.unrouted() {
        events.push(event(
            (*instance).to_owned(),
            format!("interrupt {interrupt} reaches no line of the core"),
            1,
        ));
    }
    for told in session.told() {
        events.push(event(
            format!("{}.{}", told.instance, told.register),
            told.reason.to_owned(),
            1,
        ));
    }
    events.sort();
    events
}
