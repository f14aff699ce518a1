//! What stands between roslibrust's node and the rest of ROS 1, so that the node answers more
//! of what other programs ask.
//!
//! roslibrust's node refuses `getBusInfo` and `getBusStats`, at which `rosnode info` ends in a
//! traceback. So the node is told a master that is ours: it passes every call on to the real one,
//! with our URI in place of the node's. Other programs then ask us. What roslibrust does not know
//! is answered here, everything else is passed on to it as it came.

use super::master::{exchange, Master};
use std::io::{self, Read, Write};
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener, TcpStream, ToSocketAddrs};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// For the whole of a call that comes in. Others keep their connections open and say nothing for
/// long.
const INCOMING: Duration = Duration::from_secs(10);
/// For the answer to a call that is passed on: roslibrust tries a publisher that was killed for
/// seconds.
const PASSED_ON: Duration = Duration::from_secs(30);
/// For the node at its start, until its own URI is known.
const START: Duration = Duration::from_millis(10);
/// Longest call, bytes: a list of thousands of publishers.
const LONGEST: usize = 4 << 20;

/// Two listeners, until it is dropped: drop it after the node, whose last calls go through it.
#[derive(Debug)]
pub(super) struct Front {
    /// The master for roslibrust.
    pub master_uri: String,
    shared: Arc<Shared>,
    listeners: [SocketAddr; 2],
}

#[derive(Debug)]
struct Shared {
    master: Master,
    /// Port that other programs ask.
    port: u16,
    /// The node's own URI, and ours in its place.
    node: OnceLock<(String, String)>,
    ended: AtomicBool,
}

impl Front {
    /// Begins to listen.
    ///
    /// # Errors
    /// The master has no address, or no port is free.
    pub fn open(master: &Master) -> io::Result<Self> {
        // roslibrust picks the node's host by the address of its master: one that is on the real
        // one's side.
        let local = local_address(&master.uri)?;
        let to_master = TcpListener::bind((local, 0))?;
        let to_node = TcpListener::bind((Ipv4Addr::UNSPECIFIED, 0))?;
        let at_master = to_master.local_addr()?;
        let port = to_node.local_addr()?.port();
        let shared = Arc::new(Shared {
            master: master.clone(),
            port,
            node: OnceLock::new(),
            ended: AtomicBool::new(false),
        });
        listen(to_master, &shared, Shared::from_node);
        listen(to_node, &shared, Shared::from_others);
        Ok(Self {
            master_uri: format!("http://{at_master}"),
            shared,
            listeners: [at_master, (Ipv4Addr::LOCALHOST, port).into()],
        })
    }

    /// Tells the node's own URI, before it registers anything.
    pub fn stands_for(&self, node_uri: &str) {
        let host = host_of(node_uri);
        let host = host.rsplit_once(':').map_or(host, |(host, _)| host);
        let ours = format!("http://{host}:{}", self.shared.port);
        let _ = self.shared.node.set((node_uri.to_owned(), ours));
    }
}

impl Drop for Front {
    fn drop(&mut self) {
        self.shared.ended.store(true, Ordering::Relaxed);
        for address in self.listeners {
            // It wakes up, and sees that it is over.
            let _ = TcpStream::connect(address);
        }
    }
}

/// Host and port of a URI.
fn host_of(uri: &str) -> &str {
    let rest = uri.trim_start_matches("http://");
    rest.split('/').next().unwrap_or_default()
}

/// The IPv4 address of this computer towards the master.
fn local_address(master_uri: &str) -> io::Result<Ipv4Addr> {
    let mut addresses = host_of(master_uri).to_socket_addrs()?;
    let master = addresses.find(SocketAddr::is_ipv4);
    let Some(master) = master else {
        return Ok(Ipv4Addr::LOCALHOST);
    };
    // Nothing is sent.
    let socket = std::net::UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
    socket.connect(master)?;
    Ok(match socket.local_addr()?.ip() {
        IpAddr::V4(address) => address,
        IpAddr::V6(_) => Ipv4Addr::LOCALHOST,
    })
}

/// Answers calls in threads of their own.
fn listen(
    listener: TcpListener,
    shared: &Arc<Shared>,
    answer: fn(&Shared, &str) -> io::Result<String>,
) {
    let shared = Arc::clone(shared);
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            if shared.ended.load(Ordering::Relaxed) {
                break;
            }
            let Ok(stream) = stream else {
                // No file to be had, for example: not again at once.
                std::thread::sleep(START);
                continue;
            };
            let shared = Arc::clone(&shared);
            let serve = move || serve(stream, |call| answer(&shared, call));
            // Without a thread the caller finds its connection closed.
            let _ = std::thread::Builder::new().spawn(serve);
        }
    });
}

/// One call of a connection. Then it is closed, which every client of ROS takes.
fn serve(mut stream: TcpStream, answer: impl FnOnce(&str) -> io::Result<String>) {
    let answered = (|| {
        stream.set_read_timeout(Some(INCOMING))?;
        stream.set_write_timeout(Some(INCOMING))?;
        answer(&call_of(&mut stream)?)
    })();
    let answer =
        answered.unwrap_or_else(|error| whole("502 Bad Gateway", "text/plain", &error.to_string()));
    let _ = stream.write_all(answer.as_bytes());
}

