//! A client of the service, and the service as a link: what runs on a port runs on a rig that
//! others watch.

use super::protocol::{
    self, Call, CommandParams, Event, Hello, HoldParams, Request, ServiceStatus, Telemetry, Tick,
    Topics, Welcome, STOPPED_BY,
};
use super::socket;
use base64::prelude::{Engine as _, BASE64_STANDARD};
use emulator_link::{Injection, Report};
use serde_json::Value;
use session::link::{Exchange, LinkError, RigControls, RigLink};
use std::collections::VecDeque;
use std::io::{BufRead, BufReader, ErrorKind, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

/// How long an answer may take.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(10);
/// How long giving back the commander's role may take.
const RELEASE_TIMEOUT: Duration = Duration::from_millis(500);
/// How long the service may send no tick before it counts as gone.
const TICK_TIMEOUT: Duration = Duration::from_secs(3);
/// Longest single wait for a line. Time in which this process did not run (Ctrl-Z, a computer that
/// sleeps) counts as one at most: the service is not silent because nobody listened.
const WAIT_SLICE: Duration = Duration::from_millis(100);
/// Why a service can't be used.
#[derive(Debug, thiserror::Error)]
pub enum ServiceError {
    /// No service listens for this rig.
    #[error("rig `{name}` is not running ({}); `forcectl rig` starts an emulated one, `--link usb` or `--link serial:PORT` names a board", if running.is_empty() { "no rig is".to_owned() } else { format!("running: {}", running.join(", ")) })]
    NotRunning {
        /// The rig.
        name: String,
        /// Rigs whose service answers.
        running: Vec<String>,
    },
    /// Its service does not listen yet.
    #[error(
        "rig `{name}` is being brought up; try again when its terminal says that it is served"
    )]
    Starting {
        /// The rig.
        name: String,
    },
    /// The connection broke.
    #[error("the service of rig `{name}` can't be reached: {cause}; a board without setpoints goes to 0 V within 100 ms")]
    Io {
        /// The rig.
        name: String,
        /// The operating system's words.
        cause: String,
    },
    /// The service refused a request.
    #[error("{message}")]
    Refused {
        /// Number of the error ([`super::protocol::code`]).
        code: i64,
        /// What it said.
        message: String,
    },
}

impl From<ServiceError> for LinkError {
    fn from(error: ServiceError) -> Self {
        match error {
            ServiceError::Refused { code, message } if code != protocol::code::LINK => {
                Self::NotAllowed(message)
            }
            error => Self::Service(error.to_string()),
        }
    }
}

/// A notification.
#[derive(Debug, Clone, PartialEq)]
pub enum Notification {
    /// See [`Tick`].
    Tick(Box<Tick>),
    /// See [`Telemetry`].
    Telemetry(Box<Telemetry>),
    /// See [`Event`].
    Event(Event),
    /// The link of the service was lost: why.
    LinkLost(String),
    /// The service has refused a frame of this client: why.
    Refused(String),
}

enum Line {
    Answer(Value),
    Notification(Notification),
}

/// A connection to a service.
#[derive(Debug)]
pub struct Client {
    name: String,
    writer: UnixStream,
    lines: Receiver<Line>,
    waiting: VecDeque<Notification>,
    next_id: u64,
    welcome: Welcome,
}

impl Client {
    /// Connects to the service of a rig. `client` is this program's name for others.
    ///
    /// # Errors
    /// No service answers, or one of another version.
    pub fn connect(name: &str, client: &str) -> Result<Self, ServiceError> {
        let path = socket::of(name).map_err(|error| ServiceError::Io {
            name: name.to_owned(),
            cause: error.to_string(),
        })?;
        Self::connect_at(&path, name, client)
    }

    /// Connects to the service that listens on this socket.
    ///
    /// # Errors
    /// As [`Client::connect`].
    pub fn connect_at(path: &Path, name: &str, client: &str) -> Result<Self, ServiceError> {
        let failed = |error: std::io::Error| ServiceError::Io {
            name: name.to_owned(),
            cause: error.to_string(),
        };
        let stream = UnixStream::connect(path).map_err(|error| match error.kind() {
            ErrorKind::NotFound if socket::is_reserved(path) => ServiceError::Starting {
                name: name.to_owned(),
            },
            ErrorKind::NotFound | ErrorKind::ConnectionRefused => ServiceError::NotRunning {
                name: name.to_owned(),
                running: socket::running(),
            },
            _ => failed(error),
        })?;
        Self::over(stream, name, Hello::of_this_process(client))
    }

