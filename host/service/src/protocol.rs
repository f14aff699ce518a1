//! Messages between the service and its clients: JSON-RPC 2.0, one object per line
//! (docs/service.md).
//!
//! A client sends requests `{"jsonrpc": "2.0", "id": 1, "method": "stop"}`. The service answers
//! each request that has an `id`, and sends notifications (no `id`) for the topics that the client
//! subscribed to. The first request is `hello`.

use super::account;
use emulator_link::{Pose, Truth};
use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};
use serde_json::{json, Value};
pub use session::telemetry::Telemetry;
use wire::message::{BoardInfo, Status};
use wire::UNITS;

/// Version of this protocol. The service refuses a client of another version in `hello`.
pub const VERSION: u32 = 1;

/// Longest line that either side accepts, bytes.
pub const MAX_LINE: usize = 16 << 20;

/// Numbers of errors. -32,768 to -32,000 are those of JSON-RPC 2.0.
pub mod code {
    /// The line is not JSON.
    pub const PARSE: i64 = -32_700;
    /// The method does not exist, or its parameters are wrong.
    pub const INVALID: i64 = -32_602;
    /// The first request must be `hello` with this service's version (and token, over TCP).
    pub const HELLO: i64 = 1;
    /// Another client commands.
    pub const BUSY: i64 = 2;
    /// The link to the board is gone, or the board does not answer.
    pub const LINK: i64 = 3;
    /// The board refused the command.
    pub const REFUSED: i64 = 4;
    /// The rig can't do that (an injection into a real board).
    pub const UNSUPPORTED: i64 = 5;
    /// The job failed.
    pub const JOB: i64 = 6;
    /// A part of the rig was exchanged since its bring-up.
    pub const EXCHANGED: i64 = 7;
}

/// What a client requests.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "method", content = "params", rename_all = "snake_case")]
pub enum Call {
    /// First request.
    Hello(Hello),
    /// Become the commander. Refused while another client commands, unless that one has been silent
    /// for 1 s of the link's time and drives nothing.
    Command(CommandParams),
    /// Stop being the commander. A rig that is driven is disarmed.
    Release,
    /// All motors to 0 V at once, latched until `clear`. Any client, at any time.
    Stop,
    /// Ramp down and disarm; ends the service's job. Refused while another client commands.
    Disarm,
    /// Clear latched faults whose cause is gone. Refused while another client commands.
    Clear,
    /// The state of board, link and clients.
    Status,
    /// Receive notifications of these topics, and no others.
    Subscribe(Topics),
    /// Frames for the board as docs/protocol.md describes them, in base64. Has no answer of its
    /// own.
    Bytes(String),
    /// The service holds tensions until `disarm`: arms, holds, and answers when it holds.
    Hold(HoldParams),
    /// The service holds a force at the tip for some time, and answers with the figures at the end.
    SetForce(ForceParams),
    /// The robot of an emulated rig starts or stops to move.
    Robot {
        /// `true`: move.
        moving: bool,
    },
    /// A fault of an emulated rig, in the words of `forcectl set-force --inject help`, without a
    /// time: `unplug=3`.
    Inject {
        /// The fault.
        what: String,
    },
    /// Figures of an emulated rig since the last such request (postcard of `emulator_link::Report`,
    /// base64).
    Report,
    /// End the service. A rig that is driven is disarmed first.
    Shutdown,
}

/// The first request.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Hello {
    /// [`VERSION`] of the client.
    pub version: u32,
    /// Name of the client, for messages to others, for example `forcectl monitor`.
    pub client: String,
    /// Its process, for messages to others.
    #[serde(default)]
    pub pid: Option<u32>,
    /// Its account, for messages to others.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub user: Option<String>,
    /// Its terminal, for messages to others.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub terminal: Option<String>,
    /// The token of a service that listens on TCP.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub token: Option<String>,
}

/// Topics of notifications.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Topics {
    /// [`Tick`]: each cycle of the link, with the board's frames as bytes. What `forcectl` itself
    /// uses.
    pub ticks: bool,
    /// The plant's true state in the ticks (emulated rig).
    pub truth: bool,
    /// [`Telemetry`]: tensions, forces, states and faults, 50 times a second; twice a second while
    /// the link is lost.
    pub telemetry: bool,
    /// [`Event`]: faults, who commands, a link that is lost or back.
    pub events: bool,
}

impl Hello {
    /// That of this process: `client` is the program's name.
    #[must_use]
    pub fn of_this_process(client: &str) -> Self {
        Self {
            pid: Some(std::process::id()),
            user: Some(account::name(account::uid())),
            terminal: account::terminal(),
            ..Self::nameless(client)
        }
    }

    /// That of a client without a process of its own.
    #[must_use]
    pub fn nameless(client: &str) -> Self {
        Self {
            version: VERSION,
            client: client.to_owned(),
            ..Self::default()
        }
    }

