//! Debian's ROS 1 for a test: a core, processes that end with the test. Also included by
//! `host-cli/tests/ros1.rs`.

use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Programs that the test needs.
pub const TOOLS: [&str; 3] = ["/usr/bin/rosmaster", "/usr/bin/rostopic", "/usr/bin/rosbag"];
/// How long to wait for something that must come. It is no measure of anything.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// A process in a group of its own, ended with the test.
pub struct Process(pub Child);

impl Process {
    /// Ends it as Ctrl-C does, and waits for it.
    #[allow(dead_code)] // not every test that includes this file does
    pub fn interrupt(&mut self) {
        signal(&self.0, "-INT");
        let _ = self.0.wait();
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        signal(&self.0, "-KILL");
        let _ = self.0.wait();
    }
}

fn signal(child: &Child, signal: &str) {
    let group = format!("-{}", child.id());
    let _ = Command::new("kill").args([signal, "--", &group]).status();
}

pub struct Ros {
    port: u16,
    pub folder: tempfile::TempDir,
}

impl Ros {
    pub fn command(&self, program: &str, arguments: &[&str]) -> Command {
        use std::os::unix::process::CommandExt;
        let mut command = Command::new(format!("/usr/bin/{program}"));
        command
            .args(arguments)
            .env("PATH", "/usr/bin:/bin")
            .env("ROS_MASTER_URI", self.master())
            .env("ROS_IP", "127.0.0.1")
            .env("ROS_LOG_DIR", self.folder.path())
            .env("ROS_HOME", self.folder.path())
            .current_dir(self.folder.path())
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .process_group(0);
        command
    }

    pub fn start(&self, program: &str, arguments: &[&str]) -> Process {
        Process(self.command(program, arguments).spawn().expect(program))
    }

    /// Waits until rosbag has finished this bag: it has another name before. Calls `meanwhile`
    /// again and again.
    pub fn finished(&self, bag: &Path, mut meanwhile: impl FnMut()) {
        let limit = Instant::now() + PATIENCE;
        while !bag.exists() {
            assert!(Instant::now() < limit, "{} is not finished", bag.display());
            meanwhile();
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    pub fn master(&self) -> String {
        format!("http://127.0.0.1:{}", self.port)
    }
}

/// A core, where Debian's tools are installed.
pub fn ros() -> Option<(Ros, Process)> {
    if let Some(missing) = TOOLS.iter().find(|tool| !Path::new(tool).exists()) {
        println!("skipped: {missing} is not installed");
        return None;
    }
    let port = TcpListener::bind("127.0.0.1:0")
        .and_then(|socket| socket.local_addr())
        .expect("a free port")
        .port();
    let ros = Ros {
        port,
        folder: tempfile::tempdir().expect("a folder"),
    };
    // The master alone: roscore puts it, and rosout, into sessions of their own, which outlive the
    // test.
    let core = ros.start("rosmaster", &["--core", "-p", &port.to_string()]);
    let limit = Instant::now() + PATIENCE;
    while TcpStream::connect(("127.0.0.1", port)).is_err() {
        assert!(Instant::now() < limit, "rosmaster does not come up");
        std::thread::sleep(Duration::from_millis(50));
    }
    Some((ros, core))
}