    /// Uses a stream that is connected already.
    pub(super) fn over(stream: UnixStream, name: &str, hello: Hello) -> Result<Self, ServiceError> {
        let failed = |error: std::io::Error| ServiceError::Io {
            name: name.to_owned(),
            cause: error.to_string(),
        };
        let reader = stream.try_clone().map_err(failed)?;
        let (sender, lines) = std::sync::mpsc::channel();
        std::thread::Builder::new()
            .name("service".to_owned())
            .spawn(move || {
                for line in BufReader::new(reader).lines().map_while(Result::ok) {
                    if let Some(line) = parse(&line) {
                        if sender.send(line).is_err() {
                            return;
                        }
                    }
                }
            })
            .map_err(failed)?;
        let mut connected = Self {
            name: name.to_owned(),
            writer: stream,
            lines,
            waiting: VecDeque::new(),
            next_id: 0,
            welcome: Welcome::default(),
        };
        let welcome = connected.call(Call::Hello(hello))?;
        connected.welcome = serde_json::from_value(welcome)
            .map_err(|error| connected.broken(&format!("its answer to hello: {error}")))?;
        Ok(connected)
    }

    fn broken(&self, cause: &str) -> ServiceError {
        ServiceError::Io {
            name: self.name.clone(),
            cause: cause.to_owned(),
        }
    }

    /// The service's answer to hello.
    #[must_use]
    pub fn welcome(&self) -> &Welcome {
        &self.welcome
    }

    /// Sends a request without waiting for an answer.
    ///
    /// # Errors
    /// The connection is gone.
    pub fn send(&mut self, call: Call, id: Option<u64>) -> Result<(), ServiceError> {
        let request = Request {
            id: id.map(Value::from),
            call,
        };
        let line = request.to_line();
        self.writer
            .write_all(line.as_bytes())
            .map_err(|error| self.broken(&error.to_string()))
    }

    /// Sends a request and waits for its answer, 10 s at most.
    ///
    /// # Errors
    /// The service refused it or is gone.
    pub fn call(&mut self, call: Call) -> Result<Value, ServiceError> {
        self.call_within(call, ANSWER_TIMEOUT)
    }

    /// The same with another timeout.
    ///
    /// # Errors
    /// As [`Client::call`].
    pub fn call_within(&mut self, call: Call, timeout: Duration) -> Result<Value, ServiceError> {
        self.next_id += 1;
        let id = self.next_id;
        self.send(call, Some(id))?;
        let mut left = timeout;
        loop {
            match self.line(&mut left)? {
                Some(Line::Notification(notification)) => self.waiting.push_back(notification),
                Some(Line::Answer(mut answer)) => {
                    if answer["id"] != id {
                        continue;
                    }
                    if let Some(error) = answer.get("error") {
                        return Err(ServiceError::Refused {
                            code: error["code"].as_i64().unwrap_or(0),
                            message: error["message"].as_str().unwrap_or_default().to_owned(),
                        });
                    }
                    return Ok(answer["result"].take());
                }
                None => {
                    return Err(
                        self.broken(&format!("it does not answer for {} s", timeout.as_secs()))
                    );
                }
            }
        }
    }

    /// The next line; `None` when `left` is over. Takes what it waited from `left`.
    fn line(&self, left: &mut Duration) -> Result<Option<Line>, ServiceError> {
        loop {
            let (slice, began) = ((*left).min(WAIT_SLICE), Instant::now());
            match self.lines.recv_timeout(slice) {
                Ok(line) => {
                    *left = left.saturating_sub(began.elapsed().min(slice));
                    return Ok(Some(line));
                }
                Err(RecvTimeoutError::Timeout) if *left <= slice => return Ok(None),
                Err(RecvTimeoutError::Timeout) => *left -= slice,
                Err(RecvTimeoutError::Disconnected) => return Err(self.broken("it has ended")),
            }
        }
    }

