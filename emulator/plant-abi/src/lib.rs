//! The plant behind a C ABI.
//!
//! Renode's device models are C#; the physics is the crate `plant`, once. This library is the
//! interface: a handle, plain numbers, no callbacks. One thread at a time may use a handle.
//!
//! ```c
//! char error[256];
//! void *plant = plant_new(1, NULL, error, sizeof error);
//! plant_set_amplifier_power(plant, 1);
//! plant_set_amplifier_volts(plant, 0, 0.43);
//! plant_advance_to(plant, 200000000ULL);          // 0.2 s
//! double bridge = plant_bridge_v_per_v(plant, 0); // V per V of excitation
//! plant_free(plant);
//! ```
//!
//! Units count from 0. A null handle or a unit that does not exist gives 0 and changes nothing,
//! except where a function says otherwise: an error in a model must not end the emulator.
// A C ABI: exported symbols and the caller's pointers.
#![allow(unsafe_code)]

use plant::{Plant, PlantConfig};
use std::ffi::{c_char, CStr};

/// Version of this interface; the caller compares it before anything else.
pub const ABI_VERSION: u32 = 2;

/// Doubles that [`plant_truth`] writes for the rig itself, before those of the units.
pub const TRUTH_RIG: usize = 9;

/// Doubles that [`plant_truth`] writes for each unit.
pub const TRUTH_UNIT: usize = 3;

/// [`ABI_VERSION`].
#[no_mangle]
pub extern "C" fn plant_abi_version() -> u32 {
    ABI_VERSION
}

/// A rig at rest; all scatter is drawn from `seed`. `config` is a plant configuration in TOML, or
/// null for the default one. Returns null where it cannot be built, with the reason,
/// zero-terminated, in `error`.
///
/// # Safety
/// `config` is null or a zero-terminated string; `error` is null or has room for `error_size`
/// bytes.
#[no_mangle]
pub unsafe extern "C" fn plant_new(
    seed: u64,
    config: *const c_char,
    error: *mut c_char,
    error_size: usize,
) -> *mut Plant {
    let text = if config.is_null() {
        Ok("")
    } else {
        // SAFETY: not null, and zero-terminated by contract.
        unsafe { CStr::from_ptr(config) }
            .to_str()
            .map_err(|e| e.to_string())
    };
    match text.and_then(|text| build(seed, text)) {
        Ok(plant) => Box::into_raw(Box::new(plant)),
        Err(why) => {
            if !error.is_null() && error_size > 0 {
                let bytes = why.as_bytes();
                let length = bytes.len().min(error_size - 1);
                // SAFETY: room for `error_size` bytes by contract, and `length + 1 <= error_size`.
                unsafe {
                    std::ptr::copy_nonoverlapping(bytes.as_ptr(), error.cast(), length);
                    error.add(length).write(0);
                }
            }
            std::ptr::null_mut()
        }
    }
}

fn build(seed: u64, text: &str) -> Result<Plant, String> {
    let config: PlantConfig = toml::from_str(text).map_err(|e| e.to_string())?;
    Plant::new(config, seed).map_err(|e| e.to_string())
}

/// Frees a rig. Null does nothing.
///
/// # Safety
/// `plant` is null or came from [`plant_new`] and was not freed before.
#[no_mangle]
pub unsafe extern "C" fn plant_free(plant: *mut Plant) {
    if !plant.is_null() {
        // SAFETY: made by `Box::into_raw` in `plant_new`, by contract not freed yet.
        drop(unsafe { Box::from_raw(plant) });
    }
}

/// # Safety
/// `plant` is null or a live handle that no other thread uses.
unsafe fn rig<'a>(plant: *mut Plant) -> Option<&'a mut Plant> {
    // SAFETY: by the contract of every function here.
    unsafe { plant.as_mut() }
}

/// # Safety
/// As [`rig`].
unsafe fn unit<'a>(plant: *mut Plant, unit: u32) -> Option<(&'a mut Plant, usize)> {
    // SAFETY: passed on.
    let plant = unsafe { rig(plant) }?;
    let unit = usize::try_from(unit).ok()?;
    (unit < plant.units()).then_some((plant, unit))
}

/// Number of units.
///
/// # Safety
/// `plant` is null or a live handle that no other thread uses.
#[no_mangle]
pub unsafe extern "C" fn plant_units(plant: *mut Plant) -> u32 {
    // SAFETY: by contract.
    unsafe { rig(plant) }.map_or(0, |p| u32::try_from(p.units()).unwrap_or(u32::MAX))
}

