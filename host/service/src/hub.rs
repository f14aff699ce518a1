//! The hub: the one loop that owns the link. It decides who may command, and which bytes go where.
//!
//! Every [`CYCLE`] it takes what clients sent, exchanges bytes with the board, and hands out what
//! arrived. It never waits for a client. All state is in this one thread; connections and jobs talk
//! to it through [`Inbound`].
//!
//! | part | file |
//! | --- | --- |
//! | cycle, routing of frames | this one |
//! | requests of clients | `calls` |
//! | clients, commander | `clients` |

mod calls;
mod clients;

use super::inbound::{ClientId, Inbound, TERMINAL};
use super::job;
use super::protocol::{notification, Event, Tick};
use super::terminal::Terminal;
use base64::prelude::{Engine as _, BASE64_STANDARD};
use bring_up::gate::Changes;
use clients::{Client, Waiter};
use control::{Fault, SystemState};
use known::base;
use known::store::Store;
use rig::Rig;
use serde_json::Value;
use session::link::{Exchange, LinkError, RigLink};
use session::telemetry::Gatherer;
use session::{explain_fault, system_state_name, Gaps, PERIOD, SILENCE_TIMEOUT};
use std::collections::{BTreeMap, HashMap};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender};
use std::sync::Arc;
use std::time::{Duration, Instant};
use wire::message::{BoardInfo, CommandError, FaultReport, Response, Status};
use wire::{BoardFrame, BoardMessage, Command, Decoder, HostFrame, UNITS};

/// Period of the hub. A `stop` waits for one at most before it goes out.
pub const CYCLE: Duration = Duration::from_millis(2);
/// A commander that sends nothing for this long, in the link's time, may be replaced by another.
pub const SILENT_NS: u64 = 1_000_000_000;
/// Period of telemetry in the link's time, ns.
const TELEMETRY_NS: u64 = 20_000_000;
/// How long a reply of the board may take before a command of the hub is sent again, ns.
const REPLY_NS: u64 = 30_000_000;
/// How often a command of the hub is sent.
const MAX_ATTEMPTS: u32 = 10;
/// How long the reply to a client's frame is awaited, ns. The client repeats it by itself.
const CLIENT_REPLY_NS: u64 = 1_000_000_000;
/// A step of board time further back than this is a reset, us (as in the session).
const RESET_STEP_US: i32 = -500_000;
/// With [`Setup::lockstep`], how far the link's time may run ahead of the commander's last frame,
/// ns: four of its cycles.
const LEAD_NS: u64 = 40_000_000;
/// With [`Setup::lockstep`], how long the hub waits for a commander on the clock on the wall. One
/// that hangs is left behind. Shorter than the 3 s after which a client gives a silent service up,
/// so that the two never wait for each other.
const LOCKSTEP_WAIT: Duration = Duration::from_secs(2);
/// Time between two attempts to open a link that was lost.
const REOPEN: Duration = Duration::from_millis(500);

/// What the hub takes of clients in one cycle at most; the board's bytes must not wait for more.
const MAX_INBOUND: usize = 1000;

/// Who waits for the reply to a frame.
#[derive(Debug, Clone)]
enum Origin {
    /// A frame of a client, with the client's own number.
    Frame(ClientId, u16),
    /// A request of a client.
    Call(ClientId, Option<Value>),
    /// The hub.
    Hub,
}

/// A command that the board has not answered yet.
#[derive(Debug)]
struct Pending {
    origin: Origin,
    command: Command,
    due_ns: u64,
    attempts: u32,
}

/// Opens the link again.
pub type Opener = Box<dyn Fn() -> Result<Box<dyn RigLink>, LinkError>>;

