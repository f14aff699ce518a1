//! Offsets and bits of the core's registers in device mode (RM0433 rev 9 sections 57.14.1 to
//! 57.14.67).

/// OTG control and status.
pub const GOTGCTL: u32 = 0x000;
/// OTG interrupt.
pub const GOTGINT: u32 = 0x004;
/// AHB configuration.
pub const GAHBCFG: u32 = 0x008;
/// USB configuration.
pub const GUSBCFG: u32 = 0x00C;
/// Reset.
pub const GRSTCTL: u32 = 0x010;
/// Core interrupt.
pub const GINTSTS: u32 = 0x014;
/// Interrupt mask.
pub const GINTMSK: u32 = 0x018;
/// Receive status, read.
pub const GRXSTSR: u32 = 0x01C;
/// Receive status, read and pop.
pub const GRXSTSP: u32 = 0x020;
/// Receive FIFO size.
pub const GRXFSIZ: u32 = 0x024;
/// Transmit FIFO 0 size and start.
pub const DIEPTXF0: u32 = 0x028;
/// Non-periodic transmit status (host mode).
pub const HNPTXSTS: u32 = 0x02C;
/// General core configuration: transceiver and VBUS detection.
pub const GCCFG: u32 = 0x038;
/// Core ID of the vendor.
pub const CID: u32 = 0x03C;
/// Core release of Synopsys. Not in the manual; ST's drivers read it.
pub const GSNPSID: u32 = 0x040;
/// Last of the five configuration words after GSNPSID.
pub const GHWCFG4: u32 = 0x050;
/// LPM configuration.
pub const GLPMCFG: u32 = 0x054;
/// Transmit FIFO x size and start, x from 1.
pub const DIEPTXF: u32 = 0x100;
/// Device configuration.
pub const DCFG: u32 = 0x800;
/// Device control.
pub const DCTL: u32 = 0x804;
/// Device status.
pub const DSTS: u32 = 0x808;
/// IN endpoint common interrupt mask.
pub const DIEPMSK: u32 = 0x810;
/// OUT endpoint common interrupt mask.
pub const DOEPMSK: u32 = 0x814;
/// All endpoints interrupt.
pub const DAINT: u32 = 0x818;
/// All endpoints interrupt mask.
pub const DAINTMSK: u32 = 0x81C;
/// IN endpoint FIFO empty interrupt mask.
pub const DIEPEMPMSK: u32 = 0x834;
/// IN endpoint registers, 0x20 for each endpoint.
pub const DIEP: u32 = 0x900;
/// OUT endpoint registers, 0x20 for each endpoint.
pub const DOEP: u32 = 0xB00;
/// Power and clock gating.
pub const PCGCCTL: u32 = 0xE00;
/// FIFO of endpoint 0; the next endpoint's is 0x1000 further.
pub const FIFO: u32 = 0x1000;
/// Spacing of the FIFOs.
pub const FIFO_SPACING: u32 = 0x1000;

/// Control register of an endpoint, in its 0x20 bytes.
pub const EP_CTL: u32 = 0x00;
/// Interrupt register of an endpoint.
pub const EP_INT: u32 = 0x08;
/// Transfer size of an endpoint.
pub const EP_TSIZ: u32 = 0x10;
/// DMA address of an endpoint.
pub const EP_DMA: u32 = 0x14;
/// Free words in the FIFO of an IN endpoint.
pub const EP_FSTS: u32 = 0x18;

/// Endpoints of each direction, endpoint 0 included.
pub const ENDPOINTS: usize = 9;
/// FIFO memory in words: 4 Kbytes.
pub const FIFO_WORDS: usize = 1024;

