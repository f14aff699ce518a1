//! The small parts: conversions, filters, friction, zeroing, supervisors, faults, geometry.

use control::config::{field, nominal_dac_counts_per_n_q16, Field, FIELDS};
use control::convert::{dac_code, nominal_codes_per_newton, COUNTS_PER_TURN, GEAR, REEL_RADIUS_M};
use control::faults::{Latch, Scope};
use control::filter::{Filter, FilterConfig, SpikeGate};
use control::friction::{
    sin_q30, Direction, DirectionEstimator, Level, Model, ReelSpeed, REVERSAL_SHARE_Q16,
};
use control::let_go::LetGo;
use control::supervisor::{CheckIn, EncoderWatch, Expiry, Rate, RateLimits, Verdict};
use control::zero::{Averager, Progress, Refused, SAMPLES};
use control::{geometry, AdcCode, Config, DacCode, EncoderCounts, Fault, InvCos, Micros, Newton};
use nalgebra::Vector3;
use proptest::prelude::*;
use wire::message::{FilterChoice, Ripple, UnitConfig};

fn newton(n: f64) -> Newton {
    Newton::from_un((n * 1e6).round() as i32)
}

#[test]
fn nominal_numbers_are_those_of_the_parts() {
    let nominal = Config::nominal();
    assert!((nominal_codes_per_newton() - 282.22).abs() < 0.01);
    assert!((nominal.dac_counts_per_n_q16 - nominal_dac_counts_per_n_q16()).abs() < 1_000);
    let travel = std::f64::consts::TAU * REEL_RADIUS_M / (COUNTS_PER_TURN * GEAR) * 1e9;
    assert!(
        (f64::from(nominal.travel_nm_per_count) - travel).abs() < 1.0,
        "{travel}"
    );
    assert!(Config::from_wire(&nominal).is_ok());
    assert!(!Config::default().enabled());
    assert_eq!(
        Config::default().wire().scale_pn_per_count,
        nominal.scale_pn_per_count
    );
}

#[test]
fn zero_command_is_zero_volt_whatever_the_scale() {
    for scale in [18_495_479, -18_495_479, 65_536_000] {
        assert_eq!(dac_code(Newton::ZERO, scale), DacCode::ZERO_VOLT);
    }
    assert_eq!(DacCode::default(), DacCode(0x8000));
    // The ends are reached, not passed.
    assert_eq!(dac_code(newton(500.0), 65_536_000), DacCode(0xFFFF));
    assert_eq!(dac_code(newton(500.0), -65_536_000), DacCode(0));
    assert_eq!(dac_code(newton(12.0), 18_495_479).steps(), 3_387);
}

/// Sets this field to `value`.
fn set(config: &mut UnitConfig, field: &Field, value: i32) {
    match field.number {
        1 => config.scale_pn_per_count = value,
        2 => config.zero_code = value,
        3 => config.stored_zero_code = value,
        4 => config.zero_deviation_un = value,
        20 => config.authority_un = value,
        21 => config.plausible_un = value,
        5 => {
            config.filter = match field.name {
                "filter" => FilterChoice::LowPass {
                    corner_chz: value as u16,
                },
                _ => FilterChoice::MovingAverage(value as u8),
            }
        }
        6 => config.spike_limit_un = value,
        7 => config.kp_q16 = value,
        8 => config.ki_q16 = value,
        9 => config.kd_q16 = value,
        10 => config.damping_q16 = value,
        12 => config.friction_offset_un = value,
        13 => config.friction_gain_q16 = value,
        14 => config.coulomb_un = value,
        15 => config.coulomb_load_q16 = value,
        16 => config.reversal_nm = value,
        17 => config.travel_nm_per_count = value,
        18 => config.dac_counts_per_n_q16 = value,
        19 => config.force_limit_un = value,
        22 => config.slew_un_per_s = value,
        23 => config.over_tension_un = value,
        24 => config.viscous_q16 = value,
        25 => match field.name {
            "ripples.periods_per_count_q32" => config.ripples[1].periods_per_count_q32 = value,
            "ripples.amplitude_un" => config.ripples[1].amplitude_un = value,
            "ripples.amplitude_load_q16" => config.ripples[1].amplitude_load_q16 = value,
            other => panic!("no field {other}"),
        },
        26 => match field.name {
            "cell.curve_nn_per_n2" => config.cell.curve_nn_per_n2 = value,
            "cell.creep_q16" => config.cell.creep_q16 = value,
            "cell.creep_ms" => config.cell.creep_ms = value,
            other => panic!("no field {other}"),
        },
        27 => config.tension_max_un = value,
        28 => config.leaky_ki_q16 = value,
        other => panic!("no field {other}"),
    }
}