/// What the service is for.
pub(super) struct Setup {
    /// Name of the rig.
    pub name: String,
    /// The rig file: name and text.
    pub rig_file: (String, String),
    /// Token that untrusted clients need.
    pub token: Option<String>,
    /// Opens the link again where it was lost; `None`: the service ends with its link.
    pub reopen: Option<Opener>,
    /// Where the rig's bring-up and calibration are kept; `None`: in the user's folder.
    pub store: Option<Store>,
    /// End where nobody was connected for this long and nothing is driven.
    pub idle_end: Option<Duration>,
    /// The link's time passes as fast as it can be computed: it waits for a commander that drives.
    pub lockstep: bool,
    /// Set from outside to end the service.
    pub stop: Arc<AtomicBool>,
}

/// Stops since the service began: for each who made some, how many, and the number of the last.
#[derive(Debug, Default)]
struct Stops {
    of: BTreeMap<String, (u64, u64)>,
    all: u64,
}

impl Stops {
    fn note(&mut self, who: &str) {
        self.all += 1;
        let (count, last) = self.of.entry(who.to_owned()).or_default();
        (*count, *last) = (*count + 1, self.all);
    }

    /// Those that this client did not make, and who made the last of them.
    fn of_others(&self, who: &str) -> (u64, Option<String>) {
        let others = || self.of.iter().filter(|(name, _)| *name != who);
        let last = others().max_by_key(|(_, (_, last))| *last);
        let count = others().map(|(_, (count, _))| count).sum();
        (count, last.map(|(name, _)| name.clone()))
    }
}

/// The hub.
pub(super) struct Hub {
    setup: Setup,
    link: Option<Box<dyn RigLink>>,
    link_name: String,
    seed: Option<u64>,
    terminal: Option<Terminal>,
    inbound: Receiver<Inbound>,
    sender: Sender<Inbound>,
    clients: BTreeMap<ClientId, Client>,
    commander: Option<ClientId>,
    /// The commander that another client has stopped.
    stopped: Option<ClientId>,
    stops: Stops,
    /// Whether the commander tests a rig whose parts may be new ones.
    commander_tests: bool,
    commander_ns: u64,
    commander_seen: Instant,
    job: Option<job::Running>,
    /// A job that begins when the one that is ending has ended: its client, and its request.
    next_job: Option<(ClientId, Option<Value>, job::Kind)>,
    jobs: u64,
    waiting: Vec<Waiter>,
    // The board.
    decoder: Decoder,
    gaps: Gaps,
    seq: u16,
    outbox: Vec<u8>,
    /// Where the setpoints begin that `outbox` ends with, if it does.
    unsent_setpoints: Option<usize>,
    urgent: Vec<u8>,
    pending: HashMap<u16, Pending>,
    info: Option<BoardInfo>,
    refused: Option<CommandError>,
    hello_due_ns: u64,
    status: Option<Status>,
    /// Link time of the newest status, ns.
    status_ns: u64,
    resets: Option<u32>,
    gatherer: Gatherer,
    frames_bad: u64,
    frames_lost: u64,
    // Time.
    base_ns: u64,
    now_ns: u64,
    telemetry_due_ns: u64,
    idle_since: Instant,
    /// When a lost link is tried next.
    reopen_at: Instant,
    ending: bool,
}

impl Hub {
    pub(super) fn new(
        setup: Setup,
        mut link: Box<dyn RigLink>,
        terminal: Option<Terminal>,
        (sender, inbound): (Sender<Inbound>, Receiver<Inbound>),
    ) -> Self {
        let seed = link.controls().map(|controls| controls.seed());
        let (file, text) = &setup.rig_file;
        // A calibration that can't be read is named to whoever drives; the view then has the rig
        // file's numbers.
        let rig = Rig::parse(file, text)
            .ok()
            .map(|rig| base::with_calibration(rig.clone(), seed).unwrap_or(rig));
        let gatherer = Gatherer::new(rig.as_ref());
        let mut clients = BTreeMap::new();
        if let Some(terminal) = &terminal {
            clients.insert(TERMINAL, Client::terminal(terminal.path()));
        }
        Self {
            link_name: link.name(),
            seed,
            link: Some(link),
            setup,
            terminal,
            inbound,
            sender,
            clients,
            commander: None,
            stopped: None,
            stops: Stops::default(),
            commander_tests: false,
            commander_ns: 0,
            commander_seen: Instant::now(),
            job: None,
            next_job: None,
            jobs: 0,
            waiting: Vec::new(),
            decoder: Decoder::new(),
            gaps: Gaps::default(),
            seq: 0,
            // A zero ends whatever was on the line before.
            outbox: vec![0],
            unsent_setpoints: None,
            urgent: Vec::new(),
            pending: HashMap::new(),
            info: None,
            refused: None,
            hello_due_ns: 0,
            status: None,
            status_ns: 0,
            resets: None,
            gatherer,
            frames_bad: 0,
            frames_lost: 0,
            base_ns: 0,
            now_ns: 0,
            telemetry_due_ns: 0,
            idle_since: Instant::now(),
            reopen_at: Instant::now(),
            ending: false,
        }
    }

