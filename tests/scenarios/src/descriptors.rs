//! Checks of USB descriptors against USB 2.0 chapter 9 and CDC 1.2 with PSTN 1.2. Written from the
//! specifications; it shares nothing with the firmware or with the host model.

use std::fmt::Write;

/// One descriptor of a configuration: its bytes from bLength on.
type Descriptor<'a> = &'a [u8];

/// Endpoints of one interface: address, attributes, largest packet, interval.
pub type Endpoint = (u8, u8, u16, u8);

/// What a configuration says, where it is well formed.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct SerialPort {
    /// bInterfaceNumber of the communications interface.
    pub control_interface: u8,
    /// bInterfaceNumber of the data interface.
    pub data_interface: u8,
    /// bmCapabilities of the ACM functional descriptor (PSTN 1.2 table 4).
    pub capabilities: u8,
    /// The notification endpoint.
    pub notification: Endpoint,
    /// Bulk IN and bulk OUT.
    pub bulk: [Endpoint; 2],
}

/// Mistakes, one line each.
#[derive(Debug, Default)]
struct Mistakes(String);

impl Mistakes {
    fn check(&mut self, good: bool, what: impl FnOnce() -> String) {
        if !good {
            let _ = writeln!(self.0, "{}", what());
        }
    }
}

/// Checks a device descriptor of a full-speed device (USB 2.0 table 9-8).
///
/// # Errors
/// Every mistake, one line each.
pub fn check_device(bytes: &[u8]) -> Result<(), String> {
    let mut mistakes = Mistakes::default();
    let &[length, kind, usb_minor, usb_major, class, subclass, protocol, max_packet, .., configurations] =
        bytes
    else {
        return Err(format!("{} bytes", bytes.len()));
    };
    mistakes.check(bytes.len() == 18 && length == 18 && kind == 1, || {
        format!("length {length}, type {kind}")
    });
    mistakes.check(usb_major == 2, || {
        format!("bcdUSB {usb_major:x}.{usb_minor:02x}")
    });
    // CDC 1.2 table 2 for one function; the IAD triple for several (IAD ECN).
    mistakes.check(
        matches!((class, subclass, protocol), (2, 0, 0) | (0xEF, 2, 1)),
        || format!("class {class:#04x}, subclass {subclass:#04x}, protocol {protocol:#04x}"),
    );
    mistakes.check(matches!(max_packet, 8 | 16 | 32 | 64), || {
        format!("bMaxPacketSize0 {max_packet}")
    });
    mistakes.check(configurations == 1, || {
        format!("{configurations} configurations")
    });
    if mistakes.0.is_empty() {
        Ok(())
    } else {
        Err(mistakes.0)
    }
}

fn split(bytes: &[u8]) -> Result<Vec<Descriptor<'_>>, String> {
    let mut rest = bytes;
    let mut all = Vec::new();
    while let Some(&length) = rest.first() {
        let length = usize::from(length);
        if length < 2 || length > rest.len() {
            return Err(format!(
                "a descriptor of {length} bytes with {} left",
                rest.len()
            ));
        }
        let (one, after) = rest.split_at(length);
        all.push(one);
        rest = after;
    }
    Ok(all)
}

