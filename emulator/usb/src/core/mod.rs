//! The OTG core in device mode, register by register (RM0433 rev 9 chapter 57; product ID 0x2300,
//! release 3.30a).
//!
//! | Behaviour | Source |
//! |---|---|
//! | A SETUP packet is accepted whatever NAK and STALL say; NAK is set on both directions of endpoint 0 | 57.15.6, "SETUP and OUT data transfers" |
//! | The entry "SETUP stage done" follows when the data or status stage begins; popping it sets STUP | 57.15.6 |
//! | EPENA of OUT endpoint 0 stays set over SETUP. The manual says that it is cleared; releases after 3.00a keep it | ST's `USB_EP0_OutStart`, which arms the endpoint anew only where EPENA is clear |
//! | An OUT transfer ends with a short packet or with its last packet: NAK is set and EPENA cleared then, the entry "transfer completed" follows the data, popping it sets XFRC | 57.15.6 |
//! | The packet count of an OUT endpoint that was never written runs through zero | drivers that never write it receive (`synopsys-usb-otg`, in use on F4, F7 and H7) |
//! | An IN packet goes out once the FIFO holds all of it; otherwise NAK | 57.15.6, "IN data transfers" |
//! | EPDIS takes effect when NAK is in force | 57.15.6, "IN endpoint disable" |
//! | A bus reset deactivates all endpoints but 0. It leaves EPENA, the FIFOs, DAD and data PIDs of enabled endpoints alone | 57.14.53 (USBAEP); NuttX pull request 4505: endpoints stay enabled over a disconnection |
//! | A new address is valid from the status stage of SET_ADDRESS on, though DAD is written before it | 57.15.6, "SetAddress" |
//! | A packet is written to its FIFO without another access between its words | ChibiOS, libopencm3 issue 531, embassy pull request 2823 |
//! | STALL of endpoint 0 is cleared by SETUP; a data PID is set by SD0PID and SD1PID only | 57.14.53 |
//!
//! Not modelled: DMA, high speed, isochronous transfers, LPM, remote wake-up, host mode, the ULPI
//! interface. An access to their registers is stored. A register that the core does not have is
//! reported by [`Core::take_complaints`].

mod endpoints;
mod fifo;
pub mod registers;
#[cfg(test)]
mod tests;
mod tokens;

use endpoints::Endpoint;
use fifo::{ReceiveFifo, TransmitFifo};
use registers::{bit, *};

pub use tokens::{Handshake, InResponse};

/// OTG_CID of the STM32H7 (section 57.14.17).
const PRODUCT_ID: u32 = 0x0000_2300;
/// Release 3.30a, as ST's drivers and TinyUSB's table of cores read it on the STM32H743.
const RELEASE: u32 = 0x4F54_330A;

/// Stored words below the FIFOs.
const WORDS: usize = 0x400;

/// See the module's page.
#[derive(Debug)]
pub struct Core {
    stored: Box<[u32; WORDS]>,
    /// Latched bits of GINTSTS.
    latched: u32,
    ins: [Endpoint; ENDPOINTS],
    outs: [Endpoint; ENDPOINTS],
    transmit: [TransmitFifo; ENDPOINTS],
    receive: ReceiveFifo,
    suspended: bool,
    frame: u16,
    /// VBUS at the socket.
    vbus: bool,
    /// Address that the bus knows; DAD may be ahead of it until the status stage is over.
    address: u8,
    address_waits: bool,
    /// A SETUP packet came and the entry that ends its stage is still to be written.
    setup_stage: bool,
    /// FIFO that holds a part of its packet: the application is in the middle of writing it.
    filling: Option<u32>,
    complaints: Vec<(String, String)>,
}

impl Default for Core {
    fn default() -> Self {
        Self::new()
    }
}

impl Core {
    /// The core out of power-on.
    #[must_use]
    pub fn new() -> Self {
        let mut core = Self {
            stored: Box::new([0; WORDS]),
            latched: 0,
            ins: std::array::from_fn(|_| Endpoint::default()),
            outs: std::array::from_fn(|_| Endpoint::default()),
            transmit: std::array::from_fn(|_| TransmitFifo::default()),
            receive: ReceiveFifo::default(),
            suspended: false,
            frame: 0,
            vbus: false,
            address: 0,
            address_waits: false,
            setup_stage: false,
            filling: None,
            complaints: Vec::new(),
        };
        core.reset_registers();
        core
    }

