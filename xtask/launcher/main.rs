//! `cargo forcectl`: becomes the forcectl that was built before, or lets xtask build what is
//! missing.
//!
//! A stop must not wait for a compiler, for another cargo that holds the target folder, nor fail
//! because something in the workspace does not compile. So the commands of [`AT_ONCE`] take the
//! program that there is, and say when it is older than its sources. Everything else goes to
//! `cargo xtask forcectl`.

use std::env;
use std::ffi::{OsStr, OsString};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::time::SystemTime;

/// Commands that take the forcectl that there is.
const AT_ONCE: [&str; 5] = ["clear", "disarm", "monitor", "status", "stop"];

/// Those of them that start an embedded rig where none is kept, and so need it and the image.
const MAY_EMULATE: [&str; 2] = ["monitor", "status"];

/// Options for which a forcectl of the first build is not enough (xtask/src/rig.rs).
const WHOLE: [&str; 1] = ["--foxglove"];

/// Profiles that hold a forcectl, the one of `cargo forcectl` first.
const PROFILES: [&str; 2] = ["debug", "release"];

fn main() -> ExitCode {
    let arguments: Vec<OsString> = env::args_os().skip(1).collect();
    let checkout = Checkout::locate();
    if let Some(programs) = at_once(&arguments, &checkout.target) {
        let program = programs.join(file_name("forcectl"));
        let mut command = Command::new(&program);
        command
            .args(&arguments)
            .env("FORCE_FIRMWARE_ELF", image(&checkout.target))
            .env("FORCE_RIG_BIN", programs.join(file_name("rig")));
        let word = word(&arguments).unwrap_or_default();
        let error = if word == "stop" {
            // The age is hundreds of files: a stop that is on its way does not wait for them.
            start_it(&mut command, || warn_if_old(&program, word))
        } else {
            warn_if_old(&program, word);
            become_it(&mut command)
        };
        eprintln!("forcectl: {} can't be started: {error}", program.display());
    } else if let Some(word) = word(&arguments).filter(|word| AT_ONCE.contains(word)) {
        eprintln!(
            "forcectl: `{word}` has no program to run below {} yet, so it is built first",
            checkout.target.display()
        );
    }
    let mut command = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    for (name, _) in env::vars_os() {
        if is_of_this_package(&name) {
            command.env_remove(&name);
        }
    }
    command
        .args(["run", "--package", "xtask", "--manifest-path"])
        .arg(checkout.root.join("Cargo.toml"))
        .args(["--", "forcectl"])
        .args(&arguments);
    let error = become_it(&mut command);
    eprintln!("forcectl: cargo can't be started: {error}");
    ExitCode::FAILURE
}

/// The checkout whose forcectl is meant.
struct Checkout {
    root: PathBuf,
    /// Where cargo builds it.
    target: PathBuf,
}

impl Checkout {
    /// That of the manifest which cargo runs; without cargo, that of this program's own path,
    /// `ROOT/target/launcher/debug/launcher`.
    fn locate() -> Self {
        let of_cargo = env::var_os("CARGO_MANIFEST_DIR").map(PathBuf::from);
        let root = of_cargo
            .as_deref()
            .and_then(|manifest| manifest.ancestors().nth(2))
            .map(Path::to_path_buf)
            .or_else(|| Some(env::current_exe().ok()?.ancestors().nth(4)?.to_path_buf()))
            .unwrap_or_default();
        let chosen = ["CARGO_TARGET_DIR", "CARGO_BUILD_TARGET_DIR"]
            .iter()
            .find_map(|name| env::var_os(name).filter(|value| !value.is_empty()));
        let target = match chosen {
            Some(folder) => PathBuf::from(folder),
            None => noted_target(&root).unwrap_or_else(|| root.join("target")),
        };
        Self { root, target }
    }
}

/// The target folder of cargo's configuration, which only cargo can tell: xtask notes it where it
/// differs.
fn noted_target(root: &Path) -> Option<PathBuf> {
    let note = fs::read_to_string(root.join("target/launcher/target")).ok()?;
    Some(PathBuf::from(note))
}

fn image(target: &Path) -> PathBuf {
    target.join("firmware/force-board.elf")
}

fn file_name(program: &str) -> String {
    format!("{program}{}", env::consts::EXE_SUFFIX)
}

/// The command of forcectl. Options that may stand before it take no value.
fn word(arguments: &[OsString]) -> Option<&str> {
    (arguments.iter())
        .filter_map(|argument| argument.to_str())
        .find(|word| !word.starts_with('-'))
}

/// The folder with the programs that are enough for this call; `None`: something has to be built.
fn at_once(arguments: &[OsString], target: &Path) -> Option<PathBuf> {
    let command = word(arguments).filter(|word| AT_ONCE.contains(word))?;
    let words = || (arguments.iter()).filter_map(|argument| argument.to_str());
    let option = |word: &str| WHOLE.contains(&word.split('=').next().unwrap_or(word));
    if words().any(option) {
        return None;
    }
    let of_a_board = words().any(|word| word.starts_with("--link"));
    let emulates = MAY_EMULATE.contains(&command) && !of_a_board;
    PROFILES
        .iter()
        .map(|profile| target.join(profile))
        .filter(|programs| programs.join(file_name("forcectl")).is_file())
        .find(|programs| {
            !emulates || programs.join(file_name("rig")).is_file() && image(target).is_file()
        })
}

/// Says that a program is older than a source of its.
fn warn_if_old(program: &Path, word: &str) {
    if let Some(newer) = newer_source(program) {
        eprintln!(
            "forcectl: {} is older than {}; it is used as it is, because `{word}` waits for no compiler. Any other command \
             builds it anew",
            program.display(),
            newer.display()
        );
    }
}