/// Runs the rig on to virtual time `t_ns`, in nanoseconds. Times that have passed are ignored.
///
/// # Safety
/// `plant` is null or a live handle that no other thread uses.
#[no_mangle]
pub unsafe extern "C" fn plant_advance_to(plant: *mut Plant, t_ns: u64) {
    // SAFETY: by contract.
    if let Some(p) = unsafe { rig(plant) } {
        p.advance_to(t_ns);
    }
}

/// Amplifier input of `unit` in volts, from the time reached on. Returns 1, or 0 where the unit
/// does not exist or the value is not finite (the unit then gets 0 V).
///
/// # Safety
/// `plant` is null or a live handle that no other thread uses.
#[no_mangle]
pub unsafe extern "C" fn plant_set_amplifier_volts(
    plant: *mut Plant,
    unit_from_0: u32,
    volts: f64,
) -> u8 {
    // SAFETY: by contract.
    unsafe { unit(plant, unit_from_0) }
        .is_some_and(|(p, u)| p.set_amplifier_volts(u, volts).is_ok())
        .into()
}

/// Power of the amplifiers: 0 off, else on.
///
/// # Safety
/// `plant` is null or a live handle that no other thread uses.
#[no_mangle]
pub unsafe extern "C" fn plant_set_amplifier_power(plant: *mut Plant, on: u8) {
    // SAFETY: by contract.
    if let Some(p) = unsafe { rig(plant) } {
        p.set_amplifier_power(on != 0);
    }
}

/// Whether the robot follows its path: 0 stands, else moves.
///
/// # Safety
/// `plant` is null or a live handle that no other thread uses.
#[no_mangle]
pub unsafe extern "C" fn plant_set_robot_moving(plant: *mut Plant, moving: u8) {
    // SAFETY: by contract.
    if let Some(p) = unsafe { rig(plant) } {
        p.set_robot_moving(moving != 0);
    }
}

/// Bridge output of the load cell of `unit`, in volts per volt of excitation.
///
/// # Safety
/// `plant` is null or a live handle that no other thread uses.
#[no_mangle]
pub unsafe extern "C" fn plant_bridge_v_per_v(plant: *mut Plant, unit_from_0: u32) -> f64 {
    // SAFETY: by contract.
    unsafe { unit(plant, unit_from_0) }.map_or(0.0, |(p, u)| p.bridge_v_per_v(u))
}

/// What one newton along its axis adds to the bridge of `unit`, by the cell's own sensitivity, in
/// V/V per N.
///
/// # Safety
/// `plant` is null or a live handle that no other thread uses.
#[no_mangle]
pub unsafe extern "C" fn plant_bridge_per_newton(plant: *mut Plant, unit_from_0: u32) -> f64 {
    // SAFETY: by contract.
    unsafe { unit(plant, unit_from_0) }.map_or(0.0, |(p, u)| p.parameters(u).bridge_per_n)
}

/// Encoder of `unit`, in quadrature counts at x4 since the start.
///
/// # Safety
/// `plant` is null or a live handle that no other thread uses.
#[no_mangle]
pub unsafe extern "C" fn plant_encoder_counts(plant: *mut Plant, unit_from_0: u32) -> i64 {
    // SAFETY: by contract.
    unsafe { unit(plant, unit_from_0) }.map_or(0, |(p, u)| p.encoder_counts(u))
}

/// The true state: tip position (m, 3), tip velocity (m/s, 3), force on the tip (N, 3), then for
/// each unit its tension (N), reel speed (rad/s) and motor current (A). Writes at most `room`
/// doubles and returns how many there are.
///
/// # Safety
/// `plant` is null or a live handle that no other thread uses; `out` is null or has room for `room`
/// doubles.
#[no_mangle]
pub unsafe extern "C" fn plant_truth(plant: *mut Plant, out: *mut f64, room: usize) -> usize {
    // SAFETY: by contract.
    let Some(p) = (unsafe { rig(plant) }) else {
        return 0;
    };
    let tip = [
        p.tip_position_m(),
        p.tip_velocity_m_per_s(),
        p.tip_force_n(),
    ];
    let mut row: Vec<f64> = tip.into_iter().flatten().collect();
    for u in 0..p.units() {
        row.extend([p.tension_n(u), p.reel_rad_per_s(u), p.current_a(u)]);
    }
    if !out.is_null() {
        // SAFETY: room for `room` doubles by contract.
        unsafe { std::ptr::copy_nonoverlapping(row.as_ptr(), out, row.len().min(room)) };
    }
    row.len()
}
