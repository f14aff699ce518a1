//! Gets a compiler for the board ready, saying each step before it is done.

use std::env;
use std::fs;
use std::path::PathBuf;
use std::time::Duration;

use super::plan::{self, Apt, Facts, Rights, Route, Step};
use super::{facts, Arm, OLDEST_RUST, TARGET};
use crate::process::{self, Ended, Sees};
use crate::report::{say, Failure, Result};
use crate::workspace::Workspace;

/// Environment variable with the route to take: `auto`, `rustup` or `debian`.
pub const ROUTE_VARIABLE: &str = "FORCE_ARM_TOOLCHAIN";

/// How long `rustup target add` may make no progress. Behind some firewalls it never ends.
const RUSTUP_STALL: Duration = Duration::from_secs(20);

/// Reads the user's choice of route.
///
/// # Errors
/// For a word that is no route.
pub fn route(word: Option<&str>) -> Result<Route> {
    match word {
        None | Some("" | "auto") => Ok(Route::Any),
        Some("rustup") => Ok(Route::Host),
        Some("debian") => Ok(Route::Debian),
        Some(other) => Err(
            Failure::new(format!("`{other}` is not an ARM toolchain")).remedy(format!(
                "use auto, rustup or debian (option --toolchain, or {ROUTE_VARIABLE})"
            )),
        ),
    }
}

/// The route that the environment asks for.
///
/// # Errors
/// See [`route`].
pub fn route_from_environment() -> Result<Route> {
    route(env::var(ROUTE_VARIABLE).ok().as_deref())
}

/// Finds a compiler for the board, or sets one up.
///
/// # Errors
/// When no route is open; the message names each and what closes it.
pub fn ensure(workspace: &Workspace, route: Route) -> Result<Arm> {
    let mut facts = facts::gather(workspace, route);
    // Every step below either leads to `Ready` or closes its own route, so this ends.
    loop {
        // Asking apt takes a moment: only when nothing is ready.
        if facts.apt.is_none() && matches!(plan::next(&facts), Step::Stuck(_)) {
            facts.apt = facts::apt();
        }
        match plan::next(&facts) {
            Step::Ready(arm) => return Ok(arm),
            Step::AddTarget => {
                let reason = add_target().err().map_or_else(
                    || {
                        format!(
                            "rustup says that it has the library for {TARGET}, but it isn't there"
                        )
                    },
                    |failure| failure.to_string(),
                );
                facts = facts::gather(workspace, route);
                if !facts.host_has_target {
                    say(format!("{reason}; going on without rustup"));
                    remember(workspace, &reason);
                    facts.target_add_failed = Some(reason);
                }
            }
            Step::FetchLists => {
                say("ARM toolchain: fetching Debian's package lists (apt-get update) to find a new enough Rust");
                let outcome = apt_get(&facts, &["update"]);
                if let (Some(before), Some(mut now)) = (facts.apt.take(), facts::apt()) {
                    now.lists_fetched = true;
                    now.failed = outcome.err().map(|failure| failure.to_string());
                    facts.apt = Some(Apt {
                        rights: before.rights,
                        ..now
                    });
                }
            }
            Step::Install(packages) => {
                say(format!(
                    "ARM toolchain: installing Debian's {} system-wide (up to 150 MB to fetch), to build core for {TARGET} from source",
                    packages.join(", ")
                ));
                // --no-remove: never at the cost of something the user has installed.
                let mut arguments =
                    vec!["install", "--yes", "--no-remove", "--no-install-recommends"];
                arguments.extend(&packages);
                let reason = match apt_get(&facts, &arguments) {
                    Ok(()) => "installed, but there is still no usable compiler".to_string(),
                    Err(failure) => failure.to_string(),
                };
                let apt = facts.apt.take();
                let target_add_failed = facts.target_add_failed.take();
                facts = facts::gather(workspace, route);
                facts.target_add_failed = facts.target_add_failed.or(target_add_failed);
                facts.apt = apt.map(|apt| Apt {
                    failed: Some(reason),
                    ..apt
                });
            }
            Step::Stuck(closed) => return Err(stuck(&facts, &closed)),
        }
    }
}

