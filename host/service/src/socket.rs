//! Where a service listens: one Unix socket per rig, in a folder that only its user can enter.
//!
//! The folder depends on variables that differ between logins of one account (ssh, su, cron, an old
//! tmux), so a client looks into every folder that they may have led to ([`folders`]). On Linux a
//! service also announces its socket where every account can read it (`elsewhere`), so that a
//! stop knows of a rig that it may not reach.

use super::account;
use rig::LinkChoice;
use std::ffi::OsString;
use std::fs;
use std::io;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, PermissionsExt};
use std::os::unix::net::{UnixDatagram, UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Variable with the folder of the sockets.
pub const FOLDER_VARIABLE: &str = "FORCECTL_RUNTIME_DIR";
/// Name of the rig that `forcectl rig` keeps where no other is given.
pub const EMBEDDED_NAME: &str = "rig";
/// What the link of a service that has a board begins with: how a port names itself.
pub const PORT: &str = "port ";
/// What a service's announcement begins with, in the abstract namespace of Unix sockets (unix(7)).
/// Nobody connects to it.
const ANNOUNCED: &str = "forcectl:";
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

/// Why a rig can't be kept under a name: a port would be looked for under it, or `--link rig:NAME`
/// would not find it. `None`: it can.
#[must_use]
pub fn refusal_of(name: &str) -> Option<&'static str> {
    let is_port = name == "usb" || ["tty", "cu-", "serial"].iter().any(|p| name.starts_with(p));
    if is_port {
        Some("it is that of a port, and `--link` would find this rig in place of a board")
    } else if name.contains(':') {
        Some("`--link rig:NAME` takes no colon in it")
    } else {
        None
    }
}

/// The folder of the sockets: [`FOLDER_VARIABLE`], else `forcectl` in `XDG_RUNTIME_DIR`, else a
/// folder in the user's home. Never one where another user could listen in place of the service: a
/// client sends forces to whoever answers.
///
/// # Errors
/// None of these variables is set, nor `HOME`.
pub fn folder() -> io::Result<PathBuf> {
    folder_from(|variable| std::env::var_os(variable).filter(|value| !value.is_empty()))
}

fn folder_from(set: impl Fn(&str) -> Option<OsString>) -> io::Result<PathBuf> {
    candidates(set, &PathBuf::new(), None)
        .into_iter()
        .next()
        .ok_or_else(|| {
            io::Error::other(format!(
                "neither {FOLDER_VARIABLE} nor XDG_RUNTIME_DIR nor HOME is set; set {FOLDER_VARIABLE} to a folder of your own"
            ))
        })
}

/// Every folder in which a service of this account may listen, whatever the variables are here;
/// [`folder`] comes first. Only that one where [`FOLDER_VARIABLE`] is set: who sets it keeps some
/// rigs apart from others.
#[must_use]
pub fn folders() -> Vec<PathBuf> {
    let uid = account::uid();
    candidates(
        |variable| std::env::var_os(variable).filter(|value| !value.is_empty()),
        &PathBuf::from(format!("/run/user/{uid}")),
        account::home(uid),
    )
}

/// The folders by the variables, the account's runtime folder (empty: unknown) and its home.
fn candidates(
    set: impl Fn(&str) -> Option<OsString>,
    runtime: &Path,
    home: Option<PathBuf>,
) -> Vec<PathBuf> {
    if let Some(folder) = set(FOLDER_VARIABLE) {
        return vec![PathBuf::from(folder)];
    }
    let below_runtime = |folder: PathBuf| folder.join("forcectl");
    let below_home = |folder: PathBuf| folder.join(".local/state/forcectl/run");
    let runtime = Some(runtime.to_owned()).filter(|runtime| !runtime.as_os_str().is_empty());
    let all = [
        set("XDG_RUNTIME_DIR").map(PathBuf::from).map(below_runtime),
        set("HOME").map(PathBuf::from).map(below_home),
        runtime.map(below_runtime),
        home.map(below_home),
    ];
    let mut folders: Vec<PathBuf> = Vec::new();
    for folder in all.into_iter().flatten() {
        if !folders.contains(&folder) {
            folders.push(folder);
        }
    }
    folders
}

