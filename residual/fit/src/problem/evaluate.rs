//! Values of expressions on the kept rows, kept for the next scan.

use super::{Column, Problem};
use residual_columns::error::Error;
use residual_columns::expr::Expr;
use residual_columns::frame::Frame;
use residual_columns::stats;
use std::collections::{HashMap, VecDeque};
use std::fmt;
use std::sync::{Arc, MutexGuard, PoisonError, Weak};

/// Most values that evaluated expressions may keep in memory (8 bytes each).
const CACHE_VALUES: usize = 1 << 24;

/// The same for large logs, and for the windows on which they are screened: there a scan tries few
/// forms on all rows, each at other values of its parameter.
const CACHE_VALUES_LARGE: usize = 1 << 21;

/// Views that are kept: the model's, and those of models without one of its effects.
const VIEWS: usize = 4;

/// The same for large logs, of which each view may have new columns.
const VIEWS_LARGE: usize = 1;

/// Entries that may stand for values no longer in use before they are looked for.
const FEWEST_IN_FITS: usize = 64;

/// Rows from which on a log is large.
/// Twice the rows of the windows.
const LARGE: usize = 120_000;

/// Name that stands for a term in an expression through which every term goes.
pub const EVERYTHING: &str = "everything";

/// What a model replaces in every term, found or yet to be found.
#[derive(Debug, Clone)]
pub enum Replaced {
    /// Columns, and the expressions that stand in their place.
    Columns(Vec<(String, Expr)>),
    /// The terms themselves: a linear expression of [`EVERYTHING`] and of no column.
    Terms(Expr),
}

impl fmt::Display for Replaced {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Replaced::Columns(pairs) => pairs.iter().try_for_each(|(n, e)| write!(f, "{n}={e};")),
            Replaced::Terms(through) => write!(f, "{EVERYTHING}={through};"),
        }
    }
}

/// A term that goes through an expression of [`EVERYTHING`].
#[must_use]
pub fn through_of(through: &Expr, term: &Expr) -> Expr {
    through.substitute(&|name| (name == EVERYTHING).then(|| term.clone()))
}

/// The columns as a model sees them: some are replaced in every term, found or yet to be found.
#[derive(Debug)]
pub struct View {
    key: String,
    /// The columns.
    pub frame: Frame,
    /// What every term goes through.
    through: Vec<Expr>,
}

impl View {
    /// The columns as they are.
    pub(super) fn plain(frame: Frame) -> View {
        View {
            key: String::new(),
            frame,
            through: vec![],
        }
    }

    /// A term as the model sees it, in the columns of the view.
    fn seen(&self, e: &Expr) -> Expr {
        let all = self.through.iter();
        all.fold(e.clone(), |e, through| through_of(through, &e))
    }

    /// Distinguishes views.
    pub fn key(&self) -> &str {
        &self.key
    }
}

/// Expressions that were evaluated already: the same forms come up in every scan.
#[derive(Debug, Default)]
pub(super) struct Cache {
    /// Values by view and text, with the scan that used them last.
    columns: HashMap<String, (Column, usize)>,
    values: usize,
    /// Values for which there is no room, as long as a fit has them: the fits of a large log have
    /// most columns in common.
    in_fits: HashMap<String, Weak<Vec<f64>>>,
    /// Entries of `in_fits` at which those that no fit has any more are removed.
    most_in_fits: usize,
    ranges: HashMap<String, Option<(f64, f64)>>,
    views: VecDeque<Arc<View>>,
    scan: usize,
    /// The scan in which old values were removed last.
    swept: usize,
}

impl Cache {
    /// Values by view and text.
    fn find(&mut self, key: &str) -> Option<Column> {
        let scan = self.scan;
        if let Some((known, used)) = self.columns.get_mut(key) {
            *used = scan;
            return Some(known.clone());
        }
        self.in_fits.get(key)?.upgrade()
    }

    /// Keeps values for as long as there is room, or a fit has them. What the table has needs no
    /// room.
    fn keep(&mut self, key: String, v: &Column, most: usize) {
        if Arc::strong_count(v) > 1 || !self.make_room(v.len(), most) {
            if self.in_fits.len() >= self.most_in_fits {
                self.in_fits.retain(|_, v| v.strong_count() > 0);
                self.most_in_fits = 2 * self.in_fits.len() + FEWEST_IN_FITS;
            }
            self.in_fits.insert(key, Arc::downgrade(v));
        } else if self.columns.insert(key, (v.clone(), self.scan)).is_none() {
            self.values += v.len();
        }
    }

    /// Whether a column of this size fits. Removes values that this scan did not use, if it does
    /// not.
    fn make_room(&mut self, values: usize, most: usize) -> bool {
        if self.values + values > most && self.swept < self.scan {
            self.swept = self.scan;
            let Cache {
                columns,
                in_fits,
                scan,
                ..
            } = self;
            columns.retain(|key, (v, used)| {
                let recent = used == scan;
                if !recent && Arc::strong_count(v) > 1 {
                    in_fits.insert(key.clone(), Arc::downgrade(v));
                }
                recent
            });
            self.values = self.columns.values().map(|(v, _)| v.len()).sum();
        }
        self.values + values <= most
    }
}