    /// The next notification; `None` where none came in time.
    ///
    /// # Errors
    /// The service is gone.
    pub fn next(&mut self, timeout: Duration) -> Result<Option<Notification>, ServiceError> {
        if let Some(notification) = self.waiting.pop_front() {
            return Ok(Some(notification));
        }
        let mut left = timeout;
        loop {
            match self.line(&mut left)? {
                Some(Line::Notification(notification)) => return Ok(Some(notification)),
                Some(Line::Answer(_)) => {}
                None => return Ok(None),
            }
        }
    }

    /// State of board, link and clients.
    ///
    /// # Errors
    /// As [`Client::call`].
    pub fn status(&mut self) -> Result<ServiceStatus, ServiceError> {
        let value = self.call(Call::Status)?;
        serde_json::from_value(value).map_err(|error| self.broken(&error.to_string()))
    }

    /// Lets the service hold tensions until [`Call::Disarm`]; returns when they are held.
    ///
    /// # Errors
    /// As [`Client::call`].
    pub fn hold(&mut self, hold: HoldParams) -> Result<(), ServiceError> {
        self.call_within(Call::Hold(hold), Duration::from_secs(60))
            .map(|_| ())
    }
}

impl Drop for Client {
    /// Closes the connection: the thread that reads has a handle of its own.
    fn drop(&mut self) {
        let _ = self.writer.shutdown(std::net::Shutdown::Both);
    }
}

fn parse(line: &str) -> Option<Line> {
    let mut value: Value = serde_json::from_str(line).ok()?;
    let Some(method) = value.get("method").and_then(Value::as_str) else {
        return Some(Line::Answer(value));
    };
    let method = method.to_owned();
    let params = value["params"].take();
    Some(Line::Notification(match method.as_str() {
        "tick" => Notification::Tick(serde_json::from_value(params).ok()?),
        "telemetry" => Notification::Telemetry(serde_json::from_value(params).ok()?),
        "event" => Notification::Event(serde_json::from_value(params).ok()?),
        "refused" => Notification::Refused(params.as_str()?.to_owned()),
        "link_lost" => Notification::LinkLost(params.as_str()?.to_owned()),
        _ => return None,
    }))
}

/// The service as a link. Dropping it releases the role of the commander.
#[derive(Debug)]
pub struct ServiceLink {
    client: Client,
    commands: bool,
    now_ns: u64,
    /// Who stopped the rig last, since this link exists.
    stopped_by: Option<String>,
}

impl ServiceLink {
    /// A link that commands.
    ///
    /// # Errors
    /// Another client commands, or the service is gone.
    pub fn commander(client: Client) -> Result<Self, ServiceError> {
        Self::commander_with(client, CommandParams::default())
    }

    /// A link that commands a rig whose parts may be new ones, to test it.
    ///
    /// # Errors
    /// As [`ServiceLink::commander`].
    pub fn tester(client: Client) -> Result<Self, ServiceError> {
        Self::commander_with(client, CommandParams { tests: true })
    }

    fn commander_with(mut client: Client, how: CommandParams) -> Result<Self, ServiceError> {
        client.call(Call::Command(how))?;
        let mut link = Self::observer(client)?;
        link.commands = true;
        // An emulated rig's figures count from here. They belong to the commander: an observer
        // would take them from its run.
        if link.client.welcome.seed.is_some() {
            link.client.call(Call::Report)?;
        }
        Ok(link)
    }

    /// A link that observes. The board's commands that need the role are refused on it, apart from
    /// stop.
    ///
    /// # Errors
    /// The service is gone.
    pub fn observer(mut client: Client) -> Result<Self, ServiceError> {
        let truth = client.welcome.seed.is_some();
        client.call(Call::Subscribe(Topics {
            ticks: true,
            truth,
            events: true,
            ..Topics::default()
        }))?;
        Ok(Self {
            client,
            commands: false,
            now_ns: 0,
            stopped_by: None,
        })
    }

    /// Breaks the connection as a killed process does.
    #[cfg(test)]
    pub(super) fn kill(&self) {
        let _ = self.client.writer.shutdown(std::net::Shutdown::Both);
    }

