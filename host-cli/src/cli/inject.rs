//! `forcectl inject`: causes a fault in an emulated rig that is kept.

use super::connection::Existing;
use super::exit::{Failure, Reply, Result};
use super::Context;
use clap::Args;
use service::protocol::Call;

/// Arguments of `inject`.
#[derive(Debug, Args)]
pub struct Inject {
    /// The fault, for example unplug=3; `help` lists the faults and starts nothing
    #[arg(value_name = "WHAT", value_parser = fault, allow_hyphen_values = true)]
    what: String,
    #[command(flatten)]
    connection: Existing,
}

/// A fault without a time: it happens now.
fn fault(text: &str) -> std::result::Result<String, String> {
    match text {
        "help" => Ok(text.to_owned()),
        _ => session::inject::parse_now(text).map(|_| text.to_owned()),
    }
}

impl Inject {
    /// Runs the command. Any client may inject, whoever commands.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        if self.what == "help" {
            return Ok(Reply::done(session::inject::WORDS));
        }
        self.connection.load(context)?;
        let Some(mut client) = self.connection.client(context) else {
            return Err(Failure::usage(
                "nothing can be injected into a real rig; `forcectl rig` keeps an emulated one",
            ));
        };
        client.call(Call::Inject {
            what: self.what.clone(),
        })?;
        Ok(Reply::done(&format!("injected: {}", self.what)))
    }
}