    /// Serves until the service ends. A rig that is driven then is disarmed.
    ///
    /// # Errors
    /// The link is gone and can't be opened again.
    pub(super) fn run(&mut self) -> Result<(), LinkError> {
        loop {
            if self.setup.stop.load(Ordering::SeqCst) || self.idle_is_over() {
                self.ending = true;
            }
            if self.ending {
                return self.end();
            }
            self.cycle()?;
        }
    }

    /// One cycle: requests, bytes both ways, what is due.
    fn cycle(&mut self) -> Result<(), LinkError> {
        for _ in 0..MAX_INBOUND {
            match self.inbound.try_recv() {
                Ok(inbound) => self.take(inbound),
                Err(_) => break,
            }
        }
        self.read_terminal();
        if self.link.is_none() {
            return self.without_link();
        }
        if self.must_wait_for_commander() {
            if let Ok(inbound) = self.inbound.recv_timeout(CYCLE) {
                self.take(inbound);
            }
            return Ok(());
        }
        self.hello_when_due();
        self.repeat_when_due();
        let mut bytes = std::mem::take(&mut self.urgent);
        bytes.append(&mut self.outbox);
        self.unsent_setpoints = None;
        let link = match self.link.as_mut() {
            Some(link) => link,
            None => return Ok(()),
        };
        match link.exchange(&bytes, CYCLE) {
            Ok(exchange) => {
                self.distribute(exchange);
                self.send_telemetry();
                self.answer_waiting();
                Ok(())
            }
            Err(error) => self.lose_link(error),
        }
    }

    /// Whether the link's time has to wait, because a commander drives and has not sent anything
    /// for this time.
    fn must_wait_for_commander(&self) -> bool {
        let running = self
            .status
            .as_ref()
            .is_some_and(|status| status.state == SystemState::Running as u8);
        self.setup.lockstep
            && running
            && self.commander.is_some()
            && self.urgent.is_empty()
            && self.now_ns >= self.commander_ns + LEAD_NS
            && self.commander_seen.elapsed() < LOCKSTEP_WAIT
    }

    /// Waits for a link that was lost, and opens it again.
    fn without_link(&mut self) -> Result<(), LinkError> {
        let left = self.reopen_at.saturating_duration_since(Instant::now());
        match self.inbound.recv_timeout(left) {
            Ok(inbound) => self.take(inbound),
            Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => {
                self.reopen_at = Instant::now() + REOPEN;
                let opened = self.setup.reopen.as_ref().map(|open| open());
                if let Some(Ok(link)) = opened {
                    self.link_name = link.name();
                    self.link = Some(link);
                    self.base_ns = self.now_ns;
                    self.connect_anew();
                    self.event("link", format!("{} is back", self.link_name), None);
                }
                self.send_telemetry_now();
            }
        }
        Ok(())
    }

    /// The link is gone. Clients that rely on it are told; the service tries to get it back.
    fn lose_link(&mut self, error: LinkError) -> Result<(), LinkError> {
        let text = error.to_string();
        self.event("link", text.clone(), None);
        let line: Arc<str> = notification("link_lost", &text).into();
        for client in self.clients.values() {
            if client.topics.ticks {
                client.outbox.line(Arc::clone(&line));
            }
        }
        self.commander = None;
        self.status = None;
        self.gatherer.forget();
        self.fail_waiting(&text);
        self.fail_pending(&text);
        if self.setup.reopen.is_none() {
            return Err(error);
        }
        self.link = None;
        Ok(())
    }

