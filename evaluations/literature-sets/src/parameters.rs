//! Parameters of an effect: drawn from documented ranges, then scaled to the given size.

use crate::random::Random;
use serde_json::{json, Value};

/// One physical parameter of an effect.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Name, as in the equation of the effect.
    pub name: &'static str,
    /// Unit as text; `-` for a pure number.
    pub unit: &'static str,
    /// Value, in `unit`.
    pub value: f64,
    /// Lower and upper end of the documented range, in `unit`.
    pub typical: [f64; 2],
    /// True for a parameter that carries the size: it is multiplied by the scale, and may leave
    /// `typical`.
    pub scaled: bool,
}

/// All parameters of an effect.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parameters(Vec<Parameter>);

impl Parameters {
    /// The parameters as a list, in the order of their definition.
    pub fn list(&self) -> &[Parameter] {
        &self.0
    }

    /// Value of a parameter, in its unit.
    ///
    /// # Panics
    /// If the effect has no parameter of this name, which is a mistake in the catalogue.
    pub fn get(&self, name: &str) -> f64 {
        match self.0.iter().find(|p| p.name == name) {
            Some(p) => p.value,
            None => panic!("effect has no parameter {name}"),
        }
    }

    /// The same parameters with another value of one.
    pub fn with(mut self, name: &str, value: f64) -> Self {
        for p in self.0.iter_mut().filter(|p| p.name == name) {
            p.value = value;
        }
        self
    }

    /// The same parameters with those that carry the size multiplied by `scale`.
    pub fn at_scale(&self, scale: f64) -> Self {
        let mut scaled = self.clone();
        for p in scaled.0.iter_mut().filter(|p| p.scaled) {
            p.value *= scale;
        }
        scaled
    }

    /// The same parameters with one (by index) multiplied by a factor, or taken from `other`
    /// without a factor.
    pub fn with_changed(&self, index: usize, factor: Option<f64>, other: &Self) -> Self {
        let mut changed = self.clone();
        if let (Some(to), Some(from)) = (changed.0.get_mut(index), other.0.get(index)) {
            to.value = factor.map_or(from.value, |factor| to.value * factor);
        }
        changed
    }

    /// For `truth.json`: each parameter with unit, range, and whether the value lies in the range.
    pub fn to_json(&self) -> Value {
        self.0
            .iter()
            .map(|p| {
                json!({
                    "name": p.name,
                    "value": p.value,
                    "unit": p.unit,
                    "typical": p.typical,
                    "within_typical": (p.typical[0]..=p.typical[1]).contains(&p.value),
                    "carries_size": p.scaled,
                })
            })
            .collect()
    }
}

/// What an effect may know about the set when its parameters are drawn.
#[derive(Clone, Copy, Debug)]
pub struct Scene {
    /// Rows per second.
    pub rate_hz: f64,
    /// Largest command of the set in N.
    pub max_command_n: f64,
    /// Smallest command of the set in N.
    pub min_command_n: f64,
    /// Largest reading of the set without noise and effects, in N.
    pub max_reading_n: f64,
    /// Largest distance of the reel from its mean angle in a run, in rad.
    pub travel_rad: f64,
    /// Largest speed of the reel in rad/s.
    pub max_speed_rad_s: f64,
}

/// Draws parameters; each method appends one and returns its value.
pub struct Draw<'a> {
    random: &'a mut Random,
    drawn: Parameters,
}

impl<'a> Draw<'a> {
    /// A draw without parameters yet.
    pub fn new(random: &'a mut Random) -> Self {
        Self {
            random,
            drawn: Parameters::default(),
        }
    }

    /// The parameters drawn so far.
    pub fn finish(self) -> Parameters {
        self.drawn
    }

    fn push(
        &mut self,
        name: &'static str,
        unit: &'static str,
        value: f64,
        typical: [f64; 2],
        scaled: bool,
    ) -> f64 {
        self.drawn.0.push(Parameter {
            name,
            unit,
            value,
            typical,
            scaled,
        });
        value
    }

    /// Log-uniform in a range.
    pub fn log(&mut self, name: &'static str, unit: &'static str, low: f64, high: f64) -> f64 {
        let value = self.random.log_uniform(low, high);
        self.push(name, unit, value, [low, high], false)
    }

    /// Uniform in a range.
    pub fn uniform(&mut self, name: &'static str, unit: &'static str, low: f64, high: f64) -> f64 {
        let value = self.random.uniform(low, high);
        self.push(name, unit, value, [low, high], false)
    }

    /// One of a list.
    pub fn choice(&mut self, name: &'static str, unit: &'static str, values: &[f64]) -> f64 {
        let value = values[self.random.index(values.len())];
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        self.push(name, unit, value, [low, high], false)
    }

    /// A phase in rad, uniform over a turn.
    pub fn phase(&mut self, name: &'static str) -> f64 {
        self.uniform(name, "rad", 0.0, std::f64::consts::TAU)
    }

    /// A parameter that carries the size: log-uniform in its range, then scaled.
    pub fn scaled(&mut self, name: &'static str, unit: &'static str, low: f64, high: f64) -> f64 {
        let value = self.random.log_uniform(low, high);
        self.push(name, unit, value, [low, high], true)
    }

    /// As [`Self::scaled`], with a random sign; the range holds for the magnitude.
    pub fn signed(&mut self, name: &'static str, unit: &'static str, low: f64, high: f64) -> f64 {
        let value = self.random.log_uniform(low, high) * self.random.sign();
        self.push(name, unit, value, [-high, high], true)
    }

    /// A parameter that carries the size and is `base` times a ratio, uniform in `[low, high]`.
    /// `base_typical` is the range of the base.
    pub fn scaled_ratio(
        &mut self,
        name: &'static str,
        unit: &'static str,
        base: f64,
        base_typical: [f64; 2],
        [low, high]: [f64; 2],
    ) -> f64 {
        let value = base * self.random.uniform(low, high);
        let ends = [
            base_typical[0] * low,
            base_typical[0] * high,
            base_typical[1] * low,
            base_typical[1] * high,
        ];
        let typical = [
            ends.iter().copied().fold(f64::INFINITY, f64::min),
            ends.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        ];
        self.push(name, unit, value, typical, true)
    }

    /// A value that follows from the set, such as the largest command.
    pub fn given(&mut self, name: &'static str, unit: &'static str, value: f64) -> f64 {
        self.push(name, unit, value, [value, value], false)
    }
}
