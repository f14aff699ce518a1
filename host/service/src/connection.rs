//! One connection: a thread reads lines into the hub's queue, another writes what the hub wants to
//! say.

use super::inbound::{ClientId, Inbound};
use super::outbox::{Closing, Outbox};
use super::protocol::{self, Request, MAX_LINE};
use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::os::unix::net::UnixStream;
use std::sync::mpsc::Sender;
use std::sync::Arc;

/// A stream in both directions.
pub(super) trait Stream: Send {
    /// Its reading and its writing half, and what ends both.
    ///
    /// # Errors
    /// Those of the operating system.
    fn parts(self) -> io::Result<Parts>;
}

/// Reading half, writing half, and what ends both: a blocked write fails, the reading half gets an
/// end of file.
type Parts = (
    Box<dyn Read + Send>,
    Box<dyn Write + Send>,
    Arc<dyn Closing>,
);

impl Closing for UnixStream {
    fn close(&self) {
        let _ = self.shutdown(std::net::Shutdown::Both);
    }
}

impl Closing for TcpStream {
    fn close(&self) {
        let _ = self.shutdown(std::net::Shutdown::Both);
    }
}

impl Stream for UnixStream {
    fn parts(self) -> io::Result<Parts> {
        let (reader, writer) = (self.try_clone()?, self.try_clone()?);
        Ok((Box::new(reader), Box::new(writer), Arc::new(self)))
    }
}

impl Stream for TcpStream {
    fn parts(self) -> io::Result<Parts> {
        self.set_nodelay(true)?;
        let (reader, writer) = (self.try_clone()?, self.try_clone()?);
        Ok((Box::new(reader), Box::new(writer), Arc::new(self)))
    }
}

/// Starts the two threads of a connection and reports it to the hub.
///
/// # Errors
/// Those of the operating system.
pub(super) fn start(
    stream: impl Stream,
    id: ClientId,
    trusted: bool,
    hub: &Sender<Inbound>,
) -> io::Result<()> {
    let (reader, mut writer, connection) = stream.parts()?;
    let outbox = Outbox::of(Arc::clone(&connection));
    let to_hub = hub.clone();
    let writing = outbox.clone();
    std::thread::Builder::new()
        .name(format!("client {id} out"))
        .spawn(move || {
            // A client that has gone may have sent a stop before: what it sent is read to its end,
            // and what is for it goes nowhere.
            let mut listens = true;
            while let Some(lines) = writing.next() {
                let text: String = lines.iter().map(|line| &**line).collect();
                listens = listens && writer.write_all(text.as_bytes()).is_ok();
            }
            connection.close();
        })?;
    // The hub learns of the client before anything that it says.
    let _ = to_hub.send(Inbound::Opened {
        id,
        trusted,
        outbox: outbox.clone(),
    });
    std::thread::Builder::new()
        .name(format!("client {id} in"))
        .spawn(move || {
            read(reader, id, &outbox, &to_hub);
            let _ = to_hub.send(Inbound::Closed { id });
        })?;
    Ok(())
}

/// Reads lines until the end.
fn read(reader: impl Read, id: ClientId, outbox: &Outbox, hub: &Sender<Inbound>) {
    let mut reader = BufReader::new(reader);
    loop {
        let mut line = Vec::new();
        let limited = (&mut reader)
            .take(MAX_LINE as u64)
            .read_until(b'\n', &mut line);
        match limited {
            Ok(0) | Err(_) => return,
            Ok(_) => {}
        }
        let text = String::from_utf8_lossy(&line);
        if text.trim().is_empty() {
            continue;
        }
        match Request::parse(&text) {
            Ok(request) => {
                if !outbox.may_request() || hub.send(Inbound::Request { id, request }).is_err() {
                    return;
                }
            }
            Err((request_id, code, message)) => {
                let request_id = request_id.unwrap_or_default();
                outbox.line(protocol::answer(&request_id, &Err((code, message))));
                if line.len() >= MAX_LINE {
                    // The rest of an endless line is no request either.
                    outbox.close();
                    return;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::outbox::{MAX_REQUESTS, MAX_WAITING};
    use crate::protocol::Call;
    use std::sync::mpsc::channel;
    use std::time::Duration;

    /// Long enough for a thread to run, where something must not happen.
    const A_MOMENT: Duration = Duration::from_millis(100);

    #[test]
    fn a_client_that_floods_waits_for_itself() {
        let lines = "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"status\"}\n".repeat(1000);
        let outbox = Outbox::default();
        let (sender, hub) = channel();
        let reading = outbox.clone();
        let thread = std::thread::spawn(move || read(lines.as_bytes(), 7, &reading, &sender));
        let arrived = || hub.recv_timeout(A_MOMENT).is_ok();
        let first = std::iter::repeat_with(arrived).take_while(|here| *here);
        assert_eq!(first.count(), MAX_REQUESTS);
        // One is carried out: one more comes.
        outbox.carried_out();
        assert!(arrived() && !arrived());
        outbox.close();
        thread.join().unwrap();
    }

    #[test]
    fn what_a_client_sent_before_it_left_is_carried_out() {
        let (ours, mut theirs) = UnixStream::pair().unwrap();
        let (sender, hub) = channel();
        start(ours, 7, true, &sender).unwrap();
        let Ok(Inbound::Opened { outbox, .. }) = hub.recv() else {
            panic!("the hub was not told");
        };
        outbox.line("unread\n");
        std::thread::sleep(A_MOMENT);
        let status = "{\"id\":1,\"method\":\"status\"}\n".repeat(100);
        theirs.write_all(status.as_bytes()).unwrap();
        theirs.write_all(b"{\"method\":\"stop\"}\n").unwrap();
        drop(theirs);
        let mut requests = 0;
        loop {
            match hub.recv().expect("all that was sent") {
                Inbound::Request { request, .. } if request.call == Call::Stop => break,
                Inbound::Request { .. } => requests += 1,
                _ => panic!("gone after {requests} requests"),
            }
            // As the hub does: an answer to nobody.
            outbox.line("answer\n");
            outbox.carried_out();
        }
        assert_eq!(requests, 100);
        assert!(matches!(hub.recv(), Ok(Inbound::Closed { id: 7 })));
        outbox.close();
    }

    #[test]
    fn a_client_that_leaves_everything_unread_is_disconnected_while_a_write_blocks() {
        let (ours, mut theirs) = UnixStream::pair().unwrap();
        let (sender, hub) = channel();
        start(ours, 7, true, &sender).unwrap();
        let Ok(Inbound::Opened { outbox, .. }) = hub.recv() else {
            panic!("the hub was not told");
        };
        // Far more than the socket's buffer: the thread that writes is blocked.
        outbox.line("x".repeat(1 << 24));
        std::thread::sleep(A_MOMENT);
        for _ in 0..=MAX_WAITING {
            outbox.line("y\n");
        }
        assert!(matches!(hub.recv(), Ok(Inbound::Closed { id: 7 })));
        let mut rest = Vec::new();
        theirs.read_to_end(&mut rest).unwrap();
        assert!(rest.len() < 1 << 24);
    }
}
