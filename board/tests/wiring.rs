//! docs/wiring.md against the firmware's pins: header of the NUCLEO, connectors of the rig,
//! resistors. `board::pins` itself compares the pin table row by row.

use board::pins;
use std::collections::BTreeMap;

const PAGE: &str = include_str!("../../docs/wiring.md");

/// Signal of each pin in the code.
fn signals() -> BTreeMap<String, &'static str> {
    pins::all()
        .map(|pin| (format!("P{:?}{}", pin.port, pin.number), pin.signal))
        .collect()
}

/// Rows of the table that begins after this heading.
fn rows(heading: &str) -> Vec<Vec<&'static str>> {
    let from = PAGE.find(heading).expect("the heading");
    PAGE[from..]
        .lines()
        .skip(1)
        .skip_while(|line| !line.starts_with("| "))
        .take_while(|line| line.starts_with('|'))
        .map(|line| line.trim_matches('|').split('|').map(str::trim).collect())
        .collect()
}

/// `DAC_RST (PF15)` as signal and pin.
fn named(text: &str) -> Option<(&str, &str)> {
    let (signal, pin) = text.split_once(" (")?;
    Some((signal, pin.strip_suffix(')')?))
}

#[test]
fn every_pin_is_once_on_a_header_of_the_nucleo() {
    let mut left = signals();
    let mut numbers = Vec::new();
    for row in rows("## Connectors of the NUCLEO") {
        let [header, entries] = row[..] else {
            panic!("{row:?}")
        };
        if !header.starts_with("CN") {
            continue;
        }
        for entry in entries.split(", ") {
            let (number, what) = entry.split_once(": ").expect("a number and a signal");
            let (signal, pin) = named(what).expect("a signal and its pin");
            assert_eq!(left.remove(pin), Some(signal), "{header} {entry}");
            let number: u8 = number.parse().expect("a number");
            assert!(!numbers.contains(&(header, number)), "{header} {number}");
            numbers.push((header, number));
        }
    }
    assert!(left.is_empty(), "on no header: {left:?}");
}

#[test]
fn every_signal_is_at_one_connector_of_the_rig() {
    let mut left: Vec<&str> = signals().into_values().collect();
    for row in rows("## Connectors of the rig") {
        for signal in row[1].split('`').skip(1).step_by(2) {
            let at = left.iter().position(|of| *of == signal);
            left.remove(at.unwrap_or_else(|| panic!("{signal} is no pin's, or at two connectors")));
        }
    }
    assert!(left.is_empty(), "at no connector: {left:?}");
}

#[test]
fn resistors_are_at_pins_that_exist() {
    let signals = signals();
    let mut found = 0;
    for row in rows("## Resistors, protection, bus accelerator") {
        // `USB (PA11` of `USB (PA11, PA12)` has no end.
        for (signal, pin) in row[0].split(", ").filter_map(named) {
            assert_eq!(signals.get(pin), Some(&signal), "{row:?}");
            found += 1;
        }
    }
    assert!(found >= 7, "{found}");
}
