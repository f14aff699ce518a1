//! How bytes reach the board, and how time passes meanwhile.
//!
//! A [`RigLink`] carries bytes both ways and lets time pass. On a port that is the clock on the
//! wall; on the embedded rig it is virtual time, which passes only inside of [`RigLink::exchange`].
//! So one controller runs on both.

pub mod embedded;
pub mod fake;
pub mod fast;
pub mod of_board;
pub mod port;

use emulator_link::{Advanced, Injection, Pose, Report, Truth};
use rig::LinkChoice;
use std::time::Duration;

/// What arrived while time passed.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Exchange {
    /// Time since the link was opened (a port) or since power-on (the embedded rig), in
    /// nanoseconds.
    pub now_ns: u64,
    /// Bytes that the board sent.
    pub from_board: Vec<u8>,
    /// The robot's pose, where the link knows it.
    pub pose: Option<Pose>,
    /// The plant's true state in each millisecond; empty on a real board.
    pub truth: Vec<Truth>,
    /// Resets of the board, where the link counts them.
    pub resets: u32,
}

impl From<Advanced> for Exchange {
    fn from(advanced: Advanced) -> Self {
        Self {
            now_ns: advanced.now_ns,
            from_board: advanced.from_board,
            pose: Some(advanced.pose),
            truth: advanced.truth,
            resets: advanced.resets,
        }
    }
}

/// A way to the board.
pub trait RigLink {
    /// Name in messages.
    fn name(&self) -> String;

    /// Puts bytes on the board's receive line, lets time pass, and returns what the board sent.
    ///
    /// # Errors
    /// [`LinkError`] where the other end is gone.
    fn exchange(&mut self, to_board: &[u8], duration: Duration) -> Result<Exchange, LinkError>;

    /// Whether opening this link booted the rig behind it: an embedded rig of the program's own.
    /// Its cables are slack at first, and it ends with the link.
    fn booted_here(&self) -> bool {
        false
    }

    /// Who stopped the rig last while this link was open, where the link is told: a service is, a
    /// port is not.
    fn stopped_by(&self) -> Option<&str> {
        None
    }

    /// Number of the board that this link has to lead to; `None`: any.
    fn board(&self) -> Option<&str> {
        None
    }

    /// What can be controlled and observed on an emulated rig only; `None` on a real board.
    fn controls(&mut self) -> Option<&mut dyn RigControls> {
        None
    }
}

/// What can be done to an emulated rig beside its serial line.
pub trait RigControls {
    /// Starts or stops the robot's random path.
    ///
    /// # Errors
    /// [`LinkError`] where the rig is gone or refuses.
    fn robot(&mut self, moving: bool) -> Result<(), LinkError>;

    /// Injects a defect, or removes it.
    ///
    /// # Errors
    /// [`LinkError`] where the rig is gone or refuses.
    fn inject(&mut self, injection: Injection) -> Result<(), LinkError>;

    /// Figures of the run so far.
    ///
    /// # Errors
    /// [`LinkError`] where the rig is gone or refuses.
    fn report(&mut self) -> Result<Report, LinkError>;

    /// Seed of everything random in this run.
    fn seed(&self) -> u64;

    /// Lets a controller outside of the board drive the amplifiers, V at their inputs; `None`: the
    /// board's DACs again.
    ///
    /// # Errors
    /// [`LinkError`] where the rig has no such way.
    fn drive_outside(&mut self, volts: Option<[f64; wire::UNITS]>) -> Result<(), LinkError> {
        let _ = volts;
        Err(LinkError::Refused(
            "its amplifiers are driven by its board alone; use `--link fast`".to_owned(),
        ))
    }

    /// The virtual arm that holds the cables' ends, where there is one.
    fn arm(&mut self) -> Option<&mut robot::arm::VirtualArm> {
        None
    }
}

/// Why a link does not work. Nothing is driven any more: a board without setpoints stops by itself.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// A program or setting that the embedded rig needs is not there.
    #[error("{0}")]
    Setup(String),
    /// The link could not be opened.
    #[error("{name} can't be opened: {cause}; {hint}")]
    Open {
        /// What was to be opened.
        name: String,
        /// The operating system's words.
        cause: String,
        /// What to do.
        hint: String,
    },
    /// The connection was lost.
    #[error(
        "{name} went away: {cause}; a board without setpoints goes to 0 V by itself within 100 ms"
    )]
    Lost {
        /// Which link.
        name: String,
        /// What was noticed.
        cause: String,
    },
    /// The service of the rig can't be reached, or its link is gone.
    #[error("{0}")]
    Service(String),
    /// The service of the rig refused a request: the rig was stopped, or another client commands.
    #[error("{0}")]
    NotAllowed(String),
    /// The embedded rig refused a request.
    #[error("the embedded rig can't do that: {0}")]
    Refused(String),
}

/// Options of opening a link that only the embedded rig has.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct EmbeddedOptions {
    /// Seed of everything random; `None`: the rig's own default.
    pub seed: Option<u64>,
    /// Number of the run of this rig: noise, zeros, clocks and the robot's path differ between
    /// runs, and the rig does not. Run 0 is that of a rig that runs once.
    pub run: u64,
    /// Let virtual time pass no faster than real time.
    pub paced: bool,
    /// Configuration of the plant (TOML); `None`: the rig of the thesis.
    pub plant: Option<std::path::PathBuf>,
    /// The board's USB port instead of its serial line.
    pub usb: bool,
}

/// Opens a link.
///
/// # Errors
/// [`LinkError`] with what to do about it.
pub fn open(choice: &LinkChoice, options: &EmbeddedOptions) -> Result<Box<dyn RigLink>, LinkError> {
    Ok(match choice {
        LinkChoice::Embedded => Box::new(embedded::EmbeddedRig::start(
            &embedded::Programs::from_environment()?,
            options,
        )?),
        LinkChoice::Fast => Box::new(fast::FastRig::open(options)?),
        LinkChoice::Usb => Box::new(port::Port::usb()?),
        LinkChoice::Serial(path) => Box::new(port::Port::serial(path)?),
        LinkChoice::Kept(name) => {
            return Err(LinkError::Setup(format!(
                "rig `{name}` is kept by a service and is not opened directly"
            )))
        }
    })
}
