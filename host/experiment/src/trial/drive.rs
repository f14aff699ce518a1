//! The course of a trial: prepare, wait for the robot, arm, follow the profile, ramp down.

use super::super::dataset::Joiner;
use super::super::feed::{Feed, Tamper};
use super::super::file::ControlPath;
use super::super::pull::{Pulled, Puller};
use super::super::raven::{RavenLoop, RAVEN_CYCLE};
use super::{robot_gone, tip_of, End, Run, Setup};
use force::controller::{ControlError, Input};
use force::metrics::Step;
use force::preview::Moment;
use nalgebra::Vector3;
use robot::source::SourceConfig;
use robot::state::{Acts, Frame, Meaning, Operating, TipForce};
use robot::watch::Event;
use run::{
    ramp_down_and_disarm, ready_board, tell_of_friction, Observer, Phase, Prepared, RunError,
};
use session::link::RigLink;
use session::{Session, PERIOD};
use std::sync::atomic::Ordering;
use wire::message::UnitSetpoint;
use wire::{Command, UNITS};

/// How long the cables are tensioned before the robot moves, s.
const PRETENSION_S: f64 = 1.5;
/// How long the robot moves before the force profile begins, s.
const ROBOT_START_S: f64 = 1.5;
/// How long the first state of the robot may take, s.
const FIRST_STATE_S: f64 = 5.0;

/// Cycles after the end of a trial whose samples are taken: 20 ms, while the setpoints are valid.
const LAST_CYCLES: u32 = 2;

