//! A stop that does not depend on the service: what `forcectl stop` does for each rig that it
//! finds.
//!
//! | when | what |
//! | --- | --- |
//! | at once | the service is asked |
//! | no answer for [`PROMPT`], or the service has no link | the board is asked over every other port that may be its own |
//! | no answer for [`END_AFTER`], and the service has a board's port | its process is killed, and its port asked |
//! | [`GIVE_UP`] | an error says what was tried |
//!
//! A killed service sends no setpoints, so the board goes to 0 V within 100 ms whether its port can
//! be opened or not. The service of an emulated rig is never killed: no motor hangs on it.

use super::protocol::{Call, Hello, Request, Welcome};
use super::socket::{Socket, PORT};
use rustix::process::{kill_process, setpriority_process, Pid, Signal};
use serde_json::Value;
use session::link::port::{self, Port};
use session::link::RigLink;
use session::{Session, SessionError};
use std::io::{BufRead, BufReader, ErrorKind, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::mpsc::{channel, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};
use wire::Command;

/// How long the service may take before the board is asked in another way.
pub const PROMPT: Duration = Duration::from_millis(200);
/// How long it may take before its process is killed. Far longer than any stop of a service that
/// works: the longest of ten under load is in docs/service.md.
pub const END_AFTER: Duration = Duration::from_secs(1);
/// How long anything may take.
pub const GIVE_UP: Duration = Duration::from_secs(10);
/// When the next way is taken, from the beginning.
const WAITS: [Duration; 3] = [PROMPT, END_AFTER, GIVE_UP];
/// Numbers of the two requests.
const HELLO: u64 = 1;
const STOP: u64 = 2;

/// Nice value of a stop, and of the threads of a service: below -9, one of them has more weight
/// than twenty programs without a nice value on two processors (sched(7): a factor of 1.25 a step).
const NICE: i32 = -15;

/// Runs this thread, and those that it starts from now on, before ordinary programs, so that a
/// stop does not wait for its turn on a computer under load. Without the right to do so (root,
/// `CAP_SYS_NICE`, or a limit of `nice` in limits.conf(5)) nothing changes.
pub fn hurry() {
    let _ = setpriority_process(None, NICE);
}

/// A rig that was stopped.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stopped {
    /// The link over which the board has confirmed.
    pub link: String,
}

/// Why a rig may not be stopped.
#[derive(Debug, thiserror::Error)]
pub enum StopError {
    /// Nobody listens: a socket that was left behind.
    #[error("no service listens at this socket")]
    NobodyThere,
    /// The socket is another account's.
    #[error("it is served by the account {owner}, whose socket {path} may not be opened here: {cause}. NOTHING WAS STOPPED THERE. Stop it from that account or as root (`sudo forcectl stop`), or press the E-stop")]
    NotAllowed {
        /// Whose socket it is.
        owner: String,
        /// The socket.
        path: String,
        /// The operating system's words.
        cause: std::io::Error,
    },
    /// No way has led to the board.
    #[error("NOT CONFIRMED: {0}. Press the E-stop where a cable still pulls")]
    NoWay(String),
}

/// What one of the ways has to say.
enum News {
    /// The service has confirmed; its link.
    Service(String),
    /// The service can't.
    NoService(Asked),
    /// A port: the board has confirmed, or why not.
    Port(String, Result<(), SessionError>),
}

/// Why the service did not confirm.
enum Asked {
    NobodyThere,
    NotAllowed(std::io::Error),
    /// It answers that it can't.
    Refused(String),
    /// Its connection broke.
    Failed(String),
}

/// Stops the rig behind a socket. `say` tells at once what is done beside asking the service.
///
/// # Errors
/// [`StopError`].
pub fn stop(socket: &Socket, client: &str, say: &dyn Fn(&str)) -> Result<Stopped, StopError> {
    let holder = socket.holder();
    let own = holder
        .as_ref()
        .and_then(|(_, link)| link.strip_prefix(PORT));
    let others = || {
        let mut ports = port::of_boards();
        ports.retain(|port| Some(port.as_str()) != own);
        ports
    };
    stop_by(socket, client, holder.as_ref(), others, WAITS, say)
}

