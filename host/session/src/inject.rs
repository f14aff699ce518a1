//! Faults that can be injected into the embedded rig, as text of the command line: `unplug=3@2s`.

use emulator_link::{DacResetPull, Injection, UNITS};

macro_rules! words {
    () => {
        "unplug=UNIT, plug=UNIT, nack=UNIT, stuck-sda, estop (the same: estop=open), estop-release (estop=close), \
         spike=UNIT:CODES, pull=UNIT:NEWTON, hang-on-tip=NEWTON, freeze-encoder=UNIT, thaw-encoder=UNIT, open-bridge=UNIT, \
         frozen-code=UNIT, wrong-sign=UNIT, stuck-dac=UNIT, amplifier-off=UNIT, \
         amplifier-share=UNIT:SHARE, reverse-encoder=UNIT, encoder-lines=UNIT:LINES, exchange-encoders=UNIT:UNIT, \
         exchange-motors=UNIT:UNIT, exchange-cells=UNIT:UNIT, exchange-drdy=UNIT:UNIT, pull-out=UNIT:MM, \
         exchange-channels=UNIT:UNIT, tie-selects=UNIT:UNIT, open-ldac=UNIT, cut-drdy=UNIT, cell-share=UNIT:SHARE, \
         cell-noise=UNIT:V/V, cell-hum=UNIT:V/V, bypass-relay=UNIT, bridge-relay, invert-relay, open-alive, bridge-estop, \
         bridge-estop-at-plc, invert-estop, brown-out-level=LEVEL, dac-reset-pull=none|up|down, \
         lose-clock, hang, usb-out, usb-in, \
         usb-suspend, usb-resume (a rig started with --usb)"
    };
}

/// Frequency of the mains of `cell-hum`, Hz.
const MAINS_HZ: f64 = 50.0;

/// The words with times, for help texts.
pub const HELP: &str = concat!(
    words!(),
    "; each with @TIME (seconds after the force is commanded, or `start` for power-on), as in unplug=3@2s"
);

/// The words where the time is now.
pub const WORDS: &str = words!();

/// Reads one injection and its time in seconds after the force is commanded (`-inf`: at power-on).
///
/// # Errors
/// What is wrong with the text, and what it has to look like.
pub fn parse(text: &str) -> Result<(f64, Injection), String> {
    let wrong = |what: &str| format!("`{text}`: {what}; known are {HELP}");
    let (what, at) = text
        .split_once('@')
        .ok_or_else(|| wrong("the time is missing"))?;
    let at_s = match at {
        "start" => f64::NEG_INFINITY,
        _ => at
            .trim_end_matches('s')
            .parse::<f64>()
            .ok()
            .filter(|t| t.is_finite())
            .ok_or_else(|| wrong("the time is not a number of seconds"))?,
    };
    Ok((at_s, read(what, &wrong)?))
}

/// Reads one injection that happens now.
///
/// # Errors
/// As [`parse`]; also where there is a time.
pub fn parse_now(text: &str) -> Result<Injection, String> {
    let wrong = |what: &str| format!("`{text}`: {what}; known are {WORDS}");
    if text.contains('@') {
        return Err(wrong("the fault is caused now, without a time"));
    }
    read(text, &wrong)
}

