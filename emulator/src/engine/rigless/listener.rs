//! The readers of requests; each receives only the requests that can reach it.
//!
//! The engine announces every change of every request line to some thirty instances, and each finds
//! out by comparing names that it is not meant. A byte that DMA brings to a serial line is eight
//! such changes, so a board that streams spends most of the host's time there. The wiring is fixed
//! (RM0433 rev 9 section 17.3), so the receiver of each request is known in advance: the models
//! stay the engine's, the filter is in front.

use super::dma_guard::{Guard, Routes};
use super::peers::Shared;
use rigless::chip::spi::Peer;
use rigless::device::{
    DeviceContext, ErasedDevice, InterruptChange, Level, RegisterFile, RequestChange,
};
use rigless::emulator::InterruptLine;
use rigless::soc::stm32h743::generated::{dma1, spi1, SYSCFG};
use rigless::soc::stm32h743::peripherals::adc::{Adc, AdcCommon, Block, Converter};
use rigless::soc::stm32h743::peripherals::bdma::Bdma;
use rigless::soc::stm32h743::peripherals::dma::{Dma, DMA1_FIRST_CHANNEL, DMA2_FIRST_CHANNEL};
use rigless::soc::stm32h743::peripherals::dmamux::{Dmamux1, Dmamux2};
use rigless::soc::stm32h743::peripherals::exti::Exti;
use rigless::soc::stm32h743::peripherals::spi::{self, Spi};
use rigless::soc::stm32h743::peripherals::tim::{
    self, Tim, ADVANCED_TIMERS, BASIC_TIMERS, TIMERS, TIMER_15, TIMER_16, TIMER_17,
};
use rigless::soc::{RegisterSpec, Width};
use rigless::time::{EventId, VirtualNanos};
use std::fmt;

/// Requests of DMAMUX1 as a driver: channel outputs, then events, then acknowledges of its inputs.
const MUX_CHANNELS: usize = 16;
const MUX_ACKNOWLEDGES: usize = 32;
/// Streams of a DMA controller.
const STREAMS: usize = 8;

/// Which requests can reach a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Receives {
    /// A serial interface whose peers' selects are not the engine's business.
    Nothing,
    /// Acknowledges of DMAMUX1's inputs.
    Acknowledges,
    /// Peripherals, the controllers' acknowledges and the events of the first multiplexer itself.
    FirstMultiplexer,
    /// The same for the second multiplexer, which has no USART, no pin and nothing of the first.
    SecondMultiplexer,
    /// Channel outputs of DMAMUX1 from this one, one per stream.
    Channels(usize),
    /// Channel outputs of DMAMUX2.
    SecondChannels,
    /// Converters and their common blocks.
    Converters,
    /// The levels of the ports' pins.
    Pins,
}

impl Receives {
    fn receives(self, change: &RequestChange) -> bool {
        let by = change.instance;
        match self {
            Self::Nothing => false,
            Self::Acknowledges => {
                by == "DMAMUX1"
                    && change.request >= MUX_ACKNOWLEDGES
                    && timer_input(change.request - MUX_ACKNOWLEDGES)
            }
            Self::FirstMultiplexer => match by {
                "DMAMUX1" => (MUX_CHANNELS..MUX_ACKNOWLEDGES).contains(&change.request),
                "DMA1" | "DMA2" => change.level == Level::High,
                _ => !by.starts_with("GPIO"),
            },
            Self::SecondMultiplexer => {
                !matches!(by, "DMAMUX1" | "DMA1" | "DMA2" | "USART3") && !by.starts_with("GPIO")
            }
            Self::Channels(first) => {
                by == "DMAMUX1" && (first..first + STREAMS).contains(&change.request)
            }
            Self::SecondChannels => by == "DMAMUX2",
            Self::Converters => by.starts_with("ADC"),
            Self::Pins => by.starts_with("GPIO"),
        }
    }
}

/// Whether input `id` of DMAMUX1 is a timer's (RM0433 rev 9 table 124; the gaps between a timer's
/// own inputs are let through).
const fn timer_input(id: usize) -> bool {
    matches!(id, 11..=32 | 47..=60 | 69..=70 | 105..=112)
}

/// One of the engine's models behind its filter.
pub struct Listener {
    /// The instance that the model answers for.
    pub instance: &'static str,
    model: Box<dyn ErasedDevice + Send>,
    receives: Receives,
    guard: Option<Guard>,
}

