//! The core's side of the bus: reset, idle, resume, and what it answers to tokens.

use super::fifo::{Entry, Packet};
use super::registers::{bit, DCTL, GCCFG, GOTGCTL, GRXFSIZ, GUSBCFG};
use super::Core;

/// Words of the receive FIFO that data never use: SETUP packets, "SETUP done" and "transfer
/// completed" (57.11.3).
const RESERVED_WORDS: usize = 13;

/// What the core answers to an OUT or SETUP packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Handshake {
    /// Taken.
    Ack,
    /// Not now.
    Nak,
    /// Never.
    Stall,
    /// Nothing: the address or the endpoint is not there.
    Silence,
}

/// What the core answers to an IN token.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum InResponse {
    /// A packet; the bus reports the host's acknowledge by [`Core::acknowledged`].
    Data {
        /// PID is DATA1.
        data1: bool,
        /// Payload.
        bytes: Vec<u8>,
    },
    /// Not now.
    Nak,
    /// Never.
    Stall,
    /// Nothing: the address or the endpoint is not there.
    Silence,
}

impl Core {
    /// VBUS at the socket.
    pub fn set_vbus(&mut self, on: bool) {
        self.vbus = on;
    }

    pub(super) fn session_valid(&self) -> bool {
        let control = self.stored(GOTGCTL);
        if control & bit::BVALOEN != 0 {
            return control & bit::BVALOVAL != 0;
        }
        self.vbus && self.stored(GCCFG) & bit::VBDEN != 0
    }

    /// Whether the pull-up on D+ shows a full-speed device: transceiver on, device mode, session
    /// valid, no soft disconnect.
    #[must_use]
    pub fn pull_up(&self) -> bool {
        self.stored(GCCFG) & bit::PWRDWN != 0
            && self.stored(GUSBCFG) & bit::FHMOD == 0
            && self.stored(DCTL) & bit::SDIS == 0
            && self.session_valid()
    }

    /// The host drives a reset.
    pub fn reset_begins(&mut self) {
        self.latched |= bit::USBRST;
        self.suspended = false;
        self.setup_stage = false;
        self.address_waits = false;
        for endpoint in self.ins.iter_mut().chain(&mut self.outs) {
            endpoint.bus_reset();
        }
    }

    /// The reset is over.
    pub fn reset_ends(&mut self) {
        self.latched |= bit::ENUMDNE;
    }

    /// The bus has been idle for 3 ms.
    pub fn idle(&mut self) {
        if !self.suspended {
            self.suspended = true;
            self.latched |= bit::ESUSP | bit::USBSUSP;
        }
    }

    /// Whether the core has seen the bus idle and no activity since.
    #[must_use]
    pub fn is_suspended(&self) -> bool {
        self.suspended
    }

    /// The host drives a resume.
    pub fn resume(&mut self) {
        if self.suspended {
            self.suspended = false;
            self.latched |= bit::WKUPINT;
        }
    }

    /// A frame began; `number` is that of its SOF packet.
    pub fn frame(&mut self, number: u16) {
        self.frame = number & 0x3FFF;
        self.latched |= bit::SOF;
    }

    /// Whether the core would respond to an IN token with something else than NAK.
    #[must_use]
    pub fn responds_in(&self, address: u8, number: usize) -> bool {
        address != self.address || !self.ins[number].is_active(number) || {
            let endpoint = &self.ins[number];
            endpoint.stall || self.in_length(number).is_some()
        }
    }

    /// Whether the core would respond to an OUT packet of `length` bytes with something else than
    /// NAK.
    #[must_use]
    pub fn responds_out(&self, address: u8, number: usize, length: usize) -> bool {
        let endpoint = &self.outs[number];
        address != self.address
            || !endpoint.is_active(number)
            || endpoint.stall
            || endpoint.enabled && !endpoint.nak && self.has_room(length)
    }

    fn has_room(&self, length: usize) -> bool {
        let depth = (self.stored(GRXFSIZ) & 0xFFFF) as usize;
        self.receive.words() + length.div_ceil(4) + 1 + RESERVED_WORDS <= depth
    }

    /// Length of the packet that goes out next; `None` where the FIFO does not hold it yet.
    fn in_length(&self, number: usize) -> Option<usize> {
        let endpoint = &self.ins[number];
        if !endpoint.enabled || endpoint.nak || endpoint.packets_left() == 0 {
            return None;
        }
        let length = endpoint.bytes_left(number).min(endpoint.max_packet(number));
        (self.transmit[endpoint.fifo()].words() >= length.div_ceil(4)).then_some(length)
    }

