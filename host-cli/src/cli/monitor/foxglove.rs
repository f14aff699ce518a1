//! `monitor --foxglove`: what the monitor knows as a live source for Foxglove, over its WebSocket
//! protocol.
//!
//! | topic | schema | what |
//! | --- | --- | --- |
//! | `/unit1` to `/unit6` | `force_rig.Unit` | one unit: tension, setpoint, state |
//! | `/rig` | `force_rig.Rig` | the whole rig: state, force, tip, losses |
//! | `/tip` | `foxglove.PoseInFrame` | the tip, for the 3D view |
//! | `/tf` | `foxglove.FrameTransform` | the tip's frame |
//! | `/force` | `foxglove.SceneUpdate` | the force by measured tensions, an arrow at the tip |
//! | `/estimate` | `force_rig.Estimate` | the force that a model tells (`--estimate`) |
//! | `/log` | `foxglove.Log` | events |
//!
//! The server listens on the loopback unless it is told another address: who can reach it sees
//! everything, and commands nothing.

use super::source::{Event, Update};
use crate::cli::exit::{self, Failure, Result};
use foxglove::{
    ChannelBuilder, Context, PartialMetadata, RawChannel, Schema, WebSocketServer,
    WebSocketServerHandle,
};
use recording::foxglove::{Arrow, Scene, TipPose, TipTransform};
use recording::table::{Utc, Value as _};
use serde::Serialize;
use serde_json::{json, Value};
use session::telemetry::Telemetry;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

/// Where it listens without an address.
pub const DEFAULT_ADDRESS: &str = "127.0.0.1:8765";

/// A topic for each unit, because a topic is drawn as a line.
const UNIT_TOPICS: [&str; wire::UNITS] =
    ["/unit1", "/unit2", "/unit3", "/unit4", "/unit5", "/unit6"];

/// A unit now. What is not known is left out.
#[derive(Debug, Serialize)]
struct Unit<'a> {
    timestamp: Utc,
    t_s: f64,
    unit: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    tension_n: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    setpoint_n: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    zeroed: Option<bool>,
    #[serde(skip_serializing_if = "Option::is_none")]
    state: Option<&'a str>,
}

/// The rig now.
#[derive(Debug, Serialize)]
struct Rig<'a> {
    timestamp: Utc,
    t_s: f64,
    state: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    force_n: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    true_force_n: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    tip_m: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    estop_closed: Option<bool>,
    #[serde(skip_serializing_if = "Option::is_none")]
    latency_us: Option<u16>,
    #[serde(skip_serializing_if = "Option::is_none")]
    setpoint_age_ms: Option<u16>,
    faults: usize,
    frames_lost: u64,
    conversions_missed: u64,
}

/// An event.
#[derive(Debug, Serialize)]
struct Log<'a> {
    timestamp: Utc,
    level: u8,
    message: &'a str,
    name: &'a str,
    file: &'a str,
    line: u32,
}

/// Schema of an object with these properties; the ones in `optional` may be missing.
fn object(title: &str, required: &[(&str, Value)], optional: &[(&str, Value)]) -> Value {
    let properties: serde_json::Map<_, _> = required
        .iter()
        .chain(optional)
        .map(|(name, schema)| ((*name).to_owned(), schema.clone()))
        .collect();
    let names: Vec<_> = required.iter().map(|(name, _)| *name).collect();
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": title,
        "type": "object",
        "additionalProperties": false,
        "required": names,
        "properties": properties,
    })
}

