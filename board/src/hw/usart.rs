//! USART3, the second link: the ST-Link's virtual COM port at 2,000,000 baud, 8N1.
//!
//! Owner: the superloop, except for the end of a sending transfer (DMA_STR0, level `LINKS`), which releases
//! what was sent and starts the next piece, so the line is never idle while something waits.
//!
//! Sending: DMA1 stream 0 straight out of the queue's memory, a contiguous piece at a time. Receiving: DMA1
//! stream 1 into a ring that the superloop reads at least once a millisecond; a millisecond is 200 bytes at
//! this rate, the ring holds 2,048. Both are in AXI SRAM, which DMA1 reaches.
//!
//! A missed deadline: when the superloop is late by 10 ms, received bytes are overwritten, the frame's CRC
//! fails and the host retries. When the host does not read, nothing happens here: the queue fills and
//! frames are dropped and counted.

use super::pac::{self, interrupt, DMA1, DMAMUX1, USART3};
use super::startup;
use crate::clocks;
use bbqueue::nicknames::Churrasco;
use bbqueue::prod_cons::stream::{StreamConsumer, StreamGrantR, StreamProducer};
use core::cell::UnsafeCell;
use core::sync::atomic::{compiler_fence, Ordering};

/// Bytes of a telemetry queue: 20 ms of this line, ten of the longest frames.
pub const QUEUE: usize = 4096;

/// A telemetry queue.
pub type Queue = Churrasco<QUEUE>;
/// Where frames go in.
pub type Producer = StreamProducer<&'static Queue>;
/// Where bytes come out.
pub type Consumer = StreamConsumer<&'static Queue>;
type Grant = StreamGrantR<&'static Queue>;

const RING: usize = 2048;

/// The receiving ring. Written by DMA, read by the superloop.
#[repr(align(32))]
struct Ring(UnsafeCell<[u8; RING]>);
// SAFETY: read through volatile accesses by thread mode only.
unsafe impl Sync for Ring {}

static RECEIVED: Ring = Ring(UnsafeCell::new([0; RING]));
static SENT: Queue = Queue::new();

/// The sending side, shared by the superloop (interrupts masked) and DMA_STR0.
struct Sender {
    consumer: Consumer,
    /// What the DMA is reading: released when it has ended.
    grant: Option<Grant>,
}

struct Shared(UnsafeCell<Option<Sender>>);
// SAFETY: used with interrupts masked, or in the one handler that thread mode cannot interrupt.
unsafe impl Sync for Shared {}
static SENDER: Shared = Shared(UnsafeCell::new(None));

/// DMAMUX1 requests (section 18.3.2, table of inputs).
const REQUEST_RX: u8 = 45;
const REQUEST_TX: u8 = 46;

/// The superloop's end.
pub struct Usart {
    taken: usize,
}

fn dma() -> &'static pac::dma1::RegisterBlock {
    // SAFETY: stream 0 is used by the holder of SENDER, stream 1 by `Usart`.
    unsafe { &*DMA1::PTR }
}

