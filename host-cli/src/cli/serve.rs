//! `forcectl serve`: owns the link to a board and lets many clients share it.

use super::exit::{self, Failure, Reply, Result};
use super::{values, Context};
use clap::Args;
use rig::{LinkChoice, RigText};
use service::protocol::Call;
use service::server::{Addresses, ServeError};
use service::socket::{self, Listening, Reserved};
use service::{serve, Client, ServeOptions, ServiceError};
use session::link::port::Port;
use session::link::{self, EmbeddedOptions, RigLink};
use std::ffi::OsString;
use std::fmt::Write as _;
use std::net::SocketAddr;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// A service that was started on demand ends after so long without clients.
const IDLE_END: Duration = Duration::from_secs(10);
/// How long a command waits for a rig that is being brought up: an emulated one takes 4 s, and some
/// times as long on a busy computer.
const BRING_UP_TIMEOUT: Duration = Duration::from_secs(60);
/// How long a service that was started on demand may take until it listens.
const START_TIMEOUT: Duration = Duration::from_secs(5);

/// Options of everything that serves.
#[derive(Debug, Args)]
pub struct Listen {
    /// Name of the rig for other commands (--link rig:NAME) [default: `rig`, or the port]
    #[arg(long, value_name = "NAME", value_parser = name)]
    pub name: Option<String>,
    /// Listen on this loopback address as well, for example 127.0.0.1:4747; needs --token-file
    #[arg(long, value_name = "ADDRESS", requires = "token_file")]
    pub tcp: Option<SocketAddr>,
    /// File with the token that clients over TCP have to give (at least 16 characters)
    #[arg(long, value_name = "FILE", requires = "tcp")]
    pub token_file: Option<PathBuf>,
    /// Show the rig in a browser, at this address [default: 127.0.0.1:4750]. One that others can
    /// reach, for example --web=0.0.0.0:4750, gets a token in its link
    #[cfg(feature = "web")]
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, require_equals = true, default_missing_value = "127.0.0.1:4750")]
    pub web: Option<SocketAddr>,
    /// File with the token of the page's link (at least 16 characters)
    /// [default: a new one each time; none on this computer]
    #[cfg(feature = "web")]
    #[arg(long, value_name = "FILE", requires = "web")]
    pub web_token_file: Option<PathBuf>,
}

fn name(text: &str) -> std::result::Result<String, String> {
    format!("rig:{text}")
        .parse::<LinkChoice>()
        .map(|_| text.to_owned())
}

/// Tokens that clients have to give.
pub struct Tokens {
    /// The TCP address and its token.
    pub tcp: Option<(SocketAddr, String)>,
    /// The token of the page.
    #[cfg(feature = "web")]
    page: Option<String>,
}

impl Listen {
    /// The token of the page: that of the file, or one of its own where the page listens beyond
    /// this machine.
    #[cfg(feature = "web")]
    fn page_token(&self, address: SocketAddr) -> Result<Option<String>> {
        let Some(file) = &self.web_token_file else {
            let made = (!address.ip().is_loopback()).then(web::make_token);
            return made.transpose().map_err(|error| no_page(address, &error));
        };
        let token = token(file)?;
        if !token.bytes().all(|b| b.is_ascii_alphanumeric()) {
            return Err(Failure::usage(format!(
                "{}: the token of a page stands in its link: letters and digits only",
                file.display()
            )));
        }
        Ok(Some(token))
    }

    /// Reads what the listeners need, before anything is opened. Once: a token may come from a
    /// pipe.
    pub fn tokens(&self) -> Result<Tokens> {
        let tcp = match (self.tcp, &self.token_file) {
            (Some(address), Some(file)) => Some((address, token(file)?)),
            _ => None,
        };
        #[cfg(feature = "web")]
        let page = match self.web {
            Some(address) => self.page_token(address)?,
            None => None,
        };
        Ok(Tokens {
            tcp,
            #[cfg(feature = "web")]
            page,
        })
    }

    /// Starts the page of a rig, where it is wanted: the link to it.
    fn page(&self, tokens: Tokens, name: &str, socket: &Path) -> Result<Option<String>> {
        #[cfg(feature = "web")]
        if let Some(address) = self.web {
            let failed = |error: std::io::Error| no_page(address, &error);
            let options = web::WebOptions {
                address,
                token: tokens.page,
                socket: socket.to_owned(),
                program: std::env::current_exe().map_err(failed)?,
                link: format!("rig:{name}"),
            };
            return web::start(options).map(Some).map_err(failed);
        }
        let _ = (tokens, name, socket);
        Ok(None)
    }
}

#[cfg(feature = "web")]
fn no_page(address: SocketAddr, error: &std::io::Error) -> Failure {
    Failure::new(
        exit::LINK,
        format!("the page at {address}: {error}; --web=ADDRESS:PORT takes another"),
    )
}

/// The token in a file.
fn token(file: &Path) -> Result<String> {
    let text = files::read_text(file)
        .map_err(|error| Failure::usage(format!("{}: {error}", file.display())))?;
    let token = text.trim().to_owned();
    if token.len() < 16 {
        return Err(Failure::usage(format!(
            "{}: the token has {} characters, 16 are the least; `openssl rand -hex 16` makes one",
            file.display(),
            token.len()
        )));
    }
    Ok(token)
}

