//! A real board on a serial port: the ST-Link's virtual COM port, or USB CDC.

use super::{Exchange, LinkError, RigLink};
use serialport::{SerialPort, SerialPortType};
use std::io::ErrorKind;
use std::time::{Duration, Instant};

/// Baud rate of USART3 (docs/protocol.md). USB CDC takes any.
pub const BAUD: u32 = 2_000_000;

/// USB vendor and product number of the board: the shared test pair of pid.codes for open hardware.
pub const USB_ID: (u16, u16) = (0x1209, 0x0001);

/// USB vendor of ST, and the range of its products that are ST-LINK probes: the Nucleo's virtual
/// COM port is one's.
const ST_LINK: (u16, std::ops::RangeInclusive<u16>) = (0x0483, 0x3740..=0x375f);

/// Names of the ports that may lead to a board: its own USB port, and the virtual COM ports of
/// ST-LINK probes.
#[must_use]
pub fn of_boards() -> Vec<String> {
    serialport::available_ports()
        .unwrap_or_default()
        .into_iter()
        .filter(|port| match &port.port_type {
            SerialPortType::UsbPort(usb) => {
                (usb.vid, usb.pid) == USB_ID || usb.vid == ST_LINK.0 && ST_LINK.1.contains(&usb.pid)
            }
            _ => false,
        })
        .map(|port| port.port_name)
        .collect()
}

/// An open port.
pub struct Port {
    name: String,
    port: Box<dyn SerialPort>,
    opened: Instant,
    /// End of all time requested so far: short calls don't add up their overhead.
    due: Duration,
}

impl std::fmt::Debug for Port {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Port")
            .field("name", &self.name)
            .finish_non_exhaustive()
    }
}

/// Ports of this machine, for messages.
fn ports_here() -> String {
    let names: Vec<String> = serialport::available_ports()
        .unwrap_or_default()
        .into_iter()
        .map(|port| port.port_name)
        .collect();
    if names.is_empty() {
        "this machine has no serial ports; is the board plugged in?".to_owned()
    } else {
        format!("ports here: {}", names.join(", "))
    }
}

/// Which other process has a port open, where the system tells it (`/proc`, processes of this
/// user): a port that is in use can't be opened.
fn holder(path: &str) -> Option<String> {
    let device = std::fs::canonicalize(path).ok()?;
    let processes = std::fs::read_dir("/proc").ok()?;
    processes
        .filter_map(Result::ok)
        // Not `self` and `thread-self`, which are this process.
        .filter(|process| {
            let number = process.file_name().to_str().and_then(|n| n.parse().ok());
            number.is_some_and(|number: u32| number != std::process::id())
        })
        .find(|process| {
            let open = std::fs::read_dir(process.path().join("fd"));
            open.is_ok_and(|open| {
                open.filter_map(Result::ok)
                    .filter_map(|file| std::fs::read_link(file.path()).ok())
                    .any(|file| file == device)
            })
        })
        .map(|process| {
            let line = std::fs::read(process.path().join("cmdline")).unwrap_or_default();
            let line = String::from_utf8_lossy(&line).replace('\0', " ");
            format!(
                "process {} has it open ({}); end that program first",
                process.file_name().to_string_lossy(),
                line.trim()
            )
        })
}

impl Port {
    /// Opens a serial port by its name.
    ///
    /// # Errors
    /// [`LinkError::Open`] with the ports that there are.
    pub fn serial(path: &str) -> Result<Self, LinkError> {
        let port = serialport::new(path, BAUD)
            .timeout(Duration::from_millis(1))
            .open()
            .map_err(|error| LinkError::Open {
                name: format!("port {path}"),
                cause: error.to_string(),
                hint: match error.kind() {
                    serialport::ErrorKind::Io(ErrorKind::PermissionDenied) => {
                        "this user may not open it: install docs/udev/70-force-rig.rules (its head says how), or add yourself to the \
                         port's group (dialout or uucp) and log in again"
                            .to_owned()
                    }
                    _ => holder(path).unwrap_or_else(ports_here),
                },
            })?;
        Ok(Self {
            name: path.to_owned(),
            port,
            opened: Instant::now(),
            due: Duration::ZERO,
        })
    }

    /// Finds the board's USB CDC port and opens it.
    ///
    /// # Errors
    /// [`LinkError::Open`] where there is none, or more than one.
    pub fn usb() -> Result<Self, LinkError> {
        let boards: Vec<(String, String)> = serialport::available_ports()
            .unwrap_or_default()
            .into_iter()
            .filter_map(|port| match port.port_type {
                SerialPortType::UsbPort(usb) if (usb.vid, usb.pid) == USB_ID => {
                    Some((port.port_name, usb.serial_number.unwrap_or_default()))
                }
                _ => None,
            })
            .collect();
        match boards.as_slice() {
            [(path, _)] => Self::serial(path),
            [] => Err(LinkError::Open {
                name: "USB".to_owned(),
                cause: format!("no device {:04x}:{:04x} is there", USB_ID.0, USB_ID.1),
                hint: format!(
                    "plug the board's user USB (CN13) in, or use --link serial:PORT; {}",
                    ports_here()
                ),
            }),
            several => Err(LinkError::Open {
                name: "USB".to_owned(),
                cause: format!("{} boards are there", several.len()),
                hint: several
                    .iter()
                    .map(|(path, number)| format!("--link serial:{path} (board {number})"))
                    .reduce(|one, other| format!("{one} or {other}"))
                    .map_or_else(String::new, |choice| format!("choose one: {choice}")),
            }),
        }
    }

