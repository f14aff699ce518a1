//! USART3, the second link: the ST-Link's virtual COM port at 2,000,000 baud, 8N1.
//!
//! Owner: the superloop, except for the end of a sending transfer (DMA_STR0, level `LINKS`), which
//! releases what was sent and starts the next piece, so the line is never idle while something
//! waits.
//!
//! Sending: DMA1 stream 0 straight out of the queue's memory, a contiguous piece at a time.
//! Receiving: DMA1 stream 1 into a ring that the superloop reads at least once a millisecond; a
//! millisecond is 200 bytes at this rate, the ring holds 2,048. Both are in AXI SRAM, which DMA1
//! reaches.
//!
//! A missed deadline: when the superloop is late by 10 ms, received bytes are overwritten, the
//! frame's CRC fails and the host retries. A stream that moves nothing for [`STALL_US`] although
//! bytes wait is restarted where it stands. On silicon from revision X on, streams that serve a
//! USART can lock up unless TRBUFF is set (ES0392 2.20.4); the restart is for whatever is left.
//! When the host does not read, nothing happens here: the queue fills and frames are dropped and
//! counted.

use super::pac::{self, interrupt, DMA1, DMAMUX1, USART3};
use super::startup;
use crate::clocks;
use bbqueue::nicknames::Churrasco;
use bbqueue::prod_cons::stream::{StreamConsumer, StreamGrantR, StreamProducer};
use control::Micros;
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

/// Time without a byte after which a stream counts as stalled, in microseconds: 400 bytes of the
/// line.
pub const STALL_US: u32 = 2_000;

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
    /// TRBUFF, where the silicon has it.
    trbuff: u32,
    /// Bytes that were left at the last progress, and its time.
    progress: (u16, Micros),
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
    trbuff: u32,
    /// Bytes left in the receiving stream at its last progress, and its time.
    progress: (u16, Micros),
}

fn dma() -> &'static pac::dma1::RegisterBlock {
    // SAFETY: stream 0 is used by the holder of SENDER, stream 1 by `Usart`.
    unsafe { &*DMA1::PTR }
}