    /// A reset of the controller, or of the core by RCC. The cable stays as it is.
    pub fn power_reset(&mut self) {
        let vbus = self.vbus;
        let complaints = std::mem::take(&mut self.complaints);
        *self = Self::new();
        self.vbus = vbus;
        self.complaints = complaints;
    }

    /// Reset values of sections 57.14.1 to 57.14.63 that are not zero.
    fn reset_registers(&mut self) {
        self.stored.fill(0);
        self.set(GUSBCFG, 0x0000_1400 | bit::PHYSEL);
        self.set(GRXFSIZ, 0x200);
        self.set(DIEPTXF0, 0x0200_0200);
        self.set(DCFG, 0x0220_0000);
        self.set(DCTL, bit::SDIS);
        self.set(PCGCCTL, 0x200B_8000);
        for number in 1..ENDPOINTS as u32 {
            self.set(DIEPTXF + 4 * number, 0x0200_0200 + 0x200 * number);
        }
        self.latched = 0;
        self.ins = std::array::from_fn(|_| Endpoint::default());
        self.outs = std::array::from_fn(|_| Endpoint::default());
        self.suspended = false;
        self.address = 0;
        self.address_waits = false;
        self.setup_stage = false;
        self.filling = None;
        self.receive.clear();
        self.transmit.iter_mut().for_each(TransmitFifo::clear);
    }

    fn stored(&self, offset: u32) -> u32 {
        self.stored[offset as usize / 4]
    }

    fn set(&mut self, offset: u32, value: u32) {
        self.stored[offset as usize / 4] = value;
    }

    fn complain(&mut self, place: &str, what: String) {
        self.complaints.push((format!("OTG2_HS.{place}"), what));
    }

    /// What the driver did that the core does not allow: place and description. Each is reported
    /// once by this call.
    pub fn take_complaints(&mut self) -> Vec<(String, String)> {
        std::mem::take(&mut self.complaints)
    }

    /// Level of the core's interrupt line (`usb2_gbl_it`).
    #[must_use]
    pub fn interrupt(&self) -> bool {
        self.stored(GAHBCFG) & bit::GINT != 0 && self.interrupts() & self.stored(GINTMSK) != 0
    }

    /// GINTSTS.
    fn interrupts(&self) -> u32 {
        let mut bits = self.latched | bit::NPTXFE;
        if !self.receive.is_empty() {
            bits |= bit::RXFLVL;
        }
        let endpoints = self.endpoint_interrupts() & self.stored(DAINTMSK);
        if endpoints & 0xFFFF != 0 {
            bits |= bit::IEPINT;
        }
        if endpoints >> 16 != 0 {
            bits |= bit::OEPINT;
        }
        bits
    }

    /// DAINT: one bit for each endpoint whose unmasked interrupts are pending, OUT endpoints from
    /// bit 16.
    fn endpoint_interrupts(&self) -> u32 {
        let (in_mask, out_mask) = (self.stored(DIEPMSK), self.stored(DOEPMSK));
        let empty_mask = self.stored(DIEPEMPMSK);
        (0..ENDPOINTS).fold(0, |bits, number| {
            let empty = (empty_mask >> number & 1) * bit::TXFE;
            let of_in = self.in_interrupt(number) & (in_mask & !bit::TXFE | empty) != 0;
            let of_out = self.outs[number].interrupt & out_mask != 0;
            bits | u32::from(of_in) << number | u32::from(of_out) << (16 + number)
        })
    }

    /// DIEPINT of an endpoint: the empty flag is a level.
    fn in_interrupt(&self, number: usize) -> u32 {
        let endpoint = &self.ins[number];
        let empty = self.transmit[endpoint.fifo()].is_empty();
        endpoint.interrupt | if empty { bit::TXFE } else { 0 }
    }

    /// Reads the register at `offset` from the core's base.
    pub fn read(&mut self, offset: u32) -> u32 {
        self.interrupts_filling(offset, false);
        match offset {
            GRXSTSP => {
                let (entry, lost) = self.receive.pop();
                if lost > 0 {
                    let what =
                        format!("popped while {lost} words of the packet before were unread");
                    self.complain("GRXSTSP", what);
                }
                if let Some(entry) = entry {
                    self.popped(entry);
                }
                entry.map_or(0, |entry| entry.status())
            }
            _ if offset >= FIFO => match self.receive.read_word() {
                Some(word) => word,
                None => {
                    self.complain("FIFO", "read beyond the packet".to_owned());
                    0
                }
            },
            _ => match self.peek(offset) {
                Some(value) => value,
                None => {
                    self.complain(&format!("{offset:#05x}"), "no register here".to_owned());
                    0
                }
            },
        }
    }

