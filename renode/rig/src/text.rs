//! The lines that `RigServer` and this program exchange: requests of the link as text, answers
//! back.
//!
//! Layouts are those of `renode/models/RigServer.cs`; the two change together.

use emulator_link::{Advanced, Injection, Latency, Pose, Report, Request, Response, Truth, UNITS};
use std::str::SplitWhitespace;

/// Doubles of the plant in a row of truth: tip, speed and force, then three a unit.
const PLANT: usize = 9 + 3 * UNITS;

/// The request as a line, or `None` for one that is not the machine's business.
pub fn request(request: &Request) -> Option<String> {
    Some(match request {
        Request::Advance {
            duration_ns,
            to_board,
        } => format!("advance {duration_ns} {}", hex(to_board)),
        Request::Robot { moving } => format!("robot {}", u8::from(*moving)),
        Request::Inject(injection) => format!("inject {}", injection_words(injection)),
        Request::Report => "report".to_owned(),
        Request::Hello { .. } | Request::Quit => return None,
    })
}

fn injection_words(injection: &Injection) -> String {
    match *injection {
        Injection::UnplugSensor(unit) => format!("unplug {unit}"),
        Injection::PlugSensor(unit) => format!("plug {unit}"),
        Injection::Nack(unit) => format!("nack {unit}"),
        Injection::StuckSda => "stuck".to_owned(),
        Injection::EStop(open) => format!("estop {}", u8::from(open)),
        Injection::Spike(unit, codes) => format!("spike {unit} {codes}"),
        Injection::PullCable(unit, newtons) => format!("pull {unit} {newtons}"),
        Injection::FreezeEncoder(unit, freeze) => format!("freeze {unit} {}", u8::from(freeze)),
        Injection::HangLoop => "hang".to_owned(),
        Injection::FlipBit(address, bit) => format!("flip {address} {bit}"),
        Injection::OpenBridge(unit, on) => format!("open-bridge {unit} {}", u8::from(on)),
        Injection::FrozenCode(unit, on) => format!("frozen-code {unit} {}", u8::from(on)),
        Injection::WrongSign(unit, on) => format!("wrong-sign {unit} {}", u8::from(on)),
        Injection::PlugUsb(plugged) => format!("plug-usb {}", u8::from(plugged)),
        Injection::SuspendUsb(on) => format!("suspend-usb {}", u8::from(on)),
        Injection::ReadUsb(on) => format!("read-usb {}", u8::from(on)),
        Injection::FreeRun(on) => format!("free-run {}", u8::from(on)),
        Injection::ReportUnsettled(on) => format!("report-unsettled {}", u8::from(on)),
        Injection::StartSlowly(on) => format!("start-slowly {}", u8::from(on)),
        Injection::BusError => "bus-error 0".to_owned(),
        // The models of Renode do not have these; RigServer refuses the word.
        other => format!("{other:?}"),
    }
}

/// The machine's answer.
///
/// # Errors
/// What is wrong with the line.
pub fn response(line: &str) -> Result<Response, String> {
    let mut words = Words(line.split_whitespace());
    match words.next()? {
        "done" => Ok(Response::Done),
        "unplugged" => Ok(Response::Unplugged),
        "failed" => Ok(Response::Failed(
            line.trim_start_matches("failed").trim().to_owned(),
        )),
        "advanced" => advanced(&mut words).map(Response::Advanced),
        "report" => report(&mut words).map(|r| Response::Report(Box::new(r))),
        other => Err(format!("`{other}` is no answer of RigServer")),
    }
}

fn advanced(words: &mut Words) -> Result<Advanced, String> {
    let now_ns = words.number()?;
    let resets = words.number()?;
    let from_board = unhex(words.next()?)?;
    let plant: [f64; PLANT] = words.array()?;
    let rows: usize = words.number()?;
    let truth = (0..rows)
        .map(|_| row(words))
        .collect::<Result<Vec<_>, _>>()?;
    Ok(Advanced {
        now_ns,
        from_board,
        pose: Pose {
            position_m: [plant[0], plant[1], plant[2]],
            velocity_m_s: [plant[3], plant[4], plant[5]],
        },
        truth,
        resets,
    })
}

fn row(words: &mut Words) -> Result<Truth, String> {
    let t_ns = words.number()?;
    let amplifier_on = words.number::<u8>()? != 0;
    let plant: [f64; PLANT] = words.array()?;
    let dac_v = words.array()?;
    Ok(Truth {
        t_ns,
        tip_m: [plant[0], plant[1], plant[2]],
        tip_force_n: [plant[6], plant[7], plant[8]],
        tension_n: std::array::from_fn(|u| plant[9 + 3 * u]),
        reel_rad_s: std::array::from_fn(|u| plant[10 + 3 * u]),
        dac_v,
        amplifier_on,
    })
}

