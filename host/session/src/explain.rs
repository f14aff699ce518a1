//! Numbers of the wire in words: commands, states, faults, rejections.

use control::config::FIELDS;
use control::{Fault, MotorState, SystemState};
use serde::{Deserialize, Serialize};
use wire::message::{CommandError, CrashRecord, FaultReport, Status};
use wire::{Command, UNITS};

/// Name of a command in messages.
#[must_use]
pub fn command_name(command: &Command) -> &'static str {
    match command {
        Command::Hello { .. } => "hello",
        Command::GetStatus => "get status",
        Command::GetConfig { .. } => "get configuration",
        Command::StageConfig { .. } => "stage configuration",
        Command::StageBoard { .. } => "stage board configuration",
        Command::GetBoard => "get board configuration",
        Command::CommitConfig => "commit configuration",
        Command::Zero { .. } => "zero",
        Command::Arm => "arm",
        Command::Disarm => "disarm",
        Command::Stop => "stop",
        Command::ClearFaults => "clear faults",
        Command::Setpoints { .. } => "setpoints",
        Command::Stream { .. } => "stream",
    }
}

/// Name of a system state's number.
#[must_use]
pub fn system_state_name(number: u8) -> String {
    SystemState::from_u8(number).map_or_else(
        || format!("unknown state {number}"),
        |s| s.name().to_owned(),
    )
}

/// Name of a unit's state's number.
#[must_use]
pub fn motor_state_name(number: u8) -> String {
    MotorState::from_u8(number).map_or_else(
        || format!("unknown state {number}"),
        |s| s.name().to_owned(),
    )
}

/// A fault that the board has latched. Displayed in one line: the unit, where it is one's, and
/// [`explain_fault`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct LatchedFault {
    /// Unit from 1; `None` (JSON: `null`): the whole board, or not told.
    pub unit: Option<u8>,
    /// Number.
    pub code: u16,
    /// Its detail.
    pub detail: u32,
}

impl LatchedFault {
    /// A fault that is told without its unit.
    #[must_use]
    pub const fn new(code: u16, detail: u32) -> Self {
        Self {
            unit: None,
            code,
            detail,
        }
    }

    /// The fault of the whole board that its status names.
    #[must_use]
    pub const fn of_board(status: &Status) -> Self {
        Self::new(status.fault, status.fault_detail)
    }

    /// Of a fault 15 that names its unit: the unit, from 0, and the tension that was left, N;
    /// `None` in it where no tension that is believed showed it. As
    /// [`control::let_go::LetGo::detail`].
    #[must_use]
    pub fn output_stuck(&self) -> Option<(usize, Option<f64>)> {
        let unit = (self.detail >> 24).checked_sub(1)? as usize;
        let left_mn = self.detail & 0xFF_FFFF;
        let left_n = (left_mn != 0xFF_FFFF).then(|| f64::from(left_mn) * 1e-3);
        (self.code == Fault::OutputStuck.code()).then_some((unit, left_n))
    }

    /// All that a status names: the board's, then those of the units.
    pub fn all_of(status: &Status) -> impl Iterator<Item = Self> + '_ {
        let board = core::iter::once(Self::of_board(status));
        let units = (1..).zip(&status.units).map(|(number, unit)| Self {
            unit: Some(number),
            ..Self::new(unit.fault, unit.fault_detail)
        });
        board.chain(units).filter(|fault| fault.code != 0)
    }

    /// The first of a status: the board's, else that of one of these units.
    #[must_use]
    pub fn first_of(status: &Status, units: &[bool; UNITS]) -> Option<Self> {
        let counts = |fault: &Self| fault.unit.is_none_or(|unit| units[usize::from(unit) - 1]);
        Self::all_of(status).find(counts)
    }
}

impl From<&FaultReport> for LatchedFault {
    fn from(fault: &FaultReport) -> Self {
        Self {
            unit: (usize::from(fault.unit) < UNITS).then(|| fault.unit + 1),
            ..Self::new(fault.code, fault.detail)
        }
    }
}

