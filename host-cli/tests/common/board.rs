//! A board on a pseudo-terminal: the fast rig, whose serial line a program opens as a port.

use rustix::pty::{grantpt, openpt, ptsname, unlockpt, OpenptFlags};
use rustix::termios::{tcgetattr, tcsetattr, OptionalActions};
use session::link::fast::FastRig;
use session::link::{EmbeddedOptions, RigLink};
use std::fs::File;
use std::io::{Read, Write};
use std::sync::mpsc::{channel, Receiver};
use std::time::{Duration, Instant};

/// Longest time that the rig advances at once.
const STEP: Duration = Duration::from_millis(5);

/// A board that runs for as long as the test.
pub struct Board {
    /// Name of its port.
    pub port: String,
}

impl Board {
    /// Starts the rig of a seed.
    pub fn start(seed: u64) -> Self {
        let ours = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&ours).unwrap();
        unlockpt(&ours).unwrap();
        let name = ptsname(&ours, Vec::new()).unwrap();
        let port = name.to_str().unwrap().to_owned();
        let line = File::options().read(true).write(true).open(&port).unwrap();
        let mut settings = tcgetattr(&line).unwrap();
        settings.make_raw();
        tcsetattr(&line, OptionalActions::Now, &settings).unwrap();
        let mut from_host = File::from(ours);
        let to_host = from_host.try_clone().unwrap();
        let (bytes, received) = channel();
        std::thread::spawn(move || {
            let mut chunk = [0; 4096];
            loop {
                // Between two programs nobody has the line open, and reading it is an error.
                match from_host.read(&mut chunk) {
                    Ok(length @ 1..) if bytes.send(chunk[..length].to_vec()).is_err() => return,
                    Ok(1..) => {}
                    _ => std::thread::sleep(Duration::from_millis(1)),
                }
            }
        });
        let options = EmbeddedOptions {
            seed: Some(seed),
            ..EmbeddedOptions::default()
        };
        let rig = FastRig::open(&options).unwrap();
        std::thread::spawn(move || run(rig, &received, to_host));
        Self { port }
    }
}

/// Carries bytes both ways while the rig follows the clock on the wall.
fn run(mut rig: FastRig, received: &Receiver<Vec<u8>>, mut to_host: File) {
    let mut last = Instant::now();
    loop {
        std::thread::sleep(Duration::from_millis(1));
        let passed = last.elapsed().min(STEP);
        last = Instant::now();
        let to_board: Vec<u8> = received.try_iter().flatten().collect();
        let exchange = rig.exchange(&to_board, passed).unwrap();
        // What nobody reads is lost.
        let _ = to_host.write_all(&exchange.from_board);
    }
}
