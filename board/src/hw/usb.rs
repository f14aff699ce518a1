//! USB OTG FS with a CDC-ACM port: the first link.
//!
//! Owner: the superloop alone. The core's registers must be accessed in sequence and without
//! preemption (embassy#2823), so the OTG_FS interrupt touches none of them: it masks itself in the
//! NVIC, which wakes the superloop, and [`Usb::serve`] unmasks it after it has polled.
//!
//! A missed deadline: the host retries; enumeration allows milliseconds for each step. While the
//! port is closed on the host, queued bytes are discarded and not counted.
//!
//! The core has loops without end inside its driver (soft reset, FIFO flush). So it is tried first
//! with bounded waits; a core without clock or supply leaves the board without this link, not
//! without control.

use super::pac::{self, interrupt, OTG2_HS_GLOBAL};
use super::startup;
use super::usart::{Consumer, Producer, Queue};
use super::usb_class::{self, Corrections};
use crate::clocks;
use crate::shared::Call;
use core::sync::atomic::AtomicBool;
use heapless::String;
use synopsys_usb_otg::{UsbBus, UsbPeripheral};
use usb_device::bus::UsbBusAllocator;
use usb_device::class::UsbClass;
use usb_device::device::{
    StringDescriptors, UsbDevice, UsbDeviceBuilder, UsbDeviceState, UsbVidPid,
};
use usbd_serial::SerialPort;
use wire::message::serial_number;

static QUEUE: Queue = Queue::new();
/// The core has an event.
static CALLING: Call = Call::of(AtomicBool::new(false));

/// The test VID/PID pair of pid.codes: replace it before handing boards to others.
const ID: UsbVidPid = UsbVidPid(0x1209, 0x0001);

/// Endpoint memory in words: control, interrupt and both bulk endpoints.
const ENDPOINT_WORDS: usize = 256;

/// The second OTG core, on PA11 and PA12.
struct Otg;

// SAFETY: the constants are those of OTG_HS2 in section 57 and its address in table 8 (memory map);
// `Usb` is the only user.
unsafe impl UsbPeripheral for Otg {
    const REGISTERS: *const () = OTG2_HS_GLOBAL::PTR.cast();
    const HIGH_SPEED: bool = true;
    const FIFO_DEPTH_WORDS: usize = 1024;
    const ENDPOINT_COUNT: usize = 9;

    fn enable() {
        // Clocks and supply are on since `startup::usb_supply`.
    }

    fn ahb_frequency_hz(&self) -> u32 {
        clocks::AHB_HZ
    }
}

type Bus = UsbBus<Otg>;

/// The link.
pub struct Usb {
    device: UsbDevice<'static, Bus>,
    port: SerialPort<'static, Bus>,
    queue: Consumer,
    trimmed: bool,
    /// DTR at the last poll.
    opened: bool,
}

/// The queue's end for frames; the link itself where the core answers.
pub fn start(supplied: bool, unique_id: [u32; 3]) -> (Option<Usb>, Producer) {
    let producer = QUEUE.stream_producer();
    if !supplied || !core_answers() {
        return (None, producer);
    }
    let memory = cortex_m::singleton!(: [u32; ENDPOINT_WORDS] = [0; ENDPOINT_WORDS]);
    let Some(memory) = memory else {
        return (None, producer);
    };
    let bus = cortex_m::singleton!(: UsbBusAllocator<Bus> = UsbBus::new(Otg, memory));
    let Some(bus) = bus else {
        return (None, producer);
    };
    let digits = cortex_m::singleton!(: String<24> = String::new());
    let Some(digits) = digits else {
        return (None, producer);
    };
    // One computer may have two boards.
    *digits = serial_number(unique_id);
    let port = SerialPort::new(bus);
    let strings = StringDescriptors::default()
        .manufacturer("force rig")
        .product("force board")
        .serial_number(digits);
    let builder = UsbDeviceBuilder::new(bus, ID)
        .self_powered(true)
        .strings(&[strings]);
    let Ok(builder) = builder else {
        return (None, producer);
    };
    let mut device = builder.device_class(usbd_serial::USB_CLASS_CDC).build();
    // The builder's setting is for the descriptor alone; this one answers GET_STATUS.
    device.set_self_powered(true);
    startup::unmask(pac::Interrupt::OTG_FS);
    (
        Some(Usb {
            device,
            port,
            queue: QUEUE.stream_consumer(),
            trimmed: false,
            opened: false,
        }),
        producer,
    )
}

/// Tries with bounded waits what the driver does without bounds: idle bus, soft reset, FIFO flush
/// (section 57.14).
fn core_answers() -> bool {
    // SAFETY: nothing else uses the core yet.
    let core = unsafe { &*OTG2_HS_GLOBAL::PTR };
    const READS: u32 = 10_000;
    if !startup::wait_for(READS, || core.grstctl().read().ahbidl().bit_is_set()) {
        return false;
    }
    // The full-speed transceiver is the only one of this core; it is selected before the reset.
    core.gusbcfg().modify(|_, w| w.physel().set_bit());
    core.grstctl().modify(|_, w| w.csrst().set_bit());
    if !startup::wait_for(READS, || core.grstctl().read().csrst().bit_is_clear()) {
        return false;
    }
    core.grstctl()
        .modify(|_, w| w.rxfflsh().set_bit().txfflsh().set_bit());
    startup::wait_for(READS, || {
        let control = core.grstctl().read();
        control.rxfflsh().bit_is_clear() && control.txfflsh().bit_is_clear()
    })
}

impl Usb {
    /// Transfers at most one packet in each direction. Passes on the received bytes.
    pub fn serve(&mut self, mut take: impl FnMut(u8)) {
        self.device.poll(&mut [&mut Corrections, &mut self.port]);
        usb_class::refuse_unexpected_data(self.device.bus());
        // Frames come from a host that gave an address. A suspended bus, or one without a cable,
        // has none.
        let framed = matches!(
            self.device.state(),
            UsbDeviceState::Addressed | UsbDeviceState::Configured
        );
        if !self.trimmed && framed {
            self.trimmed = true;
            startup::trim_usb_clock();
        }
        let opened = self.port.dtr();
        if self.opened && !opened {
            // What is left was meant for the program that closed the port: the next one starts with
            // a whole frame.
            UsbClass::reset(&mut self.port);
            usb_class::discard_packet();
        }
        self.opened = opened;
        let open = self.device.state() == UsbDeviceState::Configured && opened;
        let mut packet = [0; 64];
        if let Ok(length) = self.port.read(&mut packet) {
            packet.iter().take(length).for_each(|byte| take(*byte));
        }
        if let Ok(grant) = self.queue.read() {
            let sent = if open {
                self.port.write(&grant).unwrap_or(0)
            } else {
                grant.len()
            };
            grant.release(sent);
        }
        if open {
            // Would block: the next poll continues.
            let _ = self.port.flush();
        }
        CALLING.served(|| startup::unmask(pac::Interrupt::OTG_FS));
    }
}

/// Whether the core has an event.
pub fn calls() -> bool {
    CALLING.waits()
}

#[interrupt]
fn OTG_FS() {
    CALLING.raise(|| cortex_m::peripheral::NVIC::mask(pac::Interrupt::OTG_FS));
}
