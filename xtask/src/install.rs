//! `cargo xtask install`: the program `forcectl` with its manual pages and completions, below one
//! folder.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::process;
use crate::report::{say, Failure, Result};
use crate::rig;
use crate::workspace::Workspace;

/// Completions: shell, and where its file stands below the prefix.
const COMPLETIONS: [(&str, &str); 3] = [
    ("bash", "share/bash-completion/completions/forcectl"),
    ("zsh", "share/zsh/site-functions/_forcectl"),
    ("fish", "share/fish/vendor_completions.d/forcectl.fish"),
];

/// Builds forcectl and installs it below `prefix`; `None`: `~/.local`.
///
/// # Errors
/// When something can't be built or written.
pub fn install(workspace: &Workspace, prefix: Option<PathBuf>) -> Result<()> {
    let prefix = match prefix {
        Some(prefix) => prefix,
        None => default_prefix(env::var_os("HOME").map(PathBuf::from))?,
    };
    rig::build(workspace, &["forcectl"])?;
    let program = prefix
        .join("bin")
        .join(format!("forcectl{}", env::consts::EXE_SUFFIX));
    copy(&workspace.program("forcectl"), &program)?;
    let pages = prefix.join("share/man/man1");
    process::run(
        Command::new(&program)
            .args(["--quiet", "man", "--out"])
            .arg(&pages),
    )?;
    for (shell, place) in COMPLETIONS {
        let path = prefix.join(place);
        let mut command = Command::new(&program);
        let script = process::capture(command.args(["completions", shell]))?;
        process::check(&command, script.status)?;
        write(&path, &script.stdout)?;
    }
    say(format!(
        "installed {}, its manual pages and completions below {}",
        program.display(),
        prefix.display()
    ));
    if !in_path(&prefix.join("bin")) {
        say(format!(
            "{} is not in PATH; add it to call `forcectl`",
            prefix.join("bin").display()
        ));
    }
    Ok(())
}

fn default_prefix(home: Option<PathBuf>) -> Result<PathBuf> {
    home.filter(|home| home.is_absolute())
        .map(|home| home.join(".local"))
        .ok_or_else(|| {
            Failure::new("HOME is not set, so there is no place to install to".to_owned())
                .remedy("give one with --prefix DIR")
        })
}

/// Copies a program over an earlier one, which may be running: written beside it and renamed.
fn copy(from: &Path, to: &Path) -> Result<()> {
    let fresh = to.with_extension("new");
    let copied = parent(to)
        .and_then(|()| fs::copy(from, &fresh).map(|_| ()))
        .and_then(|()| fs::rename(&fresh, to));
    copied.map_err(|error| Failure::new(format!("{} can't be written: {error}", to.display())))
}

fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    parent(path)
        .and_then(|()| fs::write(path, bytes))
        .map_err(|error| Failure::new(format!("{} can't be written: {error}", path.display())))
}

fn parent(path: &Path) -> std::io::Result<()> {
    path.parent().map_or(Ok(()), fs::create_dir_all)
}

fn in_path(folder: &Path) -> bool {
    env::var_os("PATH").is_some_and(|path| env::split_paths(&path).any(|known| known == folder))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_is_in_the_home_folder() {
        let prefix = default_prefix(Some("/home/ann".into()));
        assert_eq!(prefix.ok(), Some(PathBuf::from("/home/ann/.local")));
        for home in [None, Some(PathBuf::new())] {
            let failure = default_prefix(home).expect_err("there is no home");
            assert!(failure.to_string().contains("--prefix"), "{failure}");
        }
    }

    #[test]
    fn a_file_is_replaced_and_its_folder_made() {
        let temporary = tempfile::tempdir().expect("made");
        let folder = temporary.path();
        let (from, to) = (folder.join("from"), folder.join("a/b/forcectl"));
        for text in ["one", "two"] {
            write(&from, text.as_bytes()).expect("written");
            copy(&from, &to).expect("copied");
            assert_eq!(fs::read_to_string(&to).expect("is there"), text);
        }
        // Nothing is left beside it.
        assert_eq!(
            fs::read_dir(folder.join("a/b")).expect("is there").count(),
            1
        );
    }
}
