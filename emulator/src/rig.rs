//! The rig as one object: boot an image, step it, inject faults, read the figures.

use crate::board::Board;
use crate::engine::rigless::peers::Shared;
use crate::engine::rigless::usb::SharedUsb;
use crate::engine::rigless::RiglessEngine;
use crate::engine::{CoreBit, Engine, EngineError, Memory, Progress, Trap};
use crate::image::{Image, ImageError};
use crate::rtt;
use emulator_link::{Advanced, Injection, RegisterEvent, Report, StackUse, Truth};
use emulator_usb::{Core, Host};
use plant::{ConfigError, Plant, PlantConfig};
use std::fmt;
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// Spacing of the rows of truth, in nanoseconds.
const ROW_NS: u64 = 1_000_000;

/// Fills the stack before the first instruction.
const PAINT: [u8; 4] = [0xA5; 4];

/// How a rig is put together.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Seed of everything random.
    pub seed: u64,
    /// Number of the run of this rig: noise, zeros, clocks and the prescribed path are drawn anew
    /// for each. Run 0 draws them from `seed` alone.
    pub run: u64,
    /// The plant behind the board.
    pub plant: PlantConfig,
}

/// Why a rig cannot be built or cannot go on.
#[derive(Debug)]
pub enum RigError {
    /// The firmware image.
    Image(ImageError),
    /// The plant's configuration.
    Plant(ConfigError),
    /// Plant and board do not fit, or an injection is impossible.
    Refused(String),
    /// The engine.
    Engine(EngineError),
}

