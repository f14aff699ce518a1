//! The page's side of the WebSocket, without a browser: who may open it, what it gets, what happens
//! when it goes away.
#![cfg(unix)]

mod common;

use bring_up::record::{Identity, Record};
use common::Served;
use futures_util::{SinkExt as _, StreamExt as _};
use known::store::Store;
use serde_json::{json, Value};
use std::time::Duration;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::time::{timeout, Instant};
use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream};

/// Longest wait for what has to come. A limit of patience, not of speed: the machine may be busy.
const PATIENCE: Duration = Duration::from_secs(60);

struct Page {
    socket: WebSocketStream<MaybeTlsStream<TcpStream>>,
    next: u64,
}

impl Page {
    async fn open(served: &Served) -> Self {
        let mut request = format!("ws://{}/ws", served.host())
            .into_client_request()
            .unwrap();
        let origin = format!("http://{}", served.host());
        (request.headers_mut()).insert("origin", origin.parse().unwrap());
        let (socket, _) = tokio_tungstenite::connect_async(request).await.unwrap();
        Self { socket, next: 1 }
    }

    /// The next message that is as wanted; `None` at the end.
    async fn until(&mut self, wanted: impl Fn(&Value) -> bool) -> Option<Value> {
        let found = async {
            while let Some(Ok(message)) = self.socket.next().await {
                if let Message::Text(text) = message {
                    let value: Value = serde_json::from_str(&text).unwrap();
                    if wanted(&value) {
                        return Some(value);
                    }
                }
            }
            None
        };
        timeout(PATIENCE, found).await.expect("it never came")
    }

    async fn state(&mut self, wanted: &str) -> Value {
        let is =
            |value: &Value| value["method"] == "telemetry" && value["params"]["state"] == wanted;
        self.until(is).await.expect("telemetry")["params"].clone()
    }

    async fn send(&mut self, method: &str, params: Value) -> u64 {
        let id = self.next;
        self.next += 1;
        let request = json!({"jsonrpc": "2.0", "id": id, "method": method, "params": params});
        let message = Message::Text(request.to_string().into());
        self.socket.send(message).await.unwrap();
        id
    }

    async fn call(&mut self, method: &str, params: Value) -> Value {
        let id = self.send(method, params).await;
        self.until(|value| value["id"] == id)
            .await
            .expect("an answer")
    }
}

async fn http(served: &Served, head: &str) -> String {
    let mut stream = TcpStream::connect(served.host()).await.unwrap();
    stream.write_all(head.as_bytes()).await.unwrap();
    let mut answer = Vec::new();
    timeout(PATIENCE, stream.read_to_end(&mut answer))
        .await
        .expect("an answer")
        .unwrap();
    String::from_utf8_lossy(&answer).into_owned()
}

/// More than the page has places.
#[tokio::test]
async fn connections_that_say_nothing_keep_no_page_out() {
    let served = Served::new(None);
    let mut silent = Vec::new();
    for _ in 0..300 {
        silent.push(TcpStream::connect(served.host()).await.unwrap());
    }
    let mut page = Page::open(&served).await;
    page.state("ready").await;
    // The first of them were put out.
    let mut end = [0];
    let read = timeout(PATIENCE, silent[0].read(&mut end)).await;
    assert!(!matches!(read.expect("it ends"), Ok(1)));
}