/// Forgets failed attempts, so that the next [`ensure`] tries it again.
///
/// # Errors
/// When the note can't be deleted.
pub fn forget(workspace: &Workspace) -> Result<()> {
    let note = facts::target_add_note(workspace);
    if !note.is_file() {
        return Ok(());
    }
    fs::remove_file(&note)
        .map_err(|error| Failure::new(format!("{} can't be deleted: {error}", note.display())))
}

/// `rustup target add` for the toolchain that runs xtask, given up when the download stands still.
fn add_target() -> Result<()> {
    say(format!(
        "ARM toolchain: fetching Rust's library for {TARGET} into your rustup toolchain (about 20 MB; given up after {} s without progress)",
        RUSTUP_STALL.as_secs()
    ));
    let home = rustup_home();
    let mut command = process::command("rustup", Sees::CompilerAndFlags);
    command.args(["target", "add", TARGET]);
    let ended = process::run_unless_stalled(&mut command, RUSTUP_STALL, || {
        home.as_deref().map_or(0, |home| {
            process::folder_bytes(&home.join("downloads"))
                + process::folder_bytes(&home.join("tmp"))
        })
    })?;
    match ended {
        Ended::Itself(status) => process::check(&command, status),
        Ended::Stalled => Err(Failure::new(format!(
            "`{}` made no progress for {} s",
            process::line(&command),
            RUSTUP_STALL.as_secs()
        ))),
    }
}

/// Where rustup keeps toolchains and unfinished downloads.
fn rustup_home() -> Option<PathBuf> {
    env::var_os("RUSTUP_HOME")
        .map(PathBuf::from)
        .or_else(|| Some(PathBuf::from(env::var_os("HOME")?).join(".rustup")))
}

/// Notes a failed `rustup target add`, so that it costs its wait only once in this checkout.
fn remember(workspace: &Workspace, reason: &str) {
    let note = facts::target_add_note(workspace);
    let written = fs::create_dir_all(workspace.notes()).and_then(|()| fs::write(&note, reason));
    if let Err(error) = written {
        say(format!(
            "{} can't be written ({error}); the next run will try rustup again",
            workspace.show(&note)
        ));
    }
}

/// apt-get with root's rights, without prompts.
fn apt_get(facts: &Facts, arguments: &[&str]) -> Result<()> {
    let sudo = facts
        .apt
        .as_ref()
        .is_some_and(|apt| apt.rights == Rights::Sudo);
    let mut command = if sudo {
        let mut command = process::command("sudo", Sees::Nothing);
        command.args(["-n", "env", "DEBIAN_FRONTEND=noninteractive", "apt-get"]);
        command
    } else {
        process::command("apt-get", Sees::Nothing)
    };
    command
        .env("DEBIAN_FRONTEND", "noninteractive")
        .args(["--quiet", "-o", "DPkg::Lock::Timeout=120"])
        .args(arguments);
    // Its own report is no result of ours: off standard output.
    command.stdout(std::io::stderr());
    process::run(&mut command)
}

/// The message when no route is open.
fn stuck(facts: &Facts, closed: &[String]) -> Failure {
    let mut what = format!("no compiler for the board ({TARGET}):");
    for line in closed {
        what.push_str(
            "
  ",
        );
        what.push_str(line);
    }
    let mut remedy = format!(
        "either `rustup target add {TARGET}` (needs access to static.rust-lang.org),\n\
         or, on Debian, as root: apt-get update && apt-get install {} lld,\n\
         then `cargo xtask setup`.",
        plan::PACKAGE_SETS[0].join(" ")
    );
    if facts.target_add_failed.is_some() {
        remedy.push_str(
            "\nxtask won't ask rustup again by itself: `cargo xtask setup --retry` does.",
        );
    }
    if facts.host.is_some_and(|version| version < OLDEST_RUST) {
        remedy.push_str(&format!(
            "
Your Rust is older than {OLDEST_RUST}: `rustup update stable` first."
        ));
    }
    Failure::new(what).remedy(remedy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn routes_are_read_by_name() {
        assert_eq!(route(None), Ok(Route::Any));
        assert_eq!(route(Some("debian")), Ok(Route::Debian));
        assert_eq!(route(Some("rustup")), Ok(Route::Host));
        let error = route(Some("gcc")).unwrap_err().to_string();
        assert!(error.contains("gcc") && error.contains("debian"));
    }
}