#[test]
fn every_field_is_checked_at_both_ends() {
    for f in FIELDS {
        for (value, good) in [
            (f.min, true),
            (f.max, true),
            (f.min - 1, false),
            (f.max + 1, false),
        ] {
            let mut config = Config::nominal();
            set(&mut config, f, value);
            match Config::from_wire(&config) {
                Ok(_) => assert!(good, "{} = {value} was taken", f.name),
                Err(e) => {
                    assert!(!good, "{} = {value}: {e}", f.name);
                    assert_eq!((e.field.number, e.got), (f.number, value));
                    assert!(e.to_string().contains(f.name));
                }
            }
        }
    }
    // Near zero is out of range for what may have a sign, but is divided by or scaled with.
    for f in [&field::SCALE, &field::TRAVEL, &field::DAC_SCALE] {
        let least = f.to_wire(f.least_size);
        for (value, good) in [
            (0, false),
            (least - 1, false),
            (least, true),
            (1 - least, false),
            (-least, true),
        ] {
            let mut config = Config::nominal();
            set(&mut config, f, value);
            match Config::from_wire(&config) {
                Ok(_) => assert!(good, "{} = {value} was taken", f.name),
                Err(e) => assert!(!good && e.field == f, "{e}"),
            }
        }
    }
}

#[test]
fn spike_gate_takes_spikes_and_lets_steps_pass() {
    let limit = newton(1.0).to_bits();
    let mut gate = SpikeGate::default();
    for _ in 0..5 {
        assert_eq!(gate.step(limit, newton(3.0)), (newton(3.0), false));
    }
    // One spike, of any size.
    assert_eq!(gate.step(limit, newton(300.0)), (newton(3.0), true));
    assert_eq!(gate.step(limit, newton(3.1)), (newton(3.1), false));
    // A step: one sample late.
    // (After a spike the slope is unknown, so the prediction is the last sample.)
    assert_eq!(gate.step(limit, newton(8.0)), (newton(3.1), true));
    assert_eq!(gate.step(limit, newton(8.2)), (newton(8.2), false));
    // Samples that contradict each other are held back three times, not forever.
    let mut held = 0;
    for n in 0..4 {
        let wild = if n % 2 == 0 { 100.0 } else { -100.0 };
        held += u32::from(gate.step(limit, newton(wild)).1);
    }
    assert_eq!(held, 3);
}

/// Response of a filter to a sine of `hz`: gain and delay in samples.
fn response(choice: FilterChoice, hz: f64) -> (f64, f64) {
    let config = FilterConfig::new(choice);
    let mut filter = Filter::default();
    let omega = std::f64::consts::TAU * hz / 320.0;
    let (mut sine, mut cosine, mut count) = (0.0, 0.0, 0.0);
    for n in 0..6_400 {
        let phase = omega * f64::from(n);
        let y = filter.step(&config, newton(5.0 * phase.sin())).to_f64();
        if n >= 3_200 {
            sine += y * phase.sin();
            cosine += y * phase.cos();
            count += 1.0;
        }
    }
    let (sine, cosine) = (sine / count, cosine / count);
    (2.0 * sine.hypot(cosine) / 5.0, -cosine.atan2(sine) / omega)
}

/// Standard deviation after the filter of noise with SD 1 before it.
fn noise_gain(choice: FilterChoice) -> f64 {
    let config = FilterConfig::new(choice);
    let mut filter = Filter::default();
    filter.step(&config, Newton::ZERO);
    let mut power = 0.0;
    let mut x = newton(100.0);
    for _ in 0..2_000 {
        power += (filter.step(&config, x).to_f64() / 100.0).powi(2);
        x = Newton::ZERO;
    }
    power.sqrt()
}