/// Topics with the names of their schemas and the schemas.
fn topics() -> Vec<(&'static str, &'static str, Value)> {
    let number = |what: &str| json!({"type": "number", "description": what});
    let integer = |what: &str| json!({"type": "integer", "description": what});
    let text = |what: &str| json!({"type": "string", "description": what});
    let flag = |what: &str| json!({"type": "boolean", "description": what});
    let vector = |what: &str| {
        let mut schema = <[f64; 3]>::schema();
        schema["description"] = what.into();
        schema
    };
    let time = || ("timestamp", Utc::schema());
    let t_s = || ("t_s", number("time of the link, s"));
    let unit = object(
        "force_rig.Unit",
        &[time(), t_s(), ("unit", integer("unit, from 1"))],
        &[
            ("tension_n", number("newest cable tension, N")),
            ("setpoint_n", number("setpoint in force, N")),
            ("zeroed", flag("whether the board holds a zero of it")),
            ("state", text("state of the unit")),
        ],
    );
    let units = UNIT_TOPICS.map(|topic| (topic, "force_rig.Unit", unit.clone()));
    let others = [
        (
            "/rig",
            "force_rig.Rig",
            object(
                "force_rig.Rig",
                &[
                    time(),
                    t_s(),
                    ("state", text("state of the board")),
                    ("faults", integer("latched faults")),
                    ("frames_lost", integer("telemetry frames lost")),
                    (
                        "conversions_missed",
                        integer("conversions that the board did not read"),
                    ),
                ],
                &[
                    (
                        "force_n",
                        vector("force on the tip by the measured tensions, robot base frame, N"),
                    ),
                    (
                        "true_force_n",
                        vector("force on the tip in the plant (emulated rig), robot base frame, N"),
                    ),
                    ("tip_m", vector("tip, robot base frame, m")),
                    ("estop_closed", flag("whether the E-stop loop is closed")),
                    (
                        "latency_us",
                        integer("longest time from DRDY edge to DAC word, us"),
                    ),
                    (
                        "setpoint_age_ms",
                        integer("age of the setpoints in force, ms"),
                    ),
                ],
            ),
        ),
        (
            "/estimate",
            "force_rig.Estimate",
            object(
                "force_rig.Estimate",
                &[
                    time(),
                    ("valid", flag("whether the estimate can be used")),
                    (
                        "misfits",
                        flag("whether the model no longer fits the robot"),
                    ),
                ],
                &[
                    ("estimate_x_n", number("force on the tool along x, N")),
                    ("estimate_y_n", number("force on the tool along y, N")),
                    ("estimate_z_n", number("force on the tool along z, N")),
                    ("half_width_n", number("half width of the 90 % interval, N")),
                ],
            ),
        ),
        (
            "/log",
            "foxglove.Log",
            object(
                "foxglove.Log",
                &[
                    time(),
                    ("level", integer("2 information, 3 warning, 4 error")),
                    ("message", text("what happened")),
                    ("name", text("kind of the event")),
                    ("file", text("empty")),
                    ("line", integer("0")),
                ],
                &[],
            ),
        ),
    ];
    let drawn = recording::foxglove::topics();
    units.into_iter().chain(others).chain(drawn).collect()
}

/// Messages of an update, by topic.
fn messages(update: &Update, timestamp: Utc) -> Vec<(&'static str, Value)> {
    let mut found = Vec::new();
    let mut add = |topic, message: serde_json::Result<Value>| {
        found.extend(message.ok().map(|message| (topic, message)));
    };
    match update {
        Update::Telemetry(now) => {
            for (i, topic) in UNIT_TOPICS.into_iter().enumerate() {
                let unit = Unit {
                    timestamp,
                    t_s: now.t_s,
                    unit: i + 1,
                    tension_n: now.tension_n[i],
                    setpoint_n: now.setpoint_n[i],
                    zeroed: now.zeroed[i],
                    state: now.unit_state[i].as_deref(),
                };
                add(topic, serde_json::to_value(unit));
            }
            add("/rig", serde_json::to_value(rig(now, timestamp)));
            if let Some(tip_m) = now.tip_m {
                add(
                    TipPose::TOPIC,
                    serde_json::to_value(TipPose::new(timestamp, tip_m)),
                );
                add(
                    TipTransform::TOPIC,
                    Ok(TipTransform::message(timestamp, tip_m)),
                );
                // Without a force the arrow before it would stay.
                let arrow = Arrow::measured(now.force_n.unwrap_or_default());
                add(Scene::TOPIC, Ok(Scene::message(timestamp, tip_m, &[arrow])));
            } else {
                // Without a tip the arrow before it would stay, too.
                add(Scene::TOPIC, Ok(Scene::empty(timestamp)));
            }
        }
        Update::Event(event) => add("/log", serde_json::to_value(log(event, timestamp))),
        Update::Estimate(estimate) => {
            // What is not known is left out: without states there is no message.
            if let Value::Object(mut object) = estimate.json() {
                object.retain(|_, value| !value.is_null());
                object.insert("timestamp".to_owned(), json!(timestamp));
                add("/estimate", Ok(Value::Object(object)));
            }
        }
    }
    found
}

