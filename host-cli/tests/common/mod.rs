//! What several tests of the program need.

/// The signals that end a command. Without SIGHUP where these tests run with SIGHUP ignored (`nohup`): the command
/// inherits that and keeps it.
pub fn signals() -> Vec<&'static str> {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status
        .lines()
        .find_map(|line| line.strip_prefix("SigIgn:"))
        .and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok())
        .unwrap_or(0);
    let mut out = vec!["INT", "TERM"];
    if ignored & 1 == 0 {
        out.push("HUP");
    }
    out
}