    /// Client, process, account and terminal, as far as they are known.
    #[must_use]
    pub fn name(&self) -> String {
        let known = [
            self.pid.map(|pid| format!("process {pid}")),
            self.user.as_ref().map(|user| format!("user {user}")),
            (self.terminal.as_ref()).map(|terminal| format!("terminal {terminal}")),
        ];
        let known: Vec<String> = known.into_iter().flatten().collect();
        if known.is_empty() {
            return self.client.clone();
        }
        format!("{} ({})", self.client, known.join(", "))
    }
}

/// What the text of an event of the kind `stop` begins with; who did it follows.
pub(super) const STOPPED_BY: &str = "stopped by ";

/// How a client commands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CommandParams {
    /// It tests a rig whose parts may be new ones, as `forcectl bring-up` does: it alone may drive
    /// it then.
    pub tests: bool,
}

/// What `hold` holds.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HoldParams {
    /// Tensions of units 1 to 6 in N; absent: the rig file's least tensions.
    pub tension_n: Option<[f64; UNITS]>,
    /// The hold ends when this client goes away, as a force does.
    pub ends_with_client: bool,
}

/// What `set_force` holds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ForceParams {
    /// Force at the tip, robot base frame, N.
    pub force_n: [f64; 3],
    /// For how long, s.
    pub duration_s: f64,
}

/// Answer to `hello`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Welcome {
    /// [`VERSION`] of the service.
    pub version: u32,
    /// Name of the rig.
    pub name: String,
    /// Name of the link.
    pub link: String,
    /// Process of the service.
    pub pid: u32,
    /// Whether the link leads to an emulated rig, and its seed.
    pub seed: Option<u64>,
    /// The board, where one has answered.
    pub board: Option<BoardInfo>,
    /// The rig file of the service: its name.
    pub rig_file: String,
    /// The rig file of the service: its text.
    pub rig_text: String,
    /// Time of the link, ns.
    pub now_ns: u64,
    /// The pseudo-terminal, where there is one.
    pub terminal: Option<String>,
    /// Stops of other clients and of the E-stop since the service began. A command that connects
    /// more than once was stopped in between where this has grown.
    #[serde(default)]
    pub stops: u64,
    /// Who made the last of them.
    #[serde(default)]
    pub stopped_by: Option<String>,
}

/// One cycle of the link.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Tick {
    /// Time of the link, ns.
    pub now_ns: u64,
    /// Frames of the board, base64, numbered for this client.
    pub bytes: String,
    /// The robot's pose, where the link reports it.
    pub pose: Option<Pose>,
    /// Resets of the board, where the link counts them.
    pub resets: u32,
    /// The plant's true state in each millisecond.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub truth: Vec<Truth>,
}

/// Something that happened.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// Time of the link, s.
    pub t_s: f64,
    /// What: `fault`, `commander`, `stop`, `link`, `reset`, `job`.
    pub kind: String,
    /// In words.
    pub text: String,
    /// Number of the fault.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fault: Option<u16>,
    /// Unit, from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<u8>,
}

/// Answer to `status`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ServiceStatus {
    /// Time of the link, ns.
    pub now_ns: u64,
    /// Whether the link works.
    pub linked: bool,
    /// The board's newest status.
    pub board: Option<Status>,
    /// State of the board in words.
    pub state: String,
    /// Who commands.
    pub commander: Option<String>,
    /// All clients.
    pub clients: Vec<ClientStatus>,
    /// Frames of the board that arrived damaged.
    pub frames_bad: u64,
}

/// One client.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ClientStatus {
    /// Its name and process.
    pub name: String,
    /// Notifications that it did not read in time.
    pub dropped: u64,
}

/// The keys of a request, each of which may stand once.
#[derive(Deserialize)]
struct Once {
    #[serde(default, rename = "id")]
    _id: IgnoredAny,
    #[serde(default, rename = "method")]
    _method: IgnoredAny,
    #[serde(default, rename = "params")]
    _params: IgnoredAny,
}

/// A request as it stands on the line.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// Repeated in the answer; `None`: no answer is wanted.
    pub id: Option<Value>,
    /// What to do.
    pub call: Call,
}