impl Run<'_> {
    pub(super) fn drive(
        &mut self,
        link: &mut dyn RigLink,
        tamper: Option<Tamper>,
    ) -> Result<(), End> {
        let robot = &self.setup.experiment.robot;
        let trajectory = self.setup.trial.trajectory.as_ref();
        // Before anything is driven: a source that can't be opened must not leave cables under
        // tension.
        let mut feed =
            Feed::open(robot, link, trajectory, tamper).map_err(|error| robot_gone(&error))?;
        self.log.progress(Phase::Connect, 0.0);
        let mut session = Session::connect(link)?;
        self.shown.firmware = session
            .info()
            .map_or_else(String::new, |info| info.version.as_str().to_owned());
        let setup = self.setup;
        let prepared = ready_board(
            &mut session,
            setup.rig,
            setup.zeroing,
            &setup.stop,
            &mut self.log,
        )?;
        self.shown.config_crc = prepared.config_crc;
        for (unit, settings) in setup.rig.units.iter().enumerate() {
            if settings.enabled && !prepared.available[unit] {
                return Err(End::Stopped(format!(
                    "unit {} is not ready; see the notices and `forcectl status`",
                    settings.number
                )));
            }
        }
        self.wait_for_robot(&mut session, &mut feed)?;
        let mut path = LoopAt::new(setup, &prepared)?;
        let ended = match feed.publish_operating(Operating::Enabled) {
            Ok(()) => self.hold(&mut session, &mut feed, &prepared, &mut path),
            Err(error) => Err(robot_gone(&error)),
        };
        let ended = ended.map_err(|end| match (end, session.link().stopped_by()) {
            (End::ByOther(fault), Some(who)) => End::ByOther(format!("stopped by {who}: {fault}")),
            (end, _) => end,
        });
        path.end(&mut session);
        self.log.progress(Phase::Disarm, 0.0);
        let disarmed = ramp_down_and_disarm(&mut session, &prepared.available);
        self.shown.disarmed = disarmed.is_ok();
        if !self.shown.disarmed {
            session.make_safe();
        }
        let ended = ended.and_then(|()| disarmed.map_err(|error| End::Stopped(error.to_string())));
        let state = match (&ended, self.shown.disarmed) {
            (Err(End::Stopped(_) | End::ByOther(_)), _) | (_, false) => Operating::Fault,
            _ => Operating::Disabled,
        };
        // Where the robot's side is gone, nobody is left to be told.
        let _ = feed.publish_operating(state);
        // Samples that were on their way belong to the last rows.
        let received = session.drain();
        self.take(&received);
        if let Some(joiner) = &mut self.joiner {
            joiner.join(self.now_board_s, true);
        }
        self.shown.counts.link(session.counters());
        // Its wait belongs to no row.
        if !self.shown.disarmed {
            tell_of_friction(&mut session, setup.rig, &mut self.log);
        }
        ended
    }

    /// Waits for a usable state before anything is armed. What came during the preparation is old.
    fn wait_for_robot(&mut self, session: &mut Session<'_>, feed: &mut Feed) -> Result<(), End> {
        let began_ns = session.now_ns();
        // What came last: a cause before a silence, which is only what follows from it.
        let mut why: Option<Event> = None;
        let mut old = feed.poll(session.link(), began_ns).unwrap_or_default();
        loop {
            session.exchange(PERIOD)?;
            let now_ns = session.now_ns();
            let fresh = feed
                .poll(session.link(), now_ns)
                .map_err(|error| robot_gone(&error))?;
            let old = std::mem::take(&mut old.poll.events);
            for event in old.iter().chain(&fresh.poll.events) {
                if matches!(event, Event::LeftOut(_)) {
                    self.note_event(event, "before arming");
                }
            }
            let received = session.drain();
            self.log.received(&received);
            self.newest =
                (fresh.poll.states.iter().rev()).find_map(|state| tip_of(&fresh.poll, state));
            for event in fresh.poll.events {
                let is_cause = !matches!(event, Event::Silent { .. } | Event::LeftOut(_));
                if why.is_none() || is_cause {
                    why = Some(event);
                }
            }
            if self.newest.is_some() {
                return Ok(());
            }
            let waited_s = (now_ns - began_ns) as f64 * 1e-9;
            if waited_s > FIRST_STATE_S {
                let why = why.map_or_else(String::new, |event| format!(": {event}"));
                return Err(End::Stopped(format!(
                    "no usable state of the robot within {FIRST_STATE_S} s from {}{why}; nothing was armed",
                    feed.name()
                )));
            }
            if self.setup.stop.load(Ordering::Relaxed) {
                return Err(End::Interrupted);
            }
        }
    }

    /// Arms and follows the profile.
    fn hold(
        &mut self,
        session: &mut Session<'_>,
        feed: &mut Feed,
        prepared: &Prepared,
        path: &mut LoopAt,
    ) -> Result<(), End> {
        let setup = self.setup;
        let mut puller = Puller::new(setup.rig, &setup.experiment.force)?;
        path.begin(session)?;
        let lead_s = PRETENSION_S + ROBOT_START_S;
        let start_ns = session.now_ns() + (lead_s * 1e9) as u64;
        self.commanded_since_ns = Some(start_ns);
        let mut moving = false;
        loop {
            let t_s = (session.now_ns() as f64 - start_ns as f64) * 1e-9;
            if t_s >= setup.experiment.trial_s() {
                // The last rows need samples from after them, which the cell's filter and the link
                // delay.
                for _ in 0..LAST_CYCLES {
                    session.exchange(PERIOD)?;
                    let received = session.drain();
                    self.take(&received);
                }
                return Ok(());
            }
            if setup.stop.load(Ordering::Relaxed) {
                return Err(End::Interrupted);
            }
            if !moving && t_s >= -ROBOT_START_S {
                moving = true;
                self.move_robot(session)?;
            }
            if self.joiner.is_none() && t_s >= 0.0 {
                self.begin_rows(prepared, start_ns);
            }
            let pulled = self.pull(session, &mut puller, prepared, t_s)?;
            path.pass(session, pulled.1.setpoints)?;
            self.note_cycle(session, feed, &pulled, t_s)?;
            self.receive(session, feed, t_s)?;
            if let Some(error) = &self.file_error {
                return Err(End::Stopped(error.to_string()));
            }
            let phase = if t_s < -ROBOT_START_S {
                Phase::Tension
            } else if t_s < 0.0 {
                Phase::StartRobot
            } else {
                Phase::Hold
            };
            if let Some(recorder) = &mut self.log.recorder {
                recorder.phase(phase);
            }
            self.log
                .watcher
                .progress(self.log.trial, phase, t_s.max(0.0));
        }
    }

    fn move_robot(&self, session: &mut Session<'_>) -> Result<(), End> {
        if matches!(self.setup.experiment.robot, SourceConfig::Virtual(_)) {
            if let Some(controls) = session.link().controls() {
                controls.robot(true)?;
            }
        }
        Ok(())
    }

    fn begin_rows(&mut self, prepared: &Prepared, start_ns: u64) {
        let start_s = self.log.clocks.board_s(start_ns as f64 * 1e-9);
        let setup = self.setup;
        self.joiner = Some(Joiner::new(
            setup.rig,
            &prepared.configs,
            start_s,
            setup.trial.number,
            setup.folder.attempt,
        ));
    }

    /// Computes setpoints from what is known now.
    fn pull(
        &self,
        session: &Session<'_>,
        puller: &mut Puller,
        prepared: &Prepared,
        t_s: f64,
    ) -> Result<(Input, Pulled), End> {
        let (tip_m, at_ns) = self
            .newest
            .ok_or_else(|| End::Stopped("the robot's tip is not known".to_owned()))?;
        let input = Input {
            dt_s: PERIOD.as_secs_f64(),
            tip_m,
            // While a cable's slack is taken up its reel turns as no robot makes it.
            moment: at_ns.filter(|_| t_s >= -ROBOT_START_S).map(|at_ns| Moment {
                tip_s: at_ns as f64 * 1e-9,
                now_s: session.now_ns() as f64 * 1e-9,
            }),
            tension_n: session.recent_tension_n(),
            available: prepared.available,
            commanded_n: if t_s >= 0.0 {
                self.setup.trial.profile.at(t_s)
            } else {
                Vector3::zeros()
            },
        };
        let pulled = puller.step(&input).map_err(|error: ControlError| {
            End::Stopped(format!("no setpoints at {t_s:.2} s: {error}"))
        })?;
        Ok((input, pulled))
    }

    /// Counts, records and publishes a cycle.
    fn note_cycle(
        &mut self,
        session: &Session<'_>,
        feed: &mut Feed,
        (input, pulled): &(Input, Pulled),
        t_s: f64,
    ) -> Result<(), End> {
        let measured = input.tension_n.map(|tension| tension.unwrap_or(f64::NAN));
        if t_s >= 0.0 {
            self.shown.counts.cycle(&measured, &pulled.tension_n, t_s);
        }
        let step = Step {
            t_s,
            tip_m: input.tip_m,
            commanded_n: input.commanded_n,
            estimated_n: pulled.applied_n,
            applied_n: None,
            tension_setpoint_n: pulled.tension_n,
            measured_tension_n: measured.map(|t| if t.is_nan() { 0.0 } else { t }),
            true_tension_n: None,
            available: input.available,
        };
        if let Some(recorder) = &mut self.log.recorder {
            recorder.cycle_at(&step, session.now_ns());
        }
        publish(feed, input, pulled)
    }
}