fn stop_by(
    socket: &Socket,
    client: &str,
    holder: Option<&(u32, String)>,
    others: impl FnOnce() -> Vec<String>,
    [prompt, end_after, give_up]: [Duration; 3],
    say: &dyn Fn(&str),
) -> Result<Stopped, StopError> {
    let began = Instant::now();
    let own = holder.and_then(|(pid, link)| Some((*pid, link.strip_prefix(PORT)?)));
    let service = match holder {
        Some((pid, _)) => format!("its service (process {pid})"),
        None => "its service".to_owned(),
    };
    let (sender, news) = channel();
    ask(socket, client, &sender);
    let (mut others, mut to_end) = (Some(others), own);
    let mut asked = 1;
    let mut tried = Vec::new();
    loop {
        // What comes next where nothing is heard.
        let due = match (&others, &to_end) {
            (Some(_), _) => prompt,
            (None, Some(_)) => end_after,
            (None, None) => give_up,
        };
        let heard = match news.recv_timeout(due.saturating_sub(began.elapsed())) {
            Ok(News::Service(link)) => return Ok(Stopped { link }),
            Ok(News::Port(port, Ok(()))) => {
                return Ok(Stopped {
                    link: format!("{PORT}{port}"),
                })
            }
            Ok(News::NoService(Asked::NobodyThere)) => return Err(StopError::NobodyThere),
            Ok(News::NoService(Asked::NotAllowed(cause))) => {
                return Err(StopError::NotAllowed {
                    owner: socket.owner(),
                    path: socket.path.display().to_string(),
                    cause,
                })
            }
            Ok(News::NoService(Asked::Refused(why))) => {
                asked -= 1;
                // It is alive: there is nothing to end.
                to_end = None;
                tried.push(format!("{service}: {why}"));
                others.take()
            }
            Ok(News::NoService(Asked::Failed(why))) => {
                asked -= 1;
                // It may be gone, or alive and without a handle for who asks.
                tried.push(format!("{service}: {why}"));
                others.take()
            }
            Ok(News::Port(port, Err(error))) => {
                asked -= 1;
                tried.push(format!("{PORT}{port}: {error}"));
                None
            }
            Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => {
                if others.is_none() && to_end.is_none() {
                    tried.push(format!(
                        "{service} has not answered for {} s",
                        GIVE_UP.as_secs()
                    ));
                    break;
                }
                let next = others.take();
                if next.is_none() {
                    if let Some((pid, port)) = to_end.take() {
                        asked += end_and_ask(pid, port, &sender, &mut tried, say);
                    }
                }
                next
            }
        };
        if let Some(others) = heard {
            asked += ask_others(
                others(),
                &service,
                to_end.is_some(),
                tried.is_empty(),
                &sender,
                say,
            );
        }
        if asked == 0 {
            // Nobody is left to answer: who has the port goes.
            if let Some((pid, port)) = to_end.take() {
                asked += end_and_ask(pid, port, &sender, &mut tried, say);
            }
        }
        if asked == 0 {
            break;
        }
    }
    Err(StopError::NoWay(tried.join("; ")))
}

