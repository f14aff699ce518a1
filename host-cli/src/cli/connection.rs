//! Options of the commands that talk to a board, and the connection that they describe.

use super::exit::{self, Failure, Result};
use super::values;
use super::Context;
use clap::Args;
use control::SystemState;
use host_cli::link::{self, EmbeddedOptions, RigLink};
use host_cli::rigfile::{LinkChoice, RigFile};
use host_cli::session::Session;
use std::path::PathBuf;
use std::time::Duration;

/// Heading of the options that only the embedded rig has.
pub const EMBEDDED: &str = "Embedded rig";

/// Which rig, and how it is reached.
#[derive(Debug, Args)]
#[command(next_help_heading = "Connection")]
pub struct Connection {
    /// Connection to the board: embedded, usb or serial:PORT [default: the rig file's]
    #[arg(long, value_name = "LINK", value_parser = values::link)]
    pub link: Option<LinkChoice>,
    /// Rig file (TOML) [default: the built-in example rig]
    #[arg(long, value_name = "FILE", value_parser = values::rig_file)]
    pub rig: Option<PathBuf>,
    /// Seed of all random values in the embedded rig
    #[arg(long, value_name = "N", help_heading = EMBEDDED, value_parser = values::seed)]
    pub seed: Option<u64>,
    /// Physics of the embedded rig (TOML) [default: the rig of the thesis]
    #[arg(long, value_name = "FILE", help_heading = EMBEDDED)]
    pub plant: Option<PathBuf>,
    /// Limit the embedded rig to real time
    #[arg(long, help_heading = EMBEDDED)]
    pub paced: bool,
}

impl Connection {
    /// Loads the rig file. Refuses options of the embedded rig where the link leads to a board.
    pub fn load(&self, context: &Context) -> Result<RigFile> {
        let rig = match &self.rig {
            Some(path) => RigFile::load(path),
            None => RigFile::built_in(),
        }
        .map_err(|error| Failure::new(exit::RIG_FILE, error))?;
        self.only_embedded(
            &rig,
            &[
                ("--seed", self.seed.is_some()),
                ("--plant", self.plant.is_some()),
                ("--paced", self.paced),
            ],
        )?;
        let name = self
            .rig
            .as_ref()
            .map_or_else(|| "built in".into(), |path| path.display().to_string());
        context.output.detail(&format!(
            "rig file: {name}, rig `{}`, hash {}",
            rig.name,
            rig.hash()
        ));
        Ok(rig)
    }

    /// The connection: that of `--link`, else that of the rig file.
    fn choice<'a>(&'a self, rig: &'a RigFile) -> &'a LinkChoice {
        self.link.as_ref().unwrap_or(&rig.link)
    }

    /// Refuses options that only the embedded rig has, where the link leads to a board.
    pub fn only_embedded(&self, rig: &RigFile, options: &[(&str, bool)]) -> Result<()> {
        let choice = self.choice(rig);
        if *choice == LinkChoice::Embedded {
            return Ok(());
        }
        match options.iter().find(|(_, given)| *given) {
            Some((name, _)) => Err(Failure::new(
                exit::USAGE,
                format!(
                    "{name} works with the embedded rig only, and the link is {choice}{}; omit {name} or use --link embedded",
                    if self.link.is_some() { "" } else { " (from the rig file)" }
                ),
            )),
            None => Ok(()),
        }
    }

    /// Opens the connection.
    pub fn open(&self, rig: &RigFile, context: &Context) -> Result<Box<dyn RigLink>> {
        let options = EmbeddedOptions {
            seed: self.seed,
            paced: self.paced,
            plant: self.plant.clone(),
        };
        let link = link::open(self.choice(rig), &options)?;
        context.output.detail(&format!("link: {}", link.name()));
        Ok(link)
    }

    /// Opens the connection, does the handshake and runs a command with it. Ctrl-C requests a controlled stop.
    pub fn with_session<T>(
        &self,
        context: &Context,
        command: impl FnOnce(&mut Session<'_>, &RigFile) -> Result<T>,
    ) -> Result<T> {
        let rig = self.load(context)?;
        let _controlled_stop = context.interrupt.controlled_stop();
        let mut link = self.open(&rig, context)?;
        let mut session = Session::connect(link.as_mut())?;
        if let Some(info) = session.info() {
            context
                .output
                .detail(&format!("firmware: {} (ABI {})", info.version, info.abi));
        }
        command(&mut session, &rig)
    }
}

/// Whether the session is with the embedded rig.
pub fn is_embedded(session: &mut Session<'_>) -> bool {
    session.link().controls().is_some()
}

/// Configures a freshly booted embedded rig with the rig file, so that its units have values to show. A board is left as
/// it is.
pub fn configure_embedded(session: &mut Session<'_>, rig: &RigFile) -> Result<()> {
    if is_embedded(session) {
        session.stage_board(rig.controller.board_config())?;
        session.configure(&rig.units.map(|unit| unit.to_wire()))?;
        session.wait_for(
            Duration::from_secs(15),
            "bringing up the sensors",
            |status| status.state == SystemState::Ready as u8,
        )?;
    }
    Ok(())
}