/// Tells the robot's side the force that the rig applies, and the one that it aims at.
fn publish(feed: &mut Feed, input: &Input, pulled: &Pulled) -> Result<(), End> {
    let on_tool = |meaning, force_n: Vector3<f64>| TipForce {
        frame: Frame::Rig,
        acts: Acts::OnTool,
        meaning,
        force_n: force_n.into(),
        torque_n_m: None,
    };
    feed.publish(
        &on_tool(Meaning::Measured, pulled.applied_n),
        &on_tool(Meaning::Commanded, input.commanded_n),
    )
    .map_err(|error| robot_gone(&error))
}

/// Where the tension loops run.
enum LoopAt {
    Board,
    Host {
        raven: Box<RavenLoop>,
        transport_ms: u32,
    },
}

impl LoopAt {
    fn new(setup: &Setup<'_>, prepared: &Prepared) -> Result<Self, RunError> {
        Ok(match setup.experiment.path {
            ControlPath::Board => Self::Board,
            ControlPath::Raven => Self::Host {
                raven: Box::new(RavenLoop::new(setup.rig, &prepared.configs)?),
                transport_ms: setup.experiment.transport_ms(),
            },
        })
    }

    /// Before the first setpoints.
    fn begin(&self, session: &mut Session<'_>) -> Result<(), End> {
        match self {
            Self::Board => {
                session.command(&Command::Arm)?;
                Ok(())
            }
            // The board stays disarmed. A link without this way to the amplifiers refuses here.
            Self::Host { .. } => drive(session, [0.0; UNITS]),
        }
    }

    /// Lets a period pass with these setpoints.
    fn pass(
        &mut self,
        session: &mut Session<'_>,
        setpoints: [UnitSetpoint; UNITS],
    ) -> Result<(), End> {
        let (raven, transport_ms) = match self {
            Self::Board => {
                return Ok(session.send_setpoints(setpoints, PERIOD)?);
            }
            Self::Host {
                raven,
                transport_ms,
            } => (raven, *transport_ms),
        };
        raven.set(setpoints);
        let mut seen = session.undrained_samples().len();
        for _ in 0..PERIOD.as_millis() / RAVEN_CYCLE.as_millis() {
            session.exchange(RAVEN_CYCLE)?;
            let fresh = session.undrained_samples()[seen..].to_vec();
            seen += fresh.len();
            raven.cycle(session, &fresh, transport_ms)?;
        }
        Ok(())
    }

    /// After the last setpoints, however the trial ended: no torque.
    fn end(&self, session: &mut Session<'_>) {
        if matches!(self, Self::Host { .. }) {
            // Only where `begin` was refused; nothing was driven then.
            let _ = drive(session, [0.0; UNITS]);
        }
    }
}

/// Voltages at the amplifiers, from outside of the board.
fn drive(session: &mut Session<'_>, volts: [f64; UNITS]) -> Result<(), End> {
    match session.link().controls() {
        Some(controls) => Ok(controls.drive_outside(Some(volts))?),
        None => Err(End::Stopped(
            "path = \"raven\" needs a rig that takes torques from the host: a virtual one (`--link fast`)".to_owned(),
        )),
    }
}