/// Sets line and streams up.
pub fn start(usart: &USART3, dmamux: &DMAMUX1, silicon: u16) -> (Usart, Producer) {
    let trbuff = clocks::dma_trbuff(silicon);
    // SAFETY: interrupts of this module are still masked.
    unsafe {
        *SENDER.0.get() = Some(Sender {
            consumer: SENT.stream_consumer(),
            grant: None,
            trbuff,
            progress: (0, Micros::default()),
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
    start_receiver(trbuff);
    startup::unmask(pac::Interrupt::DMA_STR0);
    let usart = Usart {
        taken: 0,
        trbuff,
        progress: (0, Micros::default()),
    };
    (usart, SENT.stream_producer())
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

    /// Starts sending if something waits and the line is idle; restarts streams that have stalled.
    pub fn send(&mut self, now: Micros) {
        cortex_m::interrupt::free(|_| {
            // SAFETY: interrupts are masked and thread mode is here.
            if let Some(sender) = unsafe { &mut *SENDER.0.get() } {
                sender.restart_if_stalled(now);
                sender.start(now);
            }
        });
        self.restart_if_stalled(now);
    }

    /// Sets the receiving stream up again after one of its registers had changed. What was in the
    /// ring is lost: the frame's CRC shows it.
    pub fn restart_receiver(&mut self) {
        stop(1);
        clear_flags(1);
        start_receiver(self.trbuff);
        self.taken = 0;
    }

    /// Restarts the receiving stream if a byte waits in the receiver's FIFO and the stream does not
    /// take it.
    fn restart_if_stalled(&mut self, now: Micros) {
        let stream = dma().st(1);
        let left = stream.ndtr().read().ndt().bits();
        // SAFETY: read-only access to a status register.
        let waits = unsafe { (*USART3::PTR).isr().read().rxne().bit_is_set() };
        if left != self.progress.0 || !waits {
            self.progress = (left, now);
        } else if now.since(self.progress.1) > STALL_US {
            self.progress.1 = now;
            stop(1);
            // The ring starts anew, and what was in it has been taken.
            stream.ndtr().write(|w| w.ndt().set(RING as u16));
            self.taken = 0;
            clear_flags(1);
            stream.cr().modify(|_, w| w.en().enabled());
        }
    }
}

/// Sets the receiving stream up from the beginning of the ring, and enables it; EN must be 0.
fn start_receiver(trbuff: u32) {
    let receive = dma().st(1);
    // SAFETY: an address only.
    let rdr = unsafe { (*USART3::PTR).rdr().as_ptr() };
    // SAFETY: address of this peripheral's receive data register.
    receive.par().write(|w| unsafe { w.bits(rdr as u32) });
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
    // SAFETY: one bit of the control register, which this register description lacks (section
    // 15.5.5).
    receive
        .cr()
        .modify(|r, w| unsafe { w.bits(r.bits() | trbuff) });
    receive.cr().modify(|_, w| w.en().enabled());
}

/// Disables a stream and waits until it is (section 15.3.18).
fn stop(stream: usize) {
    dma().st(stream).cr().modify(|_, w| w.en().disabled());
    startup::wait_for(1_000, || dma().st(stream).cr().read().en().bit_is_clear());
}

/// Clears all flags of stream 0 or 1. A stream starts only with its flags clear (section 15.3.18).
fn clear_flags(stream: usize) {
    const ALL: u32 = 0x3D;
    // SAFETY: flag bits of one stream (section 15.5.3); writing 1 clears them.
    dma()
        .lifcr()
        .write(|w| unsafe { w.bits(ALL << (6 * stream)) });
}

impl Sender {
    fn start(&mut self, now: Micros) {
        if self.grant.is_some() {
            return;
        }
        let Ok(grant) = self.consumer.read() else {
            return;
        };
        let (first, length) = (grant.as_ptr() as u32, grant.len() as u16);
        self.grant = Some(grant);
        self.begin(first, length, now);
    }

    /// Starts the transfer of `length` bytes of the grant, from `first` on.
    fn begin(&mut self, first: u32, length: u16, now: Micros) {
        let stream = dma().st(0);
        clear_flags(0);
        // SAFETY: the grant's bytes, which stay untouched until it is released after the transfer.
        stream.m0ar().write(|w| unsafe { w.bits(first) });
        stream.ndtr().write(|w| w.ndt().set(length));
        compiler_fence(Ordering::SeqCst);
        // SAFETY: TRBUFF in a word of fields that exist.
        stream.cr().write(|w| unsafe {
            w.bits(self.trbuff)
                .dir()
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
        self.progress = (length, now);
    }

    /// Goes on with the rest of a transfer that has not moved a byte for [`STALL_US`].
    fn restart_if_stalled(&mut self, now: Micros) {
        let Some(grant) = &self.grant else {
            return;
        };
        let (first, length) = (grant.as_ptr() as u32, grant.len() as u16);
        let left = dma().st(0).ndtr().read().ndt().bits();
        if left != self.progress.0 || left == 0 {
            self.progress = (left, now);
        } else if now.since(self.progress.1) > STALL_US {
            stop(0);
            let sent = length.saturating_sub(left);
            self.begin(first + u32::from(sent), left, now);
        }
    }
}

#[interrupt]
fn DMA_STR0() {
    // SAFETY: thread mode cannot run meanwhile, and holds no reference outside its masked sections.
    let Some(sender) = (unsafe { &mut *SENDER.0.get() }) else {
        return;
    };
    let flags = dma().lisr().read();
    if flags.tcif0().bit_is_clear() && flags.teif0().bit_is_clear() {
        // Left pending by a stream that was stopped and started again.
        return;
    }
    clear_flags(0);
    if let Some(grant) = sender.grant.take() {
        // Sent, or lost to a transfer error, which the host's CRC or sequence number shows.
        let length = grant.len();
        grant.release(length);
    }
    sender.start(super::time::now());
}
