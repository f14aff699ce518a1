//! Clients of the hub: their frames, and which of them commands.

use super::{Hub, Origin};
use crate::frames::Numbering;
use crate::inbound::{ClientId, Inbound, TERMINAL};
use crate::outbox::Outbox;
use crate::protocol::{code, notification, Hello, Topics, STOPPED_BY};
use control::Fault;
use serde_json::Value;
use wire::message::{CommandError, Reply, Response};
use wire::{BoardMessage, Command, Decoder, HostFrame};

/// One client.
pub(super) struct Client {
    pub(super) outbox: Outbox,
    pub(super) topics: Topics,
    pub(super) numbering: Numbering,
    /// Frames for it in this cycle.
    pub(super) bytes: Vec<u8>,
    /// What it said in `hello`; nothing else is accepted before.
    pub(super) hello: Option<Hello>,
    trusted: bool,
    decoder: Decoder,
}

impl Client {
    fn new(outbox: Outbox, trusted: bool) -> Self {
        Self {
            outbox,
            topics: Topics::default(),
            numbering: Numbering::default(),
            bytes: Vec::new(),
            hello: None,
            trusted,
            decoder: Decoder::new(),
        }
    }

    /// The program on the pseudo-terminal.
    pub(super) fn terminal(path: &str) -> Self {
        let mut client = Self::new(Outbox::default(), true);
        client.topics.ticks = true;
        client.hello = Some(Hello::nameless(&format!("the program on {path}")));
        client
    }

    /// Name, process and account, for messages.
    pub(super) fn name(&self) -> String {
        (self.hello.as_ref()).map_or_else(|| "a client without a name".to_owned(), Hello::name)
    }

    /// Puts a frame into its bytes.
    pub(super) fn frame(&mut self, message: &BoardMessage) {
        if self.topics.ticks {
            self.numbering.encode(message, &mut self.bytes);
        }
    }

    /// A frame that arrived damaged is damaged for this client as well: its count of such frames
    /// stays right.
    pub(super) fn damaged(&mut self) {
        if self.topics.ticks {
            self.bytes.extend_from_slice(&[1, 0]);
        }
    }
}

/// A request that is answered when the motors are at 0 V.
pub(super) struct Waiter {
    pub(super) id: ClientId,
    pub(super) request: Option<Value>,
    /// Status older than this (link time, ns) doesn't count.
    pub(super) after_ns: u64,
    /// Given up at this link time, ns.
    pub(super) until_ns: u64,
}

impl Hub {
    /// Takes what a connection or a job reports.
    pub(super) fn take(&mut self, inbound: Inbound) {
        match inbound {
            Inbound::Opened {
                id,
                trusted,
                outbox,
            } => {
                self.clients.insert(id, Client::new(outbox, trusted));
            }
            Inbound::Closed { id } => self.client_is_gone(id),
            Inbound::Request { id, request } => {
                if let Some(client) = self.clients.get(&id) {
                    client.outbox.carried_out();
                    self.call(id, request);
                }
            }
            Inbound::Job(report) => self.job_reports(report),
        }
    }

    fn client_is_gone(&mut self, id: ClientId) {
        let Some(client) = self.clients.remove(&id) else {
            return;
        };
        client.outbox.close();
        self.waiting.retain(|waiter| waiter.id != id);
        self.next_job.take_if(|(of, ..)| *of == id);
        if self.commander == Some(id) {
            self.release(&format!("{} is gone", client.name()));
        }
        if let Some(job) = self
            .job
            .as_ref()
            .filter(|job| job.for_client == id && job.ends_with_client())
        {
            job.stop.store(true, std::sync::atomic::Ordering::SeqCst);
        }
    }

