//! What figures say, and what a record keeps of them: without a rig.

use bring_up::figures::{
    BoardFigures, ConverterFigures, EStopFigures, Figures, LoadLine, MotorFigures, PowerFigures,
    PullFigures, PulseFigures, TensionFigures,
};
use bring_up::judge::judge;
use bring_up::mistake::{Mistake, Sure};
use bring_up::record::{Identity, Record, Verdict};
use bring_up::steps::Test;
use control::Fault;
use rig::Rig;
use wire::message::Pull;
use wire::UNITS;

fn names(figures: &Figures) -> Vec<(Mistake, Sure)> {
    let found = judge(&Rig::built_in().unwrap(), figures);
    found.into_iter().map(|n| (n.mistake, n.sure)).collect()
}

/// Pulses of a unit, from 0, that turned its reel, or did not.
fn pulses(unit: usize, moved: bool) -> MotorFigures {
    let mut travel_m = [0.0; UNITS];
    travel_m[unit] = if moved { 1e-4 } else { 0.0 };
    MotorFigures {
        pulses: vec![PulseFigures {
            command_n: 1.0,
            travel_m,
            cell_n: [0.0; UNITS],
        }],
        refused: None,
        fault: 0,
    }
}

/// With the alive line unplugged: units, from 0, whose pulses turned the reel, or did not.
fn unplugged(units: &[(usize, bool)], lit: Option<bool>) -> Figures {
    let mut power = PowerFigures {
        lit_unplugged: lit,
        ..PowerFigures::default()
    };
    for (unit, moved) in units {
        power.unplugged[*unit] = Some(pulses(*unit, *moved));
    }
    Figures {
        power: Some(power),
        ..Figures::default()
    }
}

#[test]
fn one_unit_that_moves_without_power_does_not_say_how_many_do() {
    let bypassed = Mistake::RelayBypassed { units: vec![3] };
    let bridged = Mistake::RelayBridged;
    assert_eq!(
        names(&unplugged(&[(2, true)], None)),
        [
            (bypassed.clone(), Sure::Likely),
            (bridged.clone(), Sure::Likely)
        ]
    );
    // The lamp of the relay tells.
    let dark = names(&unplugged(&[(2, true)], Some(false)));
    assert_eq!(dark, [(bypassed.clone(), Sure::Certain)]);
    let lit = names(&unplugged(&[(2, true)], Some(true)));
    assert_eq!(lit, [(bridged.clone(), Sure::Certain)]);
    // So does another unit.
    let one_of_two = names(&unplugged(&[(2, true), (4, false)], None));
    assert_eq!(one_of_two, [(bypassed, Sure::Certain)]);
    let both = names(&unplugged(&[(2, true), (4, true)], None));
    assert_eq!(both, [(bridged, Sure::Certain)]);
    assert_eq!(names(&unplugged(&[(2, false)], None)), []);
}

#[test]
fn what_the_board_sees_of_the_e_stop_while_the_power_is_tested_is_judged() {
    let of = |closed_pressed, closed_released| Figures {
        power: Some(PowerFigures {
            closed_pressed,
            closed_released,
            ..PowerFigures::default()
        }),
        ..Figures::default()
    };
    assert_eq!(names(&of(Some(false), Some(true))), []);
    assert_eq!(names(&of(None, None)), []);
    let closed = names(&of(Some(true), None));
    assert_eq!(closed, [(Mistake::EStopNotRead, Sure::Certain)]);
    let open = names(&of(Some(false), Some(false)));
    assert_eq!(open, [(Mistake::EStopOpen, Sure::Certain)]);
    // Neither lets a motor be driven.
    let rig = Rig::built_in().unwrap();
    let mut record = Record::new(&rig, Identity::default());
    record.figures = of(Some(true), None);
    record.took(&rig, Test::Power, &[0], "2026-11-26");
    for test in [Test::Motors, Test::Tension] {
        let why = record.may_drive(test).unwrap_err();
        assert!(why.contains("the E-stop is not read"), "{why}");
    }
}

#[test]
fn a_test_that_is_left_out_keeps_the_date_of_before_and_no_figure_that_is_to_be_measured_anew() {
    let rig = Rig::built_in().unwrap();
    let mut record = Record::new(&rig, Identity::default());
    record.figures = unplugged(&[(1, false), (2, false)], Some(false));
    record.took(&rig, Test::Power, &[1, 2], "2026-11-20");
    // Unit 3 is tested again, and left out.
    record.forget(Test::Power, &[2]);
    let power = record.figures.power.clone().unwrap();
    assert_eq!(power.lit_unplugged, None);
    assert!(power.unplugged[1].is_some() && power.unplugged[2].is_none());
    record.took(&rig, Test::Power, &[2], "2026-11-26");
    let done = &record.tests[&Test::Power];
    let dates: Vec<_> = done.iter().map(|(unit, date)| (*unit, &**date)).collect();
    assert_eq!(dates, [(2, "2026-11-20")]);
    assert!(!record.open(&[1]).contains(&Test::Power));
    assert!(record.open(&[2]).contains(&Test::Power));
}

