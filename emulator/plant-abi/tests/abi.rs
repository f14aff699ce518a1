//! The C ABI answers what the plant answers, and survives what a caller must not do.
// Calls the C ABI as a caller in C does.
#![allow(unsafe_code)]

use plant::{Plant, PlantConfig};
use plant_abi::*;
use std::ffi::{c_char, CStr, CString};
use std::ptr::null_mut;

fn new(seed: u64, config: Option<&str>) -> Result<*mut Plant, String> {
    let config = config.map(|c| CString::new(c).unwrap());
    let mut error = [0 as c_char; 300];
    // SAFETY: both pointers are valid for the call, the size is the buffer's.
    let plant = unsafe {
        plant_new(
            seed,
            config
                .as_ref()
                .map_or(null_mut(), |c| c.as_ptr().cast_mut()),
            error.as_mut_ptr(),
            error.len(),
        )
    };
    if plant.is_null() {
        // SAFETY: terminated by `plant_new`.
        let text = unsafe { CStr::from_ptr(error.as_ptr()) };
        Err(text.to_string_lossy().into_owned())
    } else {
        Ok(plant)
    }
}

#[test]
fn same_seed_same_rig_as_without_the_abi() {
    let through = new(7, None).unwrap();
    let mut direct = Plant::new(PlantConfig::default(), 7).unwrap();
    direct.set_amplifier_power(true);
    direct.set_amplifier_volts(2, 0.6).unwrap();
    direct.advance_to(300_000_000);
    // SAFETY: a live handle, used by this thread only; `truth` has the stated length.
    unsafe {
        plant_set_amplifier_power(through, 1);
        assert_eq!(plant_set_amplifier_volts(through, 2, 0.6), 1);
        plant_advance_to(through, 300_000_000);
        let units = plant_units(through);
        assert_eq!(units as usize, direct.units());
        for u in 0..units {
            let i = u as usize;
            assert_eq!(plant_bridge_v_per_v(through, u), direct.bridge_v_per_v(i));
            assert_eq!(plant_encoder_counts(through, u), direct.encoder_counts(i));
        }
        let mut truth = [f64::NAN; TRUTH_RIG + 6 * TRUTH_UNIT];
        assert_eq!(
            plant_truth(through, truth.as_mut_ptr(), truth.len()),
            truth.len()
        );
        assert_eq!(truth[0..3], direct.tip_position_m());
        assert_eq!(truth[TRUTH_RIG + 2 * TRUTH_UNIT], direct.tension_n(2));
        assert!(truth[TRUTH_RIG + 2 * TRUTH_UNIT] > 3.0);
        plant_free(through);
    }
}

#[test]
fn a_short_truth_buffer_is_not_overrun() {
    let plant = new(1, None).unwrap();
    let mut truth = [-1.0; 5];
    // SAFETY: a live handle; only four of the five doubles are offered.
    unsafe {
        assert_eq!(
            plant_truth(plant, truth.as_mut_ptr(), 4),
            TRUTH_RIG + 6 * TRUTH_UNIT
        );
        plant_free(plant);
    }
    assert_eq!(truth[4], -1.0);
}

#[test]
fn a_bad_configuration_is_refused_with_its_reason() {
    let error = new(1, Some("step_ns = 3")).unwrap_err();
    assert!(error.contains("step_ns"), "{error}");
    let error = new(1, Some("no_such_key = 1")).unwrap_err();
    assert!(error.contains("no_such_key"), "{error}");
}

#[test]
fn null_and_unknown_units_change_nothing() {
    let plant = new(1, None).unwrap();
    // SAFETY: null is allowed everywhere; the other handle is live.
    unsafe {
        assert_eq!(plant_units(null_mut()), 0);
        assert_eq!(plant_bridge_v_per_v(null_mut(), 0), 0.0);
        assert_eq!(plant_set_amplifier_volts(plant, 6, 1.0), 0);
        assert_eq!(plant_set_amplifier_volts(plant, 0, f64::NAN), 0);
        assert_eq!(plant_encoder_counts(plant, 99), 0);
        plant_advance_to(null_mut(), 1);
        plant_free(null_mut());
        plant_free(plant);
    }
}

#[test]
fn a_newton_is_worth_the_cells_own_sensitivity() {
    let plant = new(1, None).unwrap();
    let direct = Plant::new(PlantConfig::default(), 1).unwrap();
    for u in 0..6 {
        // SAFETY: a live handle.
        let per_newton = unsafe { plant_bridge_per_newton(plant, u) };
        assert_eq!(per_newton, direct.parameters(u as usize).bridge_per_n);
        // Within a few standard deviations of 2 mV/V at 3 kg.
        assert!((per_newton * 3.0 * 9.80665 / 2e-3 - 1.0).abs() < 0.2);
    }
    // SAFETY: as above, and not used again.
    unsafe { plant_free(plant) };
}