#[test]
fn filters_have_the_delay_and_the_noise_their_documentation_states() {
    // Low pass, 100 Hz: 0.473 samples (1.5 ms), noise times 0.785; moving average of 4: 1.5 samples
    // (4.7 ms), noise times 0.5. Computed apart from this code from the filters' equations.
    let low_pass = FilterChoice::LowPass { corner_chz: 10_000 };
    let (gain, delay) = response(low_pass, 5.0);
    assert!(
        (gain - 1.0).abs() < 1e-3 && (delay - 0.473).abs() < 0.005,
        "{gain} {delay}"
    );
    let (corner, _) = response(low_pass, 100.0);
    assert!((corner - 0.5f64.sqrt()).abs() < 1e-3, "{corner}");
    assert!(
        (noise_gain(low_pass) - 0.785).abs() < 0.002,
        "{}",
        noise_gain(low_pass)
    );
    let average = FilterChoice::MovingAverage(4);
    let (gain, delay) = response(average, 5.0);
    assert!(
        (gain - 0.994).abs() < 1e-3 && (delay - 1.5).abs() < 0.01,
        "{gain} {delay}"
    );
    assert!((noise_gain(average) - 0.5).abs() < 1e-3);
    // An average over 80 Hz's period lets nothing of it through.
    assert!(response(average, 80.0).0 < 1e-5);
}

