//! Requests of clients, and their answers.

use super::clients::Waiter;
use super::{Hub, Origin};
use crate::inbound::{ClientId, JobReport, TERMINAL};
use crate::job::{self, Kind};
use crate::protocol::{
    self, code, Call, ClientStatus, Hello, Request, ServiceStatus, Welcome, VERSION,
};
use base64::prelude::{Engine as _, BASE64_STANDARD};
use serde_json::{json, Value};
use session::link::LinkError;
use session::{explain_refusal, LatchedFault};
use std::sync::atomic::Ordering;
use wire::message::{Response, Status};
use wire::Command;

/// The fault that a status shows, in words: the board's, else that of a unit.
fn latched(status: &Status) -> Option<String> {
    LatchedFault::all_of(status)
        .next()
        .map(|fault| fault.to_string())
}

/// How long motors may take to 0 V, ns of the link's time.
const DISARM_NS: u64 = 3_000_000_000;

impl Hub {
    /// Carries out a request.
    pub(super) fn call(&mut self, id: ClientId, request: Request) {
        let Request { id: number, call } = request;
        let known = self
            .clients
            .get(&id)
            .is_some_and(|client| client.hello.is_some());
        let number = number.as_ref();
        match call {
            Call::Hello(hello) => self.hello(id, number, hello),
            _ if !known => self.fail(id, number, code::HELLO, "the first request is `hello`"),
            // Nobody to send them to; the client has been told.
            Call::Bytes(_) if self.link.is_none() => {}
            Call::Bytes(text) => match BASE64_STANDARD.decode(text) {
                Ok(bytes) => self.client_bytes(id, &bytes),
                Err(error) => self.fail(id, number, code::INVALID, &format!("no base64: {error}")),
            },
            Call::Subscribe(topics) => {
                if let Some(client) = self.clients.get_mut(&id) {
                    client.topics = topics;
                }
                self.succeed(id, number, json!({}));
            }
            Call::Status => {
                let status = serde_json::to_value(self.service_status()).unwrap_or_default();
                self.succeed(id, number, status);
            }
            Call::Shutdown => {
                self.succeed(id, number, json!({}));
                self.ending = true;
            }
            _ if self.link.is_none() => self.fail(
                id,
                number,
                code::LINK,
                &format!(
                    "{} is gone; a board without setpoints goes to 0 V by itself",
                    self.link_name
                ),
            ),
            call => self.command(id, number, call),
        }
    }

    /// Requests that need the link.
    fn command(&mut self, id: ClientId, number: Option<&Value>, call: Call) {
        match call {
            Call::Stop => {
                self.note_stop(id);
                self.send(Origin::Call(id, number.cloned()), Command::Stop);
            }
            Call::Release => {
                if self.commander == Some(id) {
                    let why = format!("{} commands no more", self.name_of(id));
                    self.release(&why);
                }
                self.succeed(id, number, json!({}));
            }
            Call::Command(how) => match self.make_commander(id) {
                Ok(()) => {
                    self.commander_tests = how.tests;
                    self.succeed(id, number, json!({}));
                }
                Err(other) => self.busy(id, number, &other),
            },
            Call::Disarm => self.disarm(id, number),
            Call::Clear => match self.make_commander_to_clear(id) {
                Ok(()) => self.send(Origin::Call(id, number.cloned()), Command::ClearFaults),
                Err(other) => self.busy(id, number, &other),
            },
            Call::Hold(hold) => self.start_job(id, number, Kind::Hold(hold)),
            Call::SetForce(force) => self.start_job(id, number, Kind::SetForce(force)),
            Call::Robot { .. } | Call::Inject { .. } | Call::Report => {
                let done = self.control(call);
                self.answer(id, number, done);
            }
            // Answered before.
            Call::Hello(_)
            | Call::Bytes(_)
            | Call::Subscribe(_)
            | Call::Status
            | Call::Shutdown => {}
        }
    }