/// Checks a configuration with one CDC-ACM function (USB 2.0 tables 9-10 to 9-13, CDC 1.2 section
/// 5.2.3, PSTN 1.2 section 5.3).
///
/// # Errors
/// Every mistake, one line each.
pub fn check_configuration(bytes: &[u8]) -> Result<SerialPort, String> {
    let all = split(bytes)?;
    let mut mistakes = Mistakes::default();
    let mut port = SerialPort::default();
    let Some(&&[length, kind, low, high, interfaces, value, _, attributes, power]) = all
        .first()
        .map(|first| <&[u8; 9]>::try_from(*first).map_err(|error| error.to_string()))
        .transpose()?
        .as_ref()
    else {
        return Err("no configuration descriptor".to_owned());
    };
    let total = usize::from(u16::from_le_bytes([low, high]));
    mistakes.check(length == 9 && kind == 2, || {
        format!("first descriptor: type {kind}")
    });
    mistakes.check(total == bytes.len(), || {
        format!("wTotalLength {total} of {} bytes", bytes.len())
    });
    mistakes.check(interfaces == 2, || format!("{interfaces} interfaces"));
    mistakes.check(value > 0, || "bConfigurationValue 0".to_owned());
    mistakes.check(attributes & 0x9F == 0x80, || {
        format!("bmAttributes {attributes:#04x}: bit 7 set, 4 to 0 clear")
    });
    mistakes.check(power <= 250, || format!("bMaxPower {power}"));
    let mut interface = None;
    let mut functional = Vec::new();
    let mut endpoints: [Vec<Endpoint>; 2] = Default::default();
    for descriptor in &all[1..] {
        match **descriptor {
            // Interface association: both interfaces, class of the first (IAD ECN).
            [8, 0x0B, first, count, class, subclass, ..] => {
                mistakes.check((first, count, class, subclass) == (0, 2, 2, 2), || {
                    format!("IAD {descriptor:?}")
                });
            }
            [9, 4, number, alternate, count, class, subclass, protocol, _] => {
                let nth = usize::from(number).min(1);
                let wanted = [(2, 2, 1), (0x0A, 0, 2)][nth];
                mistakes.check((class, subclass, count) == wanted && alternate == 0, || {
                    format!("interface {number}: class {class:#04x}, subclass {subclass:#04x}, {count} endpoints")
                });
                // PSTN 1.2 table 17: 0 or 1 (AT commands) for ACM.
                mistakes.check(protocol <= 1 - nth as u8, || {
                    format!("interface {number}: protocol {protocol}")
                });
                interface = Some(nth);
            }
            [_, 0x24, subtype, ref rest @ ..] => {
                mistakes.check(interface == Some(0), || {
                    format!("functional descriptor {subtype} is misplaced")
                });
                functional.push((subtype, rest.to_vec()));
            }
            [7, 5, address, kind, low, high, interval] => match interface {
                Some(nth) => {
                    endpoints[nth].push((address, kind, u16::from_le_bytes([low, high]), interval))
                }
                None => mistakes.check(false, || "an endpoint before every interface".to_owned()),
            },
            ref other => mistakes.check(false, || format!("unknown descriptor {other:?}")),
        }
    }
    check_functional(&functional, &mut port, &mut mistakes);
    check_endpoints(&endpoints, &mut port, &mut mistakes);
    if mistakes.0.is_empty() {
        Ok(port)
    } else {
        Err(mistakes.0)
    }
}

/// Functional descriptors: the header comes first (CDC 1.2 section 5.2.3.1), the union and call
/// management name both interfaces.
fn check_functional(found: &[(u8, Vec<u8>)], port: &mut SerialPort, mistakes: &mut Mistakes) {
    match found.first() {
        Some((0, version)) if *version == [0x10, 0x01] || *version == [0x20, 0x01] => {}
        other => mistakes.check(false, || format!("header: {other:?}")),
    }
    let one = |subtype: u8, length: usize| {
        let mut of = found.iter().filter(|(kind, _)| *kind == subtype);
        let first = of.next().filter(|(_, bytes)| bytes.len() == length);
        first
            .filter(|_| of.next().is_none())
            .map(|(_, bytes)| bytes.as_slice())
    };
    match one(2, 1) {
        Some([capabilities]) => port.capabilities = *capabilities,
        _ => mistakes.check(false, || "not one ACM descriptor of 4 bytes".to_owned()),
    }
    match one(6, 2) {
        Some([control, data]) => {
            port.control_interface = *control;
            port.data_interface = *data;
            mistakes.check((*control, *data) == (0, 1), || {
                format!("union of {control} and {data}")
            });
        }
        _ => mistakes.check(false, || "not one union descriptor of 5 bytes".to_owned()),
    }
    match one(1, 2) {
        Some([_, data]) => mistakes.check(*data == 1, || {
            format!("call management on interface {data}")
        }),
        _ => mistakes.check(false, || {
            "not one call management descriptor of 5 bytes".to_owned()
        }),
    }
}