    /// A SETUP packet.
    pub fn setup(&mut self, address: u8, data: [u8; 8]) -> Handshake {
        if address != self.address {
            return Handshake::Silence;
        }
        let depth = (self.stored(GRXFSIZ) & 0xFFFF) as usize;
        if self.receive.words() + 3 > depth {
            self.complain("GRXFSIZ", "no room for a SETUP packet".to_owned());
            return Handshake::Silence;
        }
        self.ins[0].nak = true;
        self.outs[0].nak = true;
        self.ins[0].stall = false;
        self.outs[0].stall = false;
        // The data and status stages begin with DATA1 (USB 2.0 section 8.5.3).
        self.ins[0].data1 = true;
        self.outs[0].data1 = true;
        self.setup_stage = true;
        self.address_waits = true;
        self.receive.push(
            Entry {
                packet: Packet::Setup,
                endpoint: 0,
                bytes: 8,
                data1: false,
            },
            &data,
        );
        Handshake::Ack
    }

    /// A token for endpoint 0 after SETUP: its stage is over.
    fn leave_setup_stage(&mut self, number: usize) {
        if number == 0 && std::mem::take(&mut self.setup_stage) {
            let done = Entry {
                packet: Packet::SetupDone,
                endpoint: 0,
                bytes: 0,
                data1: false,
            };
            self.receive.push(done, &[]);
        }
    }

    /// An OUT packet with PID DATA1 or DATA0.
    pub fn out(&mut self, address: u8, number: usize, data1: bool, data: &[u8]) -> Handshake {
        if address != self.address || !self.outs[number].is_active(number) {
            return Handshake::Silence;
        }
        self.leave_setup_stage(number);
        if self.outs[number].stall {
            return Handshake::Stall;
        }
        if data.len() > self.outs[number].max_packet(number) {
            return Handshake::Silence;
        }
        let room = self.has_room(data.len());
        let endpoint = &mut self.outs[number];
        if !endpoint.enabled {
            endpoint.interrupt |= bit::OTEPDIS;
        }
        if !endpoint.enabled || endpoint.nak || !room {
            return Handshake::Nak;
        }
        if data1 != endpoint.data1 {
            // A packet that was sent again: acknowledged and dropped (57.15.6).
            return Handshake::Ack;
        }
        endpoint.data1 = !data1;
        let last = endpoint.transferred(number, data.len());
        let done = last || data.len() < endpoint.max_packet(number);
        if done {
            endpoint.nak = true;
            endpoint.enabled = false;
        }
        let entry = |packet, bytes| Entry {
            packet,
            endpoint: number,
            bytes,
            data1,
        };
        self.receive.push(entry(Packet::Out, data.len()), data);
        if done {
            self.receive.push(entry(Packet::OutDone, 0), &[]);
        }
        Handshake::Ack
    }

    /// An IN token.
    pub fn in_token(&mut self, address: u8, number: usize) -> InResponse {
        if address != self.address || !self.ins[number].is_active(number) {
            return InResponse::Silence;
        }
        self.leave_setup_stage(number);
        if self.ins[number].stall {
            return InResponse::Stall;
        }
        match self.in_length(number) {
            Some(length) => InResponse::Data {
                data1: self.ins[number].data1,
                bytes: self.transmit[self.ins[number].fifo()].packet(length),
            },
            None => {
                if !self.ins[number].nak {
                    self.ins[number].interrupt |= bit::ITTXFE;
                }
                InResponse::Nak
            }
        }
    }

    /// The host acknowledged the packet of `length` bytes that an IN token brought.
    pub fn acknowledged(&mut self, number: usize, length: usize) {
        let endpoint = &mut self.ins[number];
        endpoint.data1 = !endpoint.data1;
        let last = endpoint.transferred(number, length);
        if last {
            endpoint.enabled = false;
            endpoint.interrupt |= bit::XFRC;
        }
        let fifo = endpoint.fifo();
        self.transmit[fifo].sent(length);
        if number == 0 && length == 0 && std::mem::take(&mut self.address_waits) {
            self.address = self.wanted_address();
        }
    }

    /// The application popped an entry of the receive FIFO.
    pub(super) fn popped(&mut self, entry: Entry) {
        let endpoint = &mut self.outs[entry.endpoint];
        match entry.packet {
            Packet::SetupDone => endpoint.interrupt |= bit::STUP,
            Packet::OutDone => endpoint.interrupt |= bit::XFRC,
            Packet::Out | Packet::Setup => {}
        }
    }
}
