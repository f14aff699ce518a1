//! Enumeration and the CDC-ACM class driver: which requests follow on which, and what is kept of
//! the answers.

use super::control::{Outcome, Request, Transfer};
use super::{Host, Phase, Pipe, ADDRESS_NS, ATTEMPTS, MS};
use crate::core::Core;

/// GET_DESCRIPTOR.
const GET_DESCRIPTOR: u8 = 6;
/// Length and type of the descriptor at the start of `bytes`.
fn header(bytes: &[u8]) -> Option<(u8, u8)> {
    match *bytes {
        [length, kind, ..] if length >= 2 => Some((length, kind)),
        _ => None,
    }
}

/// Address that the host gives to the device.
const ADDRESS: u8 = 5;
/// Largest number of strings that the host reads.
const STRINGS: u8 = 8;

/// What the host knows of a configured device: its descriptors as they came.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Device {
    /// Device descriptor.
    pub device: Vec<u8>,
    /// Configuration descriptor with everything that follows it.
    pub configuration: Vec<u8>,
    /// String descriptors by index; 0 lists the languages.
    pub strings: Vec<(u8, Vec<u8>)>,
}

impl Device {
    /// The text of a string descriptor.
    #[must_use]
    pub fn text(&self, index: u8) -> Option<String> {
        let (_, bytes) = self.strings.iter().find(|(of, _)| *of == index)?;
        let units = bytes
            .get(2..)?
            .chunks_exact(2)
            .map(|pair| u16::from_le_bytes([pair[0], pair[1]]));
        Some(
            char::decode_utf16(units)
                .map(|c| c.unwrap_or('?'))
                .collect(),
        )
    }
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum Step {
    #[default]
    FirstBytes,
    Address,
    DeviceDescriptor,
    ConfigurationHeader,
    Configuration,
    Text(u8),
    Configure,
}

/// An enumeration under way.
#[derive(Debug, Default)]
pub(super) struct Enumeration {
    step: Step,
    found: Device,
    pub max_packet: usize,
}

impl Enumeration {
    fn request(&self) -> Request {
        let descriptor = |kind: u16, index: u16, language, length| {
            Request::read(0, GET_DESCRIPTOR, kind << 8 | index, language, length)
        };
        match self.step {
            Step::FirstBytes => descriptor(1, 0, 0, 8),
            Step::Address => Request::write(0, 5, ADDRESS.into(), 0, &[]),
            Step::DeviceDescriptor => descriptor(1, 0, 0, 18),
            Step::ConfigurationHeader => descriptor(2, 0, 0, 9),
            Step::Configuration => {
                let header = &self.found.configuration;
                descriptor(2, 0, 0, u16::from_le_bytes([header[2], header[3]]))
            }
            Step::Text(index) => {
                let language = match self.found.strings.first() {
                    Some((_, languages)) if index > 0 && languages.len() >= 4 => {
                        u16::from_le_bytes([languages[2], languages[3]])
                    }
                    _ => 0,
                };
                descriptor(3, index.into(), language, 255)
            }
            Step::Configure => {
                let value = self.found.configuration.get(5).copied().unwrap_or(1);
                Request::write(0, 9, value.into(), 0, &[])
            }
        }
    }

    /// Takes the answer to the step's request; the next step.
    fn take(&mut self, bytes: Vec<u8>) -> Result<Option<Step>, String> {
        let short = |what: &str| Err(format!("{what} of {} bytes", bytes.len()));
        Ok(Some(match self.step {
            Step::FirstBytes => match bytes.get(7) {
                Some(size @ (8 | 16 | 32 | 64)) => {
                    self.max_packet = usize::from(*size);
                    Step::Address
                }
                _ => return short("device descriptor without a valid bMaxPacketSize0"),
            },
            Step::Address => Step::DeviceDescriptor,
            Step::DeviceDescriptor if bytes.len() != 18 => return short("device descriptor"),
            Step::DeviceDescriptor => {
                self.found.device = bytes;
                Step::ConfigurationHeader
            }
            Step::ConfigurationHeader if bytes.len() != 9 => {
                return short("configuration descriptor")
            }
            Step::ConfigurationHeader => {
                self.found.configuration = bytes;
                Step::Configuration
            }
            Step::Configuration => {
                self.found.configuration = bytes;
                let texts = self.found.device[14..17].iter().any(|index| *index > 0);
                if texts {
                    Step::Text(0)
                } else {
                    Step::Configure
                }
            }
            Step::Text(index) => {
                self.found.strings.push((index, bytes));
                self.next_text(index)
            }
            Step::Configure => return Ok(None),
        }))
    }

