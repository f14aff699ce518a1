//! `forcectl status`: the state of board and units.

use super::connection::{configure_embedded, Connection, Role};
use super::exit::{self, Reply, Result};
use super::Context;
use clap::Args;
use control::MotorState;
use known::base;
use serde_json::json;
use session::{explain_crash_record, explain_fault, motor_state_name, system_state_name};
use std::fmt::Write as _;
use wire::message::{BoardInfo, Pull, Status as BoardStatus};

/// Arguments of `status`.
#[derive(Debug, Args)]
pub struct Status {
    #[command(flatten)]
    connection: Connection,
}

impl Status {
    /// Runs the command. A latched fault gives exit code 5.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        self.connection
            .with_session(Role::Observer, context, |session, rig| {
                configure_embedded(session, rig)?;
                let status = session.get_status()?;
                let (link, info) = (session.link().name(), session.info().cloned());
                let faulted = status.fault != 0 || status.units.iter().any(|unit| unit.fault != 0);
                let calibrated = base::with_calibration(rig.clone(), self.connection.seed(rig));
                let calibration = match &calibrated {
                    Ok(rig) => base::words(rig),
                    Err(error) => Some(error.to_string()),
                };
                let mut text = format!("link       {link}\n{}", table(info.as_ref(), &status));
                if let Some(words) = &calibration {
                    row!(text, "\nin force   {words}");
                }
                let json = json!({
                    "link": link,
                    "board": info,
                    "status": status,
                    "state": system_state_name(status.state),
                    "brown_out_level": info.as_ref().map(BoardInfo::brown_out_level),
                    "calibration": calibration,
                });
                Ok(
                    Reply::new(text, json).with_code(if faulted {
                        exit::BOARD
                    } else {
                        exit::DONE
                    }),
                )
            })
    }
}

/// The table for people.
fn table(info: Option<&BoardInfo>, status: &BoardStatus) -> String {
    let mut out = String::new();
    if let Some(info) = info {
        row!(
            out,
            "firmware   {} (ABI {}), core {} MHz, reset flags {:#010x}",
            info.version,
            info.abi,
            info.core_hz / 1_000_000,
            info.reset_flags
        );
        let level = info.brown_out_level();
        if level != BoardInfo::BROWN_OUT_LEVEL {
            row!(
                out,
                "WARNING    brown-out level {level} of the option bytes ({:#010x}), not {}: a dip of the supply may go on for long before \
                 the controller is reset, and is not reported; set it (docs/bring-up.md, step 2)",
                info.option_bytes,
                BoardInfo::BROWN_OUT_LEVEL
            );
        }
        if let Some(number) = info.number() {
            row!(out, "board      {number}");
        }
        if info.dac_reset_pull != Pull::Down {
            row!(
                out,
                "WARNING    no resistor pulls DAC_RST down: a controller in reset leaves the motors where they were (docs/bring-up.md, step 1)"
            );
        }
        if let Some(kept) = &info.crash_record {
            row!(out, "last run   ended with {}", explain_crash_record(kept));
        }
    }
    row!(
        out,
        "state      {}, E-stop {}",
        system_state_name(status.state),
        if status.estop_closed {
            "closed (may run)"
        } else {
            "OPEN"
        }
    );
    if status.fault != 0 {
        row!(
            out,
            "fault      {}",
            explain_fault(status.fault, status.fault_detail)
        );
    }
    let age = if status.setpoint_age_ms == u16::MAX {
        "none".to_owned()
    } else {
        format!("{} ms old", status.setpoint_age_ms)
    };
    row!(
        out,
        "setpoints  {age}; configuration CRC {:08x}; up {:.1} s",
        status.config_crc,
        f64::from(status.t_us) * 1e-6
    );
    row!(
        out,
        "health     asleep {:.1} %, queue at most {}, frames dropped {}, bad {}, bus recoveries {}",
        f64::from(status.sleep_permille) * 0.1,
        status.queue_high_water,
        status.frames_dropped,
        status.frames_bad,
        status.bus_recoveries
    );
    row!(
        out,
        "\nunit  state      tension N   rate 1/s   samples   missed  spikes  retries   cell code  encoder counts  fault"
    );
    for (i, unit) in status.units.iter().enumerate() {
        let live =
            MotorState::from_u8(unit.state) != Some(MotorState::Offline) && unit.period_us > 0;
        let (tension, rate) = if live {
            (
                format!("{:.3}", f64::from(unit.tension_un) * 1e-6),
                format!("{:.1}", 1e6 / f64::from(unit.period_us)),
            )
        } else {
            ("-".to_owned(), "-".to_owned())
        };
        let fault = if unit.fault == 0 {
            "-".to_owned()
        } else {
            explain_fault(unit.fault, unit.fault_detail)
        };
        row!(
            out,
            "{:>4}  {:<9} {:>10} {:>10} {:>9} {:>8} {:>7} {:>8} {:>11} {:>15}  {fault}",
            i + 1,
            motor_state_name(unit.state),
            tension,
            rate,
            unit.samples,
            unit.missed,
            unit.spikes,
            unit.failed_reads,
            unit.adc_code,
            unit.encoder_counts
        );
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::message::UnitStatus;
    use wire::UNITS;

    /// A reel that is turned by hand shows where its encoder stands, whether its cell measures or
    /// not: in its row, and in the JSON.
    #[test]
    fn counts_are_in_the_row_of_their_unit_and_in_the_json() {
        let unit = |i: usize| UnitStatus {
            encoder_counts: -4_000 + 1_000 * i as i32,
            adc_code: 70_000 + i as i32,
            failed_reads: 5,
            ..UnitStatus::default()
        };
        let status = BoardStatus {
            t_us: 0,
            state: 0,
            fault: 0,
            fault_detail: 0,
            estop_closed: true,
            units: std::array::from_fn(unit),
            tip_force_un: [0; 3],
            alive_withheld: false,
            config_crc: 0,
            setpoint_age_ms: u16::MAX,
            frames_dropped: 0,
            frames_bad: 0,
            bus_recoveries: 0,
            sleep_permille: 0,
            queue_high_water: 0,
        };
        let text = table(None, &status);
        let head = text.lines().find(|line| line.starts_with("unit ")).unwrap();
        assert!(head.contains("retries   cell code  encoder counts"));
        for i in 0..UNITS {
            let number = (i + 1).to_string();
            let row = text
                .lines()
                .map(|line| line.split_whitespace().collect::<Vec<_>>());
            let mut row = row.filter(|words| words.first() == Some(&number.as_str()));
            let row = row.next_back().expect("a row");
            let (code, counts) = (70_000 + i, -4_000 + 1_000 * i as i32);
            let expected = [
                "5".to_owned(),
                code.to_string(),
                counts.to_string(),
                "-".to_owned(),
            ];
            assert_eq!(row[row.len() - 4..], expected, "unit {number}");
            let json = serde_json::to_value(&status).unwrap();
            assert_eq!(json["units"][i]["encoder_counts"], counts);
            assert_eq!(json["units"][i]["adc_code"], code);
        }
    }
}
