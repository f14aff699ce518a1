//! Who publishes a topic: one question to the ROS master (getSystemState) that roslibrust does not answer by name.

use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::time::Duration;

/// For the master's answer.
const PATIENCE: Duration = Duration::from_secs(2);
/// Longest answer: thousands of topics.
const LONGEST: u64 = 4 << 20;

/// Names of the nodes that publish `topic`; `caller` is our node.
///
/// # Errors
/// The master can't be reached, or does not answer with its state.
pub(super) fn publishers(master: &str, caller: &str, topic: &str) -> io::Result<Vec<String>> {
    let body = serde_xmlrpc::request_to_string("getSystemState", vec![caller.into()])
        .map_err(io::Error::other)?;
    let answer = post(master, &body)?;
    // Code, message, and for publishers, subscribers, services: lists of a name and its nodes.
    type State = (i32, String, Vec<Vec<(String, Vec<String>)>>);
    let (_, _, state): State =
        serde_xmlrpc::response_from_str(&answer).map_err(io::Error::other)?;
    Ok(state
        .into_iter()
        .next()
        .unwrap_or_default()
        .into_iter()
        .filter(|(name, _)| name == topic)
        .flat_map(|(_, nodes)| nodes)
        .collect())
}

/// An HTTP/1.0 POST; the answer's body.
fn post(uri: &str, body: &str) -> io::Result<String> {
    let host = uri
        .trim_start_matches("http://")
        .split('/')
        .next()
        .unwrap_or_default();
    let mut stream = TcpStream::connect(host)?;
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    write!(
        stream,
        "POST / HTTP/1.0\r\nHost: {host}\r\nContent-Type: text/xml\r\nContent-Length: {}\r\n\r\n{body}",
        body.len()
    )?;
    let mut answer = String::new();
    stream.take(LONGEST).read_to_string(&mut answer)?;
    answer
        .split_once("\r\n\r\n")
        .map(|(_, body)| body.to_owned())
        .ok_or_else(|| io::Error::other("the master's answer has no body"))
}
