//! One endpoint in one direction: its control register, transfer size and interrupts (sections
//! 57.14.53 to 57.14.67).

use super::registers::{bit, EP_STORED};

/// See the module's page.
#[derive(Debug, Default)]
pub(super) struct Endpoint {
    /// Stored bits of DxEPCTL: size, type, FIFO number, active.
    settings: u32,
    pub enabled: bool,
    /// EPDIS was written and NAK is not in force yet.
    disabling: bool,
    pub nak: bool,
    pub stall: bool,
    /// The next packet is DATA1.
    pub data1: bool,
    /// DxEPTSIZ.
    pub size: u32,
    /// DxEPINT, latched bits.
    pub interrupt: u32,
}

impl Endpoint {
    /// DxEPCTL.
    pub fn control(&self, number: usize) -> u32 {
        let flag = |set: bool, mask: u32| if set { mask } else { 0 };
        self.settings
            | flag(number == 0, bit::USBAEP)
            | flag(self.data1, bit::DPID)
            | flag(self.nak, bit::NAKSTS)
            | flag(self.stall, bit::STALL)
            | flag(self.disabling, bit::EPDIS)
            | flag(self.enabled, bit::EPENA)
    }

    /// Takes a write of DxEPCTL. Says what the manual does not allow in it.
    pub fn write_control(&mut self, number: usize, is_in: bool, value: u32) -> Option<String> {
        self.settings = value & EP_STORED;
        // Endpoint 0: the core clears STALL, the application cannot (57.14.53, 57.14.60).
        self.stall = value & bit::STALL != 0 || number == 0 && self.stall;
        if value & bit::SD0PID != 0 {
            self.data1 = false;
        }
        if value & bit::SD1PID != 0 {
            self.data1 = true;
        }
        let both = value & bit::CNAK != 0 && value & bit::SNAK != 0;
        if value & bit::CNAK != 0 {
            self.nak = false;
        }
        if value & bit::SNAK != 0 {
            self.nak = true;
            if is_in {
                self.interrupt |= bit::INEPNE;
            }
        }
        let wants_disabled = value & bit::EPDIS != 0;
        // OUT endpoint 0 cannot be disabled (57.14.60).
        if wants_disabled && self.enabled && (number != 0 || is_in) {
            self.disabling = true;
        }
        if value & bit::EPENA != 0 && !wants_disabled {
            self.enabled = true;
            self.disabling = false;
        }
        self.finish_disabling();
        both.then(|| "CNAK and SNAK in one write".to_owned())
    }

    fn finish_disabling(&mut self) {
        if self.disabling && self.nak {
            self.disabling = false;
            self.enabled = false;
            self.interrupt |= bit::EPDISD;
        }
    }

    /// A bus reset deactivates the endpoint; nothing else changes (57.14.53, USBAEP).
    pub fn bus_reset(&mut self) {
        self.settings &= !bit::USBAEP;
        self.stall = false;
    }

    /// Whether the endpoint is there for the host.
    pub fn is_active(&self, number: usize) -> bool {
        number == 0 || self.settings & bit::USBAEP != 0
    }

    /// Largest packet in bytes.
    pub fn max_packet(&self, number: usize) -> usize {
        if number == 0 {
            64 >> (self.settings & 3)
        } else {
            (self.settings & 0x7FF) as usize
        }
    }

    /// Number of the transmit FIFO.
    pub fn fifo(&self) -> usize {
        ((self.settings >> 22 & 0xF) as usize).min(super::ENDPOINTS - 1)
    }

    /// Bytes left of the transfer.
    pub fn bytes_left(&self, number: usize) -> usize {
        (self.size & if number == 0 { 0x7F } else { 0x7_FFFF }) as usize
    }

    /// Packets left of the transfer.
    pub fn packets_left(&self) -> u32 {
        self.size >> 19 & 0x3FF
    }

    /// A packet of `bytes` was transferred. Whether it was the last of the count.
    pub fn transferred(&mut self, number: usize, bytes: usize) -> bool {
        let mask = if number == 0 { 0x7F } else { 0x7_FFFF };
        // Two bits for IN endpoint 0 (57.14.56). OUT endpoint 0 has one, which ends with a short
        // packet all the same.
        let packet_mask = if number == 0 { 0x3 } else { 0x3FF };
        let left = (self.size & mask).saturating_sub(bytes as u32);
        let packets = self.packets_left().wrapping_sub(1) & packet_mask;
        self.size = self.size & !mask & !(0x3FF << 19) | left | packets << 19;
        packets == 0
    }
}
