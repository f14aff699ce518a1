//! What a run reports while it goes on: its phase, and the trait of whoever watches it.

use force::metrics::Step;
use serde::Serialize;
use session::link::RigLink;
use session::{Received, Session, SessionError, TimedSample};
use wire::message::{BoardInfo, UnitConfig};
use wire::UNITS;

/// What a run is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// Connecting to the board.
    Connect,
    /// Waiting for the sensors.
    BringUp,
    /// Sending the configuration.
    Configure,
    /// Averaging zeros with slack cables.
    Zero,
    /// Calibrating the load cells with a known weight (emulated rig).
    Calibrate,
    /// Arming and tensioning the cables.
    Tension,
    /// The robot starts to move.
    StartRobot,
    /// Holding the force.
    Hold,
    /// Holding tensions.
    HoldTensions,
    /// Driving the cables without feedback, for an identification.
    Excite,
    /// Ramping down.
    Disarm,
}

impl Phase {
    /// One line for the user.
    #[must_use]
    pub const fn describe(self) -> &'static str {
        match self {
            Self::Connect => "booting and connecting",
            Self::BringUp => "bringing up and calibrating the sensors",
            Self::Configure => "sending the configuration",
            Self::Zero => "zeroing with slack cables",
            Self::Calibrate => "calibrating the load cells with a known weight",
            Self::Tension => "arming, tensioning the cables",
            Self::StartRobot => "robot starts to move",
            Self::Hold => "holding the force",
            Self::HoldTensions => "holding the tensions",
            Self::Excite => "exciting the cables with the loops open",
            Self::Disarm => "ramping down",
        }
    }
}

/// Watches a run. Every method does nothing unless overridden.
pub trait Observer {
    /// A phase began, or reached this fraction of its length (0 to 1).
    fn progress(&mut self, phase: Phase, fraction: f64) {
        let _ = (phase, fraction);
    }
    /// The board has answered.
    fn connected(&mut self, board: &BoardInfo) {
        let _ = board;
    }
    /// A message for the user.
    fn notice(&mut self, text: &str) {
        let _ = text;
    }
    /// These configurations are in force from now on, zeros included.
    fn configured(&mut self, configs: &[UnitConfig; UNITS]) {
        let _ = configs;
    }
    /// Something arrived: samples, faults, readings of the board's clock. What it holds belongs to
    /// the phase and the configuration that were told last.
    fn received(&mut self, received: &Received) {
        self.samples(&received.samples);
    }
    /// Samples arrived; called by [`Observer::received`] unless that is overridden.
    fn samples(&mut self, samples: &[TimedSample]) {
        let _ = samples;
    }
    /// A control cycle is over.
    fn step(&mut self, step: &Step) {
        let _ = step;
    }
}

/// Connects, and tells the observer to which board.
///
/// # Errors
/// As [`Session::connect`].
pub fn connect<'l>(
    link: &'l mut dyn RigLink,
    observer: &mut dyn Observer,
) -> Result<Session<'l>, SessionError> {
    observer.progress(Phase::Connect, 0.0);
    let session = Session::connect(link)?;
    if let Some(board) = session.info() {
        observer.connected(board);
    }
    Ok(session)
}

/// Hands over what arrived, then begins a phase.
pub fn begin(session: &mut Session<'_>, observer: &mut dyn Observer, phase: Phase) {
    observer.received(&session.drain());
    observer.progress(phase, 0.0);
}

/// Hands over what arrived, then the configurations that are in force from now on.
pub(super) fn tell_configs(
    session: &mut Session<'_>,
    observer: &mut dyn Observer,
    configs: &[UnitConfig; UNITS],
) {
    observer.received(&session.drain());
    observer.configured(configs);
}

/// Watches nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoopObserver;

impl Observer for NoopObserver {}
