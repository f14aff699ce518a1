//! Where the monitor's data come from: the service of a rig, or a session of the command's own.
//! Both give the same.

use super::model::Estimated;
use crate::cli::exit::Result;
use rig::Rig;
#[cfg(unix)]
use service::client::Notification;
#[cfg(unix)]
use service::protocol::{Call, Topics};
#[cfg(unix)]
use service::Client;
use session::telemetry::{Gatherer, Telemetry};
use session::{explain_fault, Session, SessionError, PERIOD};
use std::collections::VecDeque;
use std::time::Duration;
use wire::message::FaultReport;
use wire::{Command, UNITS};

/// Period of the telemetry of a session, ns of the link's time: that of the service.
const TELEMETRY_NS: u64 = 20_000_000;
/// How long a stop may take until the board has confirmed it.
#[cfg(unix)]
const STOP_TIMEOUT: Duration = Duration::from_secs(2);

/// What a source reports.
#[derive(Debug, Clone, PartialEq)]
pub enum Update {
    /// The state now.
    Telemetry(Box<Telemetry>),
    /// Something happened.
    Event(Event),
    /// What a model tells of the force.
    #[cfg_attr(not(feature = "estimate"), allow(dead_code))]
    Estimate(Estimated),
}

/// Something that happened: a fault, another commander, a link that is lost.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Event {
    /// Time of the link, s.
    pub t_s: f64,
    /// `fault`, `commander`, `stop`, `link`, `reset` or `job` (docs/service.md); with an estimate
    /// `misfit` and `robot`.
    pub kind: String,
    /// What happened.
    pub text: String,
    /// Number of the fault.
    pub fault: Option<u16>,
    /// Its unit, from 1; `None` for the whole board.
    pub unit: Option<u8>,
}

/// A rig that is watched.
pub trait Source {
    /// The next update; `None` where none came for some milliseconds.
    fn next(&mut self) -> Result<Option<Update>>;

    /// All motors to 0 V at once.
    fn stop(&mut self) -> Result<()>;
}

/// A rig's service.
#[cfg(unix)]
#[derive(Debug)]
pub struct ServiceSource {
    client: Client,
}

#[cfg(unix)]
impl ServiceSource {
    /// Subscribes to telemetry and events.
    pub fn new(mut client: Client) -> Result<Self> {
        client.call(Call::Subscribe(Topics {
            telemetry: true,
            events: true,
            ..Topics::default()
        }))?;
        Ok(Self { client })
    }
}

#[cfg(unix)]
impl Source for ServiceSource {
    fn next(&mut self) -> Result<Option<Update>> {
        Ok(match self.client.next(PERIOD)? {
            Some(Notification::Telemetry(telemetry)) => Some(Update::Telemetry(telemetry)),
            Some(Notification::Event(event)) => Some(Update::Event(Event {
                t_s: event.t_s,
                kind: event.kind,
                text: event.text,
                fault: event.fault,
                unit: event.unit,
            })),
            Some(Notification::Tick(_) | Notification::LinkLost(_) | Notification::Refused(_))
            | None => None,
        })
    }

    fn stop(&mut self) -> Result<()> {
        self.client.call_within(Call::Stop, STOP_TIMEOUT)?;
        Ok(())
    }
}

/// A session of this command.
#[derive(Debug)]
pub struct SessionSource<'s, 'l> {
    session: &'s mut Session<'l>,
    gatherer: Gatherer,
    waiting: VecDeque<Update>,
    due_ns: u64,
}

impl<'s, 'l> SessionSource<'s, 'l> {
    /// Asks the board for every sample.
    pub fn new(session: &'s mut Session<'l>, rig: &Rig) -> Result<Self> {
        session.command(&Command::Stream { decimation: 1 })?;
        Ok(Self {
            session,
            gatherer: Gatherer::new(Some(rig)),
            waiting: VecDeque::new(),
            due_ns: 0,
        })
    }

    fn advance(&mut self) -> Result<()> {
        match self.session.exchange(PERIOD) {
            Ok(()) => {}
            // The session has connected again.
            Err(error @ SessionError::Reset { .. }) => {
                self.gatherer.forget();
                self.session.command(&Command::Stream { decimation: 1 })?;
                self.event("reset", error.to_string(), None);
            }
            Err(error) => return Err(error.into()),
        }
        let now_ns = self.session.now_ns();
        let received = self.session.drain();
        for sample in &received.samples {
            self.gatherer.sample(now_ns, &sample.sample);
        }
        if let Some(truth) = received.truth.last() {
            self.gatherer.truth(truth);
        }
        if let Some(pose) = self.session.pose() {
            self.gatherer.pose(pose.position_m);
        }
        for fault in &received.faults {
            let (who, _) = who(fault);
            let text = format!("{who}: {}", explain_fault(fault.code, fault.detail));
            self.event("fault", text, Some(fault));
        }
        if now_ns >= self.due_ns {
            self.due_ns = now_ns + TELEMETRY_NS;
            self.read_configs_when_changed()?;
            let status = self.session.status().cloned();
            let mut telemetry = self
                .gatherer
                .telemetry(now_ns, status.as_ref(), "no status");
            let counters = self.session.counters();
            telemetry.drops.frames_lost = counters.frames_lost;
            telemetry.drops.frames_bad = counters.frames_bad;
            self.waiting
                .push_back(Update::Telemetry(Box::new(telemetry)));
        }
        Ok(())
    }

    fn read_configs_when_changed(&mut self) -> Result<()> {
        let Some(status) = self.session.status().cloned() else {
            return Ok(());
        };
        if self.gatherer.wants_configs(&status) {
            let configs = self.session.get_configs()?;
            self.gatherer.reading(&status);
            for (unit, config) in configs.iter().enumerate() {
                self.gatherer.config(unit as u8, config);
            }
        }
        Ok(())
    }

    fn event(&mut self, kind: &str, text: String, fault: Option<&FaultReport>) {
        self.waiting.push_back(Update::Event(Event {
            t_s: self.session.now_ns() as f64 * 1e-9,
            kind: kind.to_owned(),
            text,
            fault: fault.map(|fault| fault.code),
            unit: fault.and_then(|fault| who(fault).1),
        }));
    }
}

/// Who has a fault: in words, and the unit's number from 1.
fn who(fault: &FaultReport) -> (String, Option<u8>) {
    if usize::from(fault.unit) < UNITS {
        (format!("unit {}", fault.unit + 1), Some(fault.unit + 1))
    } else {
        ("board".to_owned(), None)
    }
}

impl Source for SessionSource<'_, '_> {
    fn next(&mut self) -> Result<Option<Update>> {
        if self.waiting.is_empty() {
            self.advance()?;
        }
        Ok(self.waiting.pop_front())
    }

    fn stop(&mut self) -> Result<()> {
        self.session.command(&Command::Stop)?;
        Ok(())
    }
}
