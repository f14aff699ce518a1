//! `forcectl rig`: an emulated rig that stays, for many commands and terminals.

use super::connection::check_plant;
use super::exit::Result;
use super::exit::{Failure, Reply};
use super::serve::{self, Listen};
use super::watch::Watch;
use super::{values, Context};
use clap::Args;
use emulator_link::Injection;
use rig::{LinkChoice, RigText};
use service::{socket, ServeOptions};
use session::link::{self, EmbeddedOptions};
use session::Session;
use std::path::PathBuf;

/// Arguments of `rig`.
#[derive(Debug, Args)]
pub struct Rig {
    /// Rig file (TOML) [default: the built-in example rig]
    #[arg(long, value_name = "FILE", value_parser = values::rig_file)]
    rig: Option<PathBuf>,
    /// Seed of all random values
    #[arg(long, value_name = "N", value_parser = values::seed)]
    seed: Option<u64>,
    /// Physics of the rig (TOML) [default: the rig of the thesis]
    #[arg(long, value_name = "FILE")]
    plant: Option<PathBuf>,
    /// Reach the board by its USB port instead of its serial line
    #[arg(long)]
    usb: bool,
    /// Cause a fault at power-on, for example unplug=3@start; repeatable. `forcectl inject` causes
    /// them later
    #[arg(long, value_name = "WHAT@start", value_parser = session::inject::parse, allow_hyphen_values = true)]
    inject: Vec<(f64, Injection)>,
    /// Let the rig's time wait for a commander that is late, up to 2 s: for a slow or busy computer
    #[arg(long)]
    wait: bool,
    #[command(flatten)]
    listen: Listen,
}

impl Rig {
    /// Runs the command, which ends with the rig: by Ctrl-C, or `forcectl serve --end --name rig`.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        check_plant(self.plant.as_deref())?;
        let text = RigText::read(self.rig.as_deref())?;
        let rig = text.parse()?;
        let name = self
            .listen
            .name
            .clone()
            .unwrap_or_else(|| socket::EMBEDDED_NAME.to_owned());
        if let Some(why) = socket::refusal_of(&name) {
            return Err(Failure::usage(format!(
                "a rig can't be kept under the name `{name}`: {why}; give another --name"
            )));
        }
        let mut tokens = self.listen.tokens()?;
        let reserved = serve::reserve(&name)?;
        let _controlled_stop = context.interrupt.controlled_stop();
        let options = EmbeddedOptions {
            seed: self.seed,
            run: 0,
            paced: true,
            plant: self.plant.clone(),
            usb: self.usb,
        };
        let mut link = link::open(&LinkChoice::Embedded, &options)?;
        if let Some(controls) = link.controls() {
            for (_, injection) in &self.inject {
                controls.inject(*injection)?;
            }
        }
        let mut watch = Watch::new(&context.output);
        let stop = context.interrupt.flag();
        // Cables are slack at power-on: the only time at which zeros are sure.
        let prepared = {
            let mut session = Session::connect(link.as_mut())?;
            run::ready_board(
                &mut session,
                &rig,
                &run::Zeroing::Measure,
                &stop,
                &mut watch,
            )
        };
        watch.progress.done();
        prepared?;
        // Nobody can connect before: there is nobody yet who would answer.
        let listening = serve::listen(reserved, &name)?;
        let options = ServeOptions {
            name,
            rig_file: (text.name, text.text),
            terminal: true,
            tcp: tokens.tcp.take(),
            reopen: None,
            store: None,
            idle_end: None,
            lockstep: self.wait,
            stop,
        };
        serve::run(link, listening, options, (&self.listen, tokens), context)
    }
}
