//! `forcectl zero`: sends the rig file's configuration and takes zeros.

use super::connection::{Existing, Role};
use super::exit::{Reply, Result};
use super::watch::Watch;
use super::Context;
use clap::Args;
use run::Zeroing;
use serde_json::json;
use std::fmt::Write as _;

/// Arguments of `zero`.
#[derive(Debug, Args)]
pub struct Zero {
    /// Accept zeros that are far from the last ones: a sensor was changed or mounted anew. The
    /// cables have to be slack
    #[arg(long)]
    replace: bool,
    #[command(flatten)]
    connection: Existing,
}

impl Zero {
    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        let rig = self.connection.load(context)?;
        self.connection.require_rig_file(&rig)?;
        self.connection
            .with_session(Role::Commander, context, |session, rig| {
                let mut watch = Watch::new(&context.output);
                let stop = context.interrupt.flag();
                let zeroing = match self.connection.zeroing() {
                    Zeroing::Keep(store) if self.replace => Zeroing::Replace(store),
                    Zeroing::Keep(store) => Zeroing::Ask(store),
                    other => other,
                };
                let prepared = run::ready_board(session, rig, &zeroing, &stop, &mut watch);
                watch.progress.done();
                Ok(table(&prepared?))
            })
    }
}

fn table(prepared: &run::Prepared) -> Reply {
    let mut text = "unit   zero code   zero N\n".to_owned();
    for (i, config) in prepared.configs.iter().enumerate() {
        let zero_n = f64::from(config.zero_code) * f64::from(config.scale_pn_per_count) * 1e-12;
        let state = if prepared.available[i] {
            ""
        } else {
            "   left out"
        };
        let _ = writeln!(
            text,
            "{:>4} {:>11} {zero_n:>8.3}{state}",
            i + 1,
            config.zero_code
        );
    }
    let codes = prepared.configs.map(|config| config.zero_code);
    Reply::new(
        text,
        json!({"zero_codes": codes, "available": prepared.available}),
    )
}