/// Makes the folder of the sockets where it does not exist. Refuses one that another user could
/// reach into.
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
    if found.uid() != account::uid() {
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

/// The socket of a rig whose service is started here.
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

/// A socket of a service, alive or left behind.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Socket {
    /// Name of the rig.
    pub name: String,
    /// Where it is.
    pub path: PathBuf,
}

impl Socket {
    fn at(path: PathBuf) -> Option<Self> {
        let name = path.file_name()?.to_str()?.strip_suffix(".sock")?;
        Some(Self {
            name: name.to_owned(),
            path,
        })
    }

    /// Process and link of the service that listens here, as it noted them beside its socket;
    /// `None` where it has ended.
    #[must_use]
    pub fn holder(&self) -> Option<(u32, String)> {
        let lock = self.path.with_extension("lock");
        // The lock is held as long as the service lives.
        let file = fs::File::open(&lock).ok()?;
        if file.try_lock_shared().is_ok() {
            return None;
        }
        let note = fs::read_to_string(lock).ok()?;
        let (process, link) = note.trim_end().split_once('\n')?;
        Some((process.parse().ok()?, link.to_owned()))
    }

    /// Name of the account that it belongs to, or whose folder it is in.
    #[must_use]
    pub fn owner(&self) -> String {
        let known = self.path.ancestors().find_map(|at| fs::metadata(at).ok());
        known.map_or_else(
            || "another account".to_owned(),
            |at| account::name(at.uid()),
        )
    }
}

/// What a look for services has found.
#[derive(Debug, Default)]
pub struct Found {
    /// Sockets in [`folders`].
    pub sockets: Vec<Socket>,
    /// Sockets that are announced in other folders.
    pub elsewhere: Vec<Socket>,
    /// Those of [`folders`] that can't be looked into, and why.
    pub closed: Vec<(PathBuf, io::Error)>,
}

/// Looks for services of any account.
#[must_use]
pub fn find() -> Found {
    let announced = fs::read_to_string("/proc/net/unix").unwrap_or_default();
    find_in(&folders(), &announced)
}

fn find_in(folders: &[PathBuf], announced: &str) -> Found {
    let mut found = Found::default();
    for folder in folders {
        match fs::read_dir(folder) {
            Ok(entries) => found.sockets.extend(
                entries
                    .filter_map(Result::ok)
                    .filter_map(|entry| Socket::at(entry.path())),
            ),
            // Nothing has ever listened there.
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(error) => found.closed.push((folder.clone(), error)),
        }
    }
    found
        .sockets
        .sort_by(|a, b| (&a.name, &a.path).cmp(&(&b.name, &b.path)));
    found.elsewhere = elsewhere(announced)
        .filter(|socket| {
            let same =
                |own: &Socket| fs::canonicalize(&own.path).is_ok_and(|own| own == socket.path);
            !found.sockets.iter().any(same)
        })
        .collect();
    found
}

/// The sockets that services of this machine have announced, by the text of `/proc/net/unix`
/// (proc_net(5)): the name is its last column, and `@` stands for the abstract namespace.
fn elsewhere(announced: &str) -> impl Iterator<Item = Socket> + '_ {
    announced.lines().filter_map(|line| {
        let (_, path) = line.split_once(&format!(" @{ANNOUNCED}"))?;
        Socket::at(PathBuf::from(path.trim_end_matches('@')))
    })
}

/// Announces a socket to every account of this machine. `None` where the system has no such way.
#[cfg(target_os = "linux")]
fn announce(path: &Path) -> Option<UnixDatagram> {
    use std::os::linux::net::SocketAddrExt;
    use std::os::unix::net::SocketAddr;
    let path = fs::canonicalize(path).ok()?;
    let name = [ANNOUNCED.as_bytes(), path.as_os_str().as_encoded_bytes()].concat();
    let address = SocketAddr::from_abstract_name(name).ok()?;
    UnixDatagram::bind_addr(&address).ok()
}