/// Asks the board over these ports, and says so. Returns how many.
fn ask_others(
    ports: Vec<String>,
    service: &str,
    to_end: bool,
    silent: bool,
    sender: &Sender<News>,
    say: &dyn Fn(&str),
) -> usize {
    let what = if silent {
        format!("{service} has not answered for {} ms", PROMPT.as_millis())
    } else {
        format!("{service} can't stop it")
    };
    let next = match (ports.is_empty(), to_end, silent) {
        (false, ..) => format!("the board is asked over {}", ports.join(" and ")),
        (true, true, _) => format!(
            "no other port leads to a board; without an answer its process is killed after {} s: without setpoints a board \
             goes to 0 V within 100 ms",
            END_AFTER.as_secs()
        ),
        (true, false, true) => format!(
            "there is no other way to the rig; waiting for {} s at most",
            GIVE_UP.as_secs()
        ),
        (true, false, false) => "there is no other way to the rig".to_owned(),
    };
    say(&format!("{what}; {next}"));
    let count = ports.len();
    for port in ports {
        ask_port(port, sender);
    }
    count
}

/// Kills the service and asks its board directly. Returns how many ports are asked.
fn end_and_ask(
    pid: u32,
    port: &str,
    sender: &Sender<News>,
    tried: &mut Vec<String>,
    say: &dyn Fn(&str),
) -> usize {
    let killed = i32::try_from(pid)
        .ok()
        .and_then(Pid::from_raw)
        .map(|pid| kill_process(pid, Signal::KILL));
    match killed {
        Some(Ok(())) => {
            say(&format!(
                "its service (process {pid}) does not answer and was killed; the board is asked over {PORT}{port}"
            ));
            ask_port(port.to_owned(), sender);
            1
        }
        Some(Err(error)) => {
            tried.push(format!("process {pid} can't be killed: {error}"));
            0
        }
        None => 0,
    }
}

/// Asks the service in a thread: a socket whose queue is full blocks.
fn ask(socket: &Socket, client: &str, sender: &Sender<News>) {
    let (path, client, sender) = (socket.path.clone(), client.to_owned(), sender.clone());
    std::thread::spawn(move || {
        let news = match ask_service(&path, &client) {
            Ok(link) => News::Service(link),
            Err(asked) => News::NoService(asked),
        };
        let _ = sender.send(news);
    });
}

/// Both requests in one piece: the stop does not wait for an answer to hello.
fn ask_service(path: &Path, client: &str) -> Result<String, Asked> {
    let failed = |error: std::io::Error| Asked::Failed(error.to_string());
    let mut stream = UnixStream::connect(path).map_err(|error| match error.kind() {
        ErrorKind::NotFound | ErrorKind::ConnectionRefused => Asked::NobodyThere,
        ErrorKind::PermissionDenied => Asked::NotAllowed(error),
        _ => failed(error),
    })?;
    let line = |id: u64, call: Call| {
        let id = Some(Value::from(id));
        Request { id, call }.to_line()
    };
    let hello = Call::Hello(Hello::of_this_process(client));
    let lines = line(HELLO, hello) + &line(STOP, Call::Stop);
    stream.write_all(lines.as_bytes()).map_err(failed)?;
    let mut link = String::new();
    for line in BufReader::new(stream).lines() {
        let mut answer: Value =
            serde_json::from_str(&line.map_err(failed)?).map_err(|e| failed(e.into()))?;
        if let Some(error) = answer.get("error") {
            let words = error["message"].as_str().unwrap_or_default();
            return Err(Asked::Refused(words.to_owned()));
        }
        if answer["id"] == HELLO {
            let welcome: Result<Welcome, _> = serde_json::from_value(answer["result"].take());
            link = welcome.map_err(|error| failed(error.into()))?.link;
        } else if answer["id"] == STOP {
            return Ok(link);
        }
    }
    Err(Asked::Failed("it has ended".to_owned()))
}

/// Asks the board at a port in a thread.
fn ask_port(port: String, sender: &Sender<News>) {
    let sender = sender.clone();
    std::thread::spawn(move || {
        let stopped = stop_port(&port);
        let _ = sender.send(News::Port(port, stopped));
    });
}