    /// Whether a token is right. Compared in a time that does not depend on where they differ.
    pub(super) fn may_enter(&self, id: ClientId, hello: &Hello) -> bool {
        let trusted = self.clients.get(&id).is_some_and(|client| client.trusted);
        let (Some(expected), Some(given)) = (&self.setup.token, &hello.token) else {
            return trusted;
        };
        let same = expected.len() == given.len()
            && expected
                .bytes()
                .zip(given.bytes())
                .fold(0, |differ, (a, b)| differ | (a ^ b))
                == 0;
        trusted || same
    }

    /// Who keeps a client from commanding; `None`: it may.
    pub(super) fn other_commander(&self, id: ClientId) -> Option<ClientId> {
        let other = self.commander.filter(|other| *other != id)?;
        // Whether a program still has the pseudo-terminal open is not known: it keeps the role
        // while it drives.
        let silent =
            other == TERMINAL || self.now_ns.saturating_sub(self.commander_ns) > super::SILENT_NS;
        (!silent || self.drives()).then_some(other)
    }

    /// Makes a client the commander.
    ///
    /// # Errors
    /// Another one commands: its name.
    pub(super) fn make_commander(&mut self, id: ClientId) -> Result<(), String> {
        if let Some(other) = self.other_commander(id) {
            return Err(self.name_of(other));
        }
        if self.commander != Some(id) {
            let text = match self.commander {
                Some(silent) => format!(
                    "{} was silent; {} commands now",
                    self.name_of(silent),
                    self.name_of(id)
                ),
                None => format!("{} commands", self.name_of(id)),
            };
            self.event("commander", text, None);
        }
        self.commander_tests &= self.commander == Some(id);
        self.commander = Some(id);
        self.commander_ns = self.now_ns;
        self.commander_seen = std::time::Instant::now();
        Ok(())
    }

    /// Nobody commands any more. What is driven is disarmed.
    pub(super) fn release(&mut self, why: &str) {
        self.commander = None;
        let armed = self.drives();
        if armed {
            self.send(Origin::Hub, Command::Disarm);
        }
        let text = if armed {
            format!("{why}; the rig is disarmed")
        } else {
            why.to_owned()
        };
        self.event("commander", text, None);
    }

