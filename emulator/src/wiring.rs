//! Which pin of the controller goes where: the rig's own copy of the pin table in `docs/wiring.md`,
//! which a test compares with that file.

/// A pin: port (0 = A) and number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pin {
    /// Port, 0 for GPIOA.
    pub port: usize,
    /// Pin of the port, 0 to 15.
    pub pin: u8,
}

impl Pin {
    /// The pin's bit in its port's registers.
    #[must_use]
    pub const fn bit(self) -> u16 {
        1 << self.pin
    }
}

const fn pin(port: char, pin: u8) -> Pin {
    Pin {
        port: port as usize - 'A' as usize,
        pin,
    }
}

/// Number of force units.
pub const UNITS: usize = 6;
/// Ports of the part.
pub const PORTS: usize = 11;

/// SPI clock of the DACs.
pub const DAC_SCK: Pin = pin('A', 5);
/// SPI data of the DACs.
pub const DAC_MOSI: Pin = pin('B', 5);
/// I2C clock.
pub const I2C_SCL: Pin = pin('B', 8);
/// I2C data.
pub const I2C_SDA: Pin = pin('B', 9);
/// Watchdog line to the PLC.
pub const ALIVE: Pin = pin('C', 8);
/// Counters: control (high) or data.
pub const CNT_CD: Pin = pin('D', 0);
/// Counters: axis Y (high) or X.
pub const CNT_XY: Pin = pin('D', 1);
/// Counters: read strobe, active low.
pub const CNT_RD: Pin = pin('D', 3);
/// Counters: write strobe, active low.
pub const CNT_WR: Pin = pin('D', 4);
/// Counters: chip selects, active low.
pub const CNT_CS: [Pin; 3] = [pin('D', 5), pin('D', 6), pin('D', 7)];
/// USART3 transmit.
pub const VCP_TX: Pin = pin('D', 8);
/// USART3 receive.
pub const VCP_RX: Pin = pin('D', 9);
/// Counters: lowest pin of the data bus, eight in a row.
pub const CNT_D0: Pin = pin('E', 8);
/// Bits of the counters' data bus in their port.
pub const CNT_DATA: u16 = 0xFF00;
/// Data ready of the six converters.
pub const DRDY: [Pin; UNITS] = [
    pin('F', 0),
    pin('F', 1),
    pin('F', 2),
    pin('F', 3),
    pin('F', 4),
    pin('F', 5),
];
/// Reset of the multiplexer, active low.
pub const MUX_RST: Pin = pin('F', 12);
/// Load of all DACs, rising edge.
pub const DAC_LDAC: Pin = pin('F', 14);
/// Reset of all DACs, active low.
pub const DAC_RST: Pin = pin('F', 15);
/// Chip selects of the DACs, active low.
pub const DAC_CS: [Pin; UNITS] = [
    pin('G', 0),
    pin('G', 1),
    pin('G', 2),
    pin('G', 3),
    pin('G', 4),
    pin('G', 5),
];
/// E-stop loop: high = closed.
pub const E_STOP: Pin = pin('G', 8);

/// USB data lines.
pub const USB_DM: Pin = pin('A', 11);
/// See [`USB_DM`].
pub const USB_DP: Pin = pin('A', 12);

/// Pins in an alternate function, with its number and what for.
pub const FUNCTIONS: [(Pin, u8, &str); 8] = [
    (DAC_SCK, 5, "SPI1_SCK"),
    (DAC_MOSI, 5, "SPI1_MOSI"),
    (I2C_SCL, 4, "I2C1_SCL"),
    (I2C_SDA, 4, "I2C1_SDA"),
    (VCP_TX, 7, "USART3_TX"),
    (VCP_RX, 7, "USART3_RX"),
    (USB_DM, 10, "OTG_HS D-"),
    (USB_DP, 10, "OTG_HS D+"),
];