/// Stops the board at a port.
fn stop_port(port: &str) -> Result<(), SessionError> {
    // A process that was killed a moment ago may have it still.
    let until = Instant::now() + END_AFTER;
    let mut link = loop {
        match Port::serial(port) {
            Ok(link) => break link,
            Err(error) if Instant::now() >= until => return Err(error.into()),
            Err(_) => std::thread::sleep(Duration::from_millis(5)),
        }
    };
    stop_link(&mut link)
}

fn stop_link(link: &mut dyn RigLink) -> Result<(), SessionError> {
    Session::connect(link)?.command(&Command::Stop).map(|_| ())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::terminal::Terminal;
    use session::link::fake::{Behavior, FakeBoard};
    use std::os::unix::net::UnixListener;
    use std::process::Child;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::sync::{Arc, Mutex};

    /// A board on a pseudo-terminal.
    struct Board {
        port: String,
        commands: Arc<Mutex<Vec<Command>>>,
        end: Arc<AtomicBool>,
        thread: Option<std::thread::JoinHandle<()>>,
    }

    impl Board {
        fn start() -> Self {
            let (commands, end) = (
                Arc::<Mutex<Vec<_>>>::default(),
                Arc::<AtomicBool>::default(),
            );
            let (log, ended) = (Arc::clone(&commands), Arc::clone(&end));
            let mut terminal = Terminal::open().unwrap();
            let port = terminal.path().to_owned();
            let thread = std::thread::spawn(move || {
                let mut board = FakeBoard::new(Behavior::Good);
                while !ended.load(Ordering::SeqCst) {
                    let cycle = Duration::from_millis(2);
                    let exchange = board.exchange(&terminal.read(), cycle).unwrap();
                    log.lock().unwrap().append(&mut board.commands);
                    terminal.write(&exchange.from_board);
                    std::thread::sleep(cycle);
                }
            });
            Self {
                port,
                commands,
                end,
                thread: Some(thread),
            }
        }

        fn stops(&self) -> usize {
            let commands = self.commands.lock().unwrap();
            (commands.iter())
                .filter(|command| **command == Command::Stop)
                .count()
        }
    }

    impl Drop for Board {
        fn drop(&mut self) {
            self.end.store(true, Ordering::SeqCst);
            let _ = self.thread.take().map(std::thread::JoinHandle::join);
        }
    }

    /// A process that stands for a service that hangs.
    struct Hangs(Child);

    impl Hangs {
        fn start() -> Self {
            let child = std::process::Command::new("sleep").arg("600").spawn();
            Self(child.unwrap())
        }
    }

    impl Drop for Hangs {
        fn drop(&mut self) {
            let _ = self.0.kill();
            let _ = self.0.wait();
        }
    }

    /// A socket at which nobody answers.
    fn hung(folder: &Path) -> (Socket, UnixListener) {
        let socket = Socket {
            name: "usb".to_owned(),
            path: folder.join("usb.sock"),
        };
        let listener = UnixListener::bind(&socket.path).unwrap();
        (socket, listener)
    }

    /// On a computer under load an answer may come after any of the product's times: a test of a
    /// service that answers does not end its wait for it, and none gives up.
    const LONG: Duration = Duration::from_secs(600);
    const HUNG: [Duration; 3] = [PROMPT, END_AFTER, LONG];
    const ANSWERS: [Duration; 3] = [LONG; 3];

    fn stopped(
        socket: &Socket,
        holder: Option<&(u32, String)>,
        others: &[&str],
        waits: [Duration; 3],
    ) -> (Result<Stopped, StopError>, String) {
        let said = Mutex::new(String::new());
        let others = others.iter().map(|port| (*port).to_owned()).collect();
        let result = stop_by(socket, "a test", holder, || others, waits, &|words| {
            said.lock().unwrap().push_str(words);
        });
        (result, said.into_inner().unwrap())
    }

    #[test]
    fn a_board_whose_service_hangs_is_stopped_over_its_other_port() {
        let folder = tempfile::tempdir().unwrap();
        let (socket, _listener) = hung(folder.path());
        let board = Board::start();
        // A process that must stay: no port of its is known.
        let holder = (std::process::id(), "embedded rig".to_owned());
        let (result, said) = stopped(&socket, Some(&holder), &[&board.port], HUNG);
        assert_eq!(result.unwrap().link, format!("port {}", board.port));
        assert_eq!(board.stops(), 1);
        assert!(
            said.contains("has not answered") && said.contains(&board.port),
            "{said}"
        );
    }

    #[test]
    fn a_service_that_hangs_on_the_only_port_is_killed_and_its_board_stopped() {
        let folder = tempfile::tempdir().unwrap();
        let (socket, _listener) = hung(folder.path());
        let board = Board::start();
        let mut service = Hangs::start();
        let holder = (service.0.id(), format!("port {}", board.port));
        let (result, said) = stopped(&socket, Some(&holder), &[], HUNG);
        assert_eq!(result.unwrap().link, format!("port {}", board.port));
        assert_eq!(board.stops(), 1);
        assert!(said.contains("is killed after 1 s"), "{said}");
        assert!(said.contains("does not answer and was killed"), "{said}");
        let ended = service.0.try_wait().unwrap();
        let signal = ended.and_then(|s| std::os::unix::process::ExitStatusExt::signal(&s));
        assert_eq!(signal, Some(9));
    }

    /// As one that has no file handle left for who asks: it is alive, and drives on.
    #[test]
    fn a_service_that_breaks_the_connection_is_killed_and_its_board_stopped() {
        let folder = tempfile::tempdir().unwrap();
        let (socket, listener) = hung(folder.path());
        let breaks = std::thread::spawn(move || drop(listener.accept().unwrap()));
        let board = Board::start();
        let mut service = Hangs::start();
        let holder = (service.0.id(), format!("port {}", board.port));
        let (result, said) = stopped(&socket, Some(&holder), &[], ANSWERS);
        breaks.join().unwrap();
        assert_eq!(result.unwrap().link, format!("port {}", board.port));
        assert_eq!(board.stops(), 1);
        assert!(said.contains("does not answer and was killed"), "{said}");
        assert!(service.0.try_wait().unwrap().is_some());
    }

    #[test]
    fn a_service_that_cannot_stop_its_rig_is_no_success_and_names_what_was_tried() {
        let folder = tempfile::tempdir().unwrap();
        let (socket, listener) = hung(folder.path());
        let answers = std::thread::spawn(move || {
            let (stream, _) = listener.accept().unwrap();
            let mut lines = BufReader::new(stream.try_clone().unwrap()).lines();
            let first = lines.next().unwrap().unwrap();
            let second = lines.next().unwrap().unwrap();
            let welcome = serde_json::to_value(Welcome::default()).unwrap();
            let id = |line: &str| serde_json::from_str::<Value>(line).unwrap()["id"].clone();
            let hello = crate::protocol::answer(&id(&first), &Ok(welcome));
            let gone = (3, "the port is gone".to_owned());
            let refused = crate::protocol::answer(&id(&second), &Err(gone));
            (&stream).write_all((hello + &refused).as_bytes()).unwrap();
        });
        let (result, said) = stopped(&socket, None, &["/dev/no-such-port"], ANSWERS);
        answers.join().unwrap();
        let error = result.unwrap_err().to_string();
        assert!(said.contains("can't stop it"), "{said}");
        for words in [
            "NOT CONFIRMED",
            "the port is gone",
            "no-such-port",
            "E-stop",
        ] {
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn a_socket_that_was_left_behind_is_no_rig() {
        let folder = tempfile::tempdir().unwrap();
        let (socket, listener) = hung(folder.path());
        drop(listener);
        let (result, said) = stopped(&socket, None, &["/dev/no-such-port"], ANSWERS);
        assert!(matches!(result, Err(StopError::NobodyThere)), "{result:?}");
        assert_eq!(said, "");
    }
}
