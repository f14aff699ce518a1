//! Random numbers for what differs from rig to rig: each use draws from a stream of its own
//! ([`random`]), named by a label and an index.

/// A normal draw further out than this is drawn again, so that no rig is absurd; in standard
/// deviations.
pub const FURTHEST: f64 = 2.5;

/// The seed of what differs from run to run of one rig, from the rig's `seed`. Run 0 has the rig's
/// seed.
#[must_use]
pub const fn seed_of_run(seed: u64, run: u64) -> u64 {
    // Odd multiples of the golden section: neighbouring runs of neighbouring seeds have different
    // ones.
    seed.wrapping_add(run.wrapping_mul(0x9E37_79B9_7F4A_7C15))
}
