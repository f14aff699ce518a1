//! `renode-rig`: the board in Renode, behind the same pipe as the embedded rig.
//!
//! It takes the arguments of the embedded rig's program (`--elf`, `--seed`, `--plant`), speaks
//! `emulator-link` on standard input and output, and moves a Renode of its own through the model
//! `RigServer` (renode/models). So whatever drives the embedded rig, `forcectl` with its real
//! controller first, drives Renode unchanged: name this program in `FORCE_RIG_BIN`.
//!
//! | variable | meaning |
//! | --- | --- |
//! | `RENODE` | the `renode` program; otherwise the one on `PATH` |
//! | `FORCE_RENODE_DIR` | this project's folder `renode`; otherwise the one this program was built from |
//! | `FORCE_PLANT_LIBRARY` | the library of `plant-abi`; otherwise the one beside this program |
//! | `FORCE_RENODE_ATTACH` | a port: wait there for a running Renode that executes `server Connect PORT`, and start none |

mod machine;
mod text;

use emulator_link::{receive, send, Request, Response, LINK_VERSION};
use machine::Machine;
use std::io::{self, BufReader, BufWriter, ErrorKind};
use std::path::PathBuf;
use std::process::ExitCode;

const USAGE: &str = "\
usage: renode-rig --elf FILE [--seed N] [--plant FILE.toml] [--usb]

  --elf FILE       firmware image (ELF) to boot
  --seed N         seed of everything random (default 1)
  --plant FILE     plant configuration in TOML (default: the rig of the thesis)
  --usb            the link's bytes go through the board's USB socket, not through USART3
  --run N          accepted as by the embedded rig's program, without effect: each run has the same noise
  --paced, --quiet accepted as by the embedded rig's program, without effect
  -h, --help       print this

Speaks emulator-link on standard input and output; Renode's log goes to standard error.";

/// Options of the command line.
#[derive(Debug)]
pub struct Arguments {
    /// Firmware image.
    pub elf: PathBuf,
    /// Seed of everything random.
    pub seed: u64,
    /// Configuration of the plant.
    pub plant: Option<PathBuf>,
    /// The link's bytes go through the USB socket.
    pub usb: bool,
}

/// `None`: `--help` was given.
fn arguments(mut words: impl Iterator<Item = String>) -> Result<Option<Arguments>, String> {
    let mut elf = None;
    let mut seed = 1;
    let mut plant = None;
    let mut usb = false;
    while let Some(word) = words.next() {
        let mut value = || {
            words
                .next()
                .ok_or_else(|| format!("{word} needs a value\n{USAGE}"))
        };
        match word.as_str() {
            "--elf" => elf = Some(value()?.into()),
            "--seed" => {
                let text = value()?;
                seed = text
                    .parse()
                    .map_err(|_| format!("--seed {text}: not a whole number from 0"))?;
            }
            "--run" => {
                value()?;
            }
            "--plant" => plant = Some(value()?.into()),
            "--usb" => usb = true,
            // Renode in lock-step is never faster than its partner; there is nothing to pace.
            "--paced" | "--quiet" => {}
            "-h" | "--help" => return Ok(None),
            _ => return Err(format!("{word}: unknown\n{USAGE}")),
        }
    }
    let elf = elf.ok_or_else(|| format!("--elf is missing\n{USAGE}"))?;
    Ok(Some(Arguments {
        elf,
        seed,
        plant,
        usb,
    }))
}

fn main() -> ExitCode {
    let done = arguments(std::env::args().skip(1)).and_then(|arguments| match arguments {
        Some(arguments) => serve(&arguments),
        None => {
            println!("{USAGE}");
            Ok(())
        }
    });
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("renode-rig: {why}");
            ExitCode::FAILURE
        }
    }
}

fn serve(arguments: &Arguments) -> Result<(), String> {
    let mut machine = Machine::start(arguments)?;
    let mut from = BufReader::new(io::stdin().lock());
    let mut to = BufWriter::new(io::stdout().lock());
    loop {
        let request: Request = match receive(&mut from) {
            Ok(request) => request,
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => return Ok(()),
            Err(error) => return Err(format!("the link's request can't be read: {error}")),
        };
        let quits = request == Request::Quit;
        let response = answer(&mut machine, &request);
        send(&mut to, &response).map_err(|e| format!("the link's answer can't be sent: {e}"))?;
        if quits {
            return Ok(());
        }
    }
}

fn answer(machine: &mut Machine, request: &Request) -> Response {
    match request {
        Request::Hello { .. } => Response::Ready {
            version: LINK_VERSION,
            seed: machine.seed(),
            machine: machine.name(),
        },
        Request::Quit => Response::Done,
        other => match machine.ask(other) {
            Ok(response) => response,
            Err(why) => Response::Failed(why),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(words: &[&str]) -> Result<Option<Arguments>, String> {
        arguments(words.iter().map(ToString::to_string))
    }

    #[test]
    fn the_embedded_rigs_arguments_are_understood() {
        let a = parse(&[
            "--elf", "a", "--seed", "7", "--plant", "p.toml", "--paced", "--usb",
        ])
        .unwrap()
        .unwrap();
        assert_eq!(a.elf, PathBuf::from("a"));
        assert_eq!((a.seed, a.usb), (7, true));
        assert_eq!(a.plant, Some(PathBuf::from("p.toml")));
    }

    #[test]
    fn bad_arguments_are_named() {
        assert!(parse(&["--seed", "1"]).unwrap_err().contains("--elf"));
        assert!(parse(&["--elf", "a", "--seed", "x"])
            .unwrap_err()
            .contains("--seed x"));
        assert!(parse(&["--elf"]).unwrap_err().contains("needs a value"));
        assert!(parse(&["--nope"]).unwrap_err().contains("--nope"));
    }
}