fn rig(now: &Telemetry, timestamp: Utc) -> Rig<'_> {
    Rig {
        timestamp,
        t_s: now.t_s,
        state: &now.state,
        force_n: now.force_n,
        true_force_n: now.true_force_n,
        tip_m: now.tip_m,
        estop_closed: now.estop_closed,
        latency_us: now.latency_us,
        setpoint_age_ms: now.setpoint_age_ms,
        faults: now.faults.len(),
        frames_lost: now.drops.frames_lost,
        conversions_missed: now.drops.conversions_missed,
    }
}

fn log(event: &Event, timestamp: Utc) -> Log<'_> {
    let level = match event.kind.as_str() {
        "fault" | "link" | "reset" => 4,
        "stop" | "misfit" | "robot" => 3,
        _ => 2,
    };
    Log {
        timestamp,
        level,
        message: &event.text,
        name: &event.kind,
        file: "",
        line: 0,
    }
}

/// A server with its channels.
pub struct Publisher {
    channels: Vec<(&'static str, Arc<RawChannel>)>,
    server: Option<WebSocketServerHandle>,
    /// Keeps the channels.
    _context: Arc<Context>,
}

impl Publisher {
    /// Listens on an address; returns the publisher and the address that it got.
    ///
    /// # Errors
    /// The address is in use or not this machine's.
    pub fn start(address: SocketAddr, title: &str) -> Result<(Self, SocketAddr)> {
        let failed = |error: foxglove::FoxgloveError| {
            Failure::new(
                exit::LINK,
                format!("Foxglove can't be served on {address}: {error}; give another address with --foxglove ADDRESS:PORT"),
            )
        };
        let context = Context::new();
        let mut channels = Vec::new();
        for (topic, name, schema) in topics() {
            let schema = Schema::new(name, "jsonschema", schema.to_string().into_bytes());
            let channel = ChannelBuilder::new(topic)
                .schema(schema)
                .message_encoding("json")
                .context(&context)
                .build_raw()
                .map_err(failed)?;
            channels.push((topic, channel));
        }
        let server = WebSocketServer::new()
            .name(title)
            .bind(address.ip().to_string(), address.port())
            .context(&context)
            .start_blocking()
            .map_err(failed)?;
        let at = SocketAddr::new(address.ip(), server.port());
        let publisher = Self {
            channels,
            server: Some(server),
            _context: context,
        };
        Ok((publisher, at))
    }