/// The body of an HTTP request.
fn call_of(stream: &mut TcpStream) -> io::Result<String> {
    let mut bytes = Vec::new();
    let mut piece = [0; 4096];
    let began = Instant::now();
    loop {
        let left = INCOMING.checked_sub(began.elapsed());
        let left = left
            .filter(|left| !left.is_zero())
            .ok_or(io::ErrorKind::TimedOut)?;
        stream.set_read_timeout(Some(left))?;
        let head = bytes.windows(4).position(|four| four == b"\r\n\r\n");
        if let Some(head) = head {
            let length = length_of(&String::from_utf8_lossy(&bytes[..head]))?;
            let body = &bytes[head + 4..];
            if body.len() >= length {
                return String::from_utf8(body[..length].to_vec()).map_err(io::Error::other);
            }
        }
        let read = match stream.read(&mut piece)? {
            0 => return Err(io::ErrorKind::UnexpectedEof.into()),
            read => read,
        };
        bytes.extend_from_slice(&piece[..read]);
        if bytes.len() > LONGEST {
            return Err(io::Error::other("the call is too long"));
        }
    }
}

/// Length of the body that a head announces.
fn length_of(head: &str) -> io::Result<usize> {
    head.lines()
        .filter_map(|line| line.split_once(':'))
        .find(|(name, _)| name.eq_ignore_ascii_case("content-length"))
        .and_then(|(_, length)| length.trim().parse().ok())
        .ok_or_else(|| io::Error::other("the call does not tell its length"))
}

/// An HTTP answer that ends its connection.
fn whole(status: &str, kind: &str, body: &str) -> String {
    format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{body}",
        body.len()
    )
}

/// The answer of who a call is passed on to. Its own head may say that the connection stays open.
fn passed_on(uri: &str, call: &str) -> io::Result<String> {
    let answer = exchange(uri, call, PASSED_ON)?;
    let (head, body) = answer
        .split_once("\r\n\r\n")
        .ok_or_else(|| io::Error::other("the answer has no body"))?;
    let line = head.lines().next().unwrap_or_default();
    let status = line.split_once(' ').map_or(line, |(_, status)| status);
    Ok(whole(status, "text/xml", body))
}

/// An answer with code, message and value.
fn reply<T: serde::Serialize>(code: i32, message: &str, value: T) -> io::Result<String> {
    let answer = serde_xmlrpc::to_value((code, message, value)).map_err(io::Error::other)?;
    let body = serde_xmlrpc::response_to_string(std::iter::once(answer));
    let body = body.map_err(io::Error::other)?;
    Ok(whole("200 OK", "text/xml", &body))
}

/// A connection as `getBusInfo` tells it: number, other end, `i` or `o`, transport, topic, whether
/// it is connected.
type Connection = (i32, String, &'static str, &'static str, String, bool);

impl Shared {
    /// A call of roslibrust to the master.
    fn from_node(&self, call: &str) -> io::Result<String> {
        let call = match self.node.get() {
            Some((node, ours)) => call.replace(&format!(">{node}<"), &format!(">{ours}<")),
            None => call.to_owned(),
        };
        passed_on(&self.master.uri, &call)
    }

    /// A call of another program, or of the master, to the node.
    fn from_others(&self, call: &str) -> io::Result<String> {
        let (method, _) = serde_xmlrpc::request_from_str(call).map_err(io::Error::other)?;
        match method.as_str() {
            "getBusInfo" => reply(1, "bus info", self.connections()?),
            "getBusStats" => reply(-1, "this node does not count its traffic", 0),
            "getMasterUri" => reply(1, "", self.master.uri.as_str()),
            _ => {
                let began = Instant::now();
                let node = loop {
                    match self.node.get() {
                        Some((node, _)) => break node,
                        None if began.elapsed() > INCOMING => {
                            return Err(io::Error::other("the node has not begun"));
                        }
                        None => std::thread::sleep(START),
                    }
                };
                passed_on(node, call)
            }
        }
    }

    /// The node's connections by what is registered at the master. roslibrust does not tell them:
    /// one is taken to be connected where the other end answers.
    fn connections(&self) -> io::Result<Vec<Connection>> {
        let own = &self.master.caller;
        let [publishers, subscribers] = self.master.registered()?;
        let nodes = |of: &[(String, Vec<String>)], topic: &str| -> Vec<String> {
            let nodes = of.iter().filter(|(name, _)| name == topic);
            nodes.flat_map(|(_, nodes)| nodes.clone()).collect()
        };
        let mut found: Vec<Connection> = Vec::new();
        let mut alive = std::collections::BTreeMap::new();
        for (ours, theirs, direction) in [
            (&subscribers, &publishers, "i"),
            (&publishers, &subscribers, "o"),
        ] {
            for (topic, _) in ours.iter().filter(|(_, nodes)| nodes.contains(own)) {
                for other in nodes(theirs, topic) {
                    let connected = *alive
                        .entry(other.clone())
                        .or_insert_with(|| other == *own || self.master.is_alive(&other));
                    // A publisher is told by its URI, a subscriber by its name, as rospy does it.
                    let end = match direction {
                        "i" => self.master.node(&other)?.unwrap_or(other),
                        _ => other,
                    };
                    let number = i32::try_from(found.len()).unwrap_or(i32::MAX);
                    let topic = topic.clone();
                    found.push((number, end, direction, "TCPROS", topic, connected));
                }
            }
        }
        Ok(found)
    }
}