    /// Answers the requests whose reply will not come any more.
    fn fail_pending(&mut self, text: &str) {
        let pending: Vec<Pending> = self.pending.drain().map(|(_, pending)| pending).collect();
        for pending in pending {
            if let Origin::Call(id, request) = pending.origin {
                self.fail(id, request.as_ref(), super::protocol::code::LINK, text);
            }
        }
    }

    /// A clear that was asked for before a stop undoes none: it is not sent any more, and who asked
    /// is told.
    fn forget_clears(&mut self) {
        let clears: Vec<Pending> = self
            .pending
            .extract_if(|_, pending| pending.command == Command::ClearFaults)
            .map(|(_, pending)| pending)
            .collect();
        let why = "the rig was stopped before it was cleared; clear again once nobody stops it";
        for pending in clears {
            match pending.origin {
                Origin::Call(id, request) => {
                    // Clearing is one request and no reason to keep the role.
                    self.commander.take_if(|commander| *commander == id);
                    self.fail(id, request.as_ref(), super::protocol::code::REFUSED, why);
                }
                Origin::Frame(id, seq) => {
                    let refusal = CommandError::Faulted(Fault::HostStop.code());
                    self.refuse(id, seq, refusal, why);
                }
                Origin::Hub => {}
            }
        }
    }

    /// Forgets what was known of a board that was reset or is connected anew.
    fn connect_anew(&mut self) {
        self.info = None;
        self.refused = None;
        self.status = None;
        self.resets = None;
        self.gaps = Gaps::default();
        self.gatherer.forget();
        self.pending.clear();
        self.urgent.clear();
        self.outbox = vec![0];
        self.unsent_setpoints = None;
        self.hello_due_ns = self.now_ns;
    }

    /// Says hello to the board until it answers.
    fn hello_when_due(&mut self) {
        if self.info.is_none() && self.refused.is_none() && self.now_ns >= self.hello_due_ns {
            self.hello_due_ns = self.now_ns + 5 * REPLY_NS;
            let hello = Command::Hello {
                abi: wire::ABI_VERSION,
                schema: wire::SCHEMA_HASH,
            };
            // One attempt each: this repeats it by itself, and an old answer must not count twice.
            self.pending
                .retain(|_, pending| !matches!(pending.command, Command::Hello { .. }));
            self.send(Origin::Hub, hello);
        }
    }

    /// Sends commands again that the board has not answered, and gives up on old ones.
    fn repeat_when_due(&mut self) {
        let now_ns = self.now_ns;
        let due: Vec<u16> = self
            .pending
            .iter()
            .filter(|(_, pending)| now_ns >= pending.due_ns)
            .map(|(seq, _)| *seq)
            .collect();
        for seq in due {
            let Some(pending) = self.pending.remove(&seq) else {
                continue;
            };
            match &pending.origin {
                Origin::Frame(..) => {}
                _ if matches!(pending.command, Command::Hello { .. }) => {}
                Origin::Call(..) | Origin::Hub if pending.attempts < MAX_ATTEMPTS => {
                    self.send_again(pending);
                }
                Origin::Call(id, request) => {
                    let (id, request) = (*id, request.clone());
                    self.fail(
                        id,
                        request.as_ref(),
                        super::protocol::code::LINK,
                        "the board doesn't answer; a board without setpoints goes to 0 V within 100 ms",
                    );
                }
                Origin::Hub => {}
            }
        }
    }

    /// Queues a command for the board.
    fn send(&mut self, origin: Origin, command: Command) {
        self.send_again(Pending {
            origin,
            command,
            due_ns: 0,
            attempts: 0,
        });
    }