#[cfg(not(target_os = "linux"))]
fn announce(_: &Path) -> Option<UnixDatagram> {
    None
}

/// The sockets in [`folders`] whose service answers now. Of two for one rig, the first.
fn answering() -> Vec<Socket> {
    let first = folder().ok();
    let mut sockets: Vec<Socket> = find().sockets;
    // A client sends forces to whoever answers: not in a folder of another account, unless the
    // variables name it.
    sockets.retain(|socket| {
        let parent = socket.path.parent();
        parent == first.as_deref()
            || parent
                .and_then(|parent| fs::metadata(parent).ok())
                .is_some_and(|parent| parent.uid() == account::uid())
    });
    sockets.retain(|socket| UnixStream::connect(&socket.path).is_ok());
    sockets.dedup_by(|next, kept| next.name == kept.name);
    sockets
}

/// Names of the rigs whose service answers now.
#[must_use]
pub fn running() -> Vec<String> {
    answering().into_iter().map(|socket| socket.name).collect()
}

/// The socket of a rig's service: the one that answers, else the one that would be listened on
/// here.
///
/// # Errors
/// As [`path_of`].
pub fn of(name: &str) -> io::Result<PathBuf> {
    let usual = path_of(name)?;
    if usual.exists() {
        return Ok(usual);
    }
    let answers = answering().into_iter().find(|socket| socket.name == name);
    Ok(answers.map_or(usual, |socket| socket.path))
}

/// Further tries to take a name, and the time before each: a look at it ([`is_reserved`]) has its
/// lock for some microseconds.
const LOCK_TRIES: u32 = 3;
const LOCK_WAIT: Duration = Duration::from_millis(10);

/// The name of a rig, taken before anybody can connect: a rig that is being brought up.
#[derive(Debug)]
pub struct Reserved {
    path: PathBuf,
    lock: fs::File,
}

impl Reserved {
    /// Takes the name of a rig. A socket that a killed service left behind is removed.
    ///
    /// # Errors
    /// A service for this rig runs already ([`io::ErrorKind::AddrInUse`]), or the folder is not
    /// usable.
    pub fn take(name: &str) -> io::Result<Self> {
        make_folder()?;
        Self::take_at(path_of(name)?)
    }

    fn take_at(path: PathBuf) -> io::Result<Self> {
        let lock = fs::File::options()
            .create(true)
            .truncate(false)
            .write(true)
            .open(path.with_extension("lock"))?;
        let mut tries = 0..LOCK_TRIES;
        while lock.try_lock().is_err() {
            if tries.next().is_none() {
                return Err(io::ErrorKind::AddrInUse.into());
            }
            std::thread::sleep(LOCK_WAIT);
        }
        match fs::remove_file(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
            _ => Ok(Self { path, lock }),
        }
    }

    /// Listens.
    ///
    /// # Errors
    /// Those of the operating system.
    pub fn listen(self) -> io::Result<Listening> {
        let listener = UnixListener::bind(&self.path)?;
        fs::set_permissions(&self.path, fs::Permissions::from_mode(0o600))?;
        Ok(Listening {
            listener,
            _announced: announce(&self.path),
            path: self.path,
            lock: self.lock,
        })
    }
}

/// Names of the emulated rigs that are kept here, those that are being brought up included. No
/// board's: a board is driven only where its link is named.
#[must_use]
pub fn kept() -> Vec<String> {
    let folder = folder().ok();
    kept_of(answering(), folder.as_deref())
}

fn kept_of(answering: Vec<Socket>, folder: Option<&Path>) -> Vec<String> {
    let emulated = |socket: &Socket| {
        let link = socket.holder().map(|(_, link)| link);
        socket.name == EMBEDDED_NAME || link.is_some_and(|link| !link.starts_with(PORT))
    };
    let mut names: Vec<String> = (answering.into_iter().filter(emulated))
        .map(|socket| socket.name)
        .collect();
    names.extend(folder.map(starting).unwrap_or_default());
    names.sort();
    names.dedup();
    names
}