proptest! {
    #[test]
    fn filters_settle_on_a_constant_within_a_micronewton(
        choice in prop_oneof![
            (1u8..=16).prop_map(FilterChoice::MovingAverage),
            (500u16..=12_000).prop_map(|corner_chz| FilterChoice::LowPass { corner_chz }),
        ],
        from in -57_000_000i32..57_000_000,
        to in -57_000_000i32..57_000_000,
    ) {
        let config = FilterConfig::new(choice);
        let mut filter = Filter::default();
        // The first sample fills the memory: no transient.
        prop_assert!((filter.step(&config, Newton::from_un(from)).to_un() - from).abs() <= 1);
        let mut y = Newton::ZERO;
        for _ in 0..1_000 {
            y = filter.step(&config, Newton::from_un(to));
        }
        prop_assert!((y.to_bits() - Newton::from_un(to).to_bits()).abs() <= 4, "{} {}", y.to_bits(), to);
    }

    #[test]
    fn filters_survive_any_samples(
        choice in prop_oneof![
            (1u8..=16).prop_map(FilterChoice::MovingAverage),
            (500u16..=12_000).prop_map(|corner_chz| FilterChoice::LowPass { corner_chz }),
        ],
        samples in prop::collection::vec(any::<i32>(), 1..200),
    ) {
        let config = FilterConfig::new(choice);
        let mut filter = Filter::default();
        for &sample in &samples {
            filter.step(&config, Newton::from_bits(sample));
        }
        let mut y = Newton::ZERO;
        for _ in 0..2_000 {
            y = filter.step(&config, newton(3.0));
        }
        prop_assert!((y.to_f64() - 3.0).abs() < 1e-5);
    }

    #[test]
    fn friction_model_is_the_inverse_of_the_measured_law_less_a_margin(
        offset in -1e6f64..1e6,
        gain in 0.8f64..1.3,
        c0 in 0.0f64..2e6,
        c1 in 0.0f64..0.35,
        tension in 0.0f64..16.0,
        q30 in -i64::from(Direction::ONE)..=i64::from(Direction::ONE),
    ) {
        let wire = UnitConfig {
            friction_offset_un: offset as i32,
            friction_gain_q16: (gain * 65_536.0) as i32,
            coulomb_un: c0 as i32,
            coulomb_load_q16: (c1 * 65_536.0) as i32,
            ..Config::nominal()
        };
        // The law solved for the command, in each direction.
        let exact = |sign: f64| {
            (tension - f64::from(wire.friction_offset_un) * 1e-6
                + sign * f64::from(wire.coulomb_un) * 1e-6)
                / (f64::from(wire.friction_gain_q16) - sign * f64::from(wire.coulomb_load_q16))
                * 65_536.0
        };
        let middle = (exact(1.0) + exact(-1.0)) / 2.0;
        let half = (exact(1.0) - exact(-1.0)) / 2.0;
        let command = Model::new(&wire)
            .command(newton(tension), Direction::from_q30(q30), ReelSpeed::default(), EncoderCounts(0), &Level::default())
            .command
            .to_f64();
        let direction = q30 as f64 / f64::from(Direction::ONE);
        let share = REVERSAL_SHARE_Q16 as f64 / 65_536.0;
        prop_assert!((command - (middle + share * direction * half)).abs() < 1e-5, "{command}");
    }

    /// What the feedforward takes over is what the integral gives up, whatever it holds. The tests
    /// of the loop show that something is taken over.
    #[test]
    fn friction_that_is_learned_moves_from_the_integral_to_the_feedforward(
        slides in prop::collection::vec((1usize..200, any::<bool>(), -3.0f64..3.0, 0usize..300), 1..30),
        tension in 0.0f64..16.0,
        c0 in 0.0f64..5e6,
    ) {
        let wire = UnitConfig { coulomb_un: c0 as i32, ..Config::nominal() };
        let model = Model::new(&wire);
        let mut level = Level::default();
        for (samples, inwards, towards, rest) in slides {
            let direction = Direction::from_q30(if inwards { 1 } else { -1 } * i64::from(Direction::ONE));
            let mut integral = newton(towards);
            for _ in 0..samples {
                let friction = |level: &Level| {
                    model.command(newton(tension), direction, ReelSpeed::default(), EncoderCounts(0), level)
                };
                let before = friction(&level);
                let moved = level.slid(inwards, integral, before.half).unwrap_or_default();
                let after = friction(&level);
                let jump = (after.command.to_f64() - moved.to_f64()) - before.command.to_f64();
                prop_assert!(jump.abs() < 1e-5, "{jump} N");
                prop_assert!(level.excess().abs() <= 0.4 + 1e-6);
                integral = integral.saturating_sub(moved);
            }
            (0..rest).for_each(|_| level.pause());
        }
    }

    #[test]
    fn viscous_friction_and_ripples_count_like_an_offset(
        viscous in 0.0f64..100.0,
        speed_nm in -60_000i32..60_000,
        periods_per_count in -0.2f64..0.2,
        phase in -0.5f64..0.5,
        amplitude in 0.0f64..3.0,
        share in 0.0f64..0.2,
        counts in -1_000_000_000i64..1_000_000_000,
        tension in 0.0f64..16.0,
    ) {
        let turn = 2f64.powi(32);
        let ripple = Ripple {
            periods_per_count_q32: (periods_per_count * turn) as i32,
            phase_q32: (phase * turn) as i32,
            amplitude_un: (amplitude * 1e6) as i32,
            amplitude_load_q16: (share * 65_536.0) as i32,
        };
        let wire = UnitConfig {
            viscous_q16: (viscous * 65_536.0) as i32,
            ripples: [Ripple::default(), ripple],
            friction_offset_un: 0,
            friction_gain_q16: 65_536,
            coulomb_un: 0,
            coulomb_load_q16: 0,
            ..Config::nominal()
        };
        let mut speed = ReelSpeed::default();
        for _ in 0..200 {
            speed.step(speed_nm);
        }
        let added = Model::new(&wire)
            .command(newton(tension), Direction::default(), speed, EncoderCounts(counts), &Level::default())
            .command
            .to_f64()
            - tension;
        let speed_m_per_s = f64::from(speed_nm) * 1e-9 * 320.0;
        let turns = (i128::from(counts) * i128::from(ripple.periods_per_count_q32)
            + i128::from(ripple.phase_q32))
        .rem_euclid(1 << 32) as f64
            / turn;
        let expected = (viscous * speed_m_per_s).clamp(-3.0, 3.0)
            - (amplitude + share * tension) * (std::f64::consts::TAU * turns).sin();
        prop_assert!((added - expected).abs() < 3e-4, "{added} N, {expected} N expected");
        // Switched off with the rest.
        let off = UnitConfig { friction_feedforward: false, ..wire };
        let command =
            Model::new(&off).command(newton(tension), Direction::default(), speed, EncoderCounts(counts), &Level::default());
        prop_assert_eq!(command.command, newton(tension));
    }

    #[test]
    fn sine_is_that_of_f64(turns: u32) {
        let sine = f64::from(sin_q30(turns)) / f64::from(1 << 30);
        let exact = (std::f64::consts::TAU * f64::from(turns) / 2f64.powi(32)).sin();
        prop_assert!((sine - exact).abs() < 1e-6, "{sine}, {exact}");
    }

    #[test]
    fn reel_speed_follows_any_travel_without_overflow(travels in prop::collection::vec(any::<i32>(), 1..50)) {
        let mut speed = ReelSpeed::default();
        let largest = travels
            .iter()
            .map(|t| i64::from(t.unsigned_abs().min(1 << 22)) << 8)
            .max()
            .unwrap_or(0);
        for travel in travels {
            speed.step(travel);
            prop_assert!(i64::from(speed.nm_q8()).abs() <= largest + 4);
        }
        for _ in 0..300 {
            speed.step(0);
        }
        prop_assert!(speed.nm_q8().abs() <= 4, "{speed:?}");
    }

    #[test]
    fn newton_conversions_round_to_the_nearest(un in -511_000_000i32..511_000_000) {
        let n = Newton::from_un(un);
        prop_assert_eq!(n.to_un(), un);
        prop_assert!((n.to_f64() - f64::from(un) * 1e-6).abs() <= 0.57 / 4_194_304.0);
        prop_assert!((f64::from(n.to_tenth_mn()) - f64::from(un) / 100.0).abs() <= 0.501);
    }

    #[test]
    fn direction_stays_in_bounds_and_moves_smoothly(
        steps in prop::collection::vec((any::<i32>(), any::<i32>()), 1..100),
    ) {
        let model = Model::new(&Config::nominal());
        let mut estimator = DirectionEstimator::default();
        let mut last = 0i64;
        for (travel, error) in steps {
            let d = i64::from(estimator.step(&model, travel, Newton::from_bits(error), None).q30());
            prop_assert!(d.abs() <= i64::from(Direction::ONE));
            prop_assert!((d - last).abs() <= DirectionEstimator::MAX_STEP);
            last = d;
        }
    }
}