    fn send_again(&mut self, mut pending: Pending) {
        // Setpoints replace those that have not gone out: a rig slower than its commander's clock
        // must not have a queue of old ones in front of what matters.
        let replaced = self
            .unsent_setpoints
            .take()
            .filter(|_| matches!(pending.command, Command::Setpoints { .. }));
        if let Some(start) = replaced {
            self.outbox.truncate(start);
        } else {
            self.seq = self.seq.wrapping_add(1);
        }
        let frame = HostFrame {
            seq: self.seq,
            command: pending.command.clone(),
        };
        let mut out = [0; wire::MAX_FRAME];
        // Every host frame is far shorter than MAX_FRAME; one that were not gets no reply and an
        // error.
        if let Ok(length) = wire::encode(&frame, &mut out) {
            if pending.command == Command::Stop {
                // Nothing may follow that was queued before it, and no clear that was asked for
                // before it may undo it.
                self.outbox.clear();
                self.forget_clears();
                self.urgent.push(0);
                self.urgent.extend_from_slice(&out[..length]);
            } else {
                if matches!(pending.command, Command::Setpoints { .. }) {
                    self.unsent_setpoints = Some(self.outbox.len());
                }
                self.outbox.extend_from_slice(&out[..length]);
            }
        }
        // Setpoints are answered only where they are refused; the client that sent them hears it.
        pending.attempts += 1;
        pending.due_ns = self.now_ns
            + match pending.origin {
                Origin::Frame(..) => CLIENT_REPLY_NS,
                _ => REPLY_NS,
            };
        self.pending.insert(self.seq, pending);
    }

    /// What the board sent, to everyone who may see it.
    fn distribute(&mut self, exchange: Exchange) {
        self.now_ns = self.base_ns + exchange.now_ns;
        if self.resets.is_some_and(|before| before != exchange.resets) {
            self.note_reset();
        }
        self.resets = Some(exchange.resets);
        if let Some(pose) = &exchange.pose {
            self.gatherer.pose(pose.position_m);
        }
        if let Some(truth) = exchange.truth.last() {
            self.gatherer.truth(truth);
        }
        for byte in &exchange.from_board {
            match self.decoder.push::<BoardFrame>(*byte) {
                Ok(None) => {}
                Ok(Some(frame)) => self.arrived(frame),
                Err(_) => {
                    self.frames_bad += 1;
                    for client in self.clients.values_mut() {
                        client.damaged();
                    }
                }
            }
        }
        let mut plain = Tick {
            now_ns: self.now_ns,
            bytes: String::new(),
            pose: exchange.pose,
            resets: exchange.resets,
            truth: Vec::new(),
        };
        for (id, client) in &mut self.clients {
            let bytes = std::mem::take(&mut client.bytes);
            if *id == TERMINAL {
                if let Some(terminal) = &mut self.terminal {
                    terminal.write(&bytes);
                }
            } else if client.topics.ticks {
                plain.bytes = BASE64_STANDARD.encode(&bytes);
                plain.truth = if client.topics.truth {
                    exchange.truth.clone()
                } else {
                    Vec::new()
                };
                client.outbox.telemetry(notification("tick", &plain).into());
            }
        }
    }

    /// A frame of the board: the hub takes note of it and puts it into each client's bytes.
    fn arrived(&mut self, frame: BoardFrame) {
        let BoardFrame { seq, message } = frame;
        let lost = self.gaps.arrived(seq);
        self.frames_lost += u64::from(lost);
        for client in self.clients.values_mut() {
            client.numbering.skip(lost);
        }
        match &message {
            BoardMessage::Reply(reply) => {
                if let Response::Status(status) = &reply.response {
                    self.note_status(status.clone());
                }
                let Some(pending) = self.pending.remove(&reply.seq) else {
                    return;
                };
                self.replied(pending, reply.response.clone());
                return;
            }
            BoardMessage::Status(status) => self.note_status(status.clone()),
            BoardMessage::Fault(fault) => self.note_fault(fault),
            BoardMessage::Samples(batch) => {
                for sample in &batch.samples {
                    self.gatherer.sample(self.now_ns, sample);
                }
            }
        }
        for client in self.clients.values_mut() {
            client.frame(&message);
        }
    }