/// A bridged relay does not become harmless because its test was begun anew and left out.
#[test]
fn what_a_test_found_stands_until_it_has_measured_again() {
    let rig = Rig::built_in().unwrap();
    let all: Vec<usize> = (0..UNITS).collect();
    let estop = EStopFigures {
        closed_before: true,
        closed_pressed: false,
        closed_released: true,
        alive_withheld: true,
    };
    let bridged = Figures {
        estop: Some(estop),
        ..unplugged(&[], Some(true))
    };
    let mut record = Record::new(&rig, Identity::default());
    record.figures = bridged;
    record.took(&rig, Test::Power, &all, "2026-11-20");
    let refused = |record: &Record| {
        for test in [Test::Motors, Test::Tension] {
            let why = record.may_drive(test).unwrap_err();
            assert!(why.contains("relay"), "{why}");
        }
    };
    refused(&record);
    record.forget(Test::Power, &all);
    record.took(&rig, Test::Power, &all, "2026-11-26");
    refused(&record);
    // Another test, begun anew as well, changes nothing.
    record.forget(Test::Reels, &all);
    record.took(&rig, Test::Reels, &all, "2026-11-26");
    refused(&record);
    record.forget(Test::Power, &all);
    record.figures.power = unplugged(&[(0, false)], Some(false)).power;
    record.took(&rig, Test::Power, &all, "2026-11-27");
    assert_eq!(record.mistakes, []);
    assert_eq!(record.may_drive(Test::Motors), Ok(()));
}

#[test]
fn no_cable_is_loaded_without_the_pull_down_of_dac_rst() {
    let rig = Rig::built_in().unwrap();
    let mut record = Record::new(&rig, Identity::default());
    record.figures.estop = Some(EStopFigures {
        closed_before: true,
        closed_pressed: false,
        closed_released: true,
        alive_withheld: true,
    });
    record.figures.board = Some(BoardFigures {
        firmware: String::new(),
        hse: true,
        brown_out_level: 3,
        dac_reset_pull: Pull::None,
        fault: 0,
    });
    record.took(&rig, Test::Board, &[0], "2026-11-26");
    assert_eq!(record.may_drive(Test::Motors), Ok(()));
    let why = record.may_drive(Test::Tension).unwrap_err();
    assert!(why.contains("DAC_RST"), "{why}");
}

#[test]
fn a_test_of_one_unit_leaves_what_was_found_of_the_others() {
    let rig = Rig::built_in().unwrap();
    let mut record = Record::new(&rig, Identity::default());
    let all: Vec<usize> = (0..UNITS).collect();
    let sound = ConverterFigures {
        samples: 640,
        seconds: 2.0,
        ..ConverterFigures::default()
    };
    let mut silenced = [false; UNITS];
    silenced[4] = true;
    record.figures.converters = [Some(sound); UNITS];
    record.figures.converters[0] = Some(ConverterFigures { silenced, ..sound });
    silenced = [false; UNITS];
    silenced[0] = true;
    record.figures.converters[4] = Some(ConverterFigures { silenced, ..sound });
    record.took(&rig, Test::Converters, &all, "2026-11-26");
    let found = record.mistakes.clone();
    assert_eq!(
        found[0].mistake,
        Mistake::DrdyExchanged { units: vec![1, 5] }
    );
    record.forget(Test::Converters, &[2]);
    record.figures.converters[2] = Some(sound);
    record.took(&rig, Test::Converters, &[2], "2026-11-26");
    assert_eq!(record.mistakes, found);
    assert_eq!(record.verdict(&[2]), Verdict::Failed);
    // The E-stop is the board's: it is open for every unit as soon as it is forgotten.
    record.tests.insert(
        Test::Estop,
        all.iter()
            .map(|unit| (*unit as u8 + 1, "2026-11-20".to_owned()))
            .collect(),
    );
    assert!(!record.open(&[0]).contains(&Test::Estop));
    record.forget(Test::Estop, &[2]);
    assert!(record.open(&[0]).contains(&Test::Estop));
}

