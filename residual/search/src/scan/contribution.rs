//! What a form adds to the prediction, row by row.

use super::{Candidate, Scan};
use residual_effects::Variant;

impl Scan<'_> {
    /// What a candidate adds to the prediction; empty if it cannot be evaluated.
    pub fn contribution<O>(&self, c: &Candidate<O>) -> Vec<f64> {
        self.added(&c.variant, c.psi)
    }

    /// What a form at `psi` adds to the prediction: 0 on every row for a form whose coefficients
    /// every sequence has for itself, empty if it cannot be evaluated.
    pub fn added(&self, variant: &Variant, psi: f64) -> Vec<f64> {
        let Ok(own) = self.sums(&(variant.build)(psi), false) else {
            return vec![];
        };
        let mut out = vec![0.0; self.problem.y.len()];
        if own.local {
            return out;
        }
        let (x, _) = own.sums.fit(None);
        for (column, k) in own.columns.iter().zip(&x) {
            out.iter_mut()
                .zip(column.iter())
                .for_each(|(o, v)| *o += k * v);
        }
        if let Some(present) = &own.present {
            out.iter_mut().zip(present).for_each(|(o, p)| *o -= p);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use crate::model::{Fit, Fitted, Model};
    use crate::scan::Scan;
    use residual_columns::frame::Frame;
    use residual_columns::linalg::dot;
    use residual_columns::stats::Rng;
    use residual_effects::{Build, Piece, Variant};
    use residual_fit::problem::Problem;
    use residual_log::spec::Spec;

    const RUNS: usize = 4;
    const ROWS: usize = 300;

    /// What a form adds is what a fit of the model with the form takes off the residual.
    fn is_that_of_a_fit(terms: &str, build: fn(f64) -> Build) {
        let mut rng = Rng::new(9);
        let n = RUNS * ROWS;
        let of = |f: &dyn Fn(f64) -> f64| (0..n).map(|i| f(0.02 * i as f64)).collect::<Vec<f64>>();
        let command = of(&|t| 2.0 + (1.3 * t).sin() + 0.4 * (4.1 * t).cos());
        let speed = of(&|t| (0.9 * t).cos());
        let target = command.iter().zip(&speed);
        let target = target.map(|(c, v)| 1.4 * c + 0.3 * v + 0.2 * rng.normal());
        let target = target.collect();
        let columns = [("target", target), ("command", command), ("speed", speed)];
        let columns = columns.map(|(name, values)| (name.to_string(), values));
        let runs = (0..RUNS).map(|k| k * ROWS..(k + 1) * ROWS).collect();
        let frame = Frame::new(columns.into(), of(&|t| t), runs);
        let fold: Vec<u32> = (0..n).map(|i| (i / ROWS) as u32).collect();
        // Some rows are not fitted.
        let keep: Vec<bool> = (0..n).map(|i| i % 37 > 2).collect();
        let problem = Problem::new(frame, &keep, &fold, 2, 1);
        let spec = Spec::parse(&format!(
            "[roles]\ntime = {{ column = \"t\" }}\ntarget = {{ column = \"y\", unit = \"N\" }}\n\
             command = {{ column = \"c\", unit = \"N\" }}\nvelocity = {{ column = \"v\", unit = \"m/s\" }}\n{terms}"
        ))
        .unwrap();
        let model = Model::declared(&spec).unwrap();
        let fit = Fit::new(&problem, &model).unwrap();
        let fitted = Fitted { model, fit };
        let mut with = fitted.model.clone();
        with.apply(&build(0.1), 0).unwrap();
        let expected = Fit::new(&problem, &with).unwrap().residual;
        let scan = Scan::new(&problem, &spec, "command", &fitted);
        let variant = Variant {
            build: Box::new(build),
            ..Variant::linear("", vec![])
        };
        let added = scan.added(&variant, 0.0);
        assert!(dot(&added, &added) > 1.0, "{terms}");
        for (i, expected) in expected.iter().enumerate() {
            let own = fitted.fit.residual[i] - added[i];
            assert!(
                (own - expected).abs() < 1e-9,
                "{own} for {expected}: {terms}"
            );
        }
    }

    #[test]
    fn what_a_form_adds_is_what_a_fit_explains() {
        let builds: [fn(f64) -> Build; 4] = [
            |_| Build::Add(vec![Piece::new("damping", "", "speed")]),
            |_| Build::Swap(vec![("command".into(), "delay(command, 0.1)".into())]),
            |_| Build::SwapAll(vec![("command".into(), "delay(command, 0.1)".into())]),
            |_| Build::Known(vec![Piece::new("known", "", "0.3 * speed")]),
        ];
        let fixed = "[[terms]]\nname = \"f\"\nexpr = \"command\"\nfixed = 1.2\n";
        let fitted = "[[terms]]\nname = \"k\"\nexpr = \"command\"\n";
        let zero = "[[terms]]\nname = \"zero\"\nexpr = \"1\"\n";
        let zeros = "[[terms]]\nname = \"zeros\"\nexpr = \"1\"\nper = \"sequence\"\n";
        for build in builds {
            for terms in [
                [fixed, zero].concat(),
                [fitted, zero].concat(),
                [fixed, zeros].concat(),
                [zeros, fitted].concat(),
            ] {
                is_that_of_a_fit(&terms, build);
            }
        }
    }
}
