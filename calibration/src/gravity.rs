//! Gravity where the rig stands, and the air that carries a part of a weight.

/// Standard acceleration of gravity, m/s^2 (ISO 80000-3). The local value lies within 0.27 % of it.
pub const STANDARD_M_PER_S2: f64 = 9.806_65;

/// What is on Earth at places where people live, m/s^2.
pub const ON_EARTH_M_PER_S2: std::ops::RangeInclusive<f64> = 9.76..=9.84;

/// Relative standard uncertainty of [`STANDARD_M_PER_S2`] for a place that is not known: 0.27 %
/// either way, equally likely (limit / sqrt 3). Singapore has 9.7807, -0.27 %; Spitsbergen 9.830,
/// +0.24 %.
pub const UNKNOWN_PLACE_SD: f64 = 0.0016;

/// Relative standard uncertainty of [`normal_m_per_s2`] as the local value: gravity anomalies of 50
/// mGal (estimate; the stations of the test lie within 45 mGal). In high mountains look the local
/// value up.
pub const ANOMALY_SD: f64 = 5e-5;

/// Decrease of gravity with the height, relative, 1/m.
pub const PER_METRE: f64 = 3.15e-7;

/// Part of a weight that air carries: 1.2 kg/m^3 over 8000 kg/m^3, the density to which the value
/// of a weight refers whatever it is made of (OIML D 28, conventional value of mass).
pub const AIR_BUOYANCY: f64 = 1.5e-4;

/// Relative standard uncertainty of a force from [`AIR_BUOYANCY`]: air of 0.95 to 1.3 kg/m^3, from
/// a high plateau to a cold day at the sea.
pub const AIR_BUOYANCY_SD: f64 = 1.3e-5;

/// Normal gravity at a latitude (degrees) and a height above the ellipsoid (m), m/s^2: the formula
/// of Somigliana with the constants of WGS 84 and its second-order term in height (NIMA TR8350.2,
/// 3rd ed., equations 4-1 and 4-3).
#[must_use]
pub fn normal_m_per_s2(latitude_deg: f64, height_m: f64) -> f64 {
    const EQUATOR: f64 = 9.780_325_335_9;
    const K: f64 = 0.001_931_852_652_41;
    const E2: f64 = 0.006_694_379_990_13;
    const A_M: f64 = 6_378_137.0;
    const F: f64 = 1.0 / 298.257_223_563;
    const M: f64 = 0.003_449_786_506_84;
    let s2 = latitude_deg.to_radians().sin().powi(2);
    let at_sea = EQUATOR * (1.0 + K * s2) / (1.0 - E2 * s2).sqrt();
    let h = height_m / A_M;
    at_sea * (1.0 - 2.0 * (1.0 + F + M - 2.0 * F * s2) * h + 3.0 * h * h)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_gravity_is_near_what_is_measured() {
        // At the poles, the constant of WGS 84.
        assert!((normal_m_per_s2(90.0, 0.0) - 9.832_184_937_8).abs() < 1e-8);
        // Absolute stations: Sevres (BIPM, 48.83 N, 66 m) 9.80926; Singapore (1.3 N, 20 m) 9.7807;
        // Boulder, Table Mountain (40.13 N, 1682 m) 9.79622.
        for (latitude, height, measured) in [
            (48.83, 66.0, 9.809_26),
            (1.3, 20.0, 9.780_7),
            (40.13, 1682.0, 9.796_22),
        ] {
            let relative = normal_m_per_s2(latitude, height) / measured - 1.0;
            assert!(relative.abs() < 2.0 * ANOMALY_SD, "{latitude}: {relative}");
        }
        let drop = 1.0 - normal_m_per_s2(45.0, 1000.0) / normal_m_per_s2(45.0, 0.0);
        assert!((drop / (1000.0 * PER_METRE) - 1.0).abs() < 1e-2, "{drop}");
    }
}