    /// What a read would give where it has no effect; `None`: no register, or a read that takes
    /// something.
    #[must_use]
    pub fn peek(&self, offset: u32) -> Option<u32> {
        Some(match offset {
            GOTGCTL => {
                let session = if self.session_valid() { bit::BSVLD } else { 0 };
                self.stored(GOTGCTL) | bit::CIDSTS | session
            }
            GRSTCTL => self.stored(GRSTCTL) | bit::AHBIDL,
            GINTSTS => self.interrupts(),
            GRXSTSR => self.receive.top().map_or(0, |entry| entry.status()),
            CID => PRODUCT_ID,
            GSNPSID => RELEASE,
            DSTS => {
                let suspended = if self.suspended { bit::SUSPSTS } else { 0 };
                u32::from(self.frame) << 8 | bit::FULL_SPEED | suspended
            }
            DAINT => self.endpoint_interrupts(),
            _ => match endpoint_register(offset) {
                Some((true, number, EP_CTL)) => self.ins[number].control(number),
                Some((false, number, EP_CTL)) => self.outs[number].control(number),
                Some((true, number, EP_INT)) => self.in_interrupt(number),
                Some((false, number, EP_INT)) => self.outs[number].interrupt,
                Some((true, number, EP_TSIZ)) => self.ins[number].size,
                Some((false, number, EP_TSIZ)) => self.outs[number].size,
                Some((true, number, EP_FSTS)) => {
                    let fifo = self.ins[number].fifo();
                    self.fifo_depth(fifo)
                        .saturating_sub(self.transmit[fifo].words()) as u32
                }
                Some((_, _, EP_DMA)) => self.stored(offset),
                Some(_) => return None,
                None if is_stored(offset) => self.stored(offset),
                None => return None,
            },
        })
    }

    /// Writes the register at `offset` from the core's base.
    pub fn write(&mut self, offset: u32, value: u32) {
        self.interrupts_filling(offset, true);
        match offset {
            GRSTCTL => self.reset_written(value),
            GINTSTS => self.latched &= !(value & GINTSTS_CLEARED),
            GOTGCTL => self.set(GOTGCTL, value & !(bit::BSVLD | bit::CIDSTS)),
            GOTGINT => self.set(GOTGINT, self.stored(GOTGINT) & !value),
            DCFG => {
                self.set(DCFG, value);
                self.address_written();
            }
            // Read-only.
            GRXSTSR | GRXSTSP | CID | GSNPSID..=GHWCFG4 | DSTS | DAINT => {
                self.complain(
                    &format!("{offset:#05x}"),
                    "a read-only register was written".to_owned(),
                );
            }
            _ if offset >= FIFO => self.push((offset - FIFO) / FIFO_SPACING, value),
            _ => match endpoint_register(offset) {
                Some((is_in, number, register)) => {
                    self.endpoint_written(is_in, number, register, value);
                }
                None if is_stored(offset) => self.set(offset, value),
                None => self.complain(&format!("{offset:#05x}"), "no register here".to_owned()),
            },
        }
    }

    fn reset_written(&mut self, value: u32) {
        if value & bit::CSRST != 0 {
            // Section 57.14.5: the core keeps the selection of the transceiver, DCFG's speed and
            // the power control.
            let kept = [GUSBCFG, GCCFG, DCFG, GAHBCFG, GOTGCTL].map(|at| (at, self.stored(at)));
            self.reset_registers();
            for (at, value) in kept {
                self.set(at, value);
            }
            self.set(GAHBCFG, self.stored(GAHBCFG) & !bit::GINT);
            // ES0392 2.25.6: a reset sets CIDSCHG without a change of the ID pin.
            self.latched |= bit::CIDSCHG;
        }
        if value & bit::RXFFLSH != 0 {
            self.receive.clear();
        }
        if value & bit::TXFFLSH != 0 {
            match value >> 6 & 0x1F {
                0x10 => self.transmit.iter_mut().for_each(TransmitFifo::clear),
                number if (number as usize) < ENDPOINTS => self.transmit[number as usize].clear(),
                number => self.complain(
                    "GRSTCTL",
                    format!("flush of FIFO {number}, which is not there"),
                ),
            }
        }
        self.set(GRSTCTL, value & 0x1F << 6);
    }

    fn address_written(&mut self) {
        let wanted = self.wanted_address();
        if self.address_waits && wanted != 0 {
            return;
        }
        self.address = wanted;
    }