    fn hello(&mut self, id: ClientId, number: Option<&Value>, hello: Hello) {
        if hello.version != VERSION {
            let text = format!(
                "this service speaks version {VERSION}, {} version {}; use a forcectl of one checkout for both",
                hello.client, hello.version
            );
            return self.fail(id, number, code::HELLO, &text);
        }
        if !self.may_enter(id, &hello) {
            self.fail(
                id,
                number,
                code::HELLO,
                "the token is missing or wrong; it stands in the file given to `forcectl serve --token-file`",
            );
            if let Some(client) = self.clients.get(&id) {
                client.outbox.close();
            }
            return;
        }
        let (stops, stopped_by) = self.stops.of_others(&hello.name());
        let welcome = Welcome {
            version: VERSION,
            name: self.setup.name.clone(),
            link: self.link_name.clone(),
            pid: std::process::id(),
            seed: self.seed,
            board: self.info.clone(),
            rig_file: self.setup.rig_file.0.clone(),
            rig_text: self.setup.rig_file.1.clone(),
            now_ns: self.now_ns,
            terminal: self.terminal.as_ref().map(|t| t.path().to_owned()),
            stops,
            stopped_by,
        };
        if let Some(client) = self.clients.get_mut(&id) {
            client.hello = Some(hello);
        }
        self.succeed(
            id,
            number,
            serde_json::to_value(welcome).unwrap_or_default(),
        );
    }

    fn service_status(&self) -> ServiceStatus {
        ServiceStatus {
            now_ns: self.now_ns,
            linked: self.link.is_some(),
            board: self.status.clone(),
            state: self.state_name(),
            commander: self.commander.map(|id| self.name_of(id)),
            clients: self
                .clients
                .iter()
                .filter(|(id, _)| **id != TERMINAL)
                .map(|(_, client)| ClientStatus {
                    name: client.name(),
                    dropped: client.outbox.dropped(),
                })
                .collect(),
            frames_bad: self.frames_bad,
        }
    }

    /// Ends the job, or disarms a board that nobody commands; answers when the motors are at 0 V.
    fn disarm(&mut self, id: ClientId, number: Option<&Value>) {
        match (&self.job, self.other_commander(id)) {
            (Some(job), _) => job.stop.store(true, Ordering::SeqCst),
            (None, Some(other)) => {
                let name = self.name_of(other);
                return self.busy(id, number, &name);
            }
            _ => {
                if self.drives() {
                    self.send(Origin::Hub, Command::Disarm);
                }
            }
        }
        self.waiting.push(Waiter {
            id,
            request: number.cloned(),
            after_ns: self.now_ns,
            until_ns: self.now_ns + DISARM_NS,
        });
    }

    fn start_job(&mut self, id: ClientId, number: Option<&Value>, kind: Kind) {
        // A client that holds the role passes it to its job.
        if self.commander == Some(id) {
            self.commander = None;
        }
        if let Some(job) = &self.job {
            // Its motors may be at 0 V already: it watches for a while whether they let go.
            let ending = job.stop.load(Ordering::SeqCst);
            if ending && self.next_job.is_none() {
                self.next_job = Some((id, number.cloned(), kind));
                return;
            }
            return self.busy(id, number, "a job of the service");
        }
        if let Some(other) = self.other_commander(id) {
            let name = self.name_of(other);
            return self.busy(id, number, &name);
        }
        let changes = match self.changes() {
            Ok(changes) => changes,
            Err(why) => return self.fail(id, number, code::EXCHANGED, &why),
        };
        if let Some(why) = changes.refusal() {
            return self.fail(id, number, code::EXCHANGED, &why);
        }
        if let Some(words) = changes.notice() {
            self.event("job", words, None);
        }
        self.jobs += 1;
        let order = job::Order {
            kind,
            for_client: id,
            request: number.cloned(),
            name: self.name_of(id),
            rig_file: self.setup.rig_file.clone(),
            board: changes.board,
            number: self.jobs,
        };
        match job::start(order, &self.sender) {
            Ok(running) => self.job = Some(running),
            Err(error) => self.fail(id, number, code::JOB, &error.to_string()),
        }
    }