    /// A reply of the board, to whoever asked.
    fn replied(&mut self, pending: Pending, response: Response) {
        if response == Response::Rejected(CommandError::NotConnected) && self.info.is_some() {
            // The board has forgotten the hello: it was reset, also where its clock does not show
            // it.
            self.note_reset();
        }
        if pending.command == Command::Stop && response == Response::Done {
            // The next status says so; until then nobody may be told that the rig is driven.
            if let Some(status) = &mut self.status {
                status.state = SystemState::Fault as u8;
            }
        }
        match pending.origin {
            Origin::Frame(id, seq) => self.reply_to(id, seq, response),
            Origin::Call(id, request) => self.call_replied(id, request, &pending.command, response),
            Origin::Hub => match (pending.command, response) {
                (Command::Hello { .. }, Response::Hello(info)) => {
                    self.info = Some(info);
                    self.send(Origin::Hub, Command::Stream { decimation: 1 });
                }
                (Command::Hello { .. }, Response::Rejected(refusal)) => {
                    self.refused = Some(refusal)
                }
                (Command::GetConfig { unit }, Response::Config(config)) => {
                    self.gatherer.config(unit, &config);
                }
                _ => {}
            },
        }
    }

    fn note_status(&mut self, status: Status) {
        let back = self
            .status
            .as_ref()
            .is_some_and(|before| (status.t_us.wrapping_sub(before.t_us) as i32) < RESET_STEP_US);
        if back {
            self.note_reset();
        }
        self.status = Some(status);
        self.status_ns = self.now_ns;
    }

    fn note_reset(&mut self) {
        if self.info.is_none() {
            return;
        }
        let text = "the board was reset; its motors are at 0 V";
        self.fail_pending(text);
        self.connect_anew();
        self.fail_waiting(text);
        self.event(
            "reset",
            "the board was reset; its motors are at 0 V".to_owned(),
            None,
        );
    }

    fn note_fault(&mut self, fault: &FaultReport) {
        let unit = (usize::from(fault.unit) < UNITS).then(|| fault.unit + 1);
        let who = unit.map_or_else(|| "board".to_owned(), |unit| format!("unit {unit}"));
        if fault.code == Fault::EStop.code() {
            self.stops.note("the E-stop");
        }
        let text = format!("{who}: {}", explain_fault(fault.code, fault.detail));
        self.event("fault", text, Some((fault.code, unit)));
    }

    /// Why a client may not drive this rig: a part of it was exchanged since its bring-up, the
    /// board included, or a setting was changed that it judged by. Read anew each time, for parts
    /// may be exchanged while the service runs.
    fn exchanged(&self, id: ClientId) -> Option<String> {
        if self.commander_tests && self.commander == Some(id) {
            return None;
        }
        self.changes()
            .map_or_else(Some, |changes| changes.refusal())
    }

    /// What has changed since the bring-up of the rig of the service's own file.
    fn changes(&self) -> Result<Changes, String> {
        let (file, text) = &self.setup.rig_file;
        let read = || -> Result<Changes, Box<dyn std::error::Error>> {
            let rig = Rig::parse(file, text)?;
            let store = match &self.setup.store {
                Some(store) => store.clone(),
                None => Store::of_rig(&rig.name, self.seed)?,
            };
            let number = self.info.as_ref().and_then(BoardInfo::number);
            let number = number.map(|number| number.as_str().to_owned());
            Ok(Changes::of(&rig, &store, number)?)
        };
        read().map_err(|error| {
            format!(
                "what has changed since the bring-up can't be read: {error}; nothing was driven"
            )
        })
    }

    /// Tells everyone who wants to know.
    fn event(&self, kind: &str, text: String, fault: Option<(u16, Option<u8>)>) {
        let event = Event {
            t_s: self.now_ns as f64 * 1e-9,
            kind: kind.to_owned(),
            text,
            fault: fault.map(|(code, _)| code),
            unit: fault.and_then(|(_, unit)| unit),
        };
        let line: Arc<str> = notification("event", &event).into();
        for client in self.clients.values() {
            if client.topics.events {
                client.outbox.line(Arc::clone(&line));
            }
        }
    }