/// A source that is newer than the program, or gone. Cargo lists the sources beside it.
fn newer_source(program: &Path) -> Option<PathBuf> {
    let built = modified(program)?;
    let list = fs::read_to_string(program.with_extension("d")).ok()?;
    sources(&list)
        .into_iter()
        .find(|source| modified(source).is_none_or(|changed| changed > built))
}

fn modified(file: &Path) -> Option<SystemTime> {
    fs::metadata(file).and_then(|file| file.modified()).ok()
}

/// The files of cargo's `PROGRAM: FILE FILE...`, where a space within a name has a backslash before
/// it.
fn sources(list: &str) -> Vec<PathBuf> {
    let Some((_, list)) = list.split_once(": ") else {
        return Vec::new();
    };
    let mut found = vec![String::new()];
    let mut characters = list.trim_end().chars().peekable();
    while let Some(character) = characters.next() {
        match (character, characters.peek(), found.last_mut()) {
            ('\\', Some(' '), Some(last)) => last.extend(characters.next()),
            (' ' | '\n', _, _) => found.push(String::new()),
            (other, _, Some(last)) => last.push(other),
            (_, _, None) => {}
        }
    }
    found.into_iter().map(PathBuf::from).collect()
}

/// Variables with which `cargo run` describes this package, and which would leak into builds
/// started from here.
fn is_of_this_package(name: &OsStr) -> bool {
    name.to_str()
        .is_some_and(|name| name.starts_with("CARGO_MANIFEST_") || name.starts_with("CARGO_PKG_"))
}

/// Replaces this process by another program: its exit code and Ctrl-C are the caller's. Returns
/// only an error.
#[cfg(unix)]
fn become_it(command: &mut Command) -> std::io::Error {
    use std::os::unix::process::CommandExt;
    command.exec()
}

/// Runs another program to its end and exits with its code. Returns only an error.
#[cfg(not(unix))]
fn become_it(command: &mut Command) -> std::io::Error {
    start_it(command, || {})
}

/// Starts another program, does something beside it, and exits with its code. Returns only an
/// error.
fn start_it(command: &mut Command, beside: impl FnOnce()) -> std::io::Error {
    let ended = command.spawn().and_then(|mut child| {
        beside();
        child.wait()
    });
    match ended {
        Ok(status) => std::process::exit(status.code().unwrap_or(1)),
        Err(error) => error,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(line: &str) -> Vec<OsString> {
        line.split_whitespace().map(OsString::from).collect()
    }

    /// A target folder with these files.
    fn target(files: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for file in files {
            let file = folder.path().join(file);
            fs::create_dir_all(file.parent().unwrap()).unwrap();
            fs::write(file, "").unwrap();
        }
        folder
    }

    #[test]
    fn a_stop_takes_any_forcectl_and_what_may_emulate_wants_the_rig_too() {
        let forcectl = format!("debug/{}", file_name("forcectl"));
        let rig = format!("debug/{}", file_name("rig"));
        let alone = target(&[&forcectl]);
        let whole = target(&[&forcectl, &rig, "firmware/force-board.elf"]);
        let released = target(&[&format!("release/{}", file_name("forcectl"))]);
        let nothing = target(&[]);
        let profile = |line: &str, target: &tempfile::TempDir| {
            let found = at_once(&words(line), target.path())?;
            Some(found.file_name()?.to_str()?.to_owned())
        };
        for line in ["stop", "--json stop", "disarm", "clear --link usb"] {
            assert_eq!(profile(line, &alone).as_deref(), Some("debug"), "{line}");
            assert_eq!(profile(line, &released).as_deref(), Some("release"));
            assert_eq!(profile(line, &nothing), None);
        }
        for line in ["status", "monitor --duration 1"] {
            assert_eq!(profile(line, &alone), None, "{line}");
            assert_eq!(profile(line, &whole).as_deref(), Some("debug"), "{line}");
            let board = format!("{line} --link=usb");
            assert_eq!(profile(&board, &alone).as_deref(), Some("debug"), "{line}");
        }
        for line in ["monitor --foxglove", "set-force 0 1 0", "", "--help"] {
            assert_eq!(profile(line, &whole), None, "{line}");
        }
    }

    #[test]
    fn a_program_is_old_where_a_source_changed_after_it_or_is_gone() {
        let folder = target(&["debug/forcectl", "a.rs", "b c.rs"]);
        let (program, a) = (
            folder.path().join("debug/forcectl"),
            folder.path().join("a.rs"),
        );
        let list = |files: &str| fs::write(program.with_extension("d"), files).unwrap();
        let set = |file: &Path, to: SystemTime| {
            let file = fs::File::options().write(true).open(file).unwrap();
            file.set_modified(to).unwrap();
        };
        let root = folder.path().display();
        assert_eq!(newer_source(&program), None, "no list");
        list(&format!(
            "{root}/debug/forcectl: {root}/a.rs {root}/b\\ c.rs\n"
        ));
        let built = modified(&program).unwrap();
        for file in ["a.rs", "b c.rs"] {
            set(&folder.path().join(file), built);
        }
        assert_eq!(newer_source(&program), None);
        set(&a, built + std::time::Duration::from_secs(1));
        assert_eq!(newer_source(&program), Some(a.clone()));
        set(&a, built);
        fs::remove_file(folder.path().join("b c.rs")).unwrap();
        assert_eq!(newer_source(&program), Some(folder.path().join("b c.rs")));
    }
}
