//! `forcectl stop`: 0 V on all motors at once.

use super::connection::{Existing, Role};
use super::exit::{self, Failure, Reply, Result};
use super::Context;
use clap::Args;
#[cfg(unix)]
use service::socket::{self, Socket};
#[cfg(unix)]
use service::stop::{stop, StopError};
use wire::Command;

/// What a stop that was confirmed means.
const STOPPED: &str = "stopped: all motors at 0 V; `forcectl clear` before arming again";

/// Arguments of `stop`.
#[derive(Debug, Args)]
pub struct Stop {
    #[command(flatten)]
    connection: Existing,
}

impl Stop {
    /// Runs the command. It works from every terminal, whoever commands the rig. Without `--link`
    /// it stops every rig that has a service here. It reads no rig file: a mistake in one must not
    /// keep the motors running.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        #[cfg(unix)]
        if self.stop_services(context)? {
            return Ok(Reply::done(STOPPED));
        }
        self.connection.load(context)?;
        #[cfg(unix)]
        if let Some(mut client) = self.connection.client(context) {
            client.call(service::protocol::Call::Stop)?;
            return Ok(Reply::done(STOPPED));
        }
        self.connection
            .with_session(Role::Observer, context, |session, _| {
                session.command(&Command::Stop)?;
                Ok(Reply::done(STOPPED))
            })
    }

    /// Stops the rigs that have a service, all at the same time: one that hangs keeps no other
    /// waiting. `false`: no service is concerned.
    #[cfg(unix)]
    fn stop_services(&self, context: &Context) -> Result<bool> {
        // A `--direct` that names no port keeps no rig from being stopped.
        if self.connection.opens_port() {
            return Ok(false);
        }
        let found = socket::find();
        let apart = std::env::var_os(socket::FOLDER_VARIABLE).is_some_and(|set| !set.is_empty());
        // Who sets the variable keeps some rigs apart: others are named, and left alone.
        let (apart, elsewhere): (Vec<Socket>, Vec<Socket>) =
            (found.elsewhere.into_iter()).partition(|_| apart);
        let closed = found.closed.iter().map(|(folder, error)| {
            format!(
                "{} can't be looked into ({error}); a rig may be served there, and was NOT stopped",
                folder.display()
            )
        });
        let sockets: Vec<Socket> = (found.sockets.into_iter().chain(elsewhere))
            .filter(|socket| self.connection.means(socket))
            .collect();
        let results: Vec<_> = std::thread::scope(|scope| {
            let stopping: Vec<_> = (sockets.iter())
                .map(|socket| {
                    let say = |words: &str| {
                        (context.output).error(&format!("rig `{}`: {words}", socket.name));
                    };
                    scope.spawn(move || stop(socket, "forcectl stop", &say))
                })
                .collect();
            (stopping.into_iter())
                .map(std::thread::ScopedJoinHandle::join)
                .collect()
        });
        let (mut failed, mut stopped) = (Vec::new(), false);
        for (socket, result) in sockets.iter().zip(results) {
            match result {
                Ok(Ok(rig)) => {
                    stopped = true;
                    (context.output).note(&format!("rig `{}`: {}", socket.name, rig.link));
                }
                Ok(Err(StopError::NobodyThere)) => {}
                Ok(Err(error)) => failed.push(format!("rig `{}`: {error}", socket.name)),
                Err(_) => failed.push(format!("rig `{}`: this program failed", socket.name)),
            }
        }
        for socket in apart.iter().filter(|_| !stopped) {
            context.output.error(&format!(
                "a rig is served at {} (account {}), outside of {variable}, and is NOT stopped; `env -u {variable} forcectl stop` \
                 stops it",
                socket.path.display(),
                socket.owner(),
                variable = socket::FOLDER_VARIABLE
            ));
        }
        // Who names a link means that rig alone.
        if self.connection.link.is_none() {
            if stopped {
                closed.for_each(|words| context.output.error(&words));
            } else {
                failed.extend(closed);
            }
        }
        if failed.is_empty() {
            return Ok(stopped);
        }
        Err(Failure::new(exit::LINK, failed.join("\n")))
    }
}