    fn send_telemetry(&mut self) {
        if self.now_ns >= self.telemetry_due_ns {
            self.telemetry_due_ns = self.now_ns + TELEMETRY_NS;
            self.send_telemetry_now();
        }
    }

    fn send_telemetry_now(&mut self) {
        if !self.clients.values().any(|client| client.topics.telemetry) {
            return;
        }
        self.read_configs_when_changed();
        // A board that is silent is not what it was.
        let heard = self.status_ns + SILENCE_TIMEOUT.as_nanos() as u64 >= self.now_ns;
        let status = self.status.as_ref().filter(|_| heard);
        let state = if self.link.is_some() {
            "no status"
        } else {
            "no link"
        };
        let mut telemetry = self.gatherer.telemetry(self.now_ns, status, state);
        telemetry.drops.frames_lost = self.frames_lost;
        telemetry.drops.frames_bad = self.frames_bad;
        telemetry.commander = self.commander.map(|id| self.name_of(id));
        telemetry.clients = self.client_names().collect();
        let line: Arc<str> = notification("telemetry", &telemetry).into();
        for client in self.clients.values() {
            if client.topics.telemetry {
                client.outbox.telemetry(Arc::clone(&line));
            }
        }
    }

    /// Reads the board's configurations where they are new: whether there are zeros is in them.
    fn read_configs_when_changed(&mut self) {
        let Some(status) = self.status.as_ref().filter(|_| self.info.is_some()) else {
            return;
        };
        if self.gatherer.wants_configs(status) {
            self.gatherer.reading(status);
            for unit in 0..UNITS as u8 {
                self.send(Origin::Hub, Command::GetConfig { unit });
            }
        }
    }

    /// State of the board in words.
    fn state_name(&self) -> String {
        match (&self.status, &self.link) {
            (Some(status), _) => system_state_name(status.state).to_owned(),
            (None, Some(_)) => "no status".to_owned(),
            (None, None) => "no link".to_owned(),
        }
    }

    /// Whether the motors act, by the newest status.
    fn drives(&self) -> bool {
        // A board that sends nothing any more has stopped by itself.
        let fresh = self.now_ns.saturating_sub(self.status_ns) <= SILENCE_TIMEOUT.as_nanos() as u64;
        self.status
            .as_ref()
            .filter(|_| fresh)
            .and_then(|status| SystemState::from_u8(status.state))
            .is_some_and(SystemState::drives)
    }

    fn read_terminal(&mut self) {
        let Some(bytes) = self.terminal.as_mut().map(Terminal::read) else {
            return;
        };
        if !bytes.is_empty() {
            self.client_bytes(TERMINAL, &bytes);
        }
    }

    fn idle_is_over(&mut self) -> bool {
        let alone = self.clients.keys().all(|id| *id == TERMINAL);
        if !alone || self.drives() {
            self.idle_since = Instant::now();
        }
        self.setup
            .idle_end
            .is_some_and(|end| self.idle_since.elapsed() >= end)
    }

    /// Ends: ramps down what is driven, within 3 s of the link's time, and closes every connection.
    fn end(&mut self) -> Result<(), LinkError> {
        self.next_job = None;
        if let Some(job) = &self.job {
            job.stop.store(true, Ordering::SeqCst);
        }
        if self.link.is_some() && self.drives() && self.job.is_none() {
            self.send(Origin::Hub, Command::Disarm);
        }
        let until_ns = self.now_ns + 3_000_000_000;
        while self.link.is_some() && (self.drives() || self.job.is_some()) && self.now_ns < until_ns
        {
            self.cycle()?;
        }
        self.event("link", "the service ends".to_owned(), None);
        for client in self.clients.values() {
            client.outbox.close();
        }
        // The writers need a moment for their last lines.
        std::thread::sleep(PERIOD);
        Ok(())
    }
}