    pub(super) fn job_reports(&mut self, report: JobReport) {
        if report.ended {
            self.job.take_if(|job| job.number == report.number);
            let text = match &report.result {
                Ok(_) => format!("{} has ended", report.name),
                Err((_, error)) => format!("{} has ended: {error}", report.name),
            };
            self.event("job", text, None);
        } else {
            if let Some(job) = self.job.as_mut().filter(|job| job.number == report.number) {
                job.holds = true;
            }
            self.event("job", format!("{} holds", report.name), None);
        }
        if let Some((id, number)) = report.answer {
            self.answer(id, number.as_ref(), report.result);
        }
        if self.job.is_none() {
            if let Some((id, number, kind)) = self.next_job.take() {
                self.start_job(id, number.as_ref(), kind);
            }
        }
    }

    /// Controls of an emulated rig.
    fn control(&mut self, call: Call) -> Result<Value, (i64, String)> {
        let refused = |error: LinkError| (code::UNSUPPORTED, error.to_string());
        let Some(controls) = self.link.as_mut().and_then(|link| link.controls()) else {
            return Err((
                code::UNSUPPORTED,
                "this is a board and not the embedded rig; nothing can be injected, moved or looked into".to_owned(),
            ));
        };
        match call {
            Call::Robot { moving } => controls.robot(moving).map_err(refused)?,
            Call::Inject { what } => {
                let injection =
                    session::inject::parse_now(&what).map_err(|error| (code::INVALID, error))?;
                controls.inject(injection).map_err(refused)?;
            }
            Call::Report => {
                let report = controls.report().map_err(refused)?;
                let bytes = postcard::to_stdvec(&report)
                    .map_err(|error| (code::UNSUPPORTED, error.to_string()))?;
                return Ok(json!({"report": BASE64_STANDARD.encode(bytes)}));
            }
            _ => {}
        }
        Ok(json!({}))
    }

    /// The board replied to a client's request.
    pub(super) fn call_replied(
        &mut self,
        id: ClientId,
        number: Option<Value>,
        command: &Command,
        response: Response,
    ) {
        // Clearing is one request and no reason to keep the role.
        if *command == Command::ClearFaults && self.commander == Some(id) {
            self.commander = None;
        }
        let result = match response {
            Response::Rejected(refusal) => Err((code::REFUSED, explain_refusal(command, &refusal))),
            // The newest status may be of the time before.
            Response::Done if *command == Command::ClearFaults => {
                return self.send(Origin::Call(id, number), Command::GetStatus);
            }
            Response::Status(status) => Ok(json!({"fault": latched(&status)})),
            _ => Ok(json!({"fault": self.status.as_ref().and_then(latched)})),
        };
        self.answer(id, number.as_ref(), result);
    }

    fn answer(&self, id: ClientId, number: Option<&Value>, result: Result<Value, (i64, String)>) {
        if let (Some(number), Some(client)) = (number, self.clients.get(&id)) {
            client.outbox.line(protocol::answer(number, &result));
        }
    }

    pub(super) fn succeed(&self, id: ClientId, number: Option<&Value>, result: Value) {
        self.answer(id, number, Ok(result));
    }

    pub(super) fn fail(&self, id: ClientId, number: Option<&Value>, code: i64, text: &str) {
        self.answer(id, number, Err((code, text.to_owned())));
    }

    fn busy(&self, id: ClientId, number: Option<&Value>, other: &str) {
        let end = if self.job.is_some() {
            "`forcectl disarm` ends it"
        } else {
            "end it there first"
        };
        let text = format!(
            "{other} commands this rig; {end}, or use `forcectl stop`, which works from every terminal"
        );
        self.fail(id, number, code::BUSY, &text);
    }
}
