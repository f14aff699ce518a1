//! What helps against an effect for which the board has no setting.

/// Whether an effect is of the load cell: `calibrate gain` measures it, and the board takes it out.
#[must_use]
pub fn is_of_cell(name: &str) -> bool {
    matches!(name, "creep" | "quadratic" | "kink")
}

/// What to do about an effect by its name in a report; `None` where the board has a setting for it.
#[must_use]
pub fn without_setting(name: &str) -> Option<&'static str> {
    Some(match name {
        "creep" => {
            "`forcectl calibrate gain` measures the creep with weights, and the board then takes it out; without weights, hold a \
             new load for some time constants before measuring; a load cell of a better creep class (OIML R 60) removes it"
        }
        "quadratic" | "kink" => {
            "`forcectl calibrate gain` with weights over the whole range that is used measures a curve, and the board then takes \
             it out; a kink points to a second load path: a cable or a screw that touches above that load"
        }
        "backlash" => {
            "keep every cable above its lowest tension so that the play stays closed on one side, and repair it: pinion \
             against rack, coupling, gear; a setting cannot move a drive through its play without an impact"
        }
        "hysteresis" | "presliding" => {
            "reach each force from the same side, or move the cable over its turning distance before measuring; a cable \
             guide with a larger radius or less wrap makes the loop smaller"
        }
        "angle_friction" => {
            "turn the reel by hand through the named sector and look for what rubs: a bent shaft, a burr, a cable layer"
        }
        "saturation" => {
            "keep the tensions below the limit that was found, or raise the limit: supply, amplifier range, converter gain"
        }
        "slew_limit" => {
            "change the command more slowly than the rate that was found, or raise the limit: a ramp in the drive, the amplifier"
        }
        "quantisation" => "use a larger gain of the converter or the amplifier, so that one step is smaller",
        "clock_skew" => "log all columns with one clock, or correct the times of one log by the skew that was found",
        "drift_time" | "drift_temperature" => {
            "take zeros again after warm-up and between runs; with a temperature column the drift per degree can be taken \
             out of the log"
        }
        "crosstalk" => {
            "route and shield the wires of the named channel apart, and check the common ground; or decouple the load \
             cells mechanically"
        }
        "tone" => "find the source by its frequency (mains, a fan, a converter) and remove it, or move the row rate away from it",
        "inertia" | "payload" | "gravity_angle" => {
            "declare the mass in the model of the arm, or move more slowly: the board holds tension and knows no mass"
        }
        "cable_stretch" => "use a stiffer or shorter cable, or lower gains; the board follows tension and not length",
        "geometry" | "cosine_misalignment" => {
            "measure exit points and axes again (`forcectl calibrate`): the direction of the cable is not what the rig file says"
        }
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::without_setting;

    /// What a setting exists for has no line here, everything else has one.
    #[test]
    fn every_effect_of_the_catalogue_has_a_setting_or_advice() {
        let settings = [
            "offset",
            "gain",
            "coulomb",
            "load_dependent_coulomb",
            "viscous",
            "stribeck",
            "periodic_angle",
            "delay",
            "sensor_lag",
        ];
        for name in residual::names() {
            assert_eq!(
                without_setting(name).is_none(),
                settings.contains(&name),
                "{name}"
            );
        }
    }
}