/// Names of the rigs that are being brought up: the name is taken, and nobody listens yet.
fn starting(folder: &Path) -> Vec<String> {
    let locks = fs::read_dir(folder).into_iter().flatten().flatten();
    let sockets = locks.filter_map(|lock| {
        let path = lock.path();
        (path.extension()? == "lock").then(|| path.with_extension("sock"))
    });
    sockets
        .filter(|path| !path.exists() && is_reserved(path))
        .filter_map(|path| Some(Socket::at(path)?.name))
        .collect()
}

/// Whether somebody has taken the name of the rig that nobody listens for at this socket.
pub(super) fn is_reserved(path: &Path) -> bool {
    // Opened for reading only: a name that nobody ever took is not taken by this look.
    fs::File::open(path.with_extension("lock"))
        .is_ok_and(|lock| matches!(lock.try_lock_shared(), Err(fs::TryLockError::WouldBlock)))
}

/// A listening socket that removes itself.
#[derive(Debug)]
pub struct Listening {
    /// The listener.
    pub listener: UnixListener,
    path: PathBuf,
    /// Held as long as the service lives: two services that start at once can't both take over a
    /// dead socket.
    lock: fs::File,
    _announced: Option<UnixDatagram>,
}

impl Listening {
    /// Listens for a rig. A socket that a killed service left behind is replaced.
    ///
    /// # Errors
    /// As [`Reserved::take`].
    pub fn bind(name: &str) -> io::Result<Self> {
        Reserved::take(name)?.listen()
    }

    /// Listens on this socket.
    ///
    /// # Errors
    /// As [`Listening::bind`].
    pub fn bind_at(path: PathBuf) -> io::Result<Self> {
        Reserved::take_at(path)?.listen()
    }