    /// Publishes an update.
    pub fn take(&self, update: &Update) {
        let now_ns = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .map_or(0, |passed| u64::try_from(passed.as_nanos()).unwrap_or(0));
        for (topic, message) in messages(update, Utc::from_ns(now_ns)) {
            let channel = self.channels.iter().find(|(name, _)| *name == topic);
            if let Some((_, channel)) = channel {
                let time = PartialMetadata {
                    log_time: Some(now_ns),
                };
                channel.log_with_meta(message.to_string().as_bytes(), time);
            }
        }
    }
}

impl Drop for Publisher {
    fn drop(&mut self) {
        if let Some(server) = self.server.take() {
            server.stop().wait_blocking();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::model::Estimated;
    use super::*;

    fn updates() -> [Update; 5] {
        let known = Telemetry {
            t_s: 2.5,
            state: "running".to_owned(),
            tension_n: [Some(2.0); 6],
            force_n: Some([0.0, 2.5, 0.0]),
            tip_m: Some([-0.08, 0.02, -0.14]),
            unit_state: std::array::from_fn(|_| Some("running".to_owned())),
            zeroed: [Some(true); 6],
            latency_us: Some(120),
            ..Telemetry::default()
        };
        [
            Update::Telemetry(Box::new(known)),
            Update::Telemetry(Box::default()),
            Update::Event(Event {
                kind: "fault".to_owned(),
                text: "unit 3".to_owned(),
                ..Event::default()
            }),
            Update::Estimate(Estimated::Silent),
            Update::Estimate(Estimated::Force {
                force_n: [None, Some(2.5), None],
                half_n: None,
                valid: true,
                misfits: false,
            }),
        ]
    }

    #[test]
    fn every_message_has_the_form_of_its_schema() {
        let topics = topics();
        let mut sent = std::collections::BTreeSet::new();
        for update in updates() {
            for (topic, message) in messages(&update, Utc::from_ns(5)) {
                let (_, _, schema) = topics.iter().find(|(name, _, _)| *name == topic).unwrap();
                let validator = jsonschema::validator_for(schema).unwrap();
                let mistakes: Vec<_> = validator
                    .iter_errors(&message)
                    .map(|error| error.to_string())
                    .collect();
                assert!(mistakes.is_empty(), "{topic}: {mistakes:?}");
                sent.insert(topic);
            }
        }
        assert_eq!(sent.len(), topics.len());
    }

    #[test]
    fn a_server_listens_on_the_loopback_and_ends_with_its_publisher() {
        let address: SocketAddr = "127.0.0.1:0".parse().unwrap();
        let (publisher, at) = Publisher::start(address, "test").unwrap();
        assert!(std::net::TcpStream::connect(at).is_ok());
        updates().iter().for_each(|update| publisher.take(update));
        let taken = Publisher::start(at, "test").err().unwrap();
        assert!(
            taken.message.contains("another address"),
            "{}",
            taken.message
        );
        drop(publisher);
        // Its runtime closes the listener a moment after the last client was told.
        let until = std::time::Instant::now() + std::time::Duration::from_secs(10);
        while std::net::TcpStream::connect(at).is_ok() {
            assert!(std::time::Instant::now() < until, "it still listens");
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
        let default: SocketAddr = DEFAULT_ADDRESS.parse().unwrap();
        assert!(default.ip().is_loopback());
    }

    /// Whether a field of a topic is there in a recording or in the stream.
    fn is_there(topic: &str, field: &str) -> bool {
        let recorded = recording::TABLES
            .iter()
            .filter(|table| table.topics.contains(&topic))
            .any(|table| table.fields.iter().any(|f| f.name == field));
        let streamed = topics()
            .iter()
            .filter(|(name, _, _)| *name == topic)
            .any(|(_, _, schema)| schema["properties"][field].is_object());
        recorded || streamed
    }

    #[test]
    fn the_layout_shows_topics_and_fields_that_there_are() {
        let layout = include_str!("../../../examples/foxglove-layout.json");
        let layout: Value = serde_json::from_str(layout).unwrap();
        let mut shown = 0;
        let mut drawn = 0;
        for panel in layout["configById"].as_object().unwrap().values() {
            for path in panel["paths"].as_array().into_iter().flatten() {
                let path = path["value"].as_str().unwrap();
                let (topic, field) = path.split_once('.').unwrap();
                let field = field.split('[').next().unwrap();
                assert!(is_there(topic, field), "{path}");
                shown += 1;
            }
            for topic in panel["topics"].as_object().into_iter().flatten() {
                let of_viewer = recording::foxglove::topics();
                assert!(of_viewer.iter().any(|(name, ..)| name == topic.0));
                drawn += 1;
            }
            if let Some(frame) = panel["followTf"].as_str() {
                assert_eq!(frame, recording::foxglove::FRAME);
            }
        }
        assert!(shown > 20 && drawn == 2, "{shown} {drawn}");
    }

    #[test]
    fn the_arrow_is_the_force_and_goes_where_there_is_none() {
        let [known, ..] = updates();
        let Update::Telemetry(mut now) = known else {
            unreachable!()
        };
        let arrow = |now: &Telemetry| {
            let update = Update::Telemetry(Box::new(now.clone()));
            let mut found = messages(&update, Utc::from_ns(5)).into_iter();
            let scene = found.find(|(topic, _)| *topic == Scene::TOPIC);
            let arrow = scene.unwrap().1["entities"][0]["arrows"][0].clone();
            arrow["shaft_length"].as_f64().unwrap() + arrow["head_length"].as_f64().unwrap()
        };
        assert!((arrow(&now) - 0.05).abs() < 1e-12);
        now.force_n = None;
        assert_eq!(arrow(&now), 0.0);
        now.tip_m = None;
        let update = Update::Telemetry(now);
        let found = messages(&update, Utc::from_ns(5));
        let scene = &found.iter().find(|(topic, _)| *topic == Scene::TOPIC);
        let scene = &scene.unwrap().1;
        assert_eq!(scene["entities"], serde_json::json!([]));
        assert_eq!(scene["deletions"][0]["type"], 1);
    }
}