impl Request {
    /// Reads a line.
    ///
    /// # Errors
    /// The error's number and words, and the request's `id` where it could be read.
    pub fn parse(line: &str) -> Result<Self, (Option<Value>, i64, String)> {
        let not_json = |error| (None, code::PARSE, format!("this line is not JSON: {error}"));
        let mut value: Value = serde_json::from_str(line).map_err(not_json)?;
        if let Err(error) = serde_json::from_str::<Once>(line) {
            // Which of two methods is meant is not guessed.
            if error.to_string().starts_with("duplicate field") {
                return Err((None, code::PARSE, error.to_string()));
            }
        }
        let id = value.get("id").filter(|id| !id.is_null()).cloned();
        let Some(object) = value.as_object_mut() else {
            return Err((
                None,
                code::PARSE,
                "a request is a JSON object with `method`".to_owned(),
            ));
        };
        // A method without parameters may have `"params": {}` as well, or `[]` as some libraries
        // send.
        let empty = |params: &Value| params.as_object().is_some_and(serde_json::Map::is_empty);
        if object
            .get("params")
            .is_some_and(|params| *params == json!([]))
        {
            object.insert("params".to_owned(), json!({}));
        }
        let mut call = serde_json::Map::new();
        for key in ["method", "params"] {
            if let Some(found) = object.remove(key) {
                call.insert(key.to_owned(), found);
            }
        }
        let bare = call.get("params").is_some_and(empty);
        let read = serde_json::from_value::<Call>(Value::Object(call.clone())).or_else(|error| {
            if bare {
                call.remove("params");
            } else if !call.contains_key("params") {
                call.insert("params".to_owned(), json!({}));
            } else {
                return Err(error);
            }
            serde_json::from_value(Value::Object(call)).map_err(|_| error)
        });
        match read {
            Ok(call) => Ok(Self { id, call }),
            Err(error) => Err((id, code::INVALID, error.to_string())),
        }
    }

    /// The line for this request.
    #[must_use]
    pub fn to_line(&self) -> String {
        let mut value = serde_json::to_value(&self.call).unwrap_or_default();
        value["jsonrpc"] = "2.0".into();
        if let Some(id) = &self.id {
            value["id"] = id.clone();
        }
        format!("{value}\n")
    }
}

/// The line of an answer.
#[must_use]
pub fn answer(id: &Value, result: &Result<Value, (i64, String)>) -> String {
    let value = match result {
        Ok(result) => json!({"jsonrpc": "2.0", "id": id, "result": result}),
        Err((code, message)) => {
            json!({"jsonrpc": "2.0", "id": id, "error": {"code": code, "message": message}})
        }
    };
    format!("{value}\n")
}

/// The line of a notification.
#[must_use]
pub fn notification(method: &str, params: &impl Serialize) -> String {
    // Plain numbers and strings: cannot fail.
    let params = serde_json::to_string(params).unwrap_or_default();
    format!("{{\"jsonrpc\":\"2.0\",\"method\":\"{method}\",\"params\":{params}}}\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_survive_the_line() {
        for call in [
            Call::Stop,
            Call::Hello(Hello {
                pid: Some(7),
                ..Hello::nameless("a test")
            }),
            Call::Hello(Hello::of_this_process("a test")),
            Call::Command(CommandParams::default()),
            Call::Command(CommandParams { tests: true }),
            Call::Hold(HoldParams::default()),
            Call::SetForce(ForceParams {
                force_n: [0.0, 2.5, 0.0],
                duration_s: 3.0,
            }),
            Call::Bytes("AAE=".to_owned()),
            Call::Inject {
                what: "unplug=3".to_owned(),
            },
        ] {
            let request = Request {
                id: Some(json!(3)),
                call,
            };
            let line = request.to_line();
            assert_eq!(line.matches('\n').count(), 1, "{line}");
            assert_eq!(Request::parse(&line).unwrap(), request, "{line}");
        }
    }

    #[test]
    fn of_two_methods_none_is_guessed() {
        let line = r#"{"id":1,"method":"stop","method":"status"}"#;
        let (_, found, text) = Request::parse(line).unwrap_err();
        assert_eq!(found, code::PARSE);
        assert!(text.contains("duplicate field `method`"), "{text}");
    }

    #[test]
    fn parameters_that_may_be_left_out_may_be_empty_too() {
        for line in [
            r#"{"jsonrpc":"2.0","id":1,"method":"stop","params":{}}"#,
            r#"{"jsonrpc":"2.0","id":1,"method":"stop","params":[]}"#,
            r#"{"id":1,"method":"stop"}"#,
        ] {
            assert_eq!(Request::parse(line).unwrap().call, Call::Stop);
        }
        let command = Request::parse(r#"{"id":1,"method":"command"}"#).unwrap();
        assert_eq!(command.call, Call::Command(CommandParams::default()));
        let hold = Request::parse(r#"{"id":1,"method":"hold"}"#).unwrap();
        assert_eq!(hold.call, Call::Hold(HoldParams::default()));
    }

    #[test]
    fn lines_that_are_no_request_are_refused_with_their_id() {
        for (line, code, words) in [
            ("GET / HTTP/1.1", code::PARSE, "not JSON"),
            ("[1]", code::PARSE, "method"),
            (r#"{"id":4,"method":"explode"}"#, code::INVALID, "explode"),
            (
                r#"{"id":4,"method":"set_force","params":{"force_n":[1,2]}}"#,
                code::INVALID,
                "",
            ),
            (r#"{"id":4}"#, code::INVALID, "method"),
        ] {
            let (id, found, text) = Request::parse(line).unwrap_err();
            assert_eq!(found, code, "{line}: {text}");
            assert!(text.contains(words), "{line}: {text}");
            assert_eq!(id.is_some(), line.contains("\"id\""), "{line}");
        }
    }
}
