//! I2C1 with a wire that can be held: the engine's controller, kept from sending a START while SDA is low.
//!
//! The engine's own model drives every edge itself and does not know a bus that another device holds. On the part a
//! START that finds SDA low never leaves: BUSY stands, no flag and no interrupt follows (RM0433 rev 9 section
//! 47.4.9: the controller waits for a free bus). Clearing PE is the only way out.

use super::peers::Shared;
use rigless::device::{Device, DeviceContext, RegisterFile, RequestChange};
use rigless::soc::stm32h743::generated::i2c1::{cr1, cr2, isr, Register};
use rigless::soc::stm32h743::peripherals::i2c::I2c;
use rigless::time::{EventId, VirtualNanos};

/// See the module's page.
#[derive(Debug)]
pub struct HeldI2c {
    inner: I2c,
    board: Shared,
}

impl HeldI2c {
    /// The controller with the board's bus on its wires.
    pub fn new(board: &Shared) -> Self {
        let mut inner = I2c::default();
        inner.attach(super::peers::SensorBus(board.clone()));
        Self {
            inner,
            board: board.clone(),
        }
    }
}

impl Device for HeldI2c {
    type Register = Register;

    fn read(
        &mut self,
        register: Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        Device::read(&mut self.inner, register, registers, context)
    }

    fn peek(&self, register: Register, registers: &RegisterFile, now: VirtualNanos) -> Option<u64> {
        Device::peek(&self.inner, register, registers, now)
    }

    fn write(
        &mut self,
        register: Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if register == Register::Cr2 && cr2::START.is_set(value) {
            let free = !isr::BUSY.is_set(registers.get(Register::Isr));
            let enabled = cr1::PE.is_set(registers.get(Register::Cr1));
            let mut board = self.board.lock();
            if enabled && free && board.sda_held() {
                let flags = registers.get(Register::Isr) | isr::BUSY.mask();
                registers.set(Register::Isr, flags);
                return;
            }
            if enabled {
                let address = (value >> 1 & 0x7F) as u8;
                board.i2c_begins(context.now().0, address);
            }
        }
        Device::write(&mut self.inner, register, value, registers, context);
    }

    fn on_event(
        &mut self,
        event: EventId,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        Device::on_event(&mut self.inner, event, registers, context);
    }

    fn on_request(
        &mut self,
        request: RequestChange,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        Device::on_request(&mut self.inner, request, registers, context);
    }

    fn on_clock(&mut self, hz: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        Device::on_clock(&mut self.inner, hz, registers, context);
    }

    fn reset(&mut self) {
        Device::reset(&mut self.inner);
    }

    fn reset_line(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        Device::reset_line(&mut self.inner, registers, context);
    }
}