/// Reads an injection without its time.
fn read(what: &str, wrong: &dyn Fn(&str) -> String) -> Result<Injection, String> {
    let (name, argument) = match what.split_once('=') {
        Some((name, argument)) => (name, Some(argument)),
        None => (what, None),
    };
    let argument = argument.unwrap_or_default();
    let (unit_text, value) = argument.split_once(':').unwrap_or((argument, ""));
    let unit = || {
        unit_text
            .parse::<u8>()
            .ok()
            .filter(|unit| (1..=UNITS as u8).contains(unit))
            .ok_or_else(|| wrong("a unit from 1 to 6 is needed"))
    };
    let other = || {
        value
            .parse::<u8>()
            .ok()
            .filter(|unit| (1..=UNITS as u8).contains(unit))
            .ok_or_else(|| wrong("two units from 1 to 6 are needed, as in 2:5"))
    };
    let number = |what: &str, within: std::ops::RangeInclusive<f64>| {
        (value.parse::<f64>().ok())
            .filter(|number| within.contains(number))
            .ok_or_else(|| wrong(what))
    };
    let injection = match name {
        "unplug" => Injection::UnplugSensor(unit()?),
        "plug" => Injection::PlugSensor(unit()?),
        "nack" => Injection::Nack(unit()?),
        "stuck-sda" => Injection::StuckSda,
        "estop" if argument == "close" => Injection::EStop(false),
        "estop" if argument.is_empty() || argument == "open" => Injection::EStop(true),
        "estop" => return Err(wrong("open or close is needed")),
        "estop-release" => Injection::EStop(false),
        "spike" => Injection::Spike(
            unit()?,
            value
                .parse()
                .map_err(|_| wrong("a whole number of codes is needed"))?,
        ),
        "pull" => {
            let force: f64 = value.parse().map_err(|_| wrong("a force in N is needed"))?;
            if !(force.is_finite() && (0.0..=100.0).contains(&force)) {
                return Err(wrong("a pull of 0 to 100 N is possible"));
            }
            Injection::PullCable(unit()?, force)
        }
        "hang-on-tip" => Injection::HangOnTip(
            (argument.parse().ok())
                .filter(|newton| (0.0..=20.0).contains(newton))
                .ok_or_else(|| wrong("a weight of 0 to 20 N is possible"))?,
        ),
        "freeze-encoder" => Injection::FreezeEncoder(unit()?, true),
        "thaw-encoder" => Injection::FreezeEncoder(unit()?, false),
        "open-bridge" => Injection::OpenBridge(unit()?, true),
        "frozen-code" => Injection::FrozenCode(unit()?, true),
        "wrong-sign" => Injection::WrongSign(unit()?, true),
        "stuck-dac" => Injection::StuckDac(unit()?, true),
        "amplifier-off" => Injection::AmplifierOff(unit()?, true),
        "amplifier-share" => {
            Injection::AmplifierShare(unit()?, number("a share of -4 to 4 is needed", -4.0..=4.0)?)
        }
        "reverse-encoder" => Injection::ReverseEncoder(unit()?, true),
        "encoder-lines" => Injection::EncoderLines(
            unit()?,
            (value.parse().ok())
                .filter(|lines| *lines > 0)
                .ok_or_else(|| wrong("a number of lines from 1 to 65535 is needed"))?,
        ),
        "exchange-encoders" => Injection::ExchangeEncoders(unit()?, other()?),
        "exchange-motors" => Injection::ExchangeMotors(unit()?, other()?),
        "exchange-cells" => Injection::ExchangeCells(unit()?, other()?),
        "exchange-drdy" => Injection::ExchangeDrdy(unit()?, other()?),
        "pull-out" => Injection::PullOut(
            unit()?,
            number("-1000 to 1000 mm of cable are possible", -1e3..=1e3)?,
        ),
        "exchange-channels" => Injection::ExchangeChannels(unit()?, other()?),
        "tie-selects" => Injection::TieSelects(unit()?, other()?),
        "open-ldac" => Injection::OpenLdac(unit()?, true),
        "cut-drdy" => Injection::CutDrdy(unit()?, true),
        "cell-share" => {
            Injection::CellShare(unit()?, number("a share of -4 to 4 is needed", -4.0..=4.0)?)
        }
        "cell-noise" => {
            Injection::CellNoise(unit()?, number("0 to 1e-3 V/V are possible", 0.0..=1e-3)?)
        }
        "cell-hum" => Injection::CellTone(
            unit()?,
            number("0 to 1e-3 V/V are possible", 0.0..=1e-3)?,
            MAINS_HZ,
        ),
        "bypass-relay" => Injection::BypassRelay(unit()?, true),
        "bridge-relay" => Injection::BridgeRelay(true),
        "invert-relay" => Injection::InvertRelay(true),
        "open-alive" => Injection::OpenAlive(true),
        "bridge-estop" => Injection::BridgeEStop(true),
        "bridge-estop-at-plc" => Injection::BridgeEStopAtPlc(true),
        "invert-estop" => Injection::InvertEStop(true),
        "brown-out-level" => Injection::BrownOutLevel(
            (argument.parse().ok())
                .filter(|level| *level <= 3)
                .ok_or_else(|| wrong("a level of 0 to 3 is needed"))?,
        ),
        "dac-reset-pull" => Injection::DacResetPull(match argument {
            "none" => DacResetPull::None,
            "up" => DacResetPull::Up,
            "down" => DacResetPull::Down,
            _ => return Err(wrong("none, up or down is needed")),
        }),
        "lose-clock" => Injection::LoseClock(true),
        "hang" => Injection::HangLoop,
        "usb-out" => Injection::PlugUsb(false),
        "usb-in" => Injection::PlugUsb(true),
        "usb-suspend" => Injection::SuspendUsb(true),
        "usb-resume" => Injection::SuspendUsb(false),
        _ => return Err(wrong("unknown")),
    };
    // A value that nobody looks at is a mistake of the user: `estop-release=3`.
    let values = |text: &str| text.matches(['=', ':']).count();
    let taken = describe(&injection).map_or(usize::MAX, |words| values(&words));
    if name != "estop" && values(what) > taken {
        return Err(wrong("it has a value too many"));
    }
    Ok(injection)
}

