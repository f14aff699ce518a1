//! Values of arguments: what reads as a number, a time, a link or a file.

use rig::LinkChoice;
use std::path::PathBuf;

/// Names of the components of a force.
pub const AXES: [&str; 3] = ["x", "y", "z"];

/// A force component in newtons. The rig's limits are checked with the rig file.
pub fn newton(text: &str) -> Result<f64, String> {
    let value: f64 = text
        .parse()
        .map_err(|_| format!("`{text}` is not a number; give newtons, for example 2.5"))?;
    if value.is_finite() {
        Ok(value)
    } else {
        Err(format!(
            "`{text}` is not a finite number; give newtons, for example 2.5"
        ))
    }
}

/// The size of a force, N, above 0. The rig's limits are checked with the rig file.
pub fn force_size(text: &str) -> Result<f64, String> {
    match newton(text)? {
        size if size > 0.0 => Ok(size),
        _ => Err(format!(
            "`{text}` is not the size of a force; give newtons above 0, for example 2.5"
        )),
    }
}

/// A duration in seconds, 0.1 to 86400; a trailing `s` is allowed.
pub fn seconds(text: &str) -> Result<f64, String> {
    let value: f64 = text
        .strip_suffix('s')
        .unwrap_or(text)
        .parse()
        .map_err(|_| format!("`{text}` is not a number; give seconds, for example 5"))?;
    if (0.1..=86_400.0).contains(&value) {
        Ok(value)
    } else {
        Err(format!(
            "`{text}` is not a duration; give 0.1 to 86400 seconds"
        ))
    }
}

/// A duration in seconds, 0.1 to 86400, or 0 for none.
pub fn seconds_or_zero(text: &str) -> Result<f64, String> {
    if matches!(text, "0" | "0s" | "0.0") {
        return Ok(0.0);
    }
    seconds(text).map_err(|error| format!("{error}, or 0 for none"))
}

/// A difference of two clocks, s: within a century, because no time is further off.
pub fn clock_shift(text: &str) -> Result<f64, String> {
    const CENTURY_S: f64 = 100.0 * 365.25 * 86_400.0;
    let parsed = text.parse().ok();
    parsed
        .filter(|s| (-CENTURY_S..=CENTURY_S).contains(s))
        .ok_or_else(|| {
            format!("`{text}` is no difference of two clocks; give seconds, for example -0.25, at most a century")
        })
}

/// The largest error of a time, s: from 0 to a day.
pub fn time_error(text: &str) -> Result<f64, String> {
    let parsed = text.parse().ok().filter(|s| (0.0..=86_400.0).contains(s));
    parsed.ok_or_else(|| {
        format!(
            "`{text}` is no largest error of a time; give 0 to 86400 seconds, for example 0.002"
        )
    })
}

/// Standard deviation of the robot's pose, mm.
pub fn pose_sd_mm(text: &str) -> Result<f64, String> {
    let parsed = text.parse().ok().filter(|mm| (0.0..=50.0).contains(mm));
    parsed.ok_or_else(|| {
        format!("`{text}` is no standard deviation of a pose; give 0 to 50 mm, for example 1")
    })
}

/// The seed of the embedded rig.
pub fn seed(text: &str) -> Result<u64, String> {
    text.parse()
        .map_err(|_| format!("`{text}` is not a seed; give a whole number from 0"))
}

/// The number of a fault.
pub fn fault_number(text: &str) -> Result<u16, String> {
    text.parse()
        .map_err(|_| format!("`{text}` is not a fault number; `forcectl explain` lists all faults"))
}

/// A connection.
pub fn link(text: &str) -> Result<LinkChoice, String> {
    text.parse::<LinkChoice>().map_err(|error| {
        if text.ends_with(".toml") {
            format!("`{text}` is not a link; give the rig file with `--rig {text}`")
        } else {
            error
        }
    })
}

/// The path of a rig file. The names of connections are refused, because `--rig` took them before.
pub fn rig_file(text: &str) -> Result<PathBuf, String> {
    match text.parse::<LinkChoice>() {
        Ok(link) => Err(format!(
            "`--rig` takes a rig file; give the connection with `--link {link}`"
        )),
        Err(_) => Ok(text.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_or_refused_with_an_example() {
        assert_eq!(newton("-2.5"), Ok(-2.5));
        assert_eq!(force_size("0.5"), Ok(0.5));
        for text in ["0", "-1", "nan", "inf"] {
            assert!(force_size(text).is_err(), "{text}");
        }
        assert_eq!(seconds("2s"), Ok(2.0));
        assert_eq!(seconds("0.1"), Ok(0.1));
        assert_eq!(seconds_or_zero("0"), Ok(0.0));
        assert!(seconds_or_zero("0.01").is_err_and(|error| error.contains("or 0 for none")));
        for (error, words) in [
            (
                newton("much"),
                "`much` is not a number; give newtons, for example 2.5",
            ),
            (newton("nan"), "finite"),
            (newton("inf"), "finite"),
            (seconds("long"), "`long` is not a number; give seconds"),
            (seconds("nan"), "0.1 to 86400 seconds"),
            (seconds("0"), "0.1 to 86400 seconds"),
            (seconds("5ss"), "not a number"),
        ] {
            let error = error.expect_err("is refused");
            assert!(error.contains(words), "{error}");
        }
        assert_eq!(clock_shift("-0.25"), Ok(-0.25));
        assert_eq!(time_error("0"), Ok(0.0));
        for text in ["inf", "-inf", "nan", "1e300", "-1e300", "x", ""] {
            assert!(clock_shift(text).is_err(), "{text}");
            assert!(time_error(text).is_err(), "{text}");
        }
        assert!(time_error("-1").is_err_and(|error| error.contains("0 to 86400")));
        assert!(seed("-1").is_err_and(|error| error.contains("whole number from 0")));
        assert!(fault_number("x").is_err_and(|error| error.contains("forcectl explain")));
    }

    #[test]
    fn a_link_and_a_rig_file_that_are_mixed_up_are_told_apart() {
        assert_eq!(link("usb"), Ok(LinkChoice::Usb));
        assert!(link("my.toml").is_err_and(|error| error.contains("`--rig my.toml`")));
        assert!(link("pigeon").is_err_and(|error| error.contains("serial:PORT")));
        assert_eq!(rig_file("my.toml"), Ok(PathBuf::from("my.toml")));
        for name in ["embedded", "usb", "serial:/dev/ttyACM0"] {
            let error = rig_file(name).expect_err("is a link");
            assert!(error.contains(&format!("`--link {name}`")), "{error}");
        }
    }
}
