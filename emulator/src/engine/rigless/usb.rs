//! The second USB core's global registers (RM0433 rev 9 chapter 57), with no cable in the socket.
//!
//! Enough that a device stack comes up as it does on a bench without a host: resets and flushes finish at
//! once, the core is in device mode, nothing is ever received. Endpoints and FIFOs are not modelled; the
//! engine has no space for them.

use rigless::device::{Device, DeviceContext, RegisterFile};
use rigless::soc::stm32h743::generated::otg1_hs_global::{
    otg_hs_gintsts, otg_hs_grstctl, Register,
};

/// OTG_CID of the STM32H7: the product ID by which device stacks tell the core's generations apart
/// (section 57.14.17).
const PRODUCT_ID: u64 = 0x0000_2300;

const SELF_CLEARING: u64 = otg_hs_grstctl::CSRST.mask()
    | otg_hs_grstctl::FCRST.mask()
    | otg_hs_grstctl::RXFFLSH.mask()
    | otg_hs_grstctl::TXFFLSH.mask();

/// See the module's page.
#[derive(Debug, Default)]
pub struct IdleUsb;

impl Device for IdleUsb {
    type Register = Register;

    fn read(
        &mut self,
        register: Register,
        registers: &mut RegisterFile,
        _context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        match register {
            Register::OtgHsCid => Some(PRODUCT_ID),
            // Device mode, the transmit FIFOs empty, nothing else pending.
            Register::OtgHsGintsts => {
                Some(otg_hs_gintsts::NPTXFE.mask() | otg_hs_gintsts::PTXFE.mask())
            }
            Register::OtgHsGrstctl => {
                Some(registers.get(register) & !SELF_CLEARING | otg_hs_grstctl::AHBIDL.mask())
            }
            _ => None,
        }
    }

    fn write(
        &mut self,
        register: Register,
        _value: u64,
        registers: &mut RegisterFile,
        _context: &mut DeviceContext<'_>,
    ) {
        if register == Register::OtgHsGrstctl {
            registers.set(register, registers.get(register) & !SELF_CLEARING);
        }
    }
}
