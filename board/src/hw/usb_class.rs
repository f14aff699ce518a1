//! What the crates for USB and CDC-ACM leave out of the two specifications: asked before them, at
//! every control request.
//!
//! * `usbd-serial` describes a port that takes no class requests (bmCapabilities 0) though it takes
//!   them. A host may then never send SET_CONTROL_LINE_STATE, and without DTR nothing is streamed.
//!   The configuration descriptor here says it (PSTN 1.2 table 4).
//! * `synopsys-usb-otg` ends a halt without setting the data PID to DATA0 (USB 2.0 section 9.4.5),
//!   and SET_CONFIGURATION has to do the same for all endpoints (section 9.1.1.5). A host that did
//!   it on its side takes the next packet for a repeated one and drops it; so does the core with
//!   the host's.
//!
//! * `usb-device` leaves data at endpoint 0 that it did not expect in the driver's buffer (a data
//!   stage longer than its 128 bytes, a status stage that is not empty). The buffer stays full, the
//!   receive FIFO behind it too, and USB is dead until the controller is reset. Such data are taken
//!   and the transfer is refused.
//! * `usb-device` keeps the place of data that were accepted with `accept_with_static` when the
//!   host abandons the transfer, and gives them as the answer to the next request. So nothing is
//!   accepted that way.
//!
//! Owner: the superloop alone, as the rest of USB.

use super::pac::{OTG2_HS_DEVICE, OTG2_HS_GLOBAL};
use super::startup;
use usb_device::bus::UsbBus;
use usb_device::class_prelude::control::{Recipient, Request, RequestType};
use usb_device::class_prelude::{ControlIn, ControlOut, EndpointAddress, UsbClass};
use usb_device::{UsbDirection, UsbError};

/// Notification endpoint. The endpoints are numbered as `usbd-serial` allocates them.
const NOTIFICATION: u8 = 0x81;
/// Bulk endpoint to the host.
const BULK_IN: u8 = 0x82;
/// Bulk endpoint from the host.
const BULK_OUT: u8 = 0x01;

/// Descriptor type of a configuration (USB 2.0 table 9-5).
const CONFIGURATION_TYPE: u16 = 2;

/// The configuration: an association of the communications and the data interface (USB 2.0 section
/// 9.6, CDC 1.2 section 5.2.3, PSTN 1.2 section 5.3).
static CONFIGURATION: [u8; 75] = [
    // Configuration 1: 75 bytes, two interfaces, self-powered, nothing drawn from the bus.
    9,
    2,
    75,
    0,
    2,
    1,
    0,
    0xC0,
    0, //
    // Interface association: interfaces 0 and 1 are one ACM function.
    8,
    0x0B,
    0,
    2,
    2,
    2,
    0,
    0, //
    // Interface 0: communications, abstract control model, one endpoint.
    9,
    4,
    0,
    0,
    1,
    2,
    2,
    0,
    0, //
    // Header: CDC 1.20.
    5,
    0x24,
    0,
    0x20,
    0x01, //
    // Abstract control management: D1, line coding and control line state.
    4,
    0x24,
    2,
    0b0010, //
    // Union: interface 0 controls interface 1.
    5,
    0x24,
    6,
    0,
    1, //
    // Call management: none, data on interface 1.
    5,
    0x24,
    1,
    0,
    1, //
    // Notifications: interrupt, 8 bytes, 255 ms.
    7,
    5,
    NOTIFICATION,
    3,
    8,
    0,
    255, //
    // Interface 1: data, two endpoints.
    9,
    4,
    1,
    0,
    2,
    0x0A,
    0,
    0,
    0, //
    7,
    5,
    BULK_IN,
    2,
    64,
    0,
    0, //
    7,
    5,
    BULK_OUT,
    2,
    64,
    0,
    0,
];