#[tokio::test]
async fn a_page_shows_commands_and_stops_the_rig() {
    let served = Served::new(None);
    let mut one = Page::open(&served).await;
    let mut two = Page::open(&served).await;
    let welcome = one.until(|v| v["method"] == "welcome").await.unwrap();
    assert_eq!(
        welcome["params"]["rig"]["units"].as_array().unwrap().len(),
        6
    );
    assert_eq!(welcome["params"]["page"], "page at 127.0.0.1");
    one.state("ready").await;
    let force = json!({"force_n": [0.0, 2.5, 0.0], "duration_s": 600.0});
    let held = one.send("set_force", force).await;
    let now = two.state("running").await;
    assert!(now["commander"]
        .as_str()
        .unwrap()
        .contains("page at 127.0.0.1"));
    // The other page may not command, and it may stop.
    let refused = two.call("hold", json!({})).await;
    assert_eq!(refused["error"]["code"], 2, "{refused}");
    let stopped = two.call("stop", json!({})).await;
    assert!(stopped["error"].is_null(), "{stopped}");
    let ended = one.until(|value| value["id"] == held).await.unwrap();
    assert!(
        ended["error"]["message"]
            .as_str()
            .unwrap()
            .contains("stopped"),
        "{ended}"
    );
    let stopped = |value: &Value| value["params"]["faults"][0]["code"] == 3;
    one.until(stopped).await.expect("telemetry");
    let cleared = one.call("clear", json!({})).await;
    assert_eq!(cleared["result"]["fault"], Value::Null, "{cleared}");
    one.state("ready").await;
    let zeroed = one.call("zero", json!({})).await;
    assert!(zeroed["error"].is_null(), "{zeroed}");
    for method in ["shutdown", "bytes", "subscribe", "no such"] {
        let refused = one.call(method, json!({})).await;
        assert_eq!(refused["error"]["code"], -32_602, "{refused}");
    }
    one.state("ready").await;
}

#[tokio::test]
async fn a_commander_that_is_gone_has_the_rig_disarmed() {
    let served = Served::new(None);
    let mut watcher = Page::open(&served).await;
    for way in ["closed", "killed", "silent"] {
        let mut commander = Page::open(&served).await;
        let held = commander
            .call("hold", json!({"ends_with_client": true}))
            .await;
        assert!(held["error"].is_null(), "{held}");
        watcher.state("running").await;
        let mut kept = None;
        match way {
            "closed" => commander.socket.close(None).await.unwrap(),
            "killed" => drop(commander),
            // Its connection stays open, and it answers no ping: a phone out of reach.
            _ => kept = Some(commander),
        }
        watcher.state("ready").await;
        drop(kept);
    }
}

/// The page's buttons ask the service, which knows the board that was tested.
#[tokio::test]
async fn a_page_drives_no_rig_whose_board_was_exchanged() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::at(folder.path());
    let identity = Identity {
        board: "OTHER".to_owned(),
        ..Identity::default()
    };
    let record = Record::new(&rig::Rig::built_in().unwrap(), identity);
    bring_up::record::write(&store, &record).unwrap();
    let served = Served::with(None, Some(store));
    let mut page = Page::open(&served).await;
    for (method, parameters) in [
        ("hold", json!({"ends_with_client": true})),
        ("set_force", json!({"force_n": [0, 1, 0], "duration_s": 1})),
    ] {
        let refused = page.call(method, parameters).await;
        let message = refused["error"]["message"].as_str().expect("an error");
        assert!(
            message.contains("the board was OTHER and is")
                && message.contains("nothing was driven"),
            "{refused}"
        );
    }
    page.state("ready").await;
}

#[tokio::test]
async fn a_page_that_only_watches_may_leave() {
    let served = Served::new(None);
    let mut commander = Page::open(&served).await;
    let watcher = Page::open(&served).await;
    let held = commander
        .call("hold", json!({"ends_with_client": true}))
        .await;
    assert!(held["error"].is_null(), "{held}");
    drop(watcher);
    let from = commander.state("running").await["t_s"].as_f64().unwrap();
    while commander.state("running").await["t_s"].as_f64().unwrap() < from + 1.0 {}
    let done = commander.call("disarm", json!({})).await;
    assert!(done["error"].is_null(), "{done}");
}

