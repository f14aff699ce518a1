//! Which runs train and which test. Rows of one run never stand on both sides, but for the split by
//! random rows, which is there to be compared.

/// How runs are kept apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Apart {
    /// One run is left out. The same load is in other runs.
    Run,
    /// One load is left out, with all its runs.
    Level,
    /// One load and one speed: the training has neither.
    LevelAndSpeed,
}

/// Step of the speed and of the load of a run.
pub type Label = (u8, u8);

/// One fold: numbers of runs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fold {
    /// Tested.
    pub test: Vec<usize>,
    /// Trained on.
    pub train: Vec<usize>,
}

impl Apart {
    /// The folds among some of the runs, given by number.
    #[must_use]
    pub fn folds(self, labels: &[Label], among: &[usize]) -> Vec<Fold> {
        let mut keys: Vec<(u8, u8, usize)> =
            among.iter().map(|run| self.key(labels, *run)).collect();
        keys.sort_unstable();
        keys.dedup();
        keys.into_iter()
            .map(|key| {
                let (test, other): (Vec<usize>, Vec<usize>) =
                    among.iter().partition(|run| self.key(labels, **run) == key);
                let train = other
                    .into_iter()
                    .filter(|run| {
                        self != Self::LevelAndSpeed
                            || (labels[*run].0 != key.0 && labels[*run].1 != key.1)
                    })
                    .collect();
                Fold { test, train }
            })
            .filter(|fold| !fold.train.is_empty())
            .collect()
    }

    /// What runs of one fold have in common.
    fn key(self, labels: &[Label], run: usize) -> (u8, u8, usize) {
        let (speed, level) = labels[run];
        match self {
            Self::Run => (0, 0, run),
            Self::Level => (0, level, 0),
            Self::LevelAndSpeed => (speed, level, 0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_of_the_tested_kind_is_trained_on() {
        let labels: Vec<Label> = (0..5).flat_map(|s| (0..10).map(move |l| (s, l))).collect();
        let all: Vec<usize> = (0..labels.len()).collect();
        for (apart, folds, train) in [
            (Apart::Run, 50, 49),
            (Apart::Level, 10, 45),
            (Apart::LevelAndSpeed, 50, 36),
        ] {
            let found = apart.folds(&labels, &all);
            assert_eq!(found.len(), folds);
            for fold in found {
                assert_eq!(fold.train.len(), train);
                for (a, b) in fold
                    .test
                    .iter()
                    .flat_map(|a| fold.train.iter().map(move |b| (*a, *b)))
                {
                    assert_ne!(a, b);
                    assert!(apart == Apart::Run || labels[a].1 != labels[b].1);
                    assert!(apart != Apart::LevelAndSpeed || labels[a].0 != labels[b].0);
                }
            }
        }
    }
}