fn copy_configuration(buffer: &mut [u8]) -> usb_device::Result<usize> {
    let place = buffer
        .get_mut(..CONFIGURATION.len())
        .ok_or(UsbError::BufferOverflow)?;
    place.copy_from_slice(&CONFIGURATION);
    Ok(CONFIGURATION.len())
}

/// See the module's page.
pub struct Corrections;

impl<B: UsbBus> UsbClass<B> for Corrections {
    fn control_in(&mut self, transfer: ControlIn<B>) {
        let request = transfer.request();
        if request.request_type == RequestType::Standard
            && request.recipient == Recipient::Device
            && request.request == Request::GET_DESCRIPTOR
            && request.value >> 8 == CONFIGURATION_TYPE
        {
            // Either fails only where no request waits for an answer. There is one configuration;
            // `usb-device` would give it for every number.
            let _ = match request.value & 0xFF {
                0 => transfer.accept(copy_configuration),
                _ => transfer.reject(),
            };
        }
    }

    /// Accepts nothing: the requests are carried out by `usb-device`.
    fn control_out(&mut self, transfer: ControlOut<B>) {
        let request = transfer.request();
        if request.request_type != RequestType::Standard {
            return;
        }
        match (request.recipient, request.request) {
            (Recipient::Device, Request::SET_CONFIGURATION) => {
                [NOTIFICATION, BULK_IN, BULK_OUT]
                    .into_iter()
                    .for_each(start_with_data0);
            }
            (Recipient::Endpoint, Request::CLEAR_FEATURE) => {
                start_with_data0((request.index & 0x8F) as u8);
            }
            _ => {}
        }
    }
}

/// Takes what is left at endpoint 0 after a poll, and stalls the transfer: everything that was
/// expected is taken by then. The next SETUP ends the stall.
pub fn refuse_unexpected_data(bus: &impl UsbBus) {
    let [from_host, to_host] = [UsbDirection::Out, UsbDirection::In]
        .map(|direction| EndpointAddress::from_parts(0, direction));
    if bus.read(from_host, &mut [0; 64]).is_ok() {
        bus.set_stalled(from_host, true);
        bus.set_stalled(to_host, true);
    }
}

/// Takes the packet for the host back that waits at the bulk endpoint (section 57.15.6, "IN
/// endpoint disable"): NAK, disable, flush. The waits are bounded; a core that does not follow
/// keeps the packet, and the host gets it.
pub fn discard_packet() {
    const READS: u32 = 100;
    // SAFETY: as above.
    let (core, device) = unsafe { (&*OTG2_HS_GLOBAL::PTR, &*OTG2_HS_DEVICE::PTR) };
    let endpoint = device.diep2().ctl();
    if endpoint.read().epena().bit_is_clear() {
        return;
    }
    endpoint.modify(|_, w| w.snak().set_bit());
    endpoint.modify(|_, w| w.epdis().set_bit());
    if startup::wait_for(READS, || endpoint.read().epena().bit_is_clear()) {
        core.grstctl().modify(|_, w| {
            // SAFETY: the number of a FIFO that exists.
            unsafe { w.txfnum().bits(BULK_IN & 0xF) }
                .txfflsh()
                .set_bit()
        });
        startup::wait_for(READS, || core.grstctl().read().txfflsh().bit_is_clear());
    }
}

/// Sets the data PID of an endpoint to DATA0 (section 57.14.53, SD0PID).
fn start_with_data0(endpoint: u8) {
    // SAFETY: the superloop is the only user of the core, and this runs in it.
    let device = unsafe { &*OTG2_HS_DEVICE::PTR };
    let _ = match endpoint {
        NOTIFICATION => device
            .diep1()
            .ctl()
            .modify(|_, w| w.sd0pid_sevnfrm().set_bit()),
        BULK_IN => device
            .diep2()
            .ctl()
            .modify(|_, w| w.sd0pid_sevnfrm().set_bit()),
        BULK_OUT => device
            .doep1()
            .ctl()
            .modify(|_, w| w.sd0pid_sevnfrm().set_bit()),
        _ => 0,
    };
}
