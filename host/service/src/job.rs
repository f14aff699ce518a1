//! What the service does by itself on behalf of a client: hold tensions, or a force.
//!
//! A job is a client like any other, in a thread of its own: the hub treats its frames as those of
//! a commander.

use super::client::{Client, ServiceLink};
use super::connection;
use super::inbound::{next_id, ClientId, Inbound, JobReport};
use super::protocol::{code, ForceParams, Hello, HoldParams};
use known::base;
use known::ZeroStore;
use rig::Rig;
use run::{hold_tensions, set_force, NoopObserver, Options, RunError, TensionOptions, Zeroing};
use serde_json::{json, Value};
use session::link::of_board::OfBoard;
use session::link::RigLink;
use session::SessionError;
use std::io;
use std::os::unix::net::UnixStream;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::Sender;
use std::sync::Arc;

/// What to do.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Kind {
    /// Hold tensions until `disarm`.
    Hold(HoldParams),
    /// Hold a force for some time.
    SetForce(ForceParams),
}

/// An order of a client.
pub(super) struct Order {
    pub kind: Kind,
    pub for_client: ClientId,
    /// Number of the request, for the answer.
    pub request: Option<Value>,
    /// Name of the client.
    pub name: String,
    /// Name and text of the rig file.
    pub rig_file: (String, String),
    /// Number of the board that was tested: the service may not know yet which one is there.
    pub board: Option<String>,
    /// Number of the job, for its client number.
    pub number: u64,
}

/// A job that runs.
pub(super) struct Running {
    /// Ends it.
    pub stop: Arc<AtomicBool>,
    /// Number of the job.
    pub number: u64,
    /// The client that asked for it.
    pub for_client: ClientId,
    /// Whether it holds already.
    pub holds: bool,
    /// Whether it outlives its client then.
    stays: bool,
}

impl Running {
    /// Whether it ends when its client goes away: nobody would get a force's result, and a hold
    /// that has not answered yet may not be wanted any more.
    pub(super) fn ends_with_client(&self) -> bool {
        !(self.stays && self.holds)
    }
}

/// Starts a job.
///
/// # Errors
/// Those of the operating system.
pub(super) fn start(order: Order, hub: &Sender<Inbound>) -> io::Result<Running> {
    let (ours, hubs) = UnixStream::pair()?;
    connection::start(hubs, next_id(), true, hub)?;
    let stop = Arc::new(AtomicBool::new(false));
    let running = Running {
        stop: Arc::clone(&stop),
        number: order.number,
        for_client: order.for_client,
        holds: false,
        stays: matches!(&order.kind, Kind::Hold(hold) if !hold.ends_with_client),
    };
    let to_hub = hub.clone();
    std::thread::Builder::new()
        .name(format!("job {}", order.number))
        .spawn(move || {
            let what = match order.kind {
                Kind::Hold(_) => "hold",
                Kind::SetForce(_) => "set_force",
            };
            let name = format!("the service's {what} for {}", order.name);
            let mut answer = Some((order.for_client, order.request.clone()));
            let holding = |answer: &mut Option<_>| {
                let _ = to_hub.send(Inbound::Job(JobReport {
                    number: order.number,
                    name: name.clone(),
                    ended: false,
                    answer: answer.take(),
                    result: Ok(json!({"holding": true})),
                }));
            };
            let result = run(&order, ours, &name, &stop, &mut || holding(&mut answer));
            let _ = to_hub.send(Inbound::Job(JobReport {
                number: order.number,
                name,
                ended: true,
                answer,
                result,
            }));
        })?;
    Ok(running)
}

fn run(
    order: &Order,
    stream: UnixStream,
    name: &str,
    stop: &Arc<AtomicBool>,
    holding: &mut dyn FnMut(),
) -> Result<Value, (i64, String)> {
    let words = |error: &dyn std::fmt::Display| (code::JOB, error.to_string());
    let failed = |error: RunError| match error {
        RunError::Session(SessionError::OtherBoard { .. }) => (code::EXCHANGED, error.to_string()),
        _ => words(&error),
    };
    let (file, text) = &order.rig_file;
    let rig = Rig::parse(file, text).map_err(|error| words(&error))?;
    let client =
        Client::over(stream, &rig.name, Hello::nameless(name)).map_err(|error| words(&error))?;
    let seed = client.welcome().seed;
    let rig = base::with_calibration(rig, seed).map_err(|error| words(&error))?;
    let store = store(&rig, seed);
    let link = ServiceLink::commander(client).map_err(|error| words(&error))?;
    let mut link: Box<dyn RigLink> = match &order.board {
        Some(number) => Box::new(OfBoard::new(Box::new(link), number.clone())),
        None => Box::new(link),
    };
    match &order.kind {
        Kind::Hold(hold) => {
            let options = TensionOptions {
                tension_n: hold.tension_n,
                duration_s: None,
                zeroing: Zeroing::Keep(store),
                stop: Arc::clone(stop),
            };
            let link = link.as_mut();
            let held =
                hold_tensions(link, &rig, &options, &mut NoopObserver, holding).map_err(failed)?;
            serde_json::to_value(held).map_err(|error| words(&error))
        }
        Kind::SetForce(force) => {
            let options = Options {
                zeroing: Zeroing::Keep(store),
                stop: Arc::clone(stop),
                ..Options::new(force.force_n, force.duration_s)
            };
            let outcome =
                set_force(link.as_mut(), &rig, &options, &mut NoopObserver).map_err(failed)?;
            serde_json::to_value(outcome).map_err(|error| words(&error))
        }
    }
}

/// Where the zeros of a rig are stored: nowhere for an emulated one, which is another one each
/// time.
#[must_use]
pub(super) fn store(rig: &Rig, seed: Option<u64>) -> ZeroStore {
    if seed.is_some() {
        ZeroStore::none()
    } else {
        ZeroStore::of_rig(&rig.name)
    }
}
