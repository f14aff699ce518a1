//! Whose process this is: for messages to others, and for the folders in which a service may
//! listen.

use rustix::termios::ttyname;
use std::fs;
use std::os::fd::AsFd;
use std::path::PathBuf;

/// The user of this process.
pub(super) fn uid() -> u32 {
    rustix::process::getuid().as_raw()
}

/// Name and home of an account, where `/etc/passwd` knows it.
fn entry(uid: u32) -> Option<(String, PathBuf)> {
    entry_in(&fs::read_to_string("/etc/passwd").ok()?, uid)
}

/// Fields of passwd(5): name, password, uid, gid, comment, home, shell.
fn entry_in(passwd: &str, uid: u32) -> Option<(String, PathBuf)> {
    passwd.lines().find_map(|line| {
        let fields: Vec<&str> = line.split(':').collect();
        let [name, _, number, _, _, home, ..] = fields[..] else {
            return None;
        };
        (number.parse() == Ok(uid)).then(|| (name.to_owned(), home.into()))
    })
}

/// An account's home, whatever `HOME` says.
pub(super) fn home(uid: u32) -> Option<PathBuf> {
    let (_, home) = entry(uid)?;
    home.is_absolute().then_some(home)
}

/// Name of an account, or its number.
pub(super) fn name(uid: u32) -> String {
    entry(uid).map_or_else(|| format!("number {uid}"), |(name, _)| name)
}

/// The terminal of this process, such as `pts/3`.
pub(super) fn terminal() -> Option<String> {
    let (stdin, stdout, stderr) = (std::io::stdin(), std::io::stdout(), std::io::stderr());
    let streams = [stdin.as_fd(), stderr.as_fd(), stdout.as_fd()];
    let path = (streams.into_iter()).find_map(|stream| ttyname(stream, Vec::new()).ok())?;
    let path = path.into_string().ok()?;
    Some(path.trim_start_matches("/dev/").to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_account_is_found_by_its_number() {
        let passwd = "root:x:0:0:root:/root:/bin/bash\nbad line\nlab:x:1001:1001:The, Lab:/home/lab:/bin/sh\n";
        assert_eq!(
            entry_in(passwd, 1001),
            Some(("lab".into(), "/home/lab".into()))
        );
        assert_eq!(entry_in(passwd, 1), None);
    }
}