#[test]
fn direction_follows_travel_and_survives_jitter() {
    let model = Model::new(&Config::nominal()); // 100 um of reversal, 4.229 um a count
    let mut estimator = DirectionEstimator::default();
    let count = 4_229;
    for _ in 0..100 {
        estimator.step(&model, 10 * count, Newton::ZERO, None);
    }
    assert_eq!(estimator.direction().q30(), Direction::ONE);
    // A jitter of one count for any time: nothing moves.
    for n in 0..10_000 {
        estimator.step(
            &model,
            if n % 2 == 0 { -count } else { count },
            Newton::ZERO,
            None,
        );
    }
    assert_eq!(estimator.direction().q30(), Direction::ONE);
    // At rest it stays, with noise of the tension as well.
    for n in 0..10_000 {
        estimator.step(
            &model,
            0,
            newton(if n % 3 == 0 { 0.0099 } else { -0.0099 }),
            None,
        );
    }
    assert_eq!(estimator.direction().q30(), Direction::ONE);
    // Reversing takes the reversal travel and one or two counts of play, and passes through the
    // middle.
    let mut travelled = 0;
    let mut middle = false;
    while estimator.direction().q30() > -Direction::ONE {
        estimator.step(&model, -count, Newton::ZERO, None);
        travelled += count;
        middle |= estimator.direction().q30().abs() < Direction::ONE / 4;
        assert!(travelled < 200_000, "never reversed");
    }
    assert!(
        middle && (100_000..=100_000 + 3 * count).contains(&travelled),
        "{travelled}"
    );
}

#[test]
fn direction_of_a_resting_reel_follows_the_error() {
    let model = Model::new(&Config::nominal());
    let mut estimator = DirectionEstimator::default();
    for _ in 0..20 {
        estimator.step(&model, 0, newton(0.2), None);
    }
    assert_eq!(estimator.direction().q30(), Direction::ONE);
    for _ in 0..40 {
        estimator.step(&model, 0, newton(-0.2), None);
    }
    assert_eq!(estimator.direction().q30(), -Direction::ONE);
    // While it moves the error has no effect.
    for _ in 0..50 {
        estimator.step(&model, -20_000, newton(3.0), None);
    }
    assert_eq!(estimator.direction().q30(), -Direction::ONE);
}

fn zero_of(codes: impl Iterator<Item = i32>) -> Progress {
    let mut averager = Averager::new(20_000, 200_000);
    let mut last = Progress::Collecting(0);
    for code in codes.take(usize::from(SAMPLES)) {
        last = averager.push(AdcCode::new(code));
        if !matches!(last, Progress::Collecting(_)) {
            break;
        }
    }
    last
}

#[test]
fn zero_is_averaged_or_refused() {
    let noisy = (0..).map(|n| -1_000 + [400, -400, 100, -100][n % 4]);
    assert_eq!(zero_of(noisy), Progress::Done(AdcCode::new(-1_000)));
    let swinging = (0..).map(|n: i32| n * 150);
    assert_eq!(
        zero_of(swinging),
        Progress::Refused(Refused::Unsteady(255 * 150))
    );
    assert_eq!(
        zero_of(std::iter::repeat(3_000_000)),
        Progress::Refused(Refused::FarOff(2_980_000))
    );
    assert_eq!(
        zero_of(std::iter::repeat(220_000)),
        Progress::Done(AdcCode::new(220_000))
    );
    assert_eq!(
        zero_of(std::iter::repeat(-180_001)),
        Progress::Refused(Refused::FarOff(-200_001))
    );
    assert_eq!(
        zero_of(std::iter::repeat(0x7F_FFFF)),
        Progress::Refused(Refused::Saturated)
    );
    assert_eq!(Refused::FarOff(-5).detail(), 1 << 31 | 5);
}