#[tokio::test]
async fn telemetry_comes_thinned() {
    let served = Served::new(None);
    let mut page = Page::open(&served).await;
    page.state("ready").await;
    let began = Instant::now();
    let (mut pictures, mut first_s, mut last_s) = (0_u32, None, 0.0);
    while last_s - first_s.unwrap_or(0.0) < 3.0 {
        let now = page.state("ready").await;
        pictures += 1;
        last_s = now["t_s"].as_f64().unwrap();
        first_s.get_or_insert(last_s);
    }
    // The service has 50 a second of the rig's time; the page gets 30 a second of its own.
    let most = 30.0 * began.elapsed().as_secs_f64() + 2.0;
    assert!(
        f64::from(pictures) < most,
        "{pictures} in {:?}",
        began.elapsed()
    );
}

#[tokio::test]
async fn a_page_is_told_that_the_service_has_ended() {
    let mut served = Served::new(None);
    let mut page = Page::open(&served).await;
    page.state("ready").await;
    let ending = tokio::task::spawn_blocking(move || {
        served.end_service();
        served
    });
    let gone = page.until(|value| value["method"] == "gone").await;
    assert!(gone.unwrap()["params"]["why"]
        .as_str()
        .unwrap()
        .contains("service"));
    assert_eq!(page.until(|_| false).await, None, "closed");
    let served = ending.await.unwrap();
    let mut page = Page::open(&served).await;
    let gone = page.until(|value| value["method"] == "gone").await;
    assert!(gone.unwrap()["params"]["why"]
        .as_str()
        .unwrap()
        .contains("can't be reached"));
}

#[tokio::test]
async fn only_the_rigs_own_page_with_its_token_gets_in() {
    let served = Served::new(Some("0123456789abcdef"));
    let host = served.host().to_owned();
    assert_eq!(
        served.link,
        format!("http://{host}/?token=0123456789abcdef")
    );
    let get = |path: &str, host: &str, more: &str| {
        format!("GET {path} HTTP/1.1\r\nHost: {host}\r\n{more}\r\n")
    };
    let upgrade = |origin: &str| {
        format!("Connection: Upgrade, close\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nOrigin: {origin}\r\n")
    };
    let close = || "Connection: close\r\n".to_owned();
    let own = format!("http://{host}");
    let token = "?token=0123456789abcdef";
    for (path, host, more, code) in [
        (format!("/{token}"), &*host, close(), 200),
        ("/app.js".to_owned(), &host, close(), 200),
        ("/".to_owned(), &host, close(), 403),
        ("/?token=wrong".to_owned(), &host, close(), 403),
        ("/nothing.js".to_owned(), &host, close(), 404),
        (format!("/{token}"), "evil.example", close(), 421),
        (
            format!("/ws{token}"),
            "evil.example",
            upgrade("http://evil.example"),
            421,
        ),
        (
            format!("/ws{token}"),
            &host,
            upgrade("http://evil.example"),
            403,
        ),
        (format!("/ws{token}"), &host, upgrade("null"), 403),
        ("/ws".to_owned(), &host, upgrade(&own), 403),
    ] {
        let answer = http(&served, &get(&path, host, &more)).await;
        assert!(
            answer.starts_with(&format!("HTTP/1.1 {code} ")),
            "{path} {host}: {answer}"
        );
        if code == 200 {
            assert!(answer.contains("frame-ancestors 'none'"), "{answer}");
            assert!(!answer.to_lowercase().contains("set-cookie"), "{answer}");
        }
    }
    // Nothing is ordered by GET or POST.
    for request in ["POST", "PUT", "DELETE"] {
        let head = get(&format!("/ws{token}"), &host, &upgrade(&own)).replacen("GET", request, 1);
        let answer = http(&served, &head).await;
        assert!(answer.starts_with("HTTP/1.1 405 "), "{answer}");
    }
}

#[test]
fn an_address_that_others_reach_needs_a_token() {
    let options = web::WebOptions {
        address: "0.0.0.0:0".parse().unwrap(),
        token: None,
        socket: "rig.sock".into(),
        program: "true".into(),
        link: "rig:rig".to_owned(),
    };
    assert!(web::start(options).is_err());
}