/// The words of an injection, without a time; `None` where it has none.
#[must_use]
pub fn describe(injection: &Injection) -> Option<String> {
    Some(match injection {
        Injection::UnplugSensor(unit) => format!("unplug={unit}"),
        Injection::PlugSensor(unit) => format!("plug={unit}"),
        Injection::Nack(unit) => format!("nack={unit}"),
        Injection::StuckSda => "stuck-sda".to_owned(),
        Injection::EStop(true) => "estop".to_owned(),
        Injection::EStop(false) => "estop-release".to_owned(),
        Injection::Spike(unit, codes) => format!("spike={unit}:{codes}"),
        Injection::PullCable(unit, newton) => format!("pull={unit}:{newton}"),
        Injection::HangOnTip(newton) => format!("hang-on-tip={newton}"),
        Injection::FreezeEncoder(unit, true) => format!("freeze-encoder={unit}"),
        Injection::FreezeEncoder(unit, false) => format!("thaw-encoder={unit}"),
        Injection::HangLoop => "hang".to_owned(),
        Injection::PlugUsb(false) => "usb-out".to_owned(),
        Injection::PlugUsb(true) => "usb-in".to_owned(),
        Injection::SuspendUsb(true) => "usb-suspend".to_owned(),
        Injection::SuspendUsb(false) => "usb-resume".to_owned(),
        Injection::OpenBridge(unit, true) => format!("open-bridge={unit}"),
        Injection::FrozenCode(unit, true) => format!("frozen-code={unit}"),
        Injection::WrongSign(unit, true) => format!("wrong-sign={unit}"),
        Injection::StuckDac(unit, true) => format!("stuck-dac={unit}"),
        Injection::AmplifierOff(unit, true) => format!("amplifier-off={unit}"),
        Injection::AmplifierShare(unit, share) => format!("amplifier-share={unit}:{share}"),
        Injection::ReverseEncoder(unit, true) => format!("reverse-encoder={unit}"),
        Injection::EncoderLines(unit, lines) => format!("encoder-lines={unit}:{lines}"),
        Injection::ExchangeEncoders(a, b) => format!("exchange-encoders={a}:{b}"),
        Injection::ExchangeMotors(a, b) => format!("exchange-motors={a}:{b}"),
        Injection::ExchangeCells(a, b) => format!("exchange-cells={a}:{b}"),
        Injection::ExchangeDrdy(a, b) => format!("exchange-drdy={a}:{b}"),
        Injection::PullOut(unit, mm) => format!("pull-out={unit}:{mm}"),
        Injection::ExchangeChannels(a, b) => format!("exchange-channels={a}:{b}"),
        Injection::TieSelects(a, b) => format!("tie-selects={a}:{b}"),
        Injection::OpenLdac(unit, true) => format!("open-ldac={unit}"),
        Injection::CutDrdy(unit, true) => format!("cut-drdy={unit}"),
        Injection::CellShare(unit, share) => format!("cell-share={unit}:{share}"),
        Injection::CellNoise(unit, sd) => format!("cell-noise={unit}:{sd}"),
        Injection::CellTone(unit, amplitude, _) => format!("cell-hum={unit}:{amplitude}"),
        Injection::BypassRelay(unit, true) => format!("bypass-relay={unit}"),
        Injection::BridgeRelay(true) => "bridge-relay".to_owned(),
        Injection::InvertRelay(true) => "invert-relay".to_owned(),
        Injection::OpenAlive(true) => "open-alive".to_owned(),
        Injection::BridgeEStop(true) => "bridge-estop".to_owned(),
        Injection::BridgeEStopAtPlc(true) => "bridge-estop-at-plc".to_owned(),
        Injection::InvertEStop(true) => "invert-estop".to_owned(),
        Injection::BrownOutLevel(level) => format!("brown-out-level={level}"),
        Injection::DacResetPull(pull) => {
            format!("dac-reset-pull={}", format!("{pull:?}").to_lowercase())
        }
        Injection::LoseClock(true) => "lose-clock".to_owned(),
        // These have no word: they are for tests.
        _ => return None,
    })
}