/// Noise, a tone, both, and reads that failed: each by its own name.
#[test]
fn noise_tones_and_repeated_reads_are_told_apart() {
    let named = |change: fn(&mut ConverterFigures)| {
        let mut found = ConverterFigures {
            samples: 640,
            seconds: 2.0,
            noise_n: 0.0015,
            ..ConverterFigures::default()
        };
        change(&mut found);
        let mut figures = Figures::default();
        figures.converters[2] = Some(found);
        let found = names(&figures).into_iter();
        found.map(|(mistake, _)| mistake).collect::<Vec<_>>()
    };
    let noise = |noise_n| Mistake::Noise { unit: 3, noise_n };
    let tone = |amplitude_n| Mistake::Tone {
        unit: 3,
        hz: 50.0,
        amplitude_n,
    };
    assert_eq!(named(|_| {}), []);
    assert_eq!(named(|found| found.noise_n = 0.02), [noise(0.02)]);
    assert_eq!(
        named(|found| (found.tone_hz, found.tone_n) = (50.0, 0.006)),
        []
    );
    assert_eq!(
        named(|found| {
            (found.tone_hz, found.tone_n, found.noise_n) = (50.0, 0.06, 0.0425);
        }),
        [tone(0.06)]
    );
    let both = named(|found| {
        (found.tone_hz, found.tone_n, found.noise_n) = (50.0, 0.06, 0.05);
    });
    assert!(
        matches!(both[..], [Mistake::Tone { .. }, Mistake::Noise { noise_n, .. }] if (noise_n - 0.0265).abs() < 1e-4),
        "{both:?}"
    );
    assert_eq!(named(|found| found.failed_reads = 1), []);
    assert_eq!(
        named(|found| found.failed_reads = 2),
        [Mistake::FailedReads { unit: 3, failed: 2 }]
    );
    assert_eq!(
        named(|found| found.recoveries = 1),
        [Mistake::BusRecoveries { recoveries: 1 }]
    );
    // What a dead converter does to the bus has its name already.
    let dead = named(|found| {
        (found.fault, found.samples, found.recoveries) = (Fault::SensorReads.code(), 0, 9);
    });
    assert!(
        matches!(dead[..], [Mistake::ConverterSilent { .. }]),
        "{dead:?}"
    );
}

/// All six of a kind, each at its neighbour's place: one name, with all of them.
#[test]
fn six_that_are_permuted_are_named_as_one_mistake() {
    let rig = Rig::built_in().unwrap();
    let next = |i: usize| (i + 1) % UNITS;
    let all: Vec<u8> = (1..=UNITS as u8).collect();
    let one = |figures: &Figures, mistake: Mistake| {
        assert_eq!(names(figures), [(mistake, Sure::Certain)]);
    };
    let mut drdy = Figures::default();
    for (i, converter) in drdy.converters.iter_mut().enumerate() {
        let mut found = ConverterFigures {
            samples: 640,
            seconds: 2.0,
            missed: 29,
            ..ConverterFigures::default()
        };
        found.silenced[next(i)] = true;
        *converter = Some(found);
    }
    one(&drdy, Mistake::DrdyExchanged { units: all.clone() });
    let pulled = |encoder: fn(usize) -> usize, cell: fn(usize) -> usize| {
        let mut figures = Figures::default();
        for (i, pull) in figures.pulls.iter_mut().enumerate() {
            let mut found = PullFigures {
                travel_m: 0.2,
                counts: [0; UNITS],
                cell_n: [0.0; UNITS],
            };
            let at = encoder(i);
            found.counts[at] = -(0.2 / rig.units[at].travel_m_per_count) as i32;
            found.cell_n[cell(i)] = 1.5;
            *pull = Some(found);
        }
        figures
    };
    one(
        &pulled(|i| (i + 1) % UNITS, |i| i),
        Mistake::EncodersExchanged { units: all.clone() },
    );
    one(
        &pulled(|i| i, |i| (i + 5) % UNITS),
        Mistake::CellsExchanged { units: all.clone() },
    );
    let mut motors = pulled(|i| i, |i| i);
    for (i, motor) in motors.motors.iter_mut().enumerate() {
        let mut found = pulses(next(i), true);
        found.pulses = vec![found.pulses[0]; 2];
        *motor = Some(found);
    }
    one(&motors, Mistake::MotorsExchanged { units: all });
}

#[test]
fn a_slope_that_friction_may_have_made_is_no_certain_gain() {
    let rig = Rig::built_in().unwrap();
    let unit = &rig.units[0];
    let slope = unit.friction_gain - unit.coulomb_per_n;
    let idle_n = (unit.coulomb_n - unit.friction_offset_n) / slope;
    for (gain, expected) in [
        (0.5, vec![Sure::Certain]),
        (0.65, vec![Sure::Likely; 2]),
        (1.0, vec![]),
        (1.5, vec![Sure::Likely; 2]),
        (2.0, vec![Sure::Certain]),
    ] {
        let mut figures = Figures::default();
        figures.tension[0] = Some(TensionFigures {
            loose: true,
            tight: true,
            line: Some(LoadLine {
                idle_n,
                command_n: idle_n + 1.0,
                reading_n: gain * slope,
            }),
            ..TensionFigures::default()
        });
        let found = names(&figures);
        let sure: Vec<Sure> = found.iter().map(|(_, sure)| *sure).collect();
        assert_eq!(sure, expected, "{gain}: {found:?}");
        if let Some((first, _)) = found.first() {
            assert!(
                matches!(first, Mistake::AmplifierGain { unit: 1, ratio } if (ratio - gain).abs() < 0.01)
            );
        }
    }
}