    /// Notes this process and its link beside the socket, for whoever finds that it does not
    /// answer.
    ///
    /// # Errors
    /// Those of the operating system.
    pub fn note(&mut self, link: &str) -> io::Result<()> {
        use std::io::{Seek, Write};
        self.lock.set_len(0)?;
        self.lock.rewind()?;
        write!(self.lock, "{}\n{link}\n", std::process::id())
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

    #[test]
    fn a_rig_that_is_brought_up_is_told_from_one_that_is_not_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.sock");
        assert!(!is_reserved(&path));
        let reserved = Reserved::take_at(path.clone()).unwrap();
        assert!(is_reserved(&path) && !path.exists());
        let error = Reserved::take_at(path.clone()).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::AddrInUse);
        let starting = |path: &Path| {
            let connected = crate::Client::connect_at(path, "rig", "a test");
            matches!(connected, Err(crate::ServiceError::Starting { .. }))
        };
        assert!(starting(&path));
        let listening = reserved.listen().unwrap();
        assert!(path.exists());
        drop(listening);
        assert!(!is_reserved(&path) && !starting(&path));
        // Somebody looks at the name just when it is taken.
        let look = fs::File::open(path.with_extension("lock")).unwrap();
        look.lock_shared().unwrap();
        let looks = std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(5));
            drop(look);
        });
        assert!(Reserved::take_at(path).is_ok());
        looks.join().unwrap();
    }

    #[test]
    fn a_stop_looks_into_every_folder_that_another_login_may_have_chosen() {
        let of = |variables: &[(&str, &str)]| {
            let set = |name: &str| {
                let found = variables.iter().find(|(variable, _)| *variable == name);
                found.map(|(_, value)| OsString::from(value))
            };
            candidates(set, Path::new("/run/user/7"), Some("/home/lab".into()))
        };
        let run = [
            "/run/user/7/forcectl",
            "/home/lab/.local/state/forcectl/run",
        ]
        .map(PathBuf::from);
        // cron: nothing is set.
        assert_eq!(of(&[]), run);
        // A login: the same folders, in the other order of no importance.
        let login = of(&[("XDG_RUNTIME_DIR", "/run/user/7"), ("HOME", "/home/lab")]);
        assert!(login.len() == 2 && run.iter().all(|folder| login.contains(folder)));
        // `su` keeps the variables of another account.
        let su = of(&[("XDG_RUNTIME_DIR", "/run/user/8"), ("HOME", "/root")]);
        assert_eq!(su[0], Path::new("/run/user/8/forcectl"));
        assert!(su.len() == 4 && run.iter().all(|folder| su.contains(folder)));
        assert_eq!(
            of(&[(FOLDER_VARIABLE, "/a"), ("HOME", "/c")]),
            [Path::new("/a")]
        );
    }

    #[test]
    fn sockets_are_found_in_all_folders_and_by_what_is_announced() {
        let folder = tempfile::tempdir().unwrap();
        let root = fs::canonicalize(folder.path()).unwrap();
        for name in ["one", "two"] {
            fs::create_dir(root.join(name)).unwrap();
        }
        let first = Listening::bind_at(root.join("one/usb.sock")).unwrap();
        let second = Listening::bind_at(root.join("two/rig.sock")).unwrap();
        fs::write(root.join("file"), "").unwrap();
        let folders = ["one", "file", "none"].map(|name| root.join(name));
        let announced = fs::read_to_string("/proc/net/unix").unwrap_or_default();
        let found = find_in(&folders, &announced);
        let paths = |sockets: &[Socket]| -> Vec<PathBuf> {
            sockets.iter().map(|socket| socket.path.clone()).collect()
        };
        assert_eq!(paths(&found.sockets), [first.path()]);
        // What can't be looked into is not the same as what is not there.
        assert_eq!(found.closed.len(), 1);
        assert_eq!(found.closed[0].0, root.join("file"));
        if cfg!(target_os = "linux") {
            let elsewhere = paths(&found.elsewhere);
            assert!(
                elsewhere.contains(&second.path().to_owned()),
                "{elsewhere:?}"
            );
            assert!(
                !elsewhere.contains(&first.path().to_owned()),
                "{elsewhere:?}"
            );
        }
    }

    #[test]
    fn no_rig_is_kept_under_the_name_of_a_port() {
        let ports = [LinkChoice::Usb].into_iter().chain(
            ["/dev/ttyACM0", "/dev/ttyS0", "/dev/cu.usb1"].map(|p| LinkChoice::Serial(p.into())),
        );
        for port in ports {
            assert!(refusal_of(&name_of(&port)).is_some(), "{port}");
        }
        assert!(refusal_of("rig:x").is_some());
        assert!(["rig", "lab", "raven-left", "usb2-bench"]
            .iter()
            .all(|name| refusal_of(name).is_none()));
    }

    #[test]
    fn an_emulated_rig_is_kept_under_any_name_and_a_board_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(format!("{name}.sock"));
        let listen = |name: &str, link: &str| {
            let mut listening = Listening::bind_at(at(name)).unwrap();
            listening.note(link).unwrap();
            listening
        };
        let served = [
            listen("one", "embedded rig"),
            listen("usb", "port /dev/ttyACM0"),
        ];
        let sockets = || {
            let paths = served.iter().map(|listening| listening.path().to_owned());
            paths.filter_map(Socket::at).collect()
        };
        assert_eq!(kept_of(sockets(), Some(folder.path())), ["one"]);
        let reserved = Reserved::take_at(at("two")).unwrap();
        assert_eq!(kept_of(sockets(), Some(folder.path())), ["one", "two"]);
        // A name that was taken once, and is not now.
        drop(reserved);
        assert_eq!(kept_of(sockets(), Some(folder.path())), ["one"]);
    }

    #[test]
    fn a_service_notes_who_it_is_as_long_as_it_lives() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("usb.sock");
        let mut listening = Listening::bind_at(path.clone()).unwrap();
        let socket = Socket::at(path).unwrap();
        assert_eq!(socket.holder(), None);
        listening.note("port /dev/a long name").unwrap();
        listening.note("port /dev/ttyACM0").unwrap();
        let holder = (std::process::id(), "port /dev/ttyACM0".to_owned());
        assert_eq!(socket.holder(), Some(holder));
        drop(listening);
        assert_eq!(socket.holder(), None);
    }
}
