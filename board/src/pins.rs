//! The pin table of docs/wiring.md as constants; a test compares the two row by row.

/// GPIO port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)] // the letters of the ports
pub enum Port {
    A,
    B,
    C,
    D,
    E,
    F,
    G,
    H,
}

/// What a pin does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// As reset leaves it: debug port, oscillator.
    AsReset,
    /// Push-pull output with the level it starts at, set before the pin is driven.
    Output {
        /// Initial level.
        high: bool,
    },
    /// Input with pull-down: a broken wire reads low.
    InputPullDown,
    /// Input and output in turn, as the firmware drives the bus; starts as an input.
    Bus,
    /// Push-pull alternate function.
    Alternate(u8),
    /// Open-drain alternate function, pull-ups on the board.
    OpenDrain(u8),
}

/// One row of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pin {
    /// Port.
    pub port: Port,
    /// Number in the port, 0 to 15.
    pub number: u8,
    /// Name of the signal.
    pub signal: &'static str,
    /// What the pin does.
    pub mode: Mode,
}

impl Pin {
    const fn new(port: Port, number: u8, signal: &'static str, mode: Mode) -> Self {
        assert!(number < 16);
        Self {
            port,
            number,
            signal,
            mode,
        }
    }

    /// The pin's bit in IDR and ODR, and the set half of BSRR.
    #[must_use]
    pub const fn mask(&self) -> u32 {
        1 << self.number
    }
}

use Mode::{Alternate, AsReset, Bus, InputPullDown, OpenDrain, Output};
use Port::{A, B, C, D, E, F, G, H};

const LOW: Mode = Output { high: false };
const HIGH: Mode = Output { high: true };

/// Green lamp: running.
pub const LED_OK: Pin = Pin::new(B, 0, "LED_OK", LOW);
/// Red lamp: a fault is latched.
pub const LED_FAULT: Pin = Pin::new(B, 14, "LED_FAULT", LOW);
/// Clock of the I2C bus.
pub const I2C_SCL: Pin = Pin::new(B, 8, "I2C_SCL", OpenDrain(4));
/// Data of the I2C bus.
pub const I2C_SDA: Pin = Pin::new(B, 9, "I2C_SDA", OpenDrain(4));
/// Alive line to the PLC.
pub const ALIVE: Pin = Pin::new(C, 8, "ALIVE", LOW);
/// C/D# of the counters: high = control.
pub const CNT_CD: Pin = Pin::new(D, 0, "CNT_CD", HIGH);
/// X/Y# of the counters: low = X.
pub const CNT_XY: Pin = Pin::new(D, 1, "CNT_XY", LOW);
/// RD# of the counters.
pub const CNT_RD: Pin = Pin::new(D, 3, "CNT_RD", HIGH);
/// WR# of the counters.
pub const CNT_WR: Pin = Pin::new(D, 4, "CNT_WR", HIGH);
/// CS# of the three counters.
pub const CNT_CS: [Pin; 3] = [
    Pin::new(D, 5, "CNT_CS1", HIGH),
    Pin::new(D, 6, "CNT_CS2", HIGH),
    Pin::new(D, 7, "CNT_CS3", HIGH),
];
/// Data bus of the counters, lowest bit first; consecutive pins of port E.
pub const CNT_DATA: [Pin; 8] = [
    Pin::new(E, 8, "CNT_D0", Bus),
    Pin::new(E, 9, "CNT_D1", Bus),
    Pin::new(E, 10, "CNT_D2", Bus),
    Pin::new(E, 11, "CNT_D3", Bus),
    Pin::new(E, 12, "CNT_D4", Bus),
    Pin::new(E, 13, "CNT_D5", Bus),
    Pin::new(E, 14, "CNT_D6", Bus),
    Pin::new(E, 15, "CNT_D7", Bus),
];
/// Data-ready line of each unit; pin number = EXTI line = unit.
pub const DRDY: [Pin; 6] = [
    Pin::new(F, 0, "DRDY1", InputPullDown),
    Pin::new(F, 1, "DRDY2", InputPullDown),
    Pin::new(F, 2, "DRDY3", InputPullDown),
    Pin::new(F, 3, "DRDY4", InputPullDown),
    Pin::new(F, 4, "DRDY5", InputPullDown),
    Pin::new(F, 5, "DRDY6", InputPullDown),
];
/// RESET of the multiplexer, active low.
pub const MUX_RST: Pin = Pin::new(F, 12, "MUX_RST", HIGH);
/// LDAC of all DACs: update on the rising edge.
pub const DAC_LDAC: Pin = Pin::new(F, 14, "DAC_LDAC", HIGH);
/// RST of all DACs, active low: starts low, so that every DAC stands at 0 V before anything else
/// runs.
pub const DAC_RST: Pin = Pin::new(F, 15, "DAC_RST", LOW);
/// CS of each unit's DAC, active low.
pub const DAC_CS: [Pin; 6] = [
    Pin::new(G, 0, "DAC_CS1", HIGH),
    Pin::new(G, 1, "DAC_CS2", HIGH),
    Pin::new(G, 2, "DAC_CS3", HIGH),
    Pin::new(G, 3, "DAC_CS4", HIGH),
    Pin::new(G, 4, "DAC_CS5", HIGH),
    Pin::new(G, 5, "DAC_CS6", HIGH),
];
/// E-stop loop: high = closed = may run.
pub const E_STOP: Pin = Pin::new(G, 8, "E_STOP", InputPullDown);

