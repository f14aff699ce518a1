//! Where a service listens: one Unix socket per rig, in a folder that only its user can enter.

use rig::LinkChoice;
use std::ffi::OsString;
use std::fs;
use std::io;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

/// Variable with the folder of the sockets.
pub const FOLDER_VARIABLE: &str = "FORCECTL_RUNTIME_DIR";
/// Name of the rig that `forcectl rig` keeps where no other is given.
pub const EMBEDDED_NAME: &str = "rig";
/// Longest path of a Unix socket (`sun_path`, unix(7)).
const MAX_PATH: usize = 107;

/// Name of the service for a link: `rig` for the embedded rig, else the port.
#[must_use]
pub fn name_of(link: &LinkChoice) -> String {
    match link {
        LinkChoice::Embedded | LinkChoice::Fast => EMBEDDED_NAME.to_owned(),
        LinkChoice::Usb => "usb".to_owned(),
        LinkChoice::Serial(port) => {
            // The same port by whatever name (`/dev/serial/by-id/...`, a relative path).
            let path = fs::canonicalize(port).unwrap_or_else(|_| PathBuf::from(port));
            let path = path.display().to_string();
            // Not `-some-path`: on a command line that would be an option.
            known::zeros::file_name_part(path.trim_start_matches("/dev").trim_start_matches('/'))
        }
        LinkChoice::Kept(name) => name.clone(),
    }
}

/// The folder of the sockets: [`FOLDER_VARIABLE`], else `forcectl` in `XDG_RUNTIME_DIR`, else a folder in the user's home. Never one
/// where another user could listen in place of the service: a client sends forces to whoever answers.
///
/// # Errors
/// None of these variables is set, nor `HOME`.
pub fn folder() -> io::Result<PathBuf> {
    folder_from(|variable| std::env::var_os(variable).filter(|value| !value.is_empty()))
}

fn folder_from(set: impl Fn(&str) -> Option<OsString>) -> io::Result<PathBuf> {
    if let Some(folder) = set(FOLDER_VARIABLE) {
        return Ok(PathBuf::from(folder));
    }
    if let Some(folder) = set("XDG_RUNTIME_DIR") {
        return Ok(Path::new(&folder).join("forcectl"));
    }
    match set("HOME") {
        Some(home) => Ok(Path::new(&home).join(".local/state/forcectl/run")),
        None => Err(io::Error::other(format!(
            "neither {FOLDER_VARIABLE} nor XDG_RUNTIME_DIR nor HOME is set; set {FOLDER_VARIABLE} to a folder of your own"
        ))),
    }
}

/// Makes the folder of the sockets where it does not exist. Refuses one that another user could reach into.
///
/// # Errors
/// It can't be made, belongs to another user or is open to others.
pub fn make_folder() -> io::Result<()> {
    let path = folder()?;
    fs::DirBuilder::new()
        .recursive(true)
        .mode(0o700)
        .create(&path)?;
    let found = fs::metadata(&path)?;
    if found.uid() != user() {
        return Err(io::Error::other(format!(
            "{} belongs to another user; set {FOLDER_VARIABLE} to a folder of your own",
            path.display()
        )));
    }
    if found.permissions().mode() & 0o022 != 0 {
        return Err(io::Error::other(format!(
            "others may write to {}; use `chmod go-w`, or set {FOLDER_VARIABLE} to another folder",
            path.display()
        )));
    }
    Ok(())
}

/// The user of this process.
fn user() -> u32 {
    rustix::process::getuid().as_raw()
}

/// The socket of a rig.
///
/// # Errors
/// The path is too long for a socket.
pub fn path_of(name: &str) -> io::Result<PathBuf> {
    let path = folder()?.join(format!("{name}.sock"));
    if path.as_os_str().len() > MAX_PATH {
        return Err(io::Error::other(format!(
            "{} is too long for a socket ({MAX_PATH} characters); set {FOLDER_VARIABLE} to a shorter folder",
            path.display()
        )));
    }
    Ok(path)
}

/// Names of the rigs whose service answers now.
#[must_use]
pub fn running() -> Vec<String> {
    let Ok(entries) = folder().and_then(fs::read_dir) else {
        return Vec::new();
    };
    let mut names: Vec<String> = entries
        .filter_map(Result::ok)
        .filter(|entry| UnixStream::connect(entry.path()).is_ok())
        .filter_map(|entry| {
            Some(
                entry
                    .file_name()
                    .to_str()?
                    .strip_suffix(".sock")?
                    .to_owned(),
            )
        })
        .collect();
    names.sort();
    names
}

/// A listening socket that removes itself.
#[derive(Debug)]
pub struct Listening {
    /// The listener.
    pub listener: UnixListener,
    path: PathBuf,
    /// Held as long as the service lives: two services that start at once can't both take over a dead socket.
    _lock: fs::File,
}

impl Listening {
    /// Listens for a rig. A socket that a killed service left behind is replaced.
    ///
    /// # Errors
    /// A service for this rig runs already ([`io::ErrorKind::AddrInUse`]), or the folder is not usable.
    pub fn bind(name: &str) -> io::Result<Self> {
        make_folder()?;
        Self::bind_at(path_of(name)?)
    }

    /// Listens on this socket.
    ///
    /// # Errors
    /// As [`Listening::bind`].
    pub fn bind_at(path: PathBuf) -> io::Result<Self> {
        let lock = fs::File::options()
            .create(true)
            .truncate(false)
            .write(true)
            .open(path.with_extension("lock"))?;
        if lock.try_lock().is_err() {
            return Err(io::ErrorKind::AddrInUse.into());
        }
        match fs::remove_file(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        let listener = UnixListener::bind(&path)?;
        fs::set_permissions(&path, fs::Permissions::from_mode(0o600))?;
        Ok(Self {
            listener,
            path,
            _lock: lock,
        })
    }

    /// The socket.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for Listening {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_folder_is_never_one_that_others_share() {
        let of = |variables: &[(&str, &str)]| {
            folder_from(|name| {
                let found = variables.iter().find(|(variable, _)| *variable == name);
                found.map(|(_, value)| OsString::from(value))
            })
        };
        let all = [
            (FOLDER_VARIABLE, "/a"),
            ("XDG_RUNTIME_DIR", "/b"),
            ("HOME", "/c"),
        ];
        let expected = ["/a", "/b/forcectl", "/c/.local/state/forcectl/run"];
        for (from, path) in expected.iter().enumerate() {
            assert_eq!(of(&all[from..]).unwrap(), Path::new(path));
        }
        let error = of(&[("TMPDIR", "/tmp")]).unwrap_err().to_string();
        assert!(error.contains(FOLDER_VARIABLE), "{error}");
    }
}
