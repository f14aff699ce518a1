//! One page: lines between its WebSocket and a connection to the service.

use crate::about;
use crate::tools::Tools;
use axum::extract::ws::{Message, WebSocket};
use futures_util::stream::{SplitSink, SplitStream};
use futures_util::{SinkExt as _, StreamExt as _};
use serde_json::{json, Value};
use service::protocol::{self, code, Call, Hello, Request, Topics};
use std::net::SocketAddr;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncBufReadExt as _, AsyncWriteExt as _, BufReader, Lines};
use tokio::net::unix::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::UnixStream;
use tokio::sync::{mpsc, watch};
use tokio::time::{interval, timeout, Instant, MissedTickBehavior};

/// Telemetry that a page gets at most, pictures a second.
pub(crate) const PICTURES_PER_S: u32 = 30;
/// A browser answers a ping by itself, also where its page is busy.
const PING: Duration = Duration::from_millis(500);
/// Without anything from the browser for so long the page is gone: a phone out of reach, a computer
/// that sleeps. A commander's rig is disarmed then.
const SILENT: Duration = Duration::from_secs(2);
/// How long the service may take to say hello.
const HELLO: Duration = Duration::from_secs(2);
/// Answers and events that wait for a page at most; one that reads so slowly is closed.
const WAITING: usize = 1024;

/// Serves a page until one of both ends goes away.
pub(crate) async fn serve(page: WebSocket, from: SocketAddr, socket: &Path, tools: &Arc<Tools>) {
    let (mut to_page, from_page) = page.split();
    let name = format!("page at {}", from.ip());
    let (welcome, lines, to_service) = match hello(socket, &name).await {
        Ok(connected) => connected,
        Err(error) => {
            let gone = protocol::notification("gone", &json!({"why": error}));
            let _ = to_page.send(Message::Text(gone.into())).await;
            return;
        }
    };
    let (answers, waiting) = mpsc::channel(WAITING);
    let (newest, pictures) = watch::channel(String::new());
    let first = protocol::notification("welcome", &about::welcome(&welcome, &name));
    let _ = answers.try_send(first);
    let began = Instant::now();
    let heard_ms = AtomicU64::new(0);
    let heard = || {
        let now_ms = u64::try_from(began.elapsed().as_millis()).unwrap_or(u64::MAX);
        heard_ms.store(now_ms, Ordering::Relaxed);
    };
    // The first that ends ends all: the connection to the service closes, and a commander's rig is
    // disarmed.
    tokio::select! {
        () = read_service(lines, &answers, &newest) => {}
        () = read_page(from_page, to_service, &answers, tools, &heard) => {}
        () = write_page(&mut to_page, waiting, pictures, tools.recording()) => {}
        () = silence(began, &heard_ms) => {}
    }
    let _ = timeout(PING, to_page.close()).await;
}

/// Connects and introduces the page: the service's welcome, its lines, and the way to it.
async fn hello(
    socket: &Path,
    name: &str,
) -> Result<(Value, Lines<BufReader<OwnedReadHalf>>, OwnedWriteHalf), String> {
    let connected = async {
        let stream = UnixStream::connect(socket).await?;
        let (reader, mut writer) = stream.into_split();
        let mut lines = BufReader::new(reader).lines();
        let topics = Topics {
            telemetry: true,
            events: true,
            ..Topics::default()
        };
        for (id, call) in [
            (json!("hello"), Call::Hello(Hello::nameless(name))),
            (Value::Null, Call::Subscribe(topics)),
        ] {
            let id = (!id.is_null()).then_some(id);
            let line = Request { id, call }.to_line();
            writer.write_all(line.as_bytes()).await?;
        }
        let answer = lines.next_line().await?.unwrap_or_default();
        Ok::<_, std::io::Error>((answer, lines, writer))
    };
    match timeout(HELLO, connected).await {
        Ok(Ok((answer, lines, writer))) => {
            let answer: Value = serde_json::from_str(&answer).unwrap_or_default();
            match answer.get("result") {
                Some(welcome) => Ok((welcome.clone(), lines, writer)),
                None => Err(format!("the service refuses the page: {answer}")),
            }
        }
        Ok(Err(error)) => Err(format!("the service can't be reached: {error}")),
        Err(_) => Err(format!("the service is silent for {} s", HELLO.as_secs())),
    }
}

/// Takes lines of the service until it ends: the newest telemetry, and everything else.
async fn read_service(
    mut lines: Lines<BufReader<OwnedReadHalf>>,
    answers: &mpsc::Sender<String>,
    newest: &watch::Sender<String>,
) {
    let telemetry = protocol::notification("telemetry", &0);
    let telemetry = telemetry.trim_end().trim_end_matches("0}");
    while let Ok(Some(line)) = lines.next_line().await {
        if line.starts_with(telemetry) {
            newest.send_replace(line);
        } else if answers.try_send(line).is_err() {
            return;
        }
    }
    let gone = json!({"why": "the service has ended; the board goes to 0 V by itself"});
    let _ = answers.send(protocol::notification("gone", &gone)).await;
    // Until the page has it.
    tokio::time::sleep(PING).await;
}