/// An injection with its time in s after the command, in the words that [`parse`] reads.
#[must_use]
pub fn describe_at(at_s: f64, injection: &Injection) -> String {
    let what = describe(injection).unwrap_or_else(|| format!("{injection:?}"));
    if at_s == f64::NEG_INFINITY {
        format!("{what}@start")
    } else {
        format!("{what}@{at_s}s")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_that_nobody_looks_at_are_refused() {
        for text in [
            "hang=3",
            "usb-out=1",
            "estop-release=close",
            "unplug=3:5",
            "estop=3",
        ] {
            assert!(parse(&format!("{text}@1s")).is_err(), "{text}");
        }
        for (text, open) in [
            ("estop", true),
            ("estop=open", true),
            ("estop=close", false),
        ] {
            let read = parse(&format!("{text}@1s"));
            assert_eq!(read, Ok((1.0, Injection::EStop(open))), "{text}");
        }
    }

    #[test]
    fn words() {
        assert_eq!(parse("unplug=3@2s"), Ok((2.0, Injection::UnplugSensor(3))));
        assert_eq!(parse("estop@0.5"), Ok((0.5, Injection::EStop(true))));
        assert_eq!(
            parse("pull=6:2.5@-1s"),
            Ok((-1.0, Injection::PullCable(6, 2.5)))
        );
        assert_eq!(
            parse("spike=1:-90000@1s"),
            Ok((1.0, Injection::Spike(1, -90_000)))
        );
        assert_eq!(
            parse("open-bridge=5@1s"),
            Ok((1.0, Injection::OpenBridge(5, true)))
        );
        assert_eq!(
            parse("nack=2@start"),
            Ok((f64::NEG_INFINITY, Injection::Nack(2)))
        );
        for words in [
            "unplug=3",
            "plug=3",
            "nack=2",
            "stuck-sda",
            "estop",
            "estop-release",
            "spike=1:-90",
            "pull=6:2.5",
            "hang-on-tip=4.9",
            "freeze-encoder=4",
            "thaw-encoder=4",
            "hang",
            "usb-out",
            "usb-in",
            "usb-suspend",
            "usb-resume",
            "amplifier-share=2:-0.5",
            "reverse-encoder=3",
            "encoder-lines=4:1024",
            "exchange-encoders=1:6",
            "exchange-motors=2:5",
            "exchange-cells=3:4",
            "exchange-drdy=1:2",
            "pull-out=2:-200",
            "exchange-channels=2:5",
            "tie-selects=2:3",
            "open-ldac=4",
            "cut-drdy=1",
            "cell-share=3:0.6",
            "cell-noise=6:0.00001",
            "cell-hum=2:0.000002",
            "bypass-relay=3",
            "bridge-relay",
            "invert-relay",
            "open-alive",
            "bridge-estop",
            "bridge-estop-at-plc",
            "invert-estop",
            "brown-out-level=0",
            "dac-reset-pull=none",
            "dac-reset-pull=up",
            "lose-clock",
        ] {
            let (_, injection) = parse(&format!("{words}@start")).unwrap();
            assert_eq!(describe(&injection).as_deref(), Some(words));
        }
        for bad in [
            "",
            "unplug=3",
            "unplug@2s",
            "unplug=7@2s",
            "unplug=0@2s",
            "pull=1:nan@1s",
            "explode@1s",
            "estop@nan",
            "spike=1@1s",
            "exchange-motors=2@1s",
            "exchange-cells=2:7@1s",
            "encoder-lines=2:0@1s",
            "pull-out=1:nan@1s",
            "hang-on-tip=nan@1s",
            "hang-on-tip=-1@1s",
            "amplifier-share=1:9@1s",
            "brown-out-level=4@start",
            "dac-reset-pull=left@start",
            "@",
            "=@=",
        ] {
            assert!(parse(bad).unwrap_err().contains("known are"), "{bad}");
        }
    }

    #[test]
    fn a_fault_that_happens_now_has_no_time_and_its_errors_name_none() {
        assert_eq!(parse_now("estop=close"), Ok(Injection::EStop(false)));
        for bad in ["unplug=3@2s", "unplug=3@start", "estop=shut", "explode", ""] {
            let error = parse_now(bad).unwrap_err();
            assert!(error.contains(&format!("`{bad}`: ")), "{error}");
            assert!(!error.contains("@TIME"), "{error}");
        }
        let error = parse_now("unplug=3@2s").unwrap_err();
        assert!(error.contains("without a time"), "{error}");
    }

    #[test]
    fn a_description_reads_back() {
        for text in [
            "unplug=3@2s",
            "plug=1@-0.5s",
            "nack=2@start",
            "stuck-sda@1s",
            "estop@1s",
            "estop-release@1.25s",
            "spike=1:-90000@1s",
            "pull=6:2.5@-1s",
            "freeze-encoder=4@1s",
            "thaw-encoder=4@3s",
            "hang@1s",
        ] {
            let (at_s, injection) = parse(text).unwrap();
            assert_eq!(describe_at(at_s, &injection), text);
        }
    }
}