    fn lost(&self, error: &std::io::Error) -> LinkError {
        LinkError::Lost {
            name: format!("port {}", self.name),
            cause: error.to_string(),
        }
    }
}

impl RigLink for Port {
    fn name(&self) -> String {
        format!("port {}", self.name)
    }

    fn exchange(&mut self, to_board: &[u8], duration: Duration) -> Result<Exchange, LinkError> {
        let mut rest = to_board;
        let give_up = Instant::now() + Duration::from_millis(100);
        while !rest.is_empty() {
            match std::io::Write::write(&mut self.port, rest) {
                Ok(n) => rest = &rest[n..],
                Err(error)
                    if matches!(
                        error.kind(),
                        ErrorKind::TimedOut | ErrorKind::Interrupted | ErrorKind::WouldBlock
                    ) && Instant::now() < give_up => {}
                Err(error) => return Err(self.lost(&error)),
            }
        }
        // Behind by more than a cycle: start counting anew rather than catch up in a burst.
        let now = self.opened.elapsed();
        if now > self.due + Duration::from_millis(50) {
            self.due = now;
        }
        self.due += duration;
        let mut from_board = Vec::new();
        let mut chunk = [0; 4096];
        loop {
            match std::io::Read::read(&mut self.port, &mut chunk) {
                Ok(0) => return Err(self.lost(&ErrorKind::UnexpectedEof.into())),
                Ok(n) => from_board.extend_from_slice(&chunk[..n]),
                Err(error)
                    if matches!(
                        error.kind(),
                        ErrorKind::TimedOut | ErrorKind::Interrupted | ErrorKind::WouldBlock
                    ) => {}
                Err(error) => return Err(self.lost(&error)),
            }
            if self.opened.elapsed() >= self.due {
                break;
            }
        }
        Ok(Exchange {
            now_ns: u64::try_from(self.opened.elapsed().as_nanos()).unwrap_or(u64::MAX),
            from_board,
            pose: None,
            truth: Vec::new(),
            resets: 0,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(target_os = "linux")]
    #[test]
    fn the_program_that_has_a_port_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("port");
        std::fs::write(&path, "").unwrap();
        // This process is none.
        let _own = std::fs::File::open(&path).unwrap();
        assert_eq!(holder(path.to_str().unwrap()), None);
        let mut other = std::process::Command::new("sh")
            .args(["-c", "exec 3<\"$0\"; echo open; read end"])
            .arg(&path)
            .stdin(std::process::Stdio::piped())
            .stdout(std::process::Stdio::piped())
            .spawn()
            .unwrap();
        let mut word = [0; 4];
        std::io::Read::read_exact(other.stdout.as_mut().unwrap(), &mut word).unwrap();
        let found = holder(path.to_str().unwrap()).unwrap();
        assert!(
            found.contains(&format!("process {} ", other.id())),
            "{found}"
        );
        drop(other.stdin.take());
        other.wait().unwrap();
    }

    #[test]
    fn a_port_that_is_not_there_is_named() {
        let error = Port::serial("/dev/no-such-port").unwrap_err().to_string();
        assert!(error.contains("/dev/no-such-port"), "{error}");
        assert!(
            error.contains("ports here") || error.contains("no serial ports"),
            "{error}"
        );
    }

    #[test]
    fn the_rules_for_udev_are_for_the_ports_that_are_looked_for() {
        let rules = include_str!("../../../../docs/udev/70-force-rig.rules");
        let (vendor, product) = USB_ID;
        let board = format!(
            "SUBSYSTEM==\"tty\", ATTRS{{idVendor}}==\"{vendor:04x}\", ATTRS{{idProduct}}==\"{product:04x}\", MODE=\"0660\""
        );
        assert!(rules.contains(&board), "{board}");
        // All of them, and no other.
        let as_text: Vec<String> = ST_LINK.1.map(|id| format!("{id:04x}")).collect();
        assert_eq!(as_text.len(), 32);
        assert!((as_text.iter()).all(|id| id.starts_with("374") || id.starts_with("375")));
        let probe = format!(
            "SUBSYSTEM==\"tty\", ATTRS{{idVendor}}==\"{:04x}\", ATTRS{{idProduct}}==\"37[45]?\"",
            ST_LINK.0
        );
        assert!(rules.contains(&probe), "{probe}");
    }
}