/// Level of each line of a port that nothing drives, as the motor control board's resistors set it:
/// the active-low controls and LDAC are pulled up; DAC_RST and the alive line are pulled down, so
/// that the DACs stand at 0 V while the controller is in reset.
pub const IDLE: [u16; PORTS] = {
    let mut idle = [0; PORTS];
    idle[I2C_SCL.port] = I2C_SCL.bit() | I2C_SDA.bit();
    idle[CNT_RD.port] =
        CNT_RD.bit() | CNT_WR.bit() | CNT_CS[0].bit() | CNT_CS[1].bit() | CNT_CS[2].bit();
    idle[MUX_RST.port] = MUX_RST.bit() | DAC_LDAC.bit();
    idle[DAC_CS[0].port] = 0x003F;
    idle
};

/// Baud rate of the virtual COM port.
pub const BAUD: u64 = 2_000_000;

#[cfg(test)]
mod tests {
    use super::*;

    /// Signal, pin and alternate function number of every row of the documented table.
    fn documented() -> Vec<(String, String, Option<u8>)> {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/wiring.md");
        let text = std::fs::read_to_string(path).expect("docs/wiring.md");
        let table = text
            .split("<!-- pin-table:begin -->")
            .nth(1)
            .and_then(|rest| rest.split("<!-- pin-table:end -->").next())
            .expect("the pin table's marks");
        table
            .lines()
            .filter(|line| line.starts_with("| P"))
            .map(|line| {
                let cells: Vec<&str> = line.split('|').map(str::trim).collect();
                let function = cells[4]
                    .strip_prefix("AF")
                    .and_then(|rest| rest.split_whitespace().next().and_then(|n| n.parse().ok()));
                (cells[2].to_owned(), cells[1].to_owned(), function)
            })
            .collect()
    }

    #[test]
    fn the_pins_are_the_documented_ones() {
        let mut ours: Vec<(String, Pin)> = vec![
            ("DAC_SCK".into(), DAC_SCK),
            ("DAC_MOSI".into(), DAC_MOSI),
            ("I2C_SCL".into(), I2C_SCL),
            ("I2C_SDA".into(), I2C_SDA),
            ("ALIVE".into(), ALIVE),
            ("CNT_CD".into(), CNT_CD),
            ("CNT_XY".into(), CNT_XY),
            ("CNT_RD".into(), CNT_RD),
            ("CNT_WR".into(), CNT_WR),
            ("VCP_TX".into(), VCP_TX),
            ("VCP_RX".into(), VCP_RX),
            ("MUX_RST".into(), MUX_RST),
            ("DAC_LDAC".into(), DAC_LDAC),
            ("DAC_RST".into(), DAC_RST),
            ("E_STOP".into(), E_STOP),
            ("USB_DM".into(), USB_DM),
            ("USB_DP".into(), USB_DP),
        ];
        for n in 0..UNITS {
            ours.push((format!("DRDY{}", n + 1), DRDY[n]));
            ours.push((format!("DAC_CS{}", n + 1), DAC_CS[n]));
        }
        for (n, cs) in CNT_CS.into_iter().enumerate() {
            ours.push((format!("CNT_CS{}", n + 1), cs));
        }
        for n in 0..8 {
            let line = Pin {
                port: CNT_D0.port,
                pin: CNT_D0.pin + n,
            };
            ours.push((format!("CNT_D{n}"), line));
        }
        let documented = documented();
        for (signal, pin) in ours {
            let name = format!("P{}{}", (b'A' + pin.port as u8) as char, pin.pin);
            let row = documented
                .iter()
                .find(|(documented, ..)| *documented == signal);
            assert_eq!(
                row.map(|(_, pin, _)| pin.as_str()),
                Some(name.as_str()),
                "{signal}"
            );
        }
        for (pin, function, _) in FUNCTIONS {
            let name = format!("P{}{}", (b'A' + pin.port as u8) as char, pin.pin);
            let row = documented.iter().find(|(_, pin, _)| *pin == name);
            assert_eq!(row.and_then(|(.., f)| *f), Some(function), "{name}");
        }
    }
}