/// Carries orders of the page to the service until the page ends.
async fn read_page(
    mut page: SplitStream<WebSocket>,
    mut service: OwnedWriteHalf,
    answers: &mpsc::Sender<String>,
    tools: &Arc<Tools>,
    heard: &impl Fn(),
) {
    while let Some(Ok(message)) = page.next().await {
        heard();
        let text = match message {
            Message::Text(text) => text,
            Message::Close(_) => return,
            Message::Binary(_) | Message::Ping(_) | Message::Pong(_) => continue,
        };
        // A line for the service, whatever stands in it: a string of JSON holds no line's end.
        let line = text.replace(['\n', '\r'], " ");
        match Order::of(&line) {
            Order::Service => {
                let line = format!("{line}\n");
                if service.write_all(line.as_bytes()).await.is_err() {
                    return;
                }
            }
            Order::Tool(tool, id) => {
                // Beside the page, which may stop meanwhile.
                let (tools, answers) = (Arc::clone(tools), answers.clone());
                tokio::spawn(async move {
                    let result = match tool {
                        Tool::Zero => tools.zero().await,
                        Tool::Record => tools.record(),
                        Tool::EndRecording => tools.end_recording(),
                    };
                    let result = result.map_err(|error| (code::REFUSED, error));
                    let _ = answers.send(protocol::answer(&id, &result)).await;
                });
            }
            Order::Refused(id, what) => {
                let error = Err((code::INVALID, what));
                if answers.send(protocol::answer(&id, &error)).await.is_err() {
                    return;
                }
            }
        }
    }
}

/// What a page asks for.
#[derive(Debug, PartialEq)]
enum Order {
    /// The service does it.
    Service,
    /// Another command does it; number of the request.
    Tool(Tool, Value),
    /// Nobody does it; number of the request, and why.
    Refused(Value, String),
}

#[derive(Debug, PartialEq)]
enum Tool {
    Zero,
    Record,
    EndRecording,
}

impl Order {
    fn of(line: &str) -> Self {
        let value: Value = serde_json::from_str(line).unwrap_or_default();
        let id = value["id"].clone();
        match value["method"].as_str().unwrap_or_default() {
            "zero" => Self::Tool(Tool::Zero, id),
            "record" => Self::Tool(Tool::Record, id),
            "end_recording" => Self::Tool(Tool::EndRecording, id),
            "stop" | "disarm" | "clear" | "hold" | "set_force" | "command" | "release"
            | "status" | "robot" | "inject" => Self::Service,
            other => Self::Refused(id, format!("a page may not ask for `{other}`")),
        }
    }
}

/// Writes to the page until that fails: answers as they come, and the newest picture in its turn.
async fn write_page(
    page: &mut SplitSink<WebSocket, Message>,
    mut answers: mpsc::Receiver<String>,
    mut pictures: watch::Receiver<String>,
    mut recording: watch::Receiver<Value>,
) {
    let every = |time| {
        let mut ticks = interval(time);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        ticks
    };
    let mut picture = every(Duration::from_secs(1) / PICTURES_PER_S);
    let mut ping = every(PING);
    recording.mark_changed();
    loop {
        let message = tokio::select! {
            biased;
            answer = answers.recv() => match answer {
                Some(line) => Message::Text(line.into()),
                None => return,
            },
            Ok(()) = recording.changed() => {
                let state = recording.borrow_and_update().clone();
                Message::Text(protocol::notification("recording", &state).into())
            }
            _ = ping.tick() => Message::Ping(Vec::new().into()),
            _ = picture.tick() => {
                if !pictures.has_changed().unwrap_or(false) {
                    continue;
                }
                Message::Text(pictures.borrow_and_update().clone().into())
            }
        };
        if page.send(message).await.is_err() {
            return;
        }
    }
}

/// Returns when nothing was heard for [`SILENT`].
async fn silence(began: Instant, heard_ms: &AtomicU64) {
    loop {
        let heard = began + Duration::from_millis(heard_ms.load(Ordering::Relaxed));
        let until = heard + SILENT;
        if Instant::now() >= until {
            return;
        }
        tokio::time::sleep_until(until).await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_may_ask_for_what_it_shows() {
        let order = |method: &str| Order::of(&json!({"id": 3, "method": method}).to_string());
        for method in ["stop", "disarm", "clear", "hold", "set_force", "status"] {
            assert_eq!(order(method), Order::Service, "{method}");
        }
        assert_eq!(order("zero"), Order::Tool(Tool::Zero, json!(3)));
        for method in ["shutdown", "bytes", "hello", "subscribe", "report", ""] {
            assert!(
                matches!(order(method), Order::Refused(id, _) if id == 3),
                "{method}"
            );
        }
        assert!(matches!(
            Order::of("no JSON"),
            Order::Refused(Value::Null, _)
        ));
    }
}