#[test]
fn rate_is_bounded_from_both_sides() {
    let run = |period: u32| {
        let mut rate = Rate::default();
        let mut t = u32::MAX - 20_000; // across the clock's wrap
        for _ in 0..200 {
            t = t.wrapping_add(period);
            rate.observe(Micros(t), 0);
        }
        (rate, Micros(t))
    };
    let verdict = |period| {
        let (rate, now) = run(period);
        rate.check(now, &RateLimits::SENSOR)
    };
    // 310 to 330 SPS are within the bounds; 290 and 350 are not.
    assert_eq!(verdict(3_226), Verdict::Ok);
    assert_eq!(verdict(3_030), Verdict::Ok);
    assert!(matches!(verdict(3_448), Verdict::TooSlow(p) if p.abs_diff(3_448) < 5));
    assert!(matches!(verdict(2_857), Verdict::TooFast(p) if p.abs_diff(2_857) < 5));
    let (rate, now) = run(3_125);
    let later = |us| rate.check(Micros(now.0.wrapping_add(us)), &RateLimits::SENSOR);
    assert_eq!(later(12_500), Verdict::Ok);
    assert_eq!(later(12_501), Verdict::Silent);
    // An edge that is newer than the supervisor's clock is no silence.
    assert_eq!(later(u32::MAX - 10), Verdict::Ok);
    assert_eq!(
        Rate::default().check(Micros(5_000_000), &RateLimits::SENSOR),
        Verdict::Ok
    );
}

#[test]
fn setpoints_expire() {
    let mut expiry = Expiry::default();
    let at = |us: u32| Micros(u32::MAX - 1_000 + us);
    assert!(!expiry.is_expired(Micros(0)) && !expiry.is_valid(Micros(0)));
    assert_eq!(expiry.age_ms(Micros(0)), 65_535);
    expiry.renew(Micros(u32::MAX - 1_000), 50);
    assert!(expiry.is_valid(at(900)));
    let wrapped = |us: u32| Micros((u32::MAX - 1_000).wrapping_add(us));
    assert!(expiry.is_valid(wrapped(50_000)) && !expiry.is_expired(wrapped(50_000)));
    assert!(expiry.is_expired(wrapped(50_001)) && !expiry.is_valid(wrapped(50_001)));
    assert_eq!(expiry.age_ms(wrapped(42_999)), 42);
    expiry.forget();
    assert!(!expiry.is_expired(wrapped(60_000)));
}

#[test]
fn the_watchdog_needs_every_part() {
    let mut parts = CheckIn::new(0b1011);
    parts.check_in(0);
    parts.check_in(3);
    parts.check_in(40); // an unknown part does not panic
    assert!(!parts.complete());
    assert_eq!(parts.missing(), 0b10);
    parts.check_in(1);
    assert!(parts.complete());
    // A new round starts from nothing.
    assert_eq!(parts.missing(), 0b1011);
}

#[test]
fn every_fault_explains_itself() {
    let mut last = 0;
    for &fault in Fault::ALL {
        assert!(fault.code() > last, "numbers rise: {fault:?}");
        last = fault.code();
        assert_eq!(Fault::from_code(fault.code()), Some(fault));
        let unit = fault.scope() == Scope::Unit;
        assert_eq!(unit, fault.code() >= 32, "{fault:?}");
        assert!(fault.name().len() <= 30 && !fault.name().is_empty());
        assert!(
            fault.meaning().len() > 40 && fault.meaning().ends_with('.'),
            "{fault:?}"
        );
        let way_out = fault.what_to_do();
        assert!(
            way_out.to_lowercase().contains("clear"),
            "{fault:?} has no way out: {way_out}"
        );
        assert!(!fault.detail_meaning().is_empty());
    }
    assert_eq!(Fault::from_code(0), None);
    assert_eq!(Fault::from_code(33), Some(Fault::SensorSilent));
}