/// Arguments of `serve`.
#[derive(Debug, Args)]
pub struct Serve {
    /// Connection to the board: usb or serial:PORT [default: the rig file's]
    #[arg(long, value_name = "LINK", value_parser = values::link)]
    link: Option<LinkChoice>,
    /// Rig file (TOML) [default: the built-in example rig]
    #[arg(long, value_name = "FILE", value_parser = values::rig_file)]
    rig: Option<PathBuf>,
    #[command(flatten)]
    listen: Listen,
    /// Offer a pseudo-terminal for a program that expects a serial port
    #[arg(long)]
    pty: bool,
    /// End the service that runs for this link (or --name); a rig that is driven is disarmed first
    #[arg(long)]
    end: bool,
    /// End after 10 s without clients
    #[arg(long, hide = true)]
    on_demand: bool,
}

impl Serve {
    /// Runs the command, which ends with the service.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        let text = RigText::read(self.rig.as_deref())?;
        let rig = text.parse()?;
        let choice = self.link.as_ref().unwrap_or(&rig.link);
        let name = self
            .listen
            .name
            .clone()
            .unwrap_or_else(|| socket::name_of(choice));
        if self.end {
            let mut client = Client::connect(&name, "forcectl serve --end")?;
            client.call(Call::Shutdown)?;
            return Ok(Reply::done(&format!("the service of rig `{name}` ends")));
        }
        let port = match choice {
            LinkChoice::Usb | LinkChoice::Serial(_) => choice.clone(),
            LinkChoice::Embedded | LinkChoice::Fast | LinkChoice::Kept(_) => {
                return Err(Failure::usage(format!("`serve` is for a board, and the link is {choice}; use --link usb or --link serial:PORT, or `forcectl rig` for an emulated rig"),
                ))
            }
        };
        let mut tokens = self.listen.tokens()?;
        let _controlled_stop = context.interrupt.controlled_stop();
        let open = move || link::open(&port, &EmbeddedOptions::default());
        // The link first: who finds the socket finds a service that has its link. A second service
        // fails at the port.
        if socket::running().contains(&name) {
            return Err(Failure::new(exit::LINK, ServeError::Running(name)));
        }
        let link = open()?;
        let listening = listen(reserve(&name)?, &name)?;
        let options = ServeOptions {
            name,
            rig_file: (text.name, text.text),
            terminal: self.pty,
            tcp: tokens.tcp.take(),
            reopen: Some(Box::new(open)),
            store: None,
            idle_end: self.on_demand.then_some(IDLE_END),
            lockstep: false,
            stop: context.interrupt.flag(),
        };
        run(link, listening, options, (&self.listen, tokens), context)
    }
}

/// Takes the name of a rig.
pub fn reserve(name: &str) -> Result<Reserved> {
    Reserved::take(name).map_err(|error| {
        if error.kind() == std::io::ErrorKind::AddrInUse {
            Failure::new(exit::LINK, ServeError::Running(name.to_owned()))
        } else {
            no_socket(name, &error)
        }
    })
}

/// Takes the socket of a rig whose name was taken.
pub fn listen(reserved: Reserved, name: &str) -> Result<Listening> {
    reserved.listen().map_err(|error| no_socket(name, &error))
}

fn no_socket(name: &str, error: &std::io::Error) -> Failure {
    Failure::new(exit::LINK, format!("the socket of rig `{name}`: {error}"))
}

/// Serves until the end.
pub fn run(
    link: Box<dyn RigLink>,
    listening: Listening,
    options: ServeOptions,
    (listen, tokens): (&Listen, Tokens),
    context: &Context,
) -> Result<Reply> {
    let name = options.name.clone();
    let what = link.name();
    let page = listen.page(tokens, &name, listening.path())?;
    serve(link, listening, options, |addresses| {
        let text = announcement(&name, &what, addresses, page.as_deref());
        context.output.note(&text);
    })
    .map_err(|error| Failure::new(exit::LINK, error))?;
    Ok(Reply::done(&format!(
        "the service of rig `{name}` has ended"
    )))
}

fn announcement(name: &str, link: &str, addresses: &Addresses, page: Option<&str>) -> String {
    let mut text = format!("rig `{name}` is served: {link}\n");
    row!(text, "socket     {}", addresses.socket.display());
    if let Some(terminal) = &addresses.terminal {
        row!(text, "terminal   {terminal}");
    }
    if let Some(tcp) = &addresses.tcp {
        row!(text, "tcp        {tcp}");
    }
    if let Some(page) = page {
        row!(text, "page       {page}");
    }
    let option = if name == socket::EMBEDDED_NAME {
        String::new()
    } else {
        format!(" --link rig:{name}")
    };
    let _ = write!(
        text,
        "In another terminal: `forcectl set-force 0 2.5 0{option}`, `forcectl monitor{option}`, `forcectl stop{option}`. Ctrl-C here ends the rig."
    );
    text
}