    fn wanted_address(&self) -> u8 {
        (self.stored(DCFG) >> 4 & 0x7F) as u8
    }

    fn endpoint_written(&mut self, is_in: bool, number: usize, register: u32, value: u32) {
        let endpoint = if is_in {
            &mut self.ins[number]
        } else {
            &mut self.outs[number]
        };
        match register {
            EP_CTL => {
                if let Some(what) = endpoint.write_control(number, is_in, value) {
                    let place = format!("{}{number}", if is_in { "DIEPCTL" } else { "DOEPCTL" });
                    self.complain(&place, what);
                }
                if is_in && value & bit::EPENA != 0 {
                    self.check_fifo(self.ins[number].fifo());
                }
            }
            EP_INT => endpoint.interrupt &= !value,
            EP_TSIZ => endpoint.size = value,
            EP_DMA => self.set(
                if is_in { DIEP } else { DOEP } + 0x20 * number as u32 + EP_DMA,
                value,
            ),
            _ => self.complain(
                &format!("endpoint {number}"),
                format!("no writable register at {register:#04x}"),
            ),
        }
    }

    /// Depth of a transmit FIFO in words.
    fn fifo_depth(&self, fifo: usize) -> usize {
        self.fifo_place(fifo).1
    }

    /// Start and depth of a transmit FIFO in words.
    fn fifo_place(&self, fifo: usize) -> (usize, usize) {
        let register = if fifo == 0 {
            DIEPTXF0
        } else {
            DIEPTXF + 4 * fifo as u32
        };
        let value = self.stored(register);
        ((value & 0xFFFF) as usize, (value >> 16) as usize)
    }

    /// The FIFO of an endpoint that is enabled must lie in the memory, clear of the receive FIFO.
    fn check_fifo(&mut self, fifo: usize) {
        let (start, depth) = self.fifo_place(fifo);
        let receive = (self.stored(GRXFSIZ) & 0xFFFF) as usize;
        if start < receive || start + depth > FIFO_WORDS || depth < 16 {
            let what = format!(
                "words {start} to {} for FIFO {fifo}: receive FIFO {receive} words, memory {FIFO_WORDS}, least depth 16",
                start + depth
            );
            self.complain("DIEPTXF", what);
        }
    }

    fn push(&mut self, number: u32, word: u32) {
        let Some(endpoint) = self.ins.get(number as usize) else {
            return self.complain("FIFO", format!("no endpoint {number}"));
        };
        let fifo = endpoint.fifo();
        if self.transmit[fifo].words() >= self.fifo_depth(fifo) {
            return self.complain("FIFO", format!("transmit FIFO {fifo} overflows"));
        }
        let needed = endpoint.bytes_left(number as usize).div_ceil(4);
        self.transmit[fifo].push(word);
        self.filling = (self.transmit[fifo].words() < needed).then_some(number);
    }

    /// An access to anything else while a packet is being written corrupts it (ES of several parts;
    /// ChibiOS, libopencm3 issue 531, embassy pull request 2823).
    fn interrupts_filling(&mut self, offset: u32, write: bool) {
        let Some(number) = self.filling else {
            return;
        };
        if !write || offset != FIFO + FIFO_SPACING * number {
            self.filling = None;
            let what =
                format!("access to {offset:#06x} while a packet is written to endpoint {number}");
            self.complain("FIFO", what);
        }
    }
}

/// Direction (`true`: IN), number and offset of an endpoint's register.
fn endpoint_register(offset: u32) -> Option<(bool, usize, u32)> {
    let (is_in, within) = match offset {
        DIEP..0xB00 => (true, offset - DIEP),
        DOEP..0xD00 => (false, offset - DOEP),
        _ => return None,
    };
    let number = (within / 0x20) as usize;
    let register = within % 0x20;
    let known =
        matches!(register, EP_CTL | EP_INT | EP_TSIZ | EP_DMA) || is_in && register == EP_FSTS;
    (number < ENDPOINTS && known).then_some((is_in, number, register))
}

/// Registers without behaviour in device mode, or whose value alone is used.
fn is_stored(offset: u32) -> bool {
    matches!(
        offset,
        GOTGINT | GAHBCFG | GUSBCFG | GINTMSK | GRXFSIZ..=HNPTXSTS | GCCFG | GLPMCFG | DCFG | DCTL
            | DIEPMSK | DOEPMSK | DAINTMSK..=DIEPEMPMSK | PCGCCTL
    ) || (DIEPTXF..DIEPTXF + 4 * ENDPOINTS as u32).contains(&offset)
}