/// Sets line and streams up.
pub fn start(usart: &USART3, dmamux: &DMAMUX1) -> (Usart, Producer) {
    // SAFETY: interrupts of this module are still masked.
    unsafe {
        *SENDER.0.get() = Some(Sender {
            consumer: SENT.stream_consumer(),
            grant: None,
        })
    };

    // Baud, DMA, no overrun: all with UE = 0 (section 48.5). The FIFO hides the DMA's latency.
    usart.brr().write(|w| w.brr().set(clocks::USART3_BRR));
    usart
        .cr3()
        .write(|w| w.dmat().enabled().dmar().enabled().ovrdis().disabled());
    usart
        .cr1()
        .write(|w| w.fifoen().enabled().te().enabled().re().enabled());
    usart.cr1().modify(|_, w| w.ue().enabled());

    // Streams (section 16.3.18, configuration procedure) with EN = 0 as reset leaves them.
    // SAFETY: request number of USART3's transmitter.
    dmamux
        .ccr(0)
        .write(|w| unsafe { w.bits(u32::from(REQUEST_TX)) });
    // SAFETY: request number of USART3's receiver.
    dmamux
        .ccr(1)
        .write(|w| unsafe { w.bits(u32::from(REQUEST_RX)) });
    let send = dma().st(0);
    // SAFETY: address of this peripheral's transmit data register.
    send.par()
        .write(|w| unsafe { w.bits(usart.tdr().as_ptr() as u32) });
    let receive = dma().st(1);
    // SAFETY: address of this peripheral's receive data register.
    receive
        .par()
        .write(|w| unsafe { w.bits(usart.rdr().as_ptr() as u32) });
    // SAFETY: AXI SRAM, RING bytes that nothing else writes.
    receive
        .m0ar()
        .write(|w| unsafe { w.bits(RECEIVED.0.get() as u32) });
    receive.ndtr().write(|w| w.ndt().set(RING as u16));
    receive.cr().write(|w| {
        w.dir()
            .peripheral_to_memory()
            .minc()
            .incremented()
            .circ()
            .enabled()
            .pl()
            .high()
    });
    receive.cr().modify(|_, w| w.en().enabled());
    startup::unmask(pac::Interrupt::DMA_STR0);
    (Usart { taken: 0 }, SENT.stream_producer())
}

impl Usart {
    /// Hands over what has been received, byte by byte, at most `limit` of them.
    pub fn receive(&mut self, limit: usize, mut take: impl FnMut(u8)) {
        let left = usize::from(dma().st(1).ndtr().read().ndt().bits());
        let head = (RING - left) % RING;
        for _ in 0..limit {
            if self.taken == head {
                return;
            }
            // SAFETY: within the ring; the DMA writes ahead of `head`, not here.
            let byte = unsafe {
                RECEIVED
                    .0
                    .get()
                    .cast::<u8>()
                    .add(self.taken)
                    .read_volatile()
            };
            self.taken = (self.taken + 1) % RING;
            take(byte);
        }
    }

    /// Starts sending if something waits and the line is idle.
    pub fn send(&mut self) {
        cortex_m::interrupt::free(|_| {
            // SAFETY: interrupts are masked and thread mode is here.
            if let Some(sender) = unsafe { &mut *SENDER.0.get() } {
                sender.start();
            }
        });
    }
}

impl Sender {
    fn start(&mut self) {
        if self.grant.is_some() {
            return;
        }
        let Ok(grant) = self.consumer.read() else {
            return;
        };
        let stream = dma().st(0);
        // A stream starts only with its flags clear (section 16.3.18).
        dma().lifcr().write(|w| {
            w.ctcif0()
                .clear()
                .chtif0()
                .clear()
                .cteif0()
                .clear()
                .cdmeif0()
                .clear()
                .cfeif0()
                .clear()
        });
        // SAFETY: the grant's bytes, which stay untouched until it is released after the transfer.
        stream
            .m0ar()
            .write(|w| unsafe { w.bits(grant.as_ptr() as u32) });
        stream.ndtr().write(|w| w.ndt().set(grant.len() as u16));
        compiler_fence(Ordering::SeqCst);
        stream.cr().write(|w| {
            w.dir()
                .memory_to_peripheral()
                .minc()
                .incremented()
                .tcie()
                .enabled()
                .teie()
                .enabled()
                .en()
                .enabled()
        });
        self.grant = Some(grant);
    }
}

#[interrupt]
fn DMA_STR0() {
    // SAFETY: thread mode cannot run meanwhile, and holds no reference outside its masked sections.
    let Some(sender) = (unsafe { &mut *SENDER.0.get() }) else {
        return;
    };
    dma().lifcr().write(|w| {
        w.ctcif0()
            .clear()
            .chtif0()
            .clear()
            .cteif0()
            .clear()
            .cdmeif0()
            .clear()
            .cfeif0()
            .clear()
    });
    if let Some(grant) = sender.grant.take() {
        // Sent, or lost to a transfer error, which the host's CRC or sequence number shows.
        let length = grant.len();
        grant.release(length);
    }
    sender.start();
}
