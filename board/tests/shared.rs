//! Every interleaving of an interrupt and the superloop on what they share without a lock
//! (`src/shared.rs`), with loom's atomic types in place of the processor's. loom runs each test
//! once for each order of the accesses that the memory model permits, which are more than
//! interrupts can make on one core.

/// loom's types, for `src/shared.rs`.
mod atomics {
    pub use loom::sync::atomic::{AtomicBool, AtomicU32, Ordering};
}

#[path = "../src/shared.rs"]
mod shared;

use atomics::{AtomicBool, AtomicU32, Ordering};
use control::UnitIndex;
use loom::sync::{Arc, Mutex};
use loom::thread::spawn;
use shared::{Call, Requests, Setting, Tick, Word};

/// Two ticks and two looks at the flag: a tick is taken, or it still waits; and what was counted
/// before it is seen with it.
#[test]
fn no_tick_is_lost_and_what_was_before_it_is_seen() {
    loom::model(|| {
        let shared = Arc::new((
            Tick::of(AtomicBool::new(false)),
            Word::of(AtomicU32::new(0)),
        ));
        let handler = {
            let shared = shared.clone();
            spawn(move || {
                for _ in 0..2 {
                    shared.1.count();
                    shared.0.set();
                }
            })
        };
        let mut taken = 0;
        for _ in 0..2 {
            if shared.0.take() {
                taken += 1;
                assert!(shared.1.get() >= taken, "a tick without what was before it");
            }
        }
        handler.join().unwrap();
        assert!(taken > 0 || shared.0.waits(), "both ticks are lost");
        if shared.0.take() {
            assert_eq!(shared.1.get(), 2);
        }
        assert!(!shared.0.waits(), "a tick that was taken waits again");
    });
}

/// The superloop asks twice while the handler takes: the last request for each unit decides, and no
/// request is lost.
fn last_request_decides(first_starts: bool) {
    loom::model(move || {
        let requests = Arc::new(Requests::of(AtomicU32::new(0)));
        // What the handler has made of unit 3 (`true`: started), and of unit 5.
        let state = Arc::new(Mutex::new([None; 2]));
        let take = |requests: &Requests, state: &Mutex<[Option<bool>; 2]>| {
            let (start, stop) = requests.take();
            let both = start.iter().any(|unit| stop.contains(unit));
            assert!(!both, "start and stop at once");
            let mut state = state.lock().unwrap();
            for (slot, unit) in state.iter_mut().zip([UnitIndex::Unit3, UnitIndex::Unit5]) {
                if stop.contains(unit) {
                    *slot = Some(false);
                }
                if start.contains(unit) {
                    *slot = Some(true);
                }
            }
        };
        let handler = {
            let (requests, state) = (requests.clone(), state.clone());
            spawn(move || take(&requests, &state))
        };
        let ask = |unit, starts| {
            if starts {
                requests.start(unit);
            } else {
                requests.stop(unit);
            }
        };
        ask(UnitIndex::Unit3, first_starts);
        ask(UnitIndex::Unit5, first_starts);
        ask(UnitIndex::Unit3, !first_starts);
        handler.join().unwrap();
        // The next millisecond.
        take(&requests, &state);
        assert_eq!(
            *state.lock().unwrap(),
            [Some(!first_starts), Some(first_starts)]
        );
    });
}

#[test]
fn the_last_of_start_and_stop_decides() {
    last_request_decides(true);
    last_request_decides(false);
}

/// A count that handlers raise only grows for its reader, and arrives whole; a setting arrives.
#[test]
fn a_count_only_grows_and_a_setting_arrives() {
    loom::model(|| {
        let shared = Arc::new((
            Word::of(AtomicU32::new(u32::MAX)),
            Setting::of(AtomicBool::new(true)),
        ));
        let handler = {
            let shared = shared.clone();
            spawn(move || {
                shared.0.count();
                let setting = shared.1.get();
                shared.0.count();
                // Once it is off it stays off.
                assert!(setting || !shared.1.get());
            })
        };
        shared.1.set(false);
        let since = |value: u32| value.wrapping_sub(u32::MAX);
        let (first, second) = (since(shared.0.get()), since(shared.0.get()));
        assert!(first <= second && second <= 2, "{first}, {second}");
        handler.join().unwrap();
        assert_eq!(since(shared.0.get()), 2);
        assert!(!shared.1.get());
    });
}

/// An interrupt line with its mask, as the NVIC has it: a handler runs when the line is up and not
/// masked.
struct Line {
    masked: AtomicBool,
    events: AtomicU32,
    /// One handler at a time.
    core: Mutex<()>,
}

impl Line {
    fn interrupt(&self, call: &Call) {
        let _core = self.core.lock().unwrap();
        if self.events.load(Ordering::SeqCst) > 0 && !self.masked.load(Ordering::SeqCst) {
            call.raise(|| self.masked.store(true, Ordering::SeqCst));
        }
    }
}

/// A peripheral has two events while the superloop serves: none is left behind with no call.
#[test]
fn no_event_is_left_without_a_call() {
    loom::model(|| {
        let shared = Arc::new((
            Call::of(AtomicBool::new(false)),
            Line {
                masked: AtomicBool::new(false),
                events: AtomicU32::new(0),
                core: Mutex::new(()),
            },
        ));
        let device = {
            let shared = shared.clone();
            spawn(move || {
                let (call, line) = &*shared;
                for _ in 0..2 {
                    line.events.fetch_add(1, Ordering::SeqCst);
                    line.interrupt(call);
                }
            })
        };
        let (call, line) = &*shared;
        let serve = || {
            line.events.swap(0, Ordering::SeqCst);
            call.served(|| line.masked.store(false, Ordering::SeqCst));
            // The line may still be up.
            line.interrupt(call);
        };
        if call.waits() {
            serve();
        }
        device.join().unwrap();
        if line.events.load(Ordering::SeqCst) > 0 {
            assert!(call.waits(), "an event that nobody serves");
        }
        if call.waits() {
            serve();
        }
        assert_eq!(line.events.load(Ordering::SeqCst), 0);
        assert!(!line.masked.load(Ordering::SeqCst), "masked for ever");
    });
}