    /// Names of everyone connected.
    pub(super) fn client_names(&self) -> impl Iterator<Item = String> + '_ {
        self.clients
            .iter()
            .filter(|(id, client)| **id != TERMINAL && client.hello.is_some())
            .map(|(_, client)| client.name())
    }

    pub(super) fn name_of(&self, id: ClientId) -> String {
        self.clients
            .get(&id)
            .map_or_else(|| "a client".to_owned(), Client::name)
    }

    /// Frames of a client.
    pub(super) fn client_bytes(&mut self, id: ClientId, bytes: &[u8]) {
        for byte in bytes {
            let Some(client) = self.clients.get_mut(&id) else {
                return;
            };
            // A damaged frame has no reply, as on the board: the client repeats it.
            if let Ok(Some(frame)) = client.decoder.push::<HostFrame>(*byte) {
                self.client_frame(id, frame);
            }
        }
    }

    fn client_frame(&mut self, id: ClientId, frame: HostFrame) {
        if self.commander == Some(id) {
            self.commander_ns = self.now_ns;
            self.commander_seen = std::time::Instant::now();
        }
        let seq = frame.seq;
        match &frame.command {
            // The board has one partner, the hub. A client gets the board's own answer to it.
            Command::Hello { .. } => {
                let known = self.info.clone().map(Response::Hello);
                if let Some(response) = known.or(self.refused.map(Response::Rejected)) {
                    self.reply_to(id, seq, response);
                }
            }
            // Everything is streamed, to everyone who subscribed.
            Command::Stream { .. } => self.reply_to(id, seq, Response::Done),
            Command::GetStatus | Command::GetConfig { .. } | Command::GetBoard => {
                self.send(Origin::Frame(id, seq), frame.command);
            }
            Command::Stop => {
                self.note_stop(id);
                self.send(Origin::Frame(id, seq), Command::Stop);
            }
            // Programs clear what their own tests have latched. That must not undo a stop that came
            // meanwhile.
            Command::ClearFaults if self.stopped == Some(id) => {
                let why = "the rig was stopped from elsewhere: `forcectl clear` first";
                self.refuse(id, seq, CommandError::Faulted(Fault::HostStop.code()), why);
            }
            command => match self.make_commander(id) {
                Ok(()) => {
                    let drives = matches!(command, Command::Arm | Command::Zero { .. });
                    match drives.then(|| self.exchanged(id)).flatten() {
                        Some(why) => {
                            let state = self.status.as_ref().map_or(0, |status| status.state);
                            self.refuse(id, seq, CommandError::State(state), &why);
                        }
                        None => self.send(Origin::Frame(id, seq), frame.command),
                    }
                }
                // docs/protocol.md: the other side commands now.
                Err(other) if matches!(command, Command::Setpoints { .. }) => {
                    let why = format!("{other} commands this rig: setpoints of others are refused");
                    self.refuse(id, seq, CommandError::NotConnected, &why);
                }
                Err(_) => self.reply_to(id, seq, Response::Rejected(CommandError::NotConnected)),
            },
        }
    }

    /// Refuses a frame of a client: in words, which no refusal of the board has, and as the board
    /// does.
    pub(super) fn refuse(&mut self, id: ClientId, seq: u16, refusal: CommandError, why: &str) {
        if let Some(client) = self.clients.get(&id) {
            client.outbox.line(notification("refused", &why));
        }
        self.reply_to(id, seq, Response::Rejected(refusal));
    }

    /// One that was stopped from elsewhere may be connected still, and commands no more.
    pub(super) fn make_commander_to_clear(&mut self, id: ClientId) -> Result<(), String> {
        if self
            .stopped
            .take()
            .is_some_and(|stopped| self.commander == Some(stopped))
        {
            self.commander = None;
        }
        self.make_commander(id)
    }

    /// Tells everyone who stops the rig, before the board does it.
    pub(super) fn note_stop(&mut self, id: ClientId) {
        // One that stops itself afterwards was stopped from elsewhere all the same.
        let by_another = self.commander.filter(|commander| *commander != id);
        self.stopped = by_another.or(self.stopped);
        let who = self.name_of(id);
        self.stops.note(&who);
        self.event("stop", format!("{STOPPED_BY}{who}"), None);
    }

    /// A reply to a client's own frame.
    pub(super) fn reply_to(&mut self, id: ClientId, seq: u16, response: Response) {
        if let Some(client) = self.clients.get_mut(&id) {
            client.frame(&BoardMessage::Reply(Reply { seq, response }));
        }
    }

    /// Answers requests that wait for motors at 0 V.
    pub(super) fn answer_waiting(&mut self) {
        if self.waiting.is_empty() {
            return;
        }
        let idle = !self.drives() && self.job.is_none();
        let (status_ns, now_ns) = (self.status_ns, self.now_ns);
        let (over, rest): (Vec<_>, Vec<_>) = std::mem::take(&mut self.waiting)
            .into_iter()
            .partition(|waiter| idle && status_ns > waiter.after_ns || now_ns >= waiter.until_ns);
        self.waiting = rest;
        for waiter in over {
            if idle {
                let done = serde_json::json!({"state": self.state_name()});
                self.succeed(waiter.id, waiter.request.as_ref(), done);
            } else {
                self.fail(
                    waiter.id,
                    waiter.request.as_ref(),
                    code::LINK,
                    "the motors are not at 0 V after 3 s; use `stop`",
                );
            }
        }
    }

    /// Requests that wait get an error.
    pub(super) fn fail_waiting(&mut self, text: &str) {
        for waiter in std::mem::take(&mut self.waiting) {
            self.fail(waiter.id, waiter.request.as_ref(), code::LINK, text);
        }
    }
}
