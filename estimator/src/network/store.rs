//! The model file: safetensors, with the settings as JSON in its metadata.
//!
//! Tensors: `layer.<number>.<name>` as in [`Layer::matrices`], and the normalisation. Numbers are
//! little-endian f32, so the same network gives the same bytes on every machine. Any reader of
//! safetensors reads the weights.

use std::{collections::HashMap, path::Path};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use safetensors::{serialize, tensor::TensorView, Dtype, SafeTensors};
use serde::{Deserialize, Serialize};

use super::{
    data::Scaling,
    layer::{self, Layer},
    Config, Epoch, Network,
};
use crate::model::ModelError;

/// Version of the file's layout.
const FORMAT: u32 = 1;
/// Key of the settings in the metadata.
const KEY: &str = "force-estimator-network";
/// Most numbers of a network that is read: a file that asks for more is damaged or not ours.
const MOST_PARAMETERS: usize = 200_000_000;

/// What the metadata says.
#[derive(Serialize, Deserialize)]
struct Header {
    format: u32,
    config: Config,
    inputs: usize,
    targets: usize,
    step_s: f64,
    epochs: Vec<Epoch>,
}

impl Network {
    /// The bytes of the model file.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let header = Header {
            format: FORMAT,
            config: self.config.clone(),
            inputs: self.inputs,
            targets: self.targets,
            step_s: self.step_s,
            epochs: self.epochs.clone(),
        };
        let header = serde_json::to_string(&header).expect("plain data");
        let mut tensors: Vec<(String, Vec<usize>, Vec<u8>)> = Vec::new();
        let mut push = |name: String, shape: Vec<usize>, values: &[f32]| {
            tensors.push((
                name,
                shape,
                values
                    .iter()
                    .flat_map(|value| value.to_le_bytes())
                    .collect(),
            ));
        };
        for (at, layer) in self.layers.iter().enumerate() {
            for (name, matrix) in layer.matrices() {
                push(
                    format!("layer.{at}.{name}"),
                    vec![matrix.rows, matrix.columns],
                    &matrix.values,
                );
            }
        }
        for (name, values) in self.scaling.named() {
            push(name.into(), vec![values.len()], values);
        }
        let views = tensors.iter().map(|(name, shape, bytes)| {
            (
                name,
                TensorView::new(Dtype::F32, shape.clone(), bytes)
                    .expect("as many bytes as the shape says"),
            )
        });
        serialize(views, Some(HashMap::from([(KEY.to_owned(), header)])))
            .expect("names are different")
    }

    /// Reads the bytes of a model file.
    ///
    /// # Errors
    ///
    /// Bytes that are no model file of a network, of a later version, or damaged.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ModelError> {
        let refuse =
            |text: String| ModelError::Stored(format!("no model file of a network: {text}"));
        let (_, metadata) =
            SafeTensors::read_metadata(bytes).map_err(|error| refuse(error.to_string()))?;
        let header = (metadata
            .metadata()
            .as_ref()
            .and_then(|entries| entries.get(KEY)))
        .ok_or_else(|| refuse(format!("its metadata has no key `{KEY}`")))?;
        let header: Header = serde_json::from_str(header)
            .map_err(|error| refuse(format!("its metadata: {error}")))?;
        if header.format != FORMAT {
            return Err(refuse(format!(
                "its format is {}, this program reads {FORMAT}",
                header.format
            )));
        }
        header.config.check()?;
        if header.inputs == 0
            || header.targets == 0
            || header.step_s.is_nan()
            || header.step_s <= 0.0
        {
            return Err(refuse(
                "a number of inputs, targets or the time between rows is not above 0".into(),
            ));
        }
        let tensors = SafeTensors::deserialize(bytes).map_err(|error| refuse(error.to_string()))?;
        let mut layers = empty_layers(&header).map_err(refuse)?;
        for (at, layer) in layers.iter_mut().enumerate() {
            let names: Vec<&str> = layer.matrices().into_iter().map(|(name, _)| name).collect();
            for (name, matrix) in names.into_iter().zip(layer.matrices_mut()) {
                let name = format!("layer.{at}.{name}");
                matrix.values =
                    read(&tensors, &name, &[matrix.rows, matrix.columns]).map_err(refuse)?;
            }
        }
        let mut scaling = Scaling::zero(header.inputs, header.targets);
        for (name, values) in scaling.named_mut() {
            *values = read(&tensors, name, &[values.len()]).map_err(refuse)?;
        }
        Ok(Self {
            config: header.config,
            inputs: header.inputs,
            targets: header.targets,
            step_s: header.step_s,
            scaling,
            layers,
            epochs: header.epochs,
        })
    }
}

