//! Questions to the ROS master and to other nodes that roslibrust does not ask: who publishes a
//! topic, of which type, and is a node that is registered still there?

use serde::de::DeserializeOwned;
use std::io::{self, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

/// For an answer.
const PATIENCE: Duration = Duration::from_secs(2);
/// Longest answer: thousands of topics.
const LONGEST: u64 = 4 << 20;

/// The master at a URI, asked by our node.
#[derive(Debug, Clone)]
pub(super) struct Master {
    /// Its URI.
    pub uri: String,
    /// Our node's name.
    pub caller: String,
}

impl Master {
    /// Topics that are published, and topics that are subscribed, with the names of the nodes.
    ///
    /// # Errors
    /// The master can't be reached, or does not answer with its state.
    pub fn registered(&self) -> io::Result<[Vec<(String, Vec<String>)>; 2]> {
        // For publishers, subscribers, services: lists of a name and its nodes.
        let state: Vec<Vec<(String, Vec<String>)>> = self.ask("getSystemState", &[])?;
        let mut state = state.into_iter();
        Ok(std::array::from_fn(|_| state.next().unwrap_or_default()))
    }

    /// Names of the nodes that publish `topic`.
    ///
    /// # Errors
    /// As [`Master::registered`].
    pub fn publishers(&self, topic: &str) -> io::Result<Vec<String>> {
        let [published, _] = self.registered()?;
        Ok(published
            .into_iter()
            .filter(|(name, _)| name == topic)
            .flat_map(|(_, nodes)| nodes)
            .collect())
    }

    /// Type of a topic, where somebody has told one.
    ///
    /// # Errors
    /// As [`Master::registered`].
    pub fn type_of(&self, topic: &str) -> io::Result<Option<String>> {
        let types: Vec<(String, String)> = self.ask("getTopicTypes", &[])?;
        Ok(types
            .into_iter()
            .find(|(name, _)| name == topic)
            .map(|(_, kind)| kind))
    }

    /// URI of a node, where one of that name is registered.
    ///
    /// # Errors
    /// As [`Master::registered`].
    pub fn node(&self, name: &str) -> io::Result<Option<String>> {
        let uri: String = self.ask("lookupNode", &[name])?;
        Ok(Some(uri).filter(|uri| !uri.is_empty()))
    }

    /// Whether a node of that name is registered and answers. One that was killed stays registered.
    pub fn is_alive(&self, name: &str) -> bool {
        let uri = self.node(name).ok().flatten();
        let pid = |uri: String| ask::<i32>(&uri, &self.caller, "getPid", &[]);
        uri.is_some_and(|uri| pid(uri).is_ok())
    }

    fn ask<T: DeserializeOwned>(&self, method: &str, arguments: &[&str]) -> io::Result<T> {
        ask(&self.uri, &self.caller, method, arguments)
    }
}

/// Asks a node, or the master: the third part of its answer, after a code and a message.
fn ask<T: DeserializeOwned>(
    uri: &str,
    caller: &str,
    method: &str,
    arguments: &[&str],
) -> io::Result<T> {
    let arguments = std::iter::once(&caller).chain(arguments);
    let arguments = arguments.map(|argument| (*argument).into()).collect();
    let body = serde_xmlrpc::request_to_string(method, arguments).map_err(io::Error::other)?;
    let answer = exchange(uri, &body, PATIENCE)?;
    let (_, answer) = answer
        .split_once("\r\n\r\n")
        .ok_or_else(|| io::Error::other("the answer has no body"))?;
    let (_, _, value): (i32, String, T) =
        serde_xmlrpc::response_from_str(answer).map_err(io::Error::other)?;
    Ok(value)
}

/// An HTTP/1.0 POST; the whole answer, for which it waits no longer than `patience` between two
/// pieces.
pub(super) fn exchange(uri: &str, body: &str, patience: Duration) -> io::Result<String> {
    let host = uri
        .trim_start_matches("http://")
        .split('/')
        .next()
        .unwrap_or_default();
    let mut failed = io::Error::other(format!("`{uri}` names no host"));
    let connected = host.to_socket_addrs()?.find_map(|address| {
        TcpStream::connect_timeout(&address, PATIENCE)
            .map_err(|error| failed = error)
            .ok()
    });
    let mut stream = connected.ok_or(failed)?;
    stream.set_read_timeout(Some(patience))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    write!(
        stream,
        "POST / HTTP/1.0\r\nHost: {host}\r\nContent-Type: text/xml\r\nContent-Length: {}\r\n\r\n{body}",
        body.len()
    )?;
    let mut answer = String::new();
    stream.take(LONGEST).read_to_string(&mut answer)?;
    Ok(answer)
}
