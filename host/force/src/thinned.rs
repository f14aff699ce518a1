//! Values of a run of any length, of which a bounded number is kept, evenly over time.

/// Values that come one after the other. Where as many are kept as may be, each second one goes,
/// and from then on one of twice as many is kept.
#[derive(Debug, Clone)]
pub struct Thinned<T> {
    kept: Vec<T>,
    most: usize,
    /// One of so many is kept.
    every: u64,
    seen: u64,
}

impl<T> Thinned<T> {
    /// None yet, of which `most` are kept.
    #[must_use]
    pub const fn new(most: usize) -> Self {
        Self {
            kept: Vec::new(),
            most,
            every: 1,
            seen: 0,
        }
    }

    /// Takes the next value.
    pub fn push(&mut self, value: T) {
        if self.seen.is_multiple_of(self.every) && self.kept.len() == self.most {
            let mut keep = false;
            self.kept.retain(|_| {
                keep = !keep;
                keep
            });
            self.every *= 2;
        }
        if self.seen.is_multiple_of(self.every) {
            self.kept.push(value);
        }
        self.seen += 1;
    }

    /// Whether all that came are kept.
    #[must_use]
    pub const fn is_whole(&self) -> bool {
        self.every == 1
    }

    /// Those that are kept, in the order in which they came.
    #[must_use]
    pub fn kept(&self) -> &[T] {
        &self.kept
    }

    /// The same, without the rest.
    #[must_use]
    pub fn into_kept(self) -> Vec<T> {
        self.kept
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bounded_number_is_kept_evenly_and_all_as_long_as_they_fit() {
        let mut thinned = Thinned::new(8);
        (0..8).for_each(|n| thinned.push(n));
        assert!(thinned.is_whole());
        assert_eq!(thinned.kept(), [0, 1, 2, 3, 4, 5, 6, 7]);
        (8..100).for_each(|n| thinned.push(n));
        assert!(!thinned.is_whole());
        assert_eq!(thinned.into_kept(), [0, 16, 32, 48, 64, 80, 96]);
    }
}