impl std::fmt::Display for LatchedFault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if let Some(unit) = self.unit {
            write!(f, "unit {unit}: ")?;
        }
        f.write_str(&explain_fault(self.code, self.detail))
    }
}

impl std::error::Error for LatchedFault {}

/// A fault in one line: number, name, meaning, way out.
#[must_use]
pub fn explain_fault(code: u16, detail: u32) -> String {
    match Fault::from_code(code) {
        Some(fault) => format!(
            "fault {code}, {}. {} {} (detail {detail}: {}; `forcectl explain {code}`)",
            fault.name(),
            fault.meaning(),
            fault.what_to_do(),
            fault.detail_meaning()
        ),
        None => format!("fault {code} (detail {detail}), which this forcectl does not know; is the firmware newer?"),
    }
}

/// The crash record of the board's run before this one, in one line.
#[must_use]
pub fn explain_crash_record(record: &CrashRecord) -> String {
    let mut text = match Fault::from_code(record.code) {
        Some(fault) => format!("fault {}, {}", record.code, fault.name()),
        None => format!("reason {}", record.code),
    };
    if record.pc != 0 {
        text.push_str(&format!(", at {:#010x}", record.pc));
    }
    if !record.text.is_empty() {
        text.push_str(&format!(": {}", record.text.as_str()));
    }
    text
}

/// Why this command was refused, and what to do.
#[must_use]
pub fn explain_refusal(command: &Command, refusal: &CommandError) -> String {
    match *refusal {
        CommandError::NotConnected => "no handshake took place on this link: the board was reset, or another program took over; connect again".to_owned(),
        CommandError::Version { abi, .. } => format!("it speaks ABI {abi}"),
        CommandError::State(state) => match SystemState::from_u8(state) {
            Some(SystemState::Running | SystemState::Stopping) => "it is armed; `forcectl disarm` first".to_owned(),
            Some(SystemState::BringUp | SystemState::Boot) => "its sensors are still being brought up; wait a second, see `forcectl status`".to_owned(),
            Some(SystemState::Ready) => "not in the state `ready`, or a unit isn't ready or the E-stop is open; see `forcectl status`".to_owned(),
            _ => format!("not in the state `{}`; see `forcectl status`", system_state_name(state)),
        },
        CommandError::Faulted(code) => format!("{}; then `forcectl clear`", explain_fault(code, 0)),
        CommandError::UnknownUnit(u8::MAX) => "no unit was named; see `forcectl status` for those that can take part".to_owned(),
        CommandError::UnknownUnit(unit) => format!("it has no unit {}", u16::from(unit) + 1),
        CommandError::UnitNotReady { unit, state } => format!(
            "unit {} is not ready (its state is `{}`); see `forcectl status`",
            u16::from(unit) + 1,
            motor_state_name(state)
        ),
        CommandError::Range { unit, field } => explain_range(command, unit, field),
    }
}