/// Connects to a service; waits for one whose rig is being brought up.
fn connect_to(
    name: &str,
    client_name: &str,
    context: &Context,
) -> std::result::Result<Client, ServiceError> {
    let until = Instant::now() + BRING_UP_TIMEOUT;
    let mut told = false;
    loop {
        match Client::connect(name, client_name) {
            Err(ServiceError::Starting { .. })
                if Instant::now() < until && !context.interrupt.flag().load(Ordering::Relaxed) =>
            {
                if !std::mem::replace(&mut told, true) {
                    let waits = format!("rig `{name}` is being brought up; waiting for it ...");
                    context.output.note(&waits);
                }
                std::thread::sleep(Duration::from_millis(100));
            }
            connected => return connected,
        }
    }
}

/// Connects to the service of a rig; starts it where it does not run and the rig is a board.
pub fn connect(
    name: &str,
    start: Option<&LinkChoice>,
    rig: Option<&Path>,
    context: &Context,
) -> Result<Client> {
    let client_name = client_name();
    match (connect_to(name, &client_name, context), start) {
        // No service can open a port that is not there, and opening it says so.
        (
            Err(ServiceError::NotRunning { .. } | ServiceError::Io { .. }),
            Some(LinkChoice::Serial(path)),
        ) if !Path::new(path).exists() => {
            Port::serial(path)?;
            Ok(Client::connect(name, &client_name)?)
        }
        (Err(ServiceError::NotRunning { .. }), Some(port)) => {
            start_service(name, port, rig, context)?;
            Ok(Client::connect(name, &client_name)?)
        }
        (connected, _) => Ok(connected?),
    }
}

/// This command, for the messages of others.
fn client_name() -> String {
    let words = std::env::args_os().skip(1);
    let command =
        (words.map(|word| word.to_string_lossy().into_owned())).find(|word| !word.starts_with('-'));
    format!("forcectl {}", command.unwrap_or_default())
}

/// Arguments of the service that is started for a port. Each value is one word with its option: a
/// name, a port or a file may begin with a hyphen.
fn arguments(name: &str, port: &LinkChoice, rig: Option<&Path>) -> Vec<OsString> {
    let mut words: Vec<OsString> = ["serve", "--on-demand", "--json"].map(Into::into).into();
    words.push(format!("--link={port}").into());
    words.push(format!("--name={name}").into());
    if let Some(rig) = rig {
        let mut word = OsString::from("--rig=");
        word.push(rig);
        words.push(word);
    }
    words
}

/// Starts `forcectl serve` in the background and waits until it listens.
fn start_service(
    name: &str,
    port: &LinkChoice,
    rig: Option<&Path>,
    context: &Context,
) -> Result<()> {
    let failed = |error: std::io::Error| {
        Failure::new(
            exit::LINK,
            format!("the service for {port} can't be started: {error}; --direct works without it"),
        )
    };
    socket::make_folder().map_err(failed)?;
    let log_path = socket::path_of(name).map_err(failed)?.with_extension("log");
    let log = std::fs::File::create(&log_path).map_err(failed)?;
    let mut command = std::process::Command::new(std::env::current_exe().map_err(failed)?);
    command.args(arguments(name, port, rig));
    // A process group of its own: Ctrl-C in this terminal is for this command.
    let mut child = command
        .stdin(Stdio::null())
        .stdout(log)
        .stderr(Stdio::null())
        .process_group(0)
        .spawn()
        .map_err(failed)?;
    context.output.detail(&format!(
        "a service for {port} is started (process {}); it ends 10 s after its last client",
        child.id()
    ));
    let until = Instant::now() + START_TIMEOUT;
    while Instant::now() < until {
        if socket::running().iter().any(|running| running == name) {
            return Ok(());
        }
        if let Ok(Some(_)) = child.try_wait() {
            let said = std::fs::read_to_string(&log_path).unwrap_or_default();
            let error = serde_json::from_str::<serde_json::Value>(&said)
                .ok()
                .and_then(|said| said["error"].as_str().map(str::to_owned));
            return Err(Failure::new(
                exit::LINK,
                error.unwrap_or_else(|| format!("the service for {port} ended at once: {said}")),
            ));
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    Err(Failure::new(
        exit::LINK,
        format!(
            "the service for {port} does not listen after {} s; its log is {}; --direct works without it",
            START_TIMEOUT.as_secs(),
            log_path.display()
        ),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[test]
    fn a_service_is_started_for_names_that_look_like_options() {
        let port = LinkChoice::Serial("-t".to_owned());
        let words = arguments("-t", &port, Some(Path::new("--my.toml")));
        let line = std::iter::once("forcectl".into()).chain(words);
        let parsed = crate::cli::Cli::try_parse_from(line).expect("is parsed");
        let crate::cli::Command::Serve(serve) = parsed.command else {
            panic!("another command");
        };
        assert_eq!(serve.listen.name.as_deref(), Some("-t"));
        assert_eq!(serve.link, Some(port));
        assert_eq!(serve.rig.as_deref(), Some(Path::new("--my.toml")));
    }
}
