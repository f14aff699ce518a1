//! Our bring-up of a NAU7802 on the model of the chip, in every variant of it that drivers which
//! work on silicon allow for.

use drivers::nau7802::{Action, Bringup, Config, Event, Rate, SequenceError};
use emulator::devices::nau7802::Nau7802;
use emulator::devices::Complaints;

/// A transaction of two bytes at 340 kHz, ns.
const TRANSACTION_NS: u64 = 90_000;

/// The converter with a bridge that gives nothing, and its time.
struct Stand {
    chip: Nau7802,
    now_ns: u64,
    complaints: Complaints,
}

impl Stand {
    fn new(seed: u64, bits: u8) -> Self {
        let mut chip = Nau7802::new(1, seed);
        let on = |bit: u8| bits >> bit & 1 == 1;
        let variant = chip.defects();
        variant.starts_slowly = on(0);
        variant.free_runs = on(1);
        variant.reports_unsettled = on(2);
        variant.keeps_ready = on(3);
        variant.latches_at_pointer = on(4);
        Self {
            chip,
            now_ns: 0,
            complaints: Complaints::default(),
        }
    }

    fn pass(&mut self, ns: u64) {
        let end = self.now_ns + ns;
        while let Some(at) = self.chip.next_event().filter(|at| *at <= end) {
            self.chip.advance(at, |_, _| 0.0);
        }
        self.now_ns = end;
    }

    fn write(&mut self, bytes: &[u8]) {
        self.pass(TRANSACTION_NS);
        let (now_ns, complaints) = (self.now_ns, &mut self.complaints);
        assert!(self.chip.start(false, now_ns, complaints));
        for byte in bytes {
            assert!(self.chip.write(*byte, now_ns, complaints));
        }
    }

    /// Carries out a sequence to its end.
    fn run(&mut self, mut sequence: Bringup) -> Result<(), SequenceError> {
        let mut event = Event::Start;
        loop {
            event = match sequence.next(event) {
                Action::Write(bytes) => {
                    self.write(&bytes);
                    self.chip.stop();
                    Event::Written
                }
                Action::WriteRead(pointer) => {
                    self.write(&pointer);
                    assert!(self.chip.start(true, self.now_ns, &mut self.complaints));
                    let byte = self.chip.read(self.now_ns);
                    self.chip.stop();
                    Event::Read(byte)
                }
                Action::WaitUs(us) => {
                    self.pass(1_000 * u64::from(us));
                    Event::Waited
                }
                Action::Done => return Ok(()),
                Action::Failed(error) => return Err(error),
            };
        }
    }
}

/// At the rate of a force unit, and at the slowest one, whose analog part is ready after 600 ms and
/// has given ten results after 2.3 s.
#[test]
fn a_converter_comes_up_at_its_first_calibration_in_every_variant() {
    for rate in [Rate::Sps320, Rate::Sps10] {
        let config = Config {
            rate,
            ..Config::FORCE_UNIT
        };
        for bits in 0..32 {
            let mut stand = Stand::new(u64::from(bits), bits);
            let came_up = stand.run(Bringup::new(config));
            assert_eq!(came_up, Ok(()), "{rate:?}, variants {bits:05b}");
            // A calibration that fails is repeated; none did.
            assert!(
                stand.now_ns < 1_000 * u64::from(config.supply_wait_us()) + 380_000_000,
                "{rate:?}, variants {bits:05b}: {} ns",
                stand.now_ns
            );
            assert!(stand.chip.is_calibrated());
            assert!(stand.complaints.is_empty(), "{:?}", stand.complaints);
        }
    }
}