#[test]
fn latch_keeps_every_fault_until_its_cause_is_gone_and_shows_the_first() {
    for &first in Fault::ALL {
        let others = Fault::ALL
            .iter()
            .filter(|other| other.scope() == first.scope());
        for &second in others.filter(|second| **second != first) {
            let mut latch = Latch::new();
            assert!(latch.latch(first, 7));
            assert!(!latch.latch(first, 9), "it is latched");
            assert!(latch.latch(second, 8));
            assert_eq!(latch.get(), Some((first, 7)));
            assert!(latch.has(first) && latch.has(second));
            // Its cause is there: it stays, and stays the one that is shown.
            assert!(!latch.clear(|fault| fault == first));
            assert_eq!(latch.get(), Some((first, 7)));
            assert!(!latch.has(second));
            // The one behind it stays.
            latch.latch(second, 8);
            assert!(!latch.clear(|fault| fault == second));
            assert_eq!(latch.get(), Some((second, 8)));
            assert!(latch.is_set() && !latch.has(first));
            assert!(latch.clear(|_| false));
            assert!(latch.get().is_none() && !latch.has(second));
        }
    }
    let latch = Latch::new();
    assert_eq!(
        (latch.code(), latch.detail(), latch.is_set()),
        (0, 0, false)
    );
}

#[test]
fn geometry_follows_the_thesis() {
    let tip = Vector3::new(0.0, 0.1, 0.0);
    let cable = geometry::cable_direction(Vector3::new(0.3, 0.5, 0.0), tip).unwrap();
    assert!((cable - Vector3::new(0.6, 0.8, 0.0)).norm() < 1e-12);
    assert!(geometry::cable_direction(tip, tip).is_none());
    assert!(geometry::cable_direction(Vector3::new(f64::NAN, 0.0, 0.0), tip).is_none());
    assert!(geometry::cable_direction(Vector3::new(f64::INFINITY, 0.0, 0.0), tip).is_none());
    let cos = geometry::cos_cell_angle(cable, Vector3::new(0.0, 2.0, 0.0)).unwrap();
    assert!((cos - 0.8).abs() < 1e-12);
    assert!(geometry::cos_cell_angle(cable, Vector3::zeros()).is_none());
    assert!((geometry::tension(4.0, cos) - 5.0).abs() < 1e-12);
    assert!((geometry::cell_force(5.0, cos) - 4.0).abs() < 1e-12);
    assert_eq!(geometry::inv_cos_q16(cos), Some(81_920));
    assert_eq!(geometry::inv_cos_q16(1.0), Some(InvCos::ONE.q16()));
    assert_eq!(geometry::inv_cos_q16(0.25), Some(InvCos::MAX.q16()));
    assert_eq!(geometry::inv_cos_q16(0.249), None);
    assert_eq!(geometry::inv_cos_q16(f64::NAN), None);
    let force = geometry::applied_force(&[cable, -cable, Vector3::z()], &[3.0, 1.0, 2.0]);
    assert!((force - Vector3::new(1.2, 1.6, 2.0)).norm() < 1e-12);
    // The same in f32, for a board.
    let narrow =
        geometry::cable_direction(Vector3::new(0.3f32, 0.5, 0.0), Vector3::new(0.0, 0.1, 0.0))
            .unwrap();
    assert!((narrow - Vector3::new(0.6, 0.8, 0.0)).norm() < 1e-6);
    for cos in [-1.0f32, -0.5, 0.0, 0.3, 0.9, 1.0, 2.0] {
        let exact = cos.clamp(-1.0, 1.0).acos().to_degrees();
        assert!((geometry::angle_deg(cos) - exact).abs() < 0.5, "{cos}");
    }
}