/// What of a command is out of its range: unit from 0, and the number of the field.
fn explain_range(command: &Command, unit: u8, field: u8) -> String {
    let number = u16::from(unit) + 1;
    match command {
        Command::Setpoints { units, .. } if usize::from(unit) < units.len() => {
            let setpoint = &units[usize::from(unit)];
            let what = match field {
                0 => format!(
                    "a tension of {:.2} N is not within 0 N and its largest one, `tension_max_n` and `force_limit_n` of the \
                     configuration in force",
                    f64::from(setpoint.tension_un) * 1e-6
                ),
                1 => format!(
                    "the cable is further from the load cell's axis than 75 degrees (1/cos {:.2}, 1 to 4 is possible): is the pose right?",
                    f64::from(setpoint.inv_cos_q16) / 65_536.0
                ),
                2 => format!(
                    "the cable's direction {:?} is no unit vector (16,384 is 1)",
                    setpoint.direction_q14
                ),
                3 => format!(
                    "a reel speed of {:.2} m/s is not within -1 and 1 m/s",
                    f64::from(setpoint.reel_um_per_s.unwrap_or(0)) * 1e-6
                ),
                _ => format!("number {field} of its setpoint is out of its range"),
            };
            format!("unit {number}: {what}")
        }
        Command::Setpoints { valid_ms, .. } => {
            format!("setpoints that are valid for {valid_ms} ms; 1 to 1000 ms are possible")
        }
        Command::StageBoard { config } => format!(
            "`tip_force_limit_n` of {:.2} N is not within 1 and 100 N; correct the rig file",
            f64::from(config.tip_force_limit_un) * 1e-6
        ),
        _ => {
            let known: Vec<String> = FIELDS
                .iter()
                .filter(|f| f.number == field)
                .map(|f| format!("`{}` ({} to {}: {})", f.name, f.min, f.max, f.why))
                .collect();
            let name = if known.is_empty() {
                format!("number {field}")
            } else {
                known.join(" or ")
            };
            format!("unit {number}: field {name} is out of its range; correct the rig file")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::message::{BoardConfig, UnitSetpoint};

    #[test]
    fn a_rejection_says_which_unit_and_which_field() {
        let field = FIELDS.iter().find(|field| field.name == "kp_q16").unwrap();
        let of = |unit, field| {
            explain_refusal(&Command::CommitConfig, &CommandError::Range { unit, field })
        };
        let text = of(2, field.number);
        assert!(text.starts_with("unit 3: field `kp_q16`"), "{text}");
        assert!(of(0, 250).contains("number 250"));
    }

    /// A setpoint is explained by what was sent, not by the configuration's field of the same
    /// number.
    #[test]
    fn a_rejected_setpoint_is_explained_by_its_own_values() {
        let units = [UnitSetpoint {
            tension_un: 14_000_000,
            inv_cos_q16: 300_000,
            direction_q14: [1, 2, 3],
            reel_um_per_s: Some(2_500_000),
        }; UNITS];
        let command = Command::Setpoints {
            valid_ms: 2_000,
            units,
        };
        let of = |unit, field| explain_refusal(&command, &CommandError::Range { unit, field });
        for (unit, field, words) in [
            (3, 0, "unit 4: a tension of 14.00 N"),
            (
                3,
                1,
                "unit 4: the cable is further from the load cell's axis",
            ),
            (0, 2, "unit 1: the cable's direction [1, 2, 3]"),
            (5, 3, "unit 6: a reel speed of 2.50 m/s"),
            (u8::MAX, 0, "setpoints that are valid for 2000 ms"),
        ] {
            let text = of(unit, field);
            assert!(text.starts_with(words), "{text}");
        }
        let config = BoardConfig {
            tip_force_limit_un: 200_000_000,
            ..BoardConfig::default()
        };
        let range = CommandError::Range {
            unit: u8::MAX,
            field: 1,
        };
        let text = explain_refusal(&Command::StageBoard { config }, &range);
        assert!(
            text.starts_with("`tip_force_limit_n` of 200.00 N"),
            "{text}"
        );
    }

    #[test]
    fn unknown_and_not_ready_units_read_differently() {
        let unknown = explain_refusal(&Command::Arm, &CommandError::UnknownUnit(6));
        assert!(unknown.contains("no unit 7"), "{unknown}");
        let not_ready = explain_refusal(
            &Command::Arm,
            &CommandError::UnitNotReady {
                unit: 2,
                state: MotorState::BringUp as u8,
            },
        );
        assert!(
            not_ready.contains("unit 3 is not ready") && not_ready.contains("bring-up"),
            "{not_ready}"
        );
    }

    #[test]
    fn numbers_of_a_newer_firmware_stay_numbers() {
        assert_eq!(system_state_name(200), "unknown state 200");
        assert_eq!(motor_state_name(200), "unknown state 200");
        assert!(explain_fault(60_000, 7).contains("fault 60000 (detail 7)"));
    }
}
