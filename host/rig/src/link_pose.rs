//! How the board is reached, and where the robot's pose comes from.

use nalgebra::Vector3;
use serde::Serialize;
use std::fmt;

/// How the board is reached.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LinkChoice {
    /// The embedded rig: the firmware image on the emulated board.
    Embedded,
    /// The firmware's machine and control core on this computer, without the emulated controller:
    /// faster, same physics.
    Fast,
    /// USB CDC, found by vendor and product number.
    Usb,
    /// A serial port at 2,000,000 baud.
    Serial(String),
    /// A rig that a service keeps (`forcectl rig`), by its name.
    Kept(String),
}

impl std::str::FromStr for LinkChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "embedded" => Ok(Self::Embedded),
            "fast" => Ok(Self::Fast),
            "usb" => Ok(Self::Usb),
            "rig" => Ok(Self::Kept("rig".to_owned())),
            _ if text.starts_with("rig:") => {
                let name = text.trim_start_matches("rig:");
                let good = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
                if name.is_empty() || !name.chars().all(good) {
                    return Err(format!(
                        "`{text}` is not the name of a rig; use letters, digits, `-` and `_`, as in rig:bench2"
                    ));
                }
                Ok(Self::Kept(name.to_owned()))
            }
            _ => match text.strip_prefix("serial:") {
                Some(port) if !port.is_empty() => Ok(Self::Serial(port.to_owned())),
                _ => Err(format!(
                    "`{text}` is not a link; use embedded, fast, usb, serial:PORT (for example serial:/dev/ttyACM0) or rig:NAME (a rig that `forcectl rig` keeps)"
                )),
            },
        }
    }
}

impl fmt::Display for LinkChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Embedded => f.write_str("embedded"),
            Self::Fast => f.write_str("fast"),
            Self::Usb => f.write_str("usb"),
            Self::Serial(port) => write!(f, "serial:{port}"),
            Self::Kept(name) => write!(f, "rig:{name}"),
        }
    }
}

/// Where the robot's pose comes from.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "source", rename_all = "snake_case")]
pub enum PoseChoice {
    /// The link brings it (the embedded rig does).
    Rig,
    /// JSON lines over UDP, see `force::pose`.
    Udp {
        /// Address and port to listen on.
        listen: String,
        /// A pose older than this stops the rig, s.
        max_age_s: f64,
    },
    /// The tip is clamped here, robot base frame, m.
    Static {
        /// Position in m.
        position_m: Vector3<f64>,
    },
}

/// Standard deviation of a coordinate of the tip of a robot that tells its pose, m (estimate): a
/// cable robot's own kinematics are right to some millimetres, to about 1 mm once corrected.
pub const ROBOT_SD_M: f64 = 1e-3;

impl PoseChoice {
    /// Standard deviation of a coordinate of the tip, m, where the rig file says none. An emulated
    /// rig reports the tip where it is; a cable robot's own kinematics are right to some
    /// millimetres, to about 1 mm once corrected; a clamped tip is measured with the digitizer or a
    /// ruler. Estimates: the real one of a robot is worth measuring.
    #[must_use]
    pub fn usual_sd_m(&self) -> f64 {
        match self {
            Self::Rig => 0.0,
            Self::Udp { .. } => ROBOT_SD_M,
            Self::Static { .. } => 5e-4,
        }
    }
}