#[test]
fn an_encoder_that_stands_while_the_tension_leaves_the_command_is_found() {
    let with_friction = |coulomb_un| {
        let wire = wire::message::UnitConfig {
            coulomb_un,
            ..Config::nominal()
        };
        Config::from_wire(&wire).unwrap()
    };
    let declared = with_friction(Config::nominal().coulomb_un);
    let observe = |config: &Config,
                   watch: &mut EncoderWatch,
                   at: i64,
                   tension_n: f64,
                   command_n: f64,
                   spike: bool| {
        let newton = |n: f64| control::Newton::from_un((n * 1e6) as i32);
        let (tension, command) = (newton(tension_n), newton(command_n));
        watch.observe(config, control::EncoderCounts(at), tension, command, spike)
    };
    let see = |watch: &mut EncoderWatch, at: i64, tension_n: f64, command_n: f64, spike: bool| {
        observe(&declared, watch, at, tension_n, command_n, spike)
    };
    // A resting reel: tension less command stays within twice the friction.
    let mut watch = EncoderWatch::default();
    for tension_n in [6.0, 8.4, 3.6, 8.4] {
        assert_eq!(see(&mut watch, 100, tension_n, 6.0, false), None);
    }
    // A robot that moves away while the command rises: the reel rests.
    let mut watch = EncoderWatch::default();
    for n in 0..30 {
        let command_n = 0.4 * f64::from(n);
        assert_eq!(see(&mut watch, 7, command_n + 1.0, command_n, false), None);
    }
    // A motor without power: the reel rests, whatever the command.
    let mut watch = EncoderWatch::default();
    for n in 0..30 {
        assert_eq!(see(&mut watch, 7, 0.5, 0.4 * f64::from(n), false), None);
    }
    // A reel that follows a large swing.
    let mut watch = EncoderWatch::default();
    for (at, tension_n) in [(0, 1.0), (30, 4.0), (60, 8.0), (90, 11.0), (0, 0.5)] {
        assert_eq!(see(&mut watch, at, tension_n, 8.0, false), None);
    }
    // Jitter of a count is no motion.
    let mut watch = EncoderWatch::default();
    assert_eq!(see(&mut watch, 7, 3.0, 6.0, false), None);
    assert_eq!(see(&mut watch, 8, 6.5, 6.0, false), None);
    let mut swing = None;
    for sample in 0..8 {
        assert_eq!(swing, None, "after {sample} samples");
        swing = see(&mut watch, 7, 10.0, 6.0, false);
    }
    assert_eq!(swing.map(|s| s.to_un()), Some(7_000_000));
    // A reel whose declared friction holds that swing, and one that is beyond its friction too.
    let more = with_friction(2_400_000);
    for (tension_n, found) in [(10.0, None), (12.5, Some(9_500_000))] {
        let mut watch = EncoderWatch::default();
        assert_eq!(observe(&more, &mut watch, 7, 3.0, 6.0, false), None);
        let mut swing = None;
        for _ in 0..8 {
            swing = observe(&more, &mut watch, 7, tension_n, 6.0, false);
        }
        assert_eq!(swing.map(|s| s.to_un()), found);
    }
    // A tension that is held back as a spike is no tension, nor are the next ones; a reel that was
    // elsewhere meanwhile begins anew.
    let mut watch = EncoderWatch::default();
    assert_eq!(see(&mut watch, 7, 9.0, 9.0, false), None);
    for (at, spike) in [(7, true), (15, false), (7, false), (7, false)] {
        assert_eq!(see(&mut watch, at, 0.0, 9.0, spike), None);
    }
    for _ in 0..20 {
        assert_eq!(see(&mut watch, 7, 3.0, 9.0, false), None);
    }
}

/// The limits of the example rig stay, and grow with the declared friction.
#[test]
fn what_a_resting_reel_may_hold_follows_the_declared_friction() {
    let limits = |coulomb_n: f64, tension_max_n: f64| {
        let wire = wire::message::UnitConfig {
            coulomb_un: (coulomb_n * 1e6) as i32,
            tension_max_un: (tension_max_n * 1e6) as i32,
            over_tension_un: 30_000_000,
            force_limit_un: Config::nominal().force_limit_un,
            ..Config::nominal()
        };
        let config = Config::from_wire(&wire).unwrap();
        [config.let_go(), config.still_swing()].map(|n| f64::from(n.to_un()) * 1e-6)
    };
    assert_eq!(limits(0.909, 12.0), [1.7, 6.0]);
    assert_eq!(limits(0.0, 12.0), [1.7, 6.0]);
    // 0.155 N of offset; from one side to the other twice Coulomb's part and that of the load.
    for (coulomb_n, tension_max_n) in [(1.7, 12.0), (2.4, 12.0), (5.0, 12.0), (2.4, 16.0)] {
        let exact = [
            (coulomb_n + 0.155) * 51.0 / 32.0,
            2.0 * (coulomb_n + 0.154 * tension_max_n) * 34.0 / 32.0,
        ];
        for (found, exact) in limits(coulomb_n, tension_max_n).into_iter().zip(exact) {
            assert!(
                (found - exact).abs() < 1e-3,
                "{coulomb_n} N: {found} {exact}"
            );
        }
    }
}

/// A bit of the memory may make any number of a unit's travel before the check of the configuration
/// sees it.
#[test]
fn any_travel_of_a_count_is_taken_while_a_cable_is_to_let_go() {
    for nm_per_count in [i32::MIN, i32::MAX, 0, -1] {
        let mut watch = LetGo::default();
        watch.driven(EncoderCounts(0), Newton::from_un(6_000_000), Newton::ZERO);
        watch.switched_off(Micros(0), control::friction::LET_GO);
        watch.blind();
        watch.turned(EncoderCounts(5), nm_per_count);
        watch.turned(EncoderCounts(-5), nm_per_count);
        let _ = watch.overdue(Micros(1_000));
    }
}