    /// The string after `index` that the device descriptor names, or the end of the strings.
    fn next_text(&self, index: u8) -> Step {
        let named = &self.found.device[14..17];
        (index + 1..=STRINGS)
            .find(|next| named.contains(next))
            .map_or(Step::Configure, Step::Text)
    }
}

impl Host {
    /// The next control transfer, if none is under way: the enumeration's, the port's, then those
    /// that were asked for.
    pub(super) fn start_next(&mut self, _core: &mut Core) {
        if self.transfer.is_some() {
            return;
        }
        let max_packet = self.max_packet_0();
        let next = if let Some(enumeration) = &self.enumeration {
            Some(Transfer::new(0, enumeration.request()))
        } else {
            self.port_request().or_else(|| self.waiting.pop_front())
        };
        self.transfer = next.map(|mut transfer| {
            transfer.begin(self.now, max_packet);
            transfer
        });
    }

    /// Whether [`Self::start_next`] would start something.
    pub(super) fn has_next(&self) -> bool {
        self.transfer.is_none()
            && (self.enumeration.is_some() || self.wants_port_request() || !self.waiting.is_empty())
    }

    fn wants_port_request(&self) -> bool {
        self.device.is_some() && self.opening.is_none() && self.wants_open != self.open
    }

    /// The request that opens or closes the port: line coding 2,000,000 8N1 and DTR with RTS, or
    /// neither.
    fn port_request(&mut self) -> Option<Transfer> {
        if !self.wants_port_request() {
            return None;
        }
        let id = self.next_id;
        self.next_id += 1;
        self.opening = Some(id);
        let coding = [0x80, 0x84, 0x1E, 0x00, 0, 0, 8];
        Some(Transfer::new(
            id,
            if self.wants_open {
                Request::write(0x21, 0x20, 0, 0, &coding)
            } else {
                Request::write(0x21, 0x22, 0, 0, &[])
            },
        ))
    }

    /// A request of the class driver is over.
    pub(super) fn opened(&mut self, request: &Request, outcome: Outcome) {
        if outcome == Outcome::Detached {
            return;
        }
        if !matches!(outcome, Outcome::Done(_)) {
            self.note(format!(
                "class request {:#04x}: {outcome:?}",
                request.request
            ));
        }
        if request.request == 0x20 {
            let id = self.next_id;
            self.next_id += 1;
            self.opening = Some(id);
            self.waiting
                .push_front(Transfer::new(id, Request::write(0x21, 0x22, 3, 0, &[])));
        } else {
            self.open = request.value != 0;
            self.note(
                if self.open {
                    "port open"
                } else {
                    "port closed"
                }
                .to_owned(),
            );
        }
    }

    /// A request of the enumeration is over.
    pub(super) fn enumerated(&mut self, core: &mut Core, request: &Request, outcome: Outcome) {
        let Some(enumeration) = &mut self.enumeration else {
            return;
        };
        let taken = match outcome {
            Outcome::Done(bytes) => enumeration.take(bytes),
            Outcome::Stalled if matches!(enumeration.step, Step::Text(_)) => {
                Ok(Some(Step::Configure))
            }
            other => Err(format!("{other:?}")),
        };
        match taken {
            Ok(Some(step)) => {
                enumeration.step = step;
                if step == Step::Address {
                    // The second reset: the device is at address 0 and in a known state.
                    self.begin_reset(core);
                } else if step == Step::DeviceDescriptor && self.address == 0 {
                    self.address = ADDRESS;
                    self.phase = Phase::Recovery(self.now + ADDRESS_NS);
                }
            }
            Ok(None) => self.configured(),
            Err(why) => {
                self.note(format!(
                    "enumeration: request {:#04x} {:#06x}: {why}",
                    request.request, request.value
                ));
                self.attempts += 1;
                self.enumeration = None;
                if self.attempts < ATTEMPTS {
                    self.begin_reset(core);
                } else {
                    self.phase = Phase::GaveUp;
                }
            }
        }
    }

    /// The device is configured: its pipes are open.
    fn configured(&mut self) {
        let Some(enumeration) = self.enumeration.take() else {
            return;
        };
        let found = enumeration.found;
        let mut rest = found.configuration.as_slice();
        while let Some((length, kind)) = header(rest) {
            if let (5, [_, _, address, attributes, low, high, ..]) = (kind, rest) {
                let pipe = Pipe {
                    number: usize::from(address & 0xF),
                    max_packet: usize::from(u16::from_le_bytes([*low, *high]) & 0x7FF),
                    ..Pipe::default()
                };
                match (attributes & 3, address & 0x80 != 0) {
                    (2, true) => self.bulk_in = pipe,
                    (2, false) => self.bulk_out = pipe,
                    (3, true) => self.notify = pipe,
                    _ => {}
                }
            }
            rest = rest.get(usize::from(length)..).unwrap_or_default();
        }
        self.notify_at = self.now + MS;
        self.device = Some(found);
        self.note("configured".to_owned());
    }

    /// Largest packet of endpoint 0.
    pub(super) fn max_packet_0(&self) -> usize {
        match (&self.enumeration, &self.device) {
            (Some(enumeration), _) if enumeration.max_packet > 0 => enumeration.max_packet,
            (None, Some(device)) => usize::from(device.device[7]),
            _ => 8,
        }
    }
}