/// Reads a model file; see [`Network::save`].
///
/// # Errors
///
/// A file that can't be read, is no model file of a network, of a later version, or damaged.
pub fn load(path: &Path) -> Result<Network, ModelError> {
    let at = |error: String| ModelError::Stored(format!("{}: {error}", path.display()));
    let bytes = std::fs::read(path).map_err(|error| at(format!("can't be read: {error}")))?;
    Network::from_bytes(&bytes).map_err(|error| at(error.to_string()))
}

/// Layers of the shapes that the settings give.
fn empty_layers(header: &Header) -> Result<Vec<Layer>, String> {
    let config = &header.config;
    let widest = config
        .layers
        .iter()
        .copied()
        .max()
        .unwrap_or(0)
        .max(header.inputs)
        .max(header.targets);
    let count = widest
        .checked_mul(widest)
        .and_then(|count| count.checked_mul(8 * (config.layers.len() + 1)));
    if count.is_none_or(|count| count > 8 * MOST_PARAMETERS) {
        return Err(format!(
            "its layers {:?} with {} inputs are too large",
            config.layers, header.inputs
        ));
    }
    // The initial weights are overwritten, or reading fails.
    let mut random = ChaCha8Rng::seed_from_u64(0);
    layer::build(config, header.inputs, header.targets, &mut random)
}

/// Values of a tensor, which must be finite.
fn read(tensors: &SafeTensors, name: &str, shape: &[usize]) -> Result<Vec<f32>, String> {
    let tensor = tensors
        .tensor(name)
        .map_err(|_| format!("it has no tensor `{name}`"))?;
    if tensor.dtype() != Dtype::F32 || tensor.shape() != shape {
        return Err(format!(
            "tensor `{name}` is {:?} {:?}, not F32 {shape:?} as its settings say",
            tensor.dtype(),
            tensor.shape()
        ));
    }
    let bytes = tensor.data().chunks_exact(4);
    let values: Vec<f32> = bytes
        .map(|value| f32::from_le_bytes([value[0], value[1], value[2], value[3]]))
        .collect();
    if let Some(at) = values.iter().position(|value| !value.is_finite()) {
        return Err(format!("value {at} of tensor `{name}` is {}", values[at]));
    }
    Ok(values)
}

impl Scaling {
    fn zero(inputs: usize, targets: usize) -> Self {
        Self {
            input_mean: vec![0.0; inputs],
            input_deviation: vec![1.0; inputs],
            target_mean: vec![0.0; targets],
            target_deviation: vec![1.0; targets],
        }
    }

    fn named(&self) -> [(&'static str, &Vec<f32>); 4] {
        [
            ("scaling.input_mean", &self.input_mean),
            ("scaling.input_deviation", &self.input_deviation),
            ("scaling.target_mean", &self.target_mean),
            ("scaling.target_deviation", &self.target_deviation),
        ]
    }

    fn named_mut(&mut self) -> [(&'static str, &mut Vec<f32>); 4] {
        [
            ("scaling.input_mean", &mut self.input_mean),
            ("scaling.input_deviation", &mut self.input_deviation),
            ("scaling.target_mean", &mut self.target_mean),
            ("scaling.target_deviation", &mut self.target_deviation),
        ]
    }
}