impl fmt::Display for RigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Image(error) => error.fmt(f),
            Self::Plant(error) => error.fmt(f),
            Self::Refused(why) => f.write_str(why),
            Self::Engine(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for RigError {}

impl From<EngineError> for RigError {
    fn from(error: EngineError) -> Self {
        Self::Engine(error)
    }
}

/// What the rows of one advance brought.
#[derive(Default)]
struct Gathered {
    truth: Vec<Truth>,
    rtt: Vec<u8>,
    error: Option<EngineError>,
}

/// A firmware image running on the emulated board.
pub struct Rig {
    engine: Box<dyn Engine>,
    board: Shared,
    usb: SharedUsb,
    progress: Progress,
    rtt_block: Option<u32>,
    stack: Option<Range<u32>>,
    rtt: Vec<u8>,
    wall_ns: u64,
    seed: u64,
}

impl Rig {
    /// Boots the image at `elf`. Virtual time stands at zero, before the first instruction.
    ///
    /// # Errors
    /// See [`RigError`].
    pub fn boot(elf: &Path, options: Options) -> Result<Self, RigError> {
        let image = Image::read(elf).map_err(RigError::Image)?;
        Self::boot_image(&image, options)
    }

    /// Boots an image that has been read already.
    ///
    /// # Errors
    /// See [`RigError`].
    pub fn boot_image(image: &Image, options: Options) -> Result<Self, RigError> {
        let of_run = plant::rng::seed_of_run(options.seed, options.run);
        let plant =
            Plant::of_run(options.plant, options.seed, options.run).map_err(RigError::Plant)?;
        let board = Shared::new(Board::new(plant, of_run).map_err(RigError::Refused)?);
        let usb = SharedUsb::default();
        let mut engine = Box::new(RiglessEngine::boot(image, &board, &usb)?);
        if let Some(stack) = &image.stack {
            let words = stack.len() / PAINT.len();
            engine.write_memory(stack.start, &PAINT.repeat(words))?;
        }
        Ok(Self {
            engine,
            board,
            usb,
            progress: Progress::default(),
            rtt_block: image.rtt,
            stack: image.stack.clone(),
            rtt: Vec::new(),
            wall_ns: 0,
            seed: options.seed,
        })
    }

    /// Name of the machine and of the engine that runs it.
    #[must_use]
    pub fn machine(&self) -> String {
        self.engine.name()
    }

    /// Seed of this run.
    #[must_use]
    pub const fn seed(&self) -> u64 {
        self.seed
    }

    /// Virtual time since power-on, in nanoseconds.
    #[must_use]
    pub const fn now_ns(&self) -> u64 {
        self.progress.now_ns
    }

    /// Puts `to_board` on the board's receive line and lets `duration_ns` pass.
    ///
    /// # Errors
    /// The engine cannot go on.
    pub fn advance(&mut self, duration_ns: u64, to_board: &[u8]) -> Result<Advanced, RigError> {
        let began = Instant::now();
        self.board.lock().queue_to_board(to_board);
        let begin = self.progress.now_ns;
        let end = begin.saturating_add(duration_ns);
        let truth = if end > begin {
            self.run(begin, end)?
        } else {
            vec![self.board.lock().truth(end)]
        };
        self.wall_ns += u64::try_from(began.elapsed().as_nanos()).unwrap_or(u64::MAX);
        let mut board = self.board.lock();
        Ok(Advanced {
            now_ns: end,
            from_board: board.take_from_board(),
            pose: board.pose(),
            truth,
            resets: self.progress.resets,
        })
    }

    fn run(&mut self, begin: u64, end: u64) -> Result<Vec<Truth>, RigError> {
        let gathered = Arc::new(Mutex::new(Gathered::default()));
        let (board, block, rows) = (self.board.clone(), self.rtt_block, gathered.clone());
        let at_row = move |t_ns: u64, memory: &mut dyn Memory| {
            let mut rows = rows.lock().unwrap_or_else(PoisonError::into_inner);
            rows.truth.push(board.lock().truth(t_ns));
            match block.map(|block| rtt::drain(memory, block)) {
                Some(Ok(bytes)) => rows.rtt.extend(bytes),
                Some(Err(error)) => rows.error = Some(error),
                None => {}
            }
        };
        self.progress = self
            .engine
            .run_until(begin, end, ROW_NS, Box::new(at_row))?;
        // The engine stops between two instructions, so up to one late.
        self.progress.now_ns = end;
        let mut gathered = gathered.lock().unwrap_or_else(PoisonError::into_inner);
        self.rtt.append(&mut gathered.rtt);
        match gathered.error.take() {
            Some(error) => Err(error.into()),
            None => Ok(std::mem::take(&mut gathered.truth)),
        }
    }

    /// The host at the board's USB socket and the core that it talks to. The host acts as virtual
    /// time passes.
    pub fn usb<R>(&mut self, act: impl FnOnce(&mut Host, &mut Core) -> R) -> R {
        self.usb.with(act)
    }

    /// What the firmware has put into RTT channel 0 since the last call (defmt's encoding is the
    /// firmware's).
    pub fn take_rtt(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.rtt)
    }

    /// What caused the last reset of the controller.
    #[must_use]
    pub fn last_reset(&self) -> Option<&str> {
        self.progress.last_reset.as_deref()
    }

    /// Starts or stops the robot's path.
    pub fn set_robot_moving(&mut self, moving: bool) {
        self.board.lock().set_robot_moving(moving);
    }

    /// Injects a fault, or removes it.
    ///
    /// # Errors
    /// What cannot be done, and why.
    pub fn inject(&mut self, injection: Injection) -> Result<(), RigError> {
        match injection {
            Injection::HangLoop => Ok(self.engine.hang()?),
            Injection::FlipBit(address, bit) => Ok(self.engine.flip_bit(address, bit)?),
            Injection::FlipRegister(address, bit) => Ok(self.engine.flip_register(address, bit)?),
            Injection::BrownOut => Ok(self.engine.brown_out()?),
            Injection::Forbidden(access) => Ok(self.engine.trap(Trap::Forbidden(access))?),
            Injection::FlipCore(exception, register, bit) => {
                Ok(self.engine.trap(Trap::Flip(CoreBit {
                    exception,
                    register,
                    bit,
                }))?)
            }
            Injection::LoseClock(on) => {
                self.board.lock().set_clock_lost(on);
                if on {
                    self.engine.trap(Trap::Nmi)?;
                }
                Ok(())
            }
            Injection::PlugUsb(plugged) => {
                self.usb.with(|host, core| host.set_cable(core, plugged));
                Ok(())
            }
            Injection::SuspendUsb(on) => {
                self.usb.with(|host, core| host.set_suspended(core, on));
                Ok(())
            }
            Injection::ReadUsb(on) => {
                self.usb.with(|host, _| host.set_reading(on));
                Ok(())
            }
            other => (self.board.lock().inject(other)).map_err(RigError::Refused),
        }
    }

    /// Reads memory of the controller as a debugger would.
    ///
    /// # Errors
    /// There is no memory there.
    pub fn read_memory(&mut self, address: u32, length: usize) -> Result<Vec<u8>, RigError> {
        Ok(self.engine.read_memory(address, length)?)
    }

    /// The stack since power-on.
    fn stack_use(&mut self) -> Result<Option<StackUse>, RigError> {
        let Some(stack) = &self.stack else {
            return Ok(None);
        };
        let words = stack.len() / PAINT.len();
        let memory = (self.engine).read_memory(stack.start, words * PAINT.len())?;
        let untouched = memory
            .chunks(PAINT.len())
            .take_while(|word| **word == PAINT)
            .count();
        Ok(Some(StackUse {
            used_bytes: ((words - untouched) * PAINT.len()) as u32,
            size_bytes: stack.len() as u32,
        }))
    }

    /// The figures so far; the latencies since the last call.
    ///
    /// # Errors
    /// The engine cannot go on.
    pub fn report(&mut self) -> Result<Report, RigError> {
        let mut register_events = self.engine.register_events()?;
        let stack = self.stack_use()?;
        let mut board = self.board.lock();
        let complaints = board.complaints();
        register_events.extend(complaints.iter().map(|(place, what, count)| RegisterEvent {
            place: place.to_owned(),
            what: what.to_owned(),
            count,
        }));
        let misuse = self.usb.with(|_, core| core.take_complaints());
        for (place, what) in misuse {
            match register_events
                .iter_mut()
                .find(|event| event.place == place && event.what == what)
            {
                Some(event) => event.count += 1,
                None => register_events.push(RegisterEvent {
                    place,
                    what,
                    count: 1,
                }),
            }
        }
        register_events.sort();
        let (conversions, conversions_read) = board.conversions();
        let now_ns = self.progress.now_ns;
        Ok(Report {
            now_ns,
            wall_ns: self.wall_ns,
            instructions: self.progress.instructions,
            sleep_fraction: if now_ns == 0 {
                0.0
            } else {
                self.progress.asleep_ns as f64 / now_ns as f64
            },
            latencies: board.probe.take(),
            conversions,
            conversions_read,
            alive_hz: board.alive_hz(),
            register_events,
            stack,
        })
    }
}