impl fmt::Debug for Listener {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Listener")
            .field("instance", &self.instance)
            .field("receives", &self.receives)
            .finish_non_exhaustive()
    }
}

/// Every reader of requests as a power-on or a system reset leaves it, but the clock controller,
/// which the part keeps. `peer` hangs on the interface of its name.
pub fn fresh(peer: (&'static str, impl Peer + 'static), board: &Shared) -> Vec<Listener> {
    let mut all = Vec::new();
    let mut add = |instance, model: Box<dyn ErasedDevice + Send>, receives| {
        all.push(Listener {
            instance,
            model,
            receives,
            guard: None,
        });
    };
    let mut peer = Some(peer);
    for interface in &spi::INSTANCES {
        let mut model = Spi::new(interface.kind);
        if let Some((_, peer)) = peer.take_if(|(name, _)| *name == interface.name) {
            model.attach(peer);
        }
        add(interface.name, Box::new(model), Receives::Nothing);
    }
    for timer in TIMERS {
        let model: Tim<tim::General> = Tim::new(timer);
        add(timer.instance, Box::new(model), Receives::Acknowledges);
    }
    for timer in ADVANCED_TIMERS {
        let model: Tim<tim::Advanced> = Tim::new(timer);
        add(timer.instance, Box::new(model), Receives::Acknowledges);
    }
    for timer in BASIC_TIMERS {
        let model: Tim<tim::Basic> = Tim::new(timer);
        add(timer.instance, Box::new(model), Receives::Acknowledges);
    }
    let (tim15, tim16, tim17): (Tim<tim::Tim15>, Tim<tim::Tim16>, Tim<tim::Tim17>) =
        (Tim::new(TIMER_15), Tim::new(TIMER_16), Tim::new(TIMER_17));
    add(TIMER_15.instance, Box::new(tim15), Receives::Acknowledges);
    add(TIMER_16.instance, Box::new(tim16), Receives::Acknowledges);
    add(TIMER_17.instance, Box::new(tim17), Receives::Acknowledges);
    add(
        "DMAMUX1",
        Box::new(Dmamux1::new()),
        Receives::FirstMultiplexer,
    );
    add(
        "DMAMUX2",
        Box::new(Dmamux2::new()),
        Receives::SecondMultiplexer,
    );
    for (instance, first) in [("DMA1", DMA1_FIRST_CHANNEL), ("DMA2", DMA2_FIRST_CHANNEL)] {
        add(
            instance,
            Box::new(Dma::new(first)),
            Receives::Channels(first),
        );
    }
    add("BDMA", Box::new(Bdma::new()), Receives::SecondChannels);
    // Out of reset the converters' kernel clock stands still (section 8.7.22: PLL2, which is off).
    let third = Converter::Adc3;
    add(
        third.instance(),
        Box::new(Adc::new(third, 0)),
        Receives::Converters,
    );
    for block in Block::ALL {
        let model = AdcCommon::new(block, 0);
        add(block.instance(), Box::new(model), Receives::Converters);
    }
    add("EXTI", Box::new(Exti::new(SYSCFG.base)), Receives::Pins);
    let routes = Routes::default();
    for listener in &mut all {
        listener.guard = match listener.instance {
            "DMAMUX1" => Some(Guard::Multiplexer(routes.clone())),
            "DMA1" => Some(Guard::controller(routes.clone(), board.clone())),
            "SPI1" => Some(Guard::Spi(board.clone())),
            _ => None,
        };
    }
    all
}

