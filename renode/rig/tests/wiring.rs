//! The platform description wires what docs/wiring.md lists: a pin moved in one and not in the
//! other is found here, and not as a suite that fails for no visible reason.

use std::collections::HashMap;
use std::path::Path;

/// A pin as both files name it: port letter and number.
type Pin = (char, u32);

fn read(path: &str) -> String {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    std::fs::read_to_string(&file).unwrap_or_else(|e| panic!("{}: {e}", file.display()))
}

/// Signal to pin, out of the table.
fn table() -> HashMap<String, Pin> {
    read("../../docs/wiring.md")
        .lines()
        .filter_map(|line| {
            let mut cells = line.split('|').map(str::trim).skip(1);
            let (pin, signal) = (cells.next()?, cells.next()?);
            let mut letters = pin.strip_prefix('P')?.chars();
            let port = letters.next()?;
            Some((signal.to_owned(), (port, letters.as_str().parse().ok()?)))
        })
        .collect()
}

/// `[0-1, 4]` or `4` as numbers.
fn numbers(text: &str) -> Vec<u32> {
    text.trim()
        .trim_matches(['[', ']'])
        .split(',')
        .flat_map(|part| {
            let (first, last) = part.trim().split_once('-').unwrap_or((part, part));
            let first: u32 = first.trim().parse().unwrap();
            let last: u32 = last.trim().parse().unwrap();
            first..=last
        })
        .collect()
}

/// Outputs of the core's pins (pin to device input) and inputs (device output to pin).
fn platform() -> (HashMap<(Pin, String), u32>, HashMap<String, Pin>) {
    let (mut outputs, mut inputs) = (HashMap::new(), HashMap::new());
    let mut owner = String::new();
    for line in read("../force_board.repl").lines() {
        if !line.starts_with(' ') {
            owner = line.split(':').next().unwrap_or_default().to_owned();
            continue;
        }
        let Some((from, targets)) = line.split_once("->") else {
            continue;
        };
        for target in targets.split('|') {
            let (device, to) = target.trim().split_once('@').unwrap();
            if let Some(port) = owner.strip_prefix("gpioPort") {
                let port = port.chars().next().unwrap();
                for (pin, input) in numbers(from).into_iter().zip(numbers(to)) {
                    outputs.insert(((port, pin), device.to_owned()), input);
                }
            } else if let Some(port) = device.strip_prefix("gpioPort") {
                let port = port.chars().next().unwrap();
                let name = format!("{owner} {}", from.trim());
                inputs.insert(name, (port, to.trim().parse().unwrap()));
            }
        }
    }
    (outputs, inputs)
}

#[test]
fn what_the_core_drives_reaches_the_device_of_the_table() {
    let (pins, (outputs, _)) = (table(), platform());
    let mut expected: Vec<(String, String, u32)> = [
        ("ALIVE", "plc", 0),
        ("MUX_RST", "mux", 0),
        ("I2C_SCL", "mux", 1),
        ("LED_OK", "GreenLED", 0),
        ("LED_FAULT", "RedLED", 0),
        ("CNT_CD", "counters", 8),
        ("CNT_XY", "counters", 9),
        ("CNT_RD", "counters", 10),
        ("CNT_WR", "counters", 11),
    ]
    .map(|(signal, device, input)| (signal.into(), device.into(), input))
    .into();
    for unit in 1..=6 {
        let dac = format!("dac{unit}");
        expected.push((format!("DAC_CS{unit}"), dac.clone(), 0));
        expected.push(("DAC_LDAC".into(), dac.clone(), 1));
        expected.push(("DAC_RST".into(), dac, 2));
    }
    expected.extend((0..8).map(|n| (format!("CNT_D{n}"), "counters".into(), n)));
    expected.extend((0..3).map(|n| (format!("CNT_CS{}", n + 1), "counters".into(), 12 + n)));
    for (signal, device, input) in expected {
        let pin = pins[&signal];
        assert_eq!(
            outputs.get(&(pin, device.clone())),
            Some(&input),
            "{signal} is P{}{} in docs/wiring.md; force_board.repl must wire that pin to {device}@{input}",
            pin.0,
            pin.1
        );
    }
}

#[test]
fn what_the_devices_drive_reaches_the_pin_of_the_table() {
    let (pins, (_, inputs)) = (table(), platform());
    for unit in 1..=6 {
        assert_eq!(
            inputs[&format!("cell{unit} DRDY")],
            pins[&format!("DRDY{unit}")]
        );
    }
    assert_eq!(inputs["plc EStop"], pins["E_STOP"]);
}

/// Properties of a peripheral in the platform description.
fn properties(owner: &str) -> HashMap<String, String> {
    read("../force_board.repl")
        .lines()
        .skip_while(|line| !line.starts_with(&format!("{owner}:")))
        .skip(1)
        .take_while(|line| line.starts_with(' '))
        .filter_map(|line| line.split_once(": "))
        .map(|(name, value)| (name.trim().to_owned(), value.trim().to_owned()))
        .collect()
}

#[test]
fn the_buses_have_the_pads_and_the_alternate_function_of_the_table() {
    let pins = table();
    for (owner, port, pin, function, signal) in [
        ("i2c1", "port", "scl", 4, "I2C_SCL"),
        ("i2c1", "port", "sda", 4, "I2C_SDA"),
        ("spi1", "clockPort", "clock", 5, "DAC_SCK"),
        ("spi1", "dataPort", "data", 5, "DAC_MOSI"),
    ] {
        let found = properties(owner);
        let (letter, number) = pins[signal];
        assert_eq!(found[port], format!("gpioPort{letter}"), "{signal}");
        assert_eq!(found[pin], number.to_string(), "{signal}");
        assert_eq!(found["function"], function.to_string(), "{signal}");
        let row = read("../../docs/wiring.md")
            .lines()
            .find(|line| line.contains(&format!("| {signal} |")))
            .unwrap()
            .to_owned();
        assert!(row.contains(&format!("AF{function} ")), "{row}");
    }
}