/// One interrupt IN endpoint at the first interface; bulk IN and bulk OUT at the second (CDC 1.2
/// section 3.4.2).
fn check_endpoints(found: &[Vec<Endpoint>; 2], port: &mut SerialPort, mistakes: &mut Mistakes) {
    match found[0].as_slice() {
        [notification @ (address, 3, size, interval)] if address & 0x80 != 0 => {
            port.notification = *notification;
            // A SERIAL_STATE notification has 10 bytes in one or more packets; full speed allows 64
            // and 1 to 255 ms.
            mistakes.check((1..=64).contains(size) && *interval > 0, || {
                format!("notification {notification:?}")
            });
        }
        other => mistakes.check(false, || {
            format!("communications interface: endpoints {other:?}")
        }),
    }
    let mut bulk = found[1].clone();
    bulk.sort_by_key(|(address, ..)| std::cmp::Reverse(*address));
    match bulk.as_slice() {
        [into @ (in_address, 2, in_size, _), out @ (out_address, 2, out_size, _)]
            if in_address & 0x80 != 0 && out_address & 0x80 == 0 =>
        {
            for size in [in_size, out_size] {
                mistakes.check(matches!(size, 8 | 16 | 32 | 64), || {
                    format!("bulk endpoint of {size} bytes")
                });
            }
            port.bulk = [*into, *out];
        }
        other => mistakes.check(false, || format!("data interface: endpoints {other:?}")),
    }
    let mut addresses: Vec<u8> = found
        .iter()
        .flatten()
        .map(|(address, ..)| *address)
        .collect();
    addresses.sort_unstable();
    addresses.dedup();
    let count = found.iter().map(Vec::len).sum::<usize>();
    mistakes.check(addresses.len() == count, || {
        "two endpoints have one address".to_owned()
    });
    mistakes.check(addresses.iter().all(|address| address & 0xF != 0), || {
        "endpoint 0 is described".to_owned()
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A configuration that is right.
    const GOOD: [u8; 67] = [
        9, 2, 67, 0, 2, 1, 0, 0x80, 50, //
        9, 4, 0, 0, 1, 2, 2, 0, 0, //
        5, 0x24, 0, 0x20, 0x01, //
        4, 0x24, 2, 2, //
        5, 0x24, 6, 0, 1, //
        5, 0x24, 1, 0, 1, //
        7, 5, 0x81, 3, 8, 0, 255, //
        9, 4, 1, 0, 2, 0x0A, 0, 0, 0, //
        7, 5, 0x82, 2, 64, 0, 0, //
        7, 5, 0x02, 2, 64, 0, 0,
    ];

    #[test]
    fn every_wrong_byte_that_matters_is_found() {
        assert_eq!(
            check_configuration(&GOOD).map(|port| port.capabilities),
            Ok(2)
        );
        // Offset, wrong value: lengths, counts, classes, interfaces, endpoints.
        for (at, value) in [
            (2, 66),
            (4, 1),
            (5, 0),
            (7, 0),
            (8, 251),
            (13, 2),
            (14, 0xFF),
            (15, 3),
            (18, 4),
            (20, 1),
            (21, 0x30),
            (24, 0x25),
            (30, 1),
            (31, 0),
            (36, 0),
            (39, 0x01),
            (40, 2),
            (43, 0),
            (48, 3),
            (49, 2),
            (55, 0x02),
            (56, 3),
            (57, 63),
            (62, 0x82),
        ] {
            let mut bytes = GOOD;
            bytes[at] = value;
            assert!(check_configuration(&bytes).is_err(), "byte {at} = {value}");
        }
        assert!(check_configuration(&GOOD[..60]).is_err());
        assert!(check_configuration(&[]).is_err());
    }

    #[test]
    fn a_device_descriptor_is_checked() {
        let good = [
            18, 1, 0x10, 2, 2, 0, 0, 64, 9, 0x12, 1, 0, 0x10, 0, 1, 2, 3, 1,
        ];
        assert_eq!(check_device(&good), Ok(()));
        for (at, value) in [(0, 17), (1, 2), (3, 1), (4, 0), (5, 2), (7, 63), (17, 2)] {
            let mut bytes = good;
            bytes[at] = value;
            assert!(check_device(&bytes).is_err(), "byte {at} = {value}");
        }
        assert!(check_device(&good[..17]).is_err());
    }
}
