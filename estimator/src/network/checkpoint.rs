//! A training that was broken off and goes on: a file after each epoch, and what reads it.
//!
//! Safetensors again: the network as its model file has it, the optimiser's state as burn writes
//! it, the best network so far where one is kept; as JSON in the metadata how far the random
//! numbers were drawn. A training that goes on gives the same weights, to the byte, as one that was
//! not broken off.

use std::{collections::HashMap, path::Path};

use burn::{optim::ModuleOptimizer, tensor::Bytes};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use safetensors::{serialize, tensor::TensorView, Dtype, SafeTensors};
use serde::{Deserialize, Serialize};

use super::{Config, Network};
use crate::model::ModelError;

/// Version of the file's layout.
const FORMAT: u32 = 1;
/// Key of the state in the metadata.
const KEY: &str = "force-estimator-training";

/// How far a training is, beside its weights.
#[derive(Serialize, Deserialize)]
struct Header {
    format: u32,
    /// Training rows: with the normalisation they tell other data.
    rows: usize,
    /// Words that were drawn of the generators; 128 bits, so not a number of JSON.
    drawn: String,
    drawn_dropout: String,
    best_mae_n: Option<f64>,
}

/// A training after a whole epoch.
pub(super) struct Standing {
    pub network: Network,
    /// The network with the smallest validation error so far, with that, N.
    pub best: Option<(f64, Network)>,
    pub rows: usize,
    pub drawn: u128,
    pub drawn_dropout: u128,
}

/// A generator of this seed after so many words.
pub(super) fn generator(seed: u64, drawn: u128) -> ChaCha8Rng {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_word_pos(drawn);
    random
}

impl Standing {
    /// Writes the file. One that is there is replaced at once: a program that is killed leaves the
    /// old one or the new one.
    pub fn write(&self, optimiser: &ModuleOptimizer, path: &Path) -> Result<(), ModelError> {
        let failed = |error: String| {
            ModelError::Data(format!("{}: can't be written: {error}", path.display()))
        };
        let header = Header {
            format: FORMAT,
            rows: self.rows,
            drawn: self.drawn.to_string(),
            drawn_dropout: self.drawn_dropout.to_string(),
            best_mae_n: self.best.as_ref().map(|(mae_n, _)| *mae_n),
        };
        let header = serde_json::to_string(&header).expect("plain data");
        let optimiser = optimiser
            .into_bytes()
            .map_err(|error| failed(error.to_string()))?;
        let mut parts = vec![
            ("network", self.network.to_bytes()),
            ("optimiser", optimiser.to_vec()),
        ];
        if let Some((_, best)) = &self.best {
            parts.push(("best", best.to_bytes()));
        }
        let views = parts.iter().map(|(name, bytes)| {
            let view = TensorView::new(Dtype::U8, vec![bytes.len()], bytes);
            (*name, view.expect("as many bytes as the shape says"))
        });
        let bytes = serialize(views, Some(HashMap::from([(KEY.to_owned(), header)])))
            .expect("names are different");
        let mut part = path.as_os_str().to_owned();
        part.push(".part");
        std::fs::write(&part, bytes)
            .and_then(|()| std::fs::rename(&part, path))
            .map_err(|error| failed(error.to_string()))
    }

    /// Reads a file of a training with these settings, apart from limit and machine, and of as many
    /// rows with the normalisation of `like`. Returns also the optimiser's state.
    pub fn read(path: &Path, like: &Network, rows: usize) -> Result<(Self, Bytes), ModelError> {
        let refuse = |text: String| {
            ModelError::Data(format!(
                "{}: {text}; train without `--resume`, with another `--out` or without this file",
                path.display()
            ))
        };
        let bytes = std::fs::read(path).map_err(|error| {
            refuse(format!(
                "no training can go on from it: it can't be read: {error}"
            ))
        })?;
        let damaged = |error: String| refuse(format!("it is no file of a training: {error}"));
        let (_, metadata) =
            SafeTensors::read_metadata(&bytes).map_err(|error| damaged(error.to_string()))?;
        let header = (metadata.metadata().as_ref())
            .and_then(|entries| entries.get(KEY))
            .ok_or_else(|| damaged(format!("its metadata has no key `{KEY}`")))?;
        let header: Header =
            serde_json::from_str(header).map_err(|error| damaged(error.to_string()))?;
        if header.format != FORMAT {
            return Err(damaged(format!(
                "its format is {}, this program reads {FORMAT}",
                header.format
            )));
        }
        let file = SafeTensors::deserialize(&bytes).map_err(|error| damaged(error.to_string()))?;
        let part = |name: &str| {
            let part = file
                .tensor(name)
                .map_err(|error| damaged(error.to_string()));
            part.map(|part| part.data().to_vec())
        };
        let network = Network::from_bytes(&part("network")?)?;
        if !alike(&network.config, &like.config) {
            return Err(refuse(
                "it is of a training with other settings (model, epochs, seed)".to_owned(),
            ));
        }
        if header.rows != rows || network.scaling != like.scaling {
            return Err(refuse("it is of a training on other data".to_owned()));
        }
        let drawn = |text: &str| {
            (text.parse().ok()).ok_or_else(|| damaged(format!("`{text}` is no number of draws")))
        };
        let best = match header.best_mae_n {
            Some(mae_n) => Some((mae_n, Network::from_bytes(&part("best")?)?)),
            None => None,
        };
        let standing = Self {
            best,
            rows,
            drawn: drawn(&header.drawn)?,
            drawn_dropout: drawn(&header.drawn_dropout)?,
            network,
        };
        Ok((standing, Bytes::from_bytes_vec(part("optimiser")?)))
    }
}

/// Whether settings are the same, apart from when a training ends and what computes it.
fn alike(a: &Config, b: &Config) -> bool {
    let a = Config {
        limit_s: b.limit_s,
        backend: b.backend,
        ..a.clone()
    };
    a == *b
}
