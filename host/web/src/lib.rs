//! The rig in a browser: a page that shows it, commands it and stops it.
//!
//! ```text
//!  browser ── HTTP: the page's files ──┐
//!     └────── WebSocket: JSON-RPC ─────┴── bridge ── the service's Unix socket ── hub
//! ```
//!
//! Each page is a client of the service like any other, over a connection of its own: who may
//! command, what happens when the commander goes away, and a stop from everyone follow from there.
//! A message of the WebSocket is a line of the service's protocol (docs/service.md). What the
//! bridge adds: it says hello, keeps telemetry to `bridge::PICTURES_PER_S` pictures a second, drops
//! pictures for a slow browser, notices a browser that is gone, and starts `forcectl zero` and
//! `forcectl record`.
//!
//! | question | file |
//! | --- | --- |
//! | who may open the page, and from where | `access` |
//! | how many connections at a time | `connections` |
//! | one page and its connection to the service | `bridge` |
//! | what the page is told of rig and faults | `about` |
//! | zero and recordings by other commands | `tools` |
//! | the page itself | `page/` |
#![cfg(unix)]

mod about;
mod access;
mod bridge;
mod connections;
mod tools;

pub use access::make_token;

use access::Access;
use axum::extract::{ConnectInfo, Path, Request, State, WebSocketUpgrade};
use axum::http::{header, HeaderMap, HeaderName, HeaderValue, StatusCode, Uri};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::Router;
use connections::{Connections, Peer};
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::path::PathBuf;
use std::sync::Arc;
use tools::Tools;

/// Longest message of a page, bytes: an order is some hundred.
const MAX_MESSAGE: usize = 1 << 16;

/// Where the page is served, and of which rig.
#[derive(Debug)]
pub struct WebOptions {
    /// Address to listen on; port 0: any that is free.
    pub address: SocketAddr,
    /// What the link to the page must carry. Needed on an address that is not loopback.
    pub token: Option<String>,
    /// The service's socket.
    pub socket: PathBuf,
    /// forcectl, for what other commands do.
    pub program: PathBuf,
    /// How these name the rig: `rig:NAME`.
    pub link: String,
}

struct Gate {
    access: Access,
    socket: PathBuf,
    tools: Arc<Tools>,
}

/// Serves the page in a thread of its own, which ends with the process. Returns the link to open.
///
/// # Errors
/// The address can't be used, or needs a token.
pub fn start(options: WebOptions) -> io::Result<String> {
    if options.token.is_none() && !options.address.ip().is_loopback() {
        let text = "an address that others can reach needs a token";
        return Err(io::Error::new(io::ErrorKind::InvalidInput, text));
    }
    let listener = TcpListener::bind(options.address)?;
    listener.set_nonblocking(true)?;
    let access = Access::new(options.token);
    let link = access.link(listener.local_addr()?);
    let gate = Arc::new(Gate {
        access,
        socket: options.socket,
        tools: Arc::new(Tools::new(options.program, options.link)),
    });
    let app = Router::new()
        .route("/", get(index))
        .route("/ws", get(socket))
        .route("/{file}", get(file))
        .layer(middleware::from_fn(guard))
        .with_state(gate)
        .into_make_service_with_connect_info::<Peer>();
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    std::thread::Builder::new()
        .name("web".to_owned())
        .spawn(move || {
            runtime.block_on(async {
                // Goes on after errors of a connection; the listener's own end ends nothing else.
                if let Ok(listener) = tokio::net::TcpListener::from_std(listener) {
                    let _ = axum::serve(Connections::new(listener), app).await;
                }
            });
        })?;
    Ok(link)
}

/// Refuses what comes for another host's page (DNS rebinding), and tells the browser to keep to
/// itself.
async fn guard(request: Request, next: Next) -> Response {
    let host = request.headers().get(header::HOST);
    if !host.is_some_and(|host| host.to_str().is_ok_and(access::host_is_ours)) {
        let text = "this address is not the rig's: open the link that forcectl has printed\n";
        return (StatusCode::MISDIRECTED_REQUEST, text).into_response();
    }
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    for (name, value) in [
        (header::CONTENT_SECURITY_POLICY, "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::CACHE_CONTROL, "no-store"),
        (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    response
}

async fn index(State(gate): State<Arc<Gate>>, uri: Uri) -> Response {
    if !gate.access.may_enter(&uri) {
        return refused();
    }
    file(Path("index.html".to_owned())).await
}

fn refused() -> Response {
    let text = "the token is missing or wrong: open the whole link that forcectl has printed\n";
    (StatusCode::FORBIDDEN, text).into_response()
}

/// The page's files. They hold no secret.
async fn file(Path(name): Path<String>) -> Response {
    let (kind, text) = match name.as_str() {
        "index.html" => ("text/html", include_str!("page/index.html")),
        "icon.svg" => ("image/svg+xml", include_str!("page/icon.svg")),
        "style.css" => ("text/css", include_str!("page/style.css")),
        "app.js" => ("text/javascript", include_str!("page/app.js")),
        "rpc.js" => ("text/javascript", include_str!("page/rpc.js")),
        "curves.js" => ("text/javascript", include_str!("page/curves.js")),
        "scene.js" => ("text/javascript", include_str!("page/scene.js")),
        _ => return (StatusCode::NOT_FOUND, "no such file\n").into_response(),
    };
    (
        [(header::CONTENT_TYPE, format!("{kind}; charset=utf-8"))],
        text,
    )
        .into_response()
}

async fn socket(
    State(gate): State<Arc<Gate>>,
    ConnectInfo(Peer(from)): ConnectInfo<Peer>,
    headers: HeaderMap,
    uri: Uri,
    upgrade: WebSocketUpgrade,
) -> Response {
    if !gate.access.may_enter(&uri) {
        return refused();
    }
    if !access::origin_is_host(&headers) {
        let text = "another site's page may not command the rig\n";
        return (StatusCode::FORBIDDEN, text).into_response();
    }
    upgrade
        .max_message_size(MAX_MESSAGE)
        .on_upgrade(move |page| async move {
            bridge::serve(page, from, &gate.socket, &gate.tools).await;
        })
}