impl ErasedDevice for Listener {
    fn layout(&self) -> &'static [RegisterSpec] {
        self.model.layout()
    }

    fn read(
        &mut self,
        row: usize,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        self.model.read(row, registers, context)
    }

    fn peek(&self, row: usize, registers: &RegisterFile, now: VirtualNanos) -> Option<u64> {
        self.model.peek(row, registers, now)
    }

    fn write(
        &mut self,
        row: usize,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let Some(guard) = &mut self.guard else {
            return self.model.write(row, value, registers, context);
        };
        let guarded = guard.write(row, value);
        if let Some(reason) = guarded.refused {
            context.tell("SxCR", reason);
            // The register file holds what the core wrote already.
            registers.set(dma1::Register::ALL[row], guarded.value);
        }
        if guarded.value != value && self.instance == "SPI1" {
            // A start that did nothing is not under way.
            registers.set(spi1::Register::Cr1, guarded.value);
        }
        self.model.write(row, guarded.value, registers, context);
        if let Some(request) = guarded.released {
            self.model.on_request(request, registers, context);
        }
    }

    fn on_event(
        &mut self,
        event: EventId,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.model.on_event(event, registers, context);
    }

    fn on_request(
        &mut self,
        request: RequestChange,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let first = match self.receives {
            Receives::Channels(first) => first,
            _ => 0,
        };
        let passes = |guard: &mut Guard| guard.passes(first, &request);
        if self.receives.receives(&request) && self.guard.as_mut().is_none_or(passes) {
            self.model.on_request(request, registers, context);
        }
    }

    fn on_interrupt(
        &mut self,
        change: InterruptChange,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.model.on_interrupt(change, registers, context);
    }

    fn acknowledge_interrupt(
        &mut self,
        line: InterruptLine,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        self.model.acknowledge_interrupt(line, registers, context)
    }

    fn on_clock(&mut self, hz: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.model.on_clock(hz, registers, context);
    }

    fn on_clock_input(
        &mut self,
        input: usize,
        hz: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.model.on_clock_input(input, hz, registers, context);
    }

    fn poll(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.model.poll(registers, context);
    }

    fn reset(&mut self) {
        self.model.reset();
    }

    fn reset_line(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.model.reset_line(registers, context);
    }

    fn on_access(
        &mut self,
        token: u64,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.model.on_access(token, value, registers, context);
    }

    fn write_region(
        &mut self,
        address: u64,
        width: Width,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> bool {
        self.model
            .write_region(address, width, value, registers, context)
    }

    fn on_refused(
        &mut self,
        token: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.model.on_refused(token, registers, context);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn change(instance: &'static str, request: usize, level: Level) -> RequestChange {
        RequestChange {
            instance,
            request,
            level,
        }
    }

    /// The way of a byte from memory to USART3 (input 46 of table 124) on stream 1, change by
    /// change.
    #[test]
    fn a_byte_by_dma_reaches_its_receiver_only() {
        let steps = [
            (
                change("USART3", 1, Level::High),
                Some(Receives::FirstMultiplexer),
            ),
            (
                change("DMAMUX1", 1, Level::High),
                Some(Receives::Channels(0)),
            ),
            (
                change("DMA1", 1, Level::High),
                Some(Receives::FirstMultiplexer),
            ),
            (change("DMA1", 1, Level::Low), None),
            (change("DMAMUX1", 32 + 46, Level::High), None),
            (
                change("DMAMUX1", 1, Level::Low),
                Some(Receives::Channels(0)),
            ),
        ];
        let all = [
            Receives::Nothing,
            Receives::Acknowledges,
            Receives::FirstMultiplexer,
            Receives::SecondMultiplexer,
            Receives::Channels(0),
            Receives::Channels(8),
            Receives::SecondChannels,
            Receives::Converters,
            Receives::Pins,
        ];
        for (change, expected) in steps {
            let received: Vec<Receives> = all.into_iter().filter(|h| h.receives(&change)).collect();
            assert_eq!(received, Vec::from_iter(expected), "{change:?}");
        }
    }

    #[test]
    fn what_concerns_the_others_gets_through() {
        // Table 124: TIM1_CH1, TIM5_TRIG, TIM8_CH1, TIM6_UP, TIM7_UP, TIM15_CH1, TIM17_UP.
        for id in [11, 60, 47, 69, 70, 105, 112] {
            assert!(Receives::Acknowledges.receives(&change("DMAMUX1", 32 + id, Level::High)));
        }
        assert!(Receives::Channels(8).receives(&change("DMAMUX1", 8, Level::High)));
        // An event of the multiplexer is a synchronization of its own channels.
        assert!(Receives::FirstMultiplexer.receives(&change("DMAMUX1", 16, Level::Low)));
        assert!(Receives::FirstMultiplexer.receives(&change("SPI1", 1, Level::Low)));
        assert!(Receives::SecondMultiplexer.receives(&change("BDMA", 0, Level::High)));
        assert!(Receives::SecondMultiplexer.receives(&change("SPI6", 0, Level::High)));
        assert!(Receives::SecondChannels.receives(&change("DMAMUX2", 0, Level::High)));
        assert!(Receives::Converters.receives(&change("ADC3_Common", 0, Level::High)));
        assert!(Receives::Pins.receives(&change("GPIOF", 6, Level::High)));
    }
}