/// Bits of the registers, by register.
pub mod bit {
    /// GOTGCTL: B-session valid is overridden.
    pub const BVALOEN: u32 = 1 << 6;
    /// GOTGCTL: value of the override.
    pub const BVALOVAL: u32 = 1 << 7;
    /// GOTGCTL: ID pin, 1 for a B-device.
    pub const CIDSTS: u32 = 1 << 16;
    /// GOTGCTL: B-session is valid.
    pub const BSVLD: u32 = 1 << 19;
    /// GAHBCFG: interrupts reach the core's line.
    pub const GINT: u32 = 1 << 0;
    /// GUSBCFG: the full-speed transceiver is selected.
    pub const PHYSEL: u32 = 1 << 6;
    /// GUSBCFG: host mode is forced.
    pub const FHMOD: u32 = 1 << 29;
    /// GRSTCTL: core soft reset.
    pub const CSRST: u32 = 1 << 0;
    /// GRSTCTL: flush the receive FIFO.
    pub const RXFFLSH: u32 = 1 << 4;
    /// GRSTCTL: flush transmit FIFOs.
    pub const TXFFLSH: u32 = 1 << 5;
    /// GRSTCTL: the AHB master is idle.
    pub const AHBIDL: u32 = 1 << 31;
    /// GINTSTS: start of frame.
    pub const SOF: u32 = 1 << 3;
    /// GINTSTS: the receive FIFO has an entry.
    pub const RXFLVL: u32 = 1 << 4;
    /// GINTSTS: the non-periodic transmit FIFO is empty.
    pub const NPTXFE: u32 = 1 << 5;
    /// GINTSTS: early suspend.
    pub const ESUSP: u32 = 1 << 10;
    /// GINTSTS: suspend.
    pub const USBSUSP: u32 = 1 << 11;
    /// GINTSTS: the bus was reset.
    pub const USBRST: u32 = 1 << 12;
    /// GINTSTS: speed enumeration is done.
    pub const ENUMDNE: u32 = 1 << 13;
    /// GINTSTS: an IN endpoint has an interrupt.
    pub const IEPINT: u32 = 1 << 18;
    /// GINTSTS: an OUT endpoint has an interrupt.
    pub const OEPINT: u32 = 1 << 19;
    /// GINTSTS: the ID pin changed.
    pub const CIDSCHG: u32 = 1 << 28;
    /// GINTSTS: resume was detected.
    pub const WKUPINT: u32 = 1 << 31;
    /// GCCFG: the transceiver is powered.
    pub const PWRDWN: u32 = 1 << 16;
    /// GCCFG: VBUS detection is on.
    pub const VBDEN: u32 = 1 << 21;
    /// DCTL: soft disconnect.
    pub const SDIS: u32 = 1 << 1;
    /// DSTS: suspend.
    pub const SUSPSTS: u32 = 1 << 0;
    /// DSTS: enumerated speed is full speed.
    pub const FULL_SPEED: u32 = 3 << 1;

    /// DxEPCTL: the endpoint is active.
    pub const USBAEP: u32 = 1 << 15;
    /// DxEPCTL: the next data PID is DATA1.
    pub const DPID: u32 = 1 << 16;
    /// DxEPCTL: the endpoint responds with NAK.
    pub const NAKSTS: u32 = 1 << 17;
    /// DxEPCTL: the endpoint responds with STALL.
    pub const STALL: u32 = 1 << 21;
    /// DxEPCTL: clear NAK.
    pub const CNAK: u32 = 1 << 26;
    /// DxEPCTL: set NAK.
    pub const SNAK: u32 = 1 << 27;
    /// DxEPCTL: set DATA0.
    pub const SD0PID: u32 = 1 << 28;
    /// DxEPCTL: set DATA1.
    pub const SD1PID: u32 = 1 << 29;
    /// DxEPCTL: disable.
    pub const EPDIS: u32 = 1 << 30;
    /// DxEPCTL: enable.
    pub const EPENA: u32 = 1 << 31;

    /// DxEPINT: transfer complete.
    pub const XFRC: u32 = 1 << 0;
    /// DxEPINT: the endpoint is disabled.
    pub const EPDISD: u32 = 1 << 1;
    /// DOEPINT: the SETUP stage is done.
    pub const STUP: u32 = 1 << 3;
    /// DIEPINT: an IN token came while the FIFO was empty.
    pub const ITTXFE: u32 = 1 << 4;
    /// DOEPINT: an OUT token came while the endpoint was disabled.
    pub const OTEPDIS: u32 = 1 << 4;
    /// DIEPINT: NAK is in force.
    pub const INEPNE: u32 = 1 << 6;
    /// DIEPINT: the transmit FIFO is empty.
    pub const TXFE: u32 = 1 << 7;
}

/// Bits of GINTSTS that a written 1 clears.
pub const GINTSTS_CLEARED: u32 = 0xF870_FC0A;
/// Writable bits of DxEPCTL that are stored as written.
pub const EP_STORED: u32 = 0x03EC_87FF & !(1 << 20 | 1 << 21);