impl Problem {
    /// The columns with some replaced, one list after the other.
    pub fn view(&self, replaced: &[Replaced]) -> Result<Arc<View>, Error> {
        if replaced.is_empty() {
            return Ok(self.plain.clone());
        }
        let key: String = replaced.iter().map(Replaced::to_string).collect();
        if let Some(known) = self.cache().views.iter().find(|v| v.key == key) {
            return Ok(known.clone());
        }
        let mut frame = self.frame.clone();
        let mut through = Vec::new();
        for one in replaced {
            match one {
                Replaced::Columns(pairs) => {
                    let old = frame.clone();
                    for (name, e) in pairs {
                        frame.insert(name, e.eval(&old)?);
                    }
                }
                Replaced::Terms(expr) => through.push(expr.clone()),
            }
        }
        let view = Arc::new(View {
            key,
            frame,
            through,
        });
        let mut cache = self.cache();
        cache.views.push_back(view.clone());
        let most = if self.is_large() { VIEWS_LARGE } else { VIEWS };
        if cache.views.len() > most {
            cache.views.pop_front();
        }
        Ok(view)
    }

    /// Keeps the values of calls that many expressions contain; anything else is left alone.
    pub fn derive(&mut self, texts: &[String]) {
        for text in texts {
            let Ok(e @ Expr::Call(..)) = Expr::parse(text) else {
                continue;
            };
            if let Ok(values) = e.eval(&self.frame) {
                self.frame.derive(e.to_string(), values);
            }
        }
        self.plain = Arc::new(View::plain(self.frame.clone()));
    }

    /// A scan begins: values that it uses take precedence over those of earlier scans.
    pub fn next_scan(&self) {
        self.cache().scan += 1;
    }

    /// Evaluates an expression on the kept rows, and keeps the values for the next time; values
    /// that are not finite become an error.
    pub fn eval(&self, view: &View, e: &Expr) -> Result<Column, Error> {
        self.cached(format!("{}{e}", view.key), true, || {
            self.eval_on(&view.frame, &view.seen(e))
        })
    }

    /// The same for an expression as text; `keep` it only if it is likely to be used again.
    pub fn eval_text(&self, view: &View, text: &str, keep: bool) -> Result<Column, Error> {
        self.cached(format!("{}{text}", view.key), keep, || {
            self.eval_on(&view.frame, &view.seen(&Expr::parse(text)?))
        })
    }

    /// The same for a term in which columns of a view are replaced; `swapped` gives the frame with
    /// them, and is called only if the values are not stored.
    pub fn eval_swapped<'a>(
        &self,
        view: &View,
        pairs: &[(String, String)],
        e: &Expr,
        keep: bool,
        swapped: impl FnOnce() -> Result<&'a Frame, Error>,
    ) -> Result<Column, Error> {
        self.cached(format!("{}{pairs:?}{e}", view.key), keep, || {
            self.eval_on(swapped()?, &view.seen(e))
        })
    }

    fn is_large(&self) -> bool {
        self.windows || self.y.len() > LARGE
    }

    fn cache_values(&self) -> usize {
        if self.is_large() {
            CACHE_VALUES_LARGE
        } else {
            CACHE_VALUES
        }
    }

    fn cache(&self) -> MutexGuard<'_, Cache> {
        self.cache.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn cached(
        &self,
        key: String,
        keep: bool,
        values: impl FnOnce() -> Result<Column, Error>,
    ) -> Result<Column, Error> {
        if let Some(known) = self.cache().find(&key) {
            return Ok(known);
        }
        let v = values()?;
        if keep {
            self.cache().keep(key, &v, self.cache_values());
        }
        Ok(v)
    }

    /// Evaluates an expression on the kept rows of a frame with other values in some columns.
    pub fn eval_on(&self, frame: &Frame, e: &Expr) -> Result<Column, Error> {
        let known = frame.known(e).filter(|_| self.kept.is_none());
        let v = match known {
            Some(known) => known.clone(),
            None => Arc::new(self.gather(e.eval(frame)?)),
        };
        // Chunks, as a test that may stop at each value is slow.
        let finite = |c: &[f64]| c.iter().fold(true, |all, x| all & x.is_finite());
        if !v.chunks(1024).all(finite) {
            let row = v.iter().position(|x| !x.is_finite()).unwrap_or(0) + 1;
            return Err(Error::Expression {
                text: e.to_string(),
                why: format!("is not finite on fitted row {row}"),
            });
        }
        Ok(v)
    }

    /// 2 % and 98 % quantiles of an expression; `None` if they are equal or it cannot be evaluated.
    pub fn range(&self, text: &str) -> Option<(f64, f64)> {
        if let Some(known) = self.cache().ranges.get(text) {
            return *known;
        }
        let mut v = self
            .eval_text(&self.plain, text, true)
            .map_or_else(|_| vec![], |v| v.to_vec());
        v.sort_unstable_by(f64::total_cmp);
        let (lo, hi) = (
            stats::quantile_sorted(&v, 0.02),
            stats::quantile_sorted(&v, 0.98),
        );
        let range = (hi > lo).then_some((lo, hi));
        self.cache().ranges.insert(text.to_string(), range);
        range
    }
}
