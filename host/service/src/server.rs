//! A service from its start to its end: the socket, the threads that accept clients, the hub.

use super::connection;
use super::hub::{Hub, Opener, Setup};
use super::inbound::{next_id, Inbound};
use super::socket::Listening;
use super::terminal::Terminal;
use known::store::Store;
use session::link::{LinkError, RigLink};
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::Sender;
use std::sync::Arc;
use std::time::Duration;

/// What a service is for.
#[derive(Default)]
pub struct ServeOptions {
    /// Name of the rig: its socket, see [`super::socket::path_of`].
    pub name: String,
    /// The rig file: its name and text. Jobs use it.
    pub rig_file: (String, String),
    /// Offer a pseudo-terminal as well.
    pub terminal: bool,
    /// Listen on this loopback address as well, with the token that clients have to give.
    pub tcp: Option<(SocketAddr, String)>,
    /// Opens the link again where it was lost; `None`: the service ends with its link.
    pub reopen: Option<Opener>,
    /// Where the rig's bring-up and calibration are kept; `None`: in the user's folder.
    pub store: Option<Store>,
    /// End where nobody was connected for this long and nothing is driven.
    pub idle_end: Option<Duration>,
    /// The link's time is not that of the clock on the wall, but passes as fast as it can be
    /// computed: it then waits for a commander that drives.
    pub lockstep: bool,
    /// Set from outside to end the service.
    pub stop: Arc<AtomicBool>,
}

/// Where a service listens.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Addresses {
    /// The socket.
    pub socket: std::path::PathBuf,
    /// The pseudo-terminal.
    pub terminal: Option<String>,
    /// The TCP address.
    pub tcp: Option<SocketAddr>,
}

/// Why a service does not run.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// Another one serves this rig.
    #[error("rig `{0}` has a service already; `forcectl status` shows it, `forcectl serve --end` ends it, `--name NAME` starts another one beside it")]
    Running(String),
    /// Socket, terminal or address.
    #[error("{what} can't be used: {cause}")]
    Io {
        /// What.
        what: String,
        /// The operating system's words.
        cause: io::Error,
    },
    /// Only loopback is allowed.
    #[error("{0} is not a loopback address; use 127.0.0.1:PORT, and a tunnel (ssh -L) from other machines")]
    NotLoopback(SocketAddr),
    /// The link.
    #[error(transparent)]
    Link(#[from] LinkError),
}

/// Serves until it is ended. `ready` is called once clients can connect.
///
/// # Errors
/// [`ServeError`].
pub fn serve(
    mut link: Box<dyn RigLink>,
    mut listening: Listening,
    options: ServeOptions,
    ready: impl FnOnce(&Addresses),
) -> Result<(), ServeError> {
    let failed = |what: &str| {
        let what = what.to_owned();
        move |cause| ServeError::Io { what, cause }
    };
    // For all threads below: what hears a stop, and what sends setpoints. An emulated board is
    // another process, which would wait behind them.
    if link.controls().is_none() {
        super::stop::hurry();
    }
    listening
        .note(&link.name())
        .map_err(failed("the lock beside the socket"))?;
    raise_handles();
    let (sender, inbound) = std::sync::mpsc::channel();
    let mut addresses = Addresses {
        socket: listening.path().to_owned(),
        terminal: None,
        tcp: None,
    };
    let terminal = if options.terminal {
        let terminal = Terminal::open().map_err(failed("a pseudo-terminal"))?;
        addresses.terminal = Some(terminal.path().to_owned());
        Some(terminal)
    } else {
        None
    };
    let (tcp, token) = match options.tcp {
        Some((address, token)) => {
            if !address.ip().is_loopback() {
                return Err(ServeError::NotLoopback(address));
            }
            let listener = TcpListener::bind(address).map_err(failed(&address.to_string()))?;
            addresses.tcp = listener.local_addr().ok();
            (Some(listener), Some(token))
        }
        None => (None, None),
    };
    let unix = listening
        .listener
        .try_clone()
        .map_err(failed("the socket"))?;
    accept(
        "unix",
        sender.clone(),
        move || unix.accept().map(|(stream, _)| stream),
        true,
    )
    .map_err(failed("the socket"))?;
    if let Some(tcp) = tcp {
        accept(
            "tcp",
            sender.clone(),
            move || tcp.accept().map(|(stream, _)| stream),
            false,
        )
        .map_err(failed("the TCP address"))?;
    }
    let setup = Setup {
        name: options.name,
        rig_file: options.rig_file,
        token,
        reopen: options.reopen,
        store: options.store,
        idle_end: options.idle_end,
        lockstep: options.lockstep,
        stop: options.stop,
    };
    let mut hub = Hub::new(setup, link, terminal, (sender, inbound));
    ready(&addresses);
    Ok(hub.run()?)
}

/// Takes as many file handles as the system allows: a client that can't be accepted can't stop the
/// rig. Each has three, and 1,024 in all are usual.
fn raise_handles() {
    use rustix::process::{getrlimit, setrlimit, Resource, Rlimit};
    let limit = getrlimit(Resource::Nofile);
    // Where it is refused, the usual number has to do.
    let _ = setrlimit(
        Resource::Nofile,
        Rlimit {
            current: limit.maximum,
            ..limit
        },
    );
}

/// Accepts clients in a thread, which ends with the process.
fn accept<S: connection::Stream + 'static>(
    name: &str,
    hub: Sender<Inbound>,
    next: impl Fn() -> io::Result<S> + Send + 'static,
    trusted: bool,
) -> io::Result<()> {
    std::thread::Builder::new()
        .name(format!("accept {name}"))
        .spawn(move || loop {
            let started =
                next().and_then(|stream| connection::start(stream, next_id(), trusted, &hub));
            if started.is_err() {
                // Out of file handles, for example: others may end meanwhile.
                std::thread::sleep(Duration::from_millis(100));
            }
        })?;
    Ok(())
}