    fn call(&mut self, call: Call) -> Result<Value, LinkError> {
        Ok(self.client.call(call)?)
    }

    fn lost(&self, cause: &str) -> LinkError {
        LinkError::Lost {
            name: self.name(),
            cause: cause.to_owned(),
        }
    }

    /// Takes a notification into the exchange.
    fn take(&mut self, notification: Notification, into: &mut Exchange) -> Result<(), LinkError> {
        match notification {
            Notification::Tick(tick) => {
                let bytes = BASE64_STANDARD
                    .decode(&tick.bytes)
                    .map_err(|error| self.lost(&format!("a tick can't be read: {error}")))?;
                self.now_ns = tick.now_ns;
                into.from_board.extend(bytes);
                if tick.pose.is_some() {
                    into.pose = tick.pose;
                }
                into.truth.extend(tick.truth);
                into.resets = tick.resets;
                Ok(())
            }
            Notification::LinkLost(cause) => Err(self.lost(&cause)),
            Notification::Refused(why) => Err(LinkError::NotAllowed(why)),
            Notification::Event(event) => {
                let who = event.text.strip_prefix(STOPPED_BY);
                if let Some(who) = who.filter(|_| event.kind == "stop") {
                    self.stopped_by = Some(who.to_owned());
                }
                Ok(())
            }
            Notification::Telemetry(_) => Ok(()),
        }
    }
}

impl Drop for ServiceLink {
    /// Gives the role back before the connection closes, so that the next command finds it free.
    fn drop(&mut self) {
        if self.commands {
            let _ = self.client.call_within(Call::Release, RELEASE_TIMEOUT);
        }
    }
}

impl RigLink for ServiceLink {
    fn name(&self) -> String {
        self.client.welcome.link.clone()
    }

    fn stopped_by(&self) -> Option<&str> {
        self.stopped_by.as_deref()
    }

    fn exchange(&mut self, to_board: &[u8], duration: Duration) -> Result<Exchange, LinkError> {
        if !to_board.is_empty() {
            let text = BASE64_STANDARD.encode(to_board);
            self.client.send(Call::Bytes(text), None)?;
        }
        // From here, and not from what has come meanwhile: a service in lock-step waits for this
        // client's next frame, and would wait for ever if this waited for time after that. Each
        // exchange brings something, and none catches up.
        let target_ns = self.now_ns + u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX / 2);
        let mut exchange = Exchange::default();
        // What has come already.
        while let Some(notification) = self.client.next(Duration::ZERO)? {
            self.take(notification, &mut exchange)?;
        }
        while self.now_ns < target_ns {
            match self.client.next(TICK_TIMEOUT)? {
                Some(notification) => self.take(notification, &mut exchange)?,
                None => {
                    return Err(self.lost(&format!(
                        "its service sends nothing for {} s",
                        TICK_TIMEOUT.as_secs()
                    )))
                }
            }
        }
        exchange.now_ns = self.now_ns;
        Ok(exchange)
    }

    fn controls(&mut self) -> Option<&mut dyn RigControls> {
        if self.client.welcome.seed.is_some() {
            Some(self)
        } else {
            None
        }
    }
}

impl RigControls for ServiceLink {
    fn robot(&mut self, moving: bool) -> Result<(), LinkError> {
        self.call(Call::Robot { moving }).map(|_| ())
    }

    fn inject(&mut self, injection: Injection) -> Result<(), LinkError> {
        let what = session::inject::describe(&injection)
            .ok_or_else(|| LinkError::Refused(format!("{injection:?} has no word")))?;
        self.call(Call::Inject { what }).map(|_| ())
    }

    fn report(&mut self) -> Result<Report, LinkError> {
        let value = self.call(Call::Report)?;
        let bytes = BASE64_STANDARD
            .decode(value["report"].as_str().unwrap_or_default())
            .map_err(|error| self.lost(&error.to_string()))?;
        postcard::from_bytes(&bytes).map_err(|error| self.lost(&error.to_string()))
    }

    fn seed(&self) -> u64 {
        self.client.welcome.seed.unwrap_or(0)
    }
}