/// Pins that only a peripheral touches.
pub const PERIPHERAL: [Pin; 9] = [
    Pin::new(A, 11, "USB_DM", Alternate(10)),
    Pin::new(A, 12, "USB_DP", Alternate(10)),
    Pin::new(A, 13, "SWDIO", AsReset),
    Pin::new(A, 14, "SWCLK", AsReset),
    Pin::new(A, 5, "DAC_SCK", Alternate(5)),
    Pin::new(B, 5, "DAC_MOSI", Alternate(5)),
    Pin::new(D, 8, "VCP_TX", Alternate(7)),
    Pin::new(D, 9, "VCP_RX", Alternate(7)),
    Pin::new(H, 0, "HSE_IN", AsReset),
];

/// Every pin of the board.
pub fn all() -> impl Iterator<Item = Pin> {
    [
        LED_OK, LED_FAULT, I2C_SCL, I2C_SDA, ALIVE, CNT_CD, CNT_XY, CNT_RD, CNT_WR, MUX_RST,
        DAC_LDAC, DAC_RST, E_STOP,
    ]
    .into_iter()
    .chain(CNT_CS)
    .chain(CNT_DATA)
    .chain(DRDY)
    .chain(DAC_CS)
    .chain(PERIPHERAL)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    /// Rows of docs/wiring.md: pin to (signal, direction, function).
    fn documented() -> BTreeMap<String, [String; 3]> {
        let text = include_str!("../../docs/wiring.md");
        let begin = text.find("<!-- pin-table:begin -->").expect("table begins");
        let end = text.find("<!-- pin-table:end -->").expect("table ends");
        text[begin..end]
            .lines()
            .filter(|line| line.starts_with("| P"))
            .map(|line| {
                let cells: Vec<_> = line
                    .split('|')
                    .map(|cell| cell.trim().to_string())
                    .collect();
                (
                    cells[1].clone(),
                    [cells[2].clone(), cells[3].clone(), cells[4].clone()],
                )
            })
            .collect()
    }

    /// Whether a row's words fit a mode.
    fn fits(mode: Mode, direction: &str, function: &str) -> bool {
        match mode {
            AsReset => function == "AF0" || function == "OSC_IN",
            Output { .. } => direction == "output" && function == "GPIO",
            InputPullDown => {
                direction == "input"
                    && function.starts_with("EXTI")
                    && function.ends_with("pull-down")
            }
            Bus => direction == "bidirectional" && function == "GPIO",
            Alternate(n) => {
                ["output", "input", "analog"].contains(&direction)
                    && function.starts_with(&format!("AF{n} "))
            }
            OpenDrain(n) => direction == "open drain" && function.starts_with(&format!("AF{n} ")),
        }
    }

    #[test]
    fn constants_and_document_agree_row_by_row() {
        let mut rows = documented();
        assert_eq!(rows.len(), 45, "rows of the table");
        for pin in all() {
            let name = format!("P{:?}{}", pin.port, pin.number);
            let [signal, direction, function] = rows
                .remove(&name)
                .unwrap_or_else(|| panic!("{name} is not documented, or twice in the code"));
            assert_eq!(signal, pin.signal, "{name}");
            assert!(
                fits(pin.mode, &direction, &function),
                "{name}: {:?} against {direction}, {function}",
                pin.mode
            );
        }
        assert!(rows.is_empty(), "documented but not in the code: {rows:?}");
    }

    #[test]
    fn groups_that_the_firmware_addresses_as_one_are_consecutive() {
        for (n, pin) in DRDY.iter().enumerate() {
            assert_eq!(
                (pin.port, usize::from(pin.number)),
                (F, n),
                "EXTI line = unit"
            );
        }
        for (n, pin) in CNT_DATA.iter().enumerate() {
            assert_eq!(
                (pin.port, usize::from(pin.number)),
                (E, 8 + n),
                "a byte is shifted by 8"
            );
        }
        for (n, pin) in DAC_CS.iter().enumerate() {
            assert_eq!((pin.port, usize::from(pin.number)), (G, n));
        }
    }

    #[test]
    fn power_starts_off() {
        assert_eq!(DAC_RST.mode, Output { high: false });
        assert_eq!(ALIVE.mode, Output { high: false });
    }
}