fn report(words: &mut Words) -> Result<Report, String> {
    let now_ns = words.number()?;
    let conversions = words.array()?;
    let conversions_read = words.array()?;
    let alive_hz = words.number()?;
    let count: usize = words.number()?;
    let latencies = (0..count)
        .map(|_| {
            Ok(Latency {
                unit: words.number()?,
                drdy_ns: words.number()?,
                dac_update_ns: words.number()?,
                ..Latency::default()
            })
        })
        .collect::<Result<Vec<_>, String>>()?;
    Ok(Report {
        now_ns,
        latencies,
        conversions,
        conversions_read,
        alive_hz,
        ..Report::default()
    })
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

fn unhex(digits: &str) -> Result<Vec<u8>, String> {
    if digits == "-" {
        return Ok(Vec::new());
    }
    if !digits.is_ascii() || !digits.len().is_multiple_of(2) {
        return Err("bytes are no pairs of hexadecimal digits".to_owned());
    }
    (0..digits.len() / 2)
        .map(|i| {
            u8::from_str_radix(&digits[2 * i..2 * i + 2], 16)
                .map_err(|_| "bytes are no hexadecimal digits".to_owned())
        })
        .collect()
}

struct Words<'a>(SplitWhitespace<'a>);

impl<'a> Words<'a> {
    fn next(&mut self) -> Result<&'a str, String> {
        self.0
            .next()
            .ok_or_else(|| "the answer ends too early".to_owned())
    }

    fn number<T: std::str::FromStr>(&mut self) -> Result<T, String> {
        let word = self.next()?;
        word.parse()
            .map_err(|_| format!("`{word}` is not the number expected"))
    }

    fn array<T: std::str::FromStr + Copy + Default, const N: usize>(
        &mut self,
    ) -> Result<[T; N], String> {
        let mut all = [T::default(); N];
        for one in &mut all {
            *one = self.number()?;
        }
        Ok(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_become_lines() {
        let advance = Request::Advance {
            duration_ns: 10,
            to_board: vec![0, 255],
        };
        assert_eq!(request(&advance).unwrap(), "advance 10 00ff");
        assert_eq!(
            request(&Request::Inject(Injection::PullCable(3, -2.5))).unwrap(),
            "inject pull 3 -2.5"
        );
        assert_eq!(
            request(&Request::Inject(Injection::PlugUsb(false))).unwrap(),
            "inject plug-usb 0"
        );
        assert_eq!(request(&Request::Quit), None);
    }

    #[test]
    fn an_advance_comes_back_whole() {
        let plant: Vec<String> = (0..PLANT).map(|n| format!("{n}.5")).collect();
        let plant = plant.join(" ");
        let line = format!("advanced 2000000 1 0aff {plant} 1 1000000 1 {plant} 1 2 3 4 5 6");
        let Response::Advanced(a) = response(&line).unwrap() else {
            panic!("not an advance")
        };
        assert_eq!((a.now_ns, a.resets), (2_000_000, 1));
        assert_eq!(a.from_board, [0x0A, 0xFF]);
        assert_eq!(a.pose.velocity_m_s, [3.5, 4.5, 5.5]);
        assert_eq!(a.truth.len(), 1);
        assert_eq!(a.truth[0].tension_n[1], 12.5);
        assert_eq!(a.truth[0].reel_rad_s[1], 13.5);
        assert_eq!(a.truth[0].dac_v[5], 6.0);
        assert!(a.truth[0].amplifier_on);
    }

    #[test]
    fn a_report_comes_back_whole() {
        let line = "report 9 1 2 3 4 5 6 1 2 3 4 5 6 500.5 2 1 100 300 6 200 450";
        let Response::Report(r) = response(line).unwrap() else {
            panic!("not a report")
        };
        assert_eq!(r.conversions, [1, 2, 3, 4, 5, 6]);
        assert_eq!(r.latencies[1].unit, 6);
        assert_eq!(r.latencies[1].dac_update_ns - r.latencies[1].drdy_ns, 250);
        assert_eq!(r.alive_hz, 500.5);
    }

    #[test]
    fn damaged_answers_are_errors_and_refusals_stay_refusals() {
        assert_eq!(response("unplugged").unwrap(), Response::Unplugged);
        assert!(response("").is_err());
        assert!(response("advanced 1").is_err());
        assert!(response("advanced 1 0 xyz").is_err());
        assert!(response("hello").unwrap_err().contains("hello"));
        assert_eq!(
            response("failed units count from 1 to 6").unwrap(),
            Response::Failed("units count from 1 to 6".to_owned())
        );
    }
}
