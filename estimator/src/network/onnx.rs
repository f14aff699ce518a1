//! A writer of ONNX: the few messages of its protocol buffers that a network needs, and the network
//! as their graph.
//!
//! Field numbers: `onnx.proto` of ONNX 1.12 (IR version 8, opset 17). Operators: its
//! `Operators.md`.

use prost::Message;

use super::{
    layer::{folded, Layer},
    lstm::Lstm,
    matrix::Matrix,
    Network, Reads,
};

const IR_VERSION: i64 = 8;
const OPSET: i64 = 17;
/// `TensorProto.DataType`.
const FLOAT: i32 = 1;
const INT64: i32 = 7;
/// `AttributeProto.AttributeType`.
const INT: i32 = 2;
const INTS: i32 = 7;

#[derive(Clone, PartialEq, Message)]
struct ModelProto {
    #[prost(int64, tag = "1")]
    ir_version: i64,
    #[prost(string, tag = "2")]
    producer_name: String,
    #[prost(string, tag = "3")]
    producer_version: String,
    #[prost(message, optional, tag = "7")]
    graph: Option<GraphProto>,
    #[prost(message, repeated, tag = "8")]
    opset_import: Vec<OperatorSetIdProto>,
    #[prost(message, repeated, tag = "14")]
    metadata_props: Vec<StringStringEntryProto>,
}

#[derive(Clone, PartialEq, Message)]
struct OperatorSetIdProto {
    #[prost(int64, tag = "2")]
    version: i64,
}

#[derive(Clone, PartialEq, Message)]
struct StringStringEntryProto {
    #[prost(string, tag = "1")]
    key: String,
    #[prost(string, tag = "2")]
    value: String,
}

#[derive(Clone, PartialEq, Message)]
struct GraphProto {
    #[prost(message, repeated, tag = "1")]
    node: Vec<NodeProto>,
    #[prost(string, tag = "2")]
    name: String,
    #[prost(message, repeated, tag = "5")]
    initializer: Vec<TensorProto>,
    #[prost(message, repeated, tag = "11")]
    input: Vec<ValueInfoProto>,
    #[prost(message, repeated, tag = "12")]
    output: Vec<ValueInfoProto>,
}

#[derive(Clone, PartialEq, Message)]
struct NodeProto {
    #[prost(string, repeated, tag = "1")]
    input: Vec<String>,
    #[prost(string, repeated, tag = "2")]
    output: Vec<String>,
    #[prost(string, tag = "3")]
    name: String,
    #[prost(string, tag = "4")]
    op_type: String,
    #[prost(message, repeated, tag = "5")]
    attribute: Vec<AttributeProto>,
}

#[derive(Clone, PartialEq, Message)]
struct AttributeProto {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(int64, optional, tag = "3")]
    i: Option<i64>,
    #[prost(int64, repeated, tag = "8")]
    ints: Vec<i64>,
    #[prost(int32, tag = "20")]
    kind: i32,
}

#[derive(Clone, PartialEq, Message)]
struct TensorProto {
    #[prost(int64, repeated, tag = "1")]
    dims: Vec<i64>,
    #[prost(int32, tag = "2")]
    data_type: i32,
    #[prost(string, tag = "8")]
    name: String,
    #[prost(bytes = "vec", tag = "9")]
    raw_data: Vec<u8>,
}

#[derive(Clone, PartialEq, Message)]
struct ValueInfoProto {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(message, optional, tag = "2")]
    kind: Option<TypeProto>,
}

#[derive(Clone, PartialEq, Message)]
struct TypeProto {
    #[prost(message, optional, tag = "1")]
    tensor_type: Option<TensorTypeProto>,
}

#[derive(Clone, PartialEq, Message)]
struct TensorTypeProto {
    #[prost(int32, tag = "1")]
    elem_type: i32,
    #[prost(message, optional, tag = "2")]
    shape: Option<TensorShapeProto>,
}

#[derive(Clone, PartialEq, Message)]
struct TensorShapeProto {
    #[prost(message, repeated, tag = "1")]
    dim: Vec<DimensionProto>,
}

#[derive(Clone, PartialEq, Message)]
struct DimensionProto {
    #[prost(int64, optional, tag = "1")]
    dim_value: Option<i64>,
    #[prost(string, optional, tag = "2")]
    dim_param: Option<String>,
}

/// A size of a dimension: a number, or a name where any number is good.
enum Size {
    Fixed(usize),
    Any(&'static str),
}

/// The bytes of the ONNX file of a network.
pub(super) fn encode(network: &Network) -> Vec<u8> {
    let metadata = [
        ("step_s", network.step_s.to_string()),
        ("window", network.config.window.to_string()),
        ("kind", format!("{:?}", network.config.kind)),
    ];
    let model = ModelProto {
        ir_version: IR_VERSION,
        producer_name: "open force rig".into(),
        producer_version: env!("CARGO_PKG_VERSION").into(),
        graph: Some(graph(network)),
        opset_import: vec![OperatorSetIdProto { version: OPSET }],
        metadata_props: metadata
            .map(|(key, value)| StringStringEntryProto {
                key: key.into(),
                value,
            })
            .into(),
    };
    model.encode_to_vec()
}

/// The network as a graph.
fn graph(network: &Network) -> GraphProto {
    let mut graph = GraphProto {
        name: "contact_force".into(),
        ..GraphProto::default()
    };
    let (any, fixed) = (Size::Any, Size::Fixed);
    let reads = network.config.reads();
    let input = match reads {
        Reads::Row => vec![any("batch"), fixed(network.inputs)],
        Reads::Window => vec![
            any("batch"),
            fixed(network.config.window),
            fixed(network.inputs),
        ],
        Reads::Carried => vec![any("rows"), any("batch"), fixed(network.inputs)],
    };
    graph.input.push(value("input", input));
    let scaling = &network.scaling;
    graph.constant("input_mean", &[network.inputs], &scaling.input_mean);
    graph.constant(
        "input_deviation",
        &[network.inputs],
        &scaling.input_deviation,
    );
    graph.node("Sub", &["input", "input_mean"], &["input_centred"], vec![]);
    graph.node(
        "Div",
        &["input_centred", "input_deviation"],
        &["input_normal"],
        vec![],
    );
    let mut current = "input_normal".to_owned();
    let layers = folded(&network.layers);
    if reads == Reads::Window && layers[0].memory() > 0 {
        graph.node(
            "Transpose",
            &[&current],
            &["rows_first"],
            vec![ints("perm", &[1, 0, 2])],
        );
        current = "rows_first".into();
    }
    for (at, layer) in layers.iter().enumerate() {
        let top = layers[at + 1..].iter().all(|above| above.memory() == 0);
        current = match layer {
            Layer::Dense(dense) => {
                graph.dense(at, &current, &dense.weight, &dense.bias, dense.relu)
            }
            Layer::Convolution(layer) => {
                let (shape, joined) = (format!("shape_{at}"), format!("joined_{at}"));
                graph.shape(&shape, &[-1, layer.weight.rows as i64]);
                graph.node("Reshape", &[&current, &shape], &[&joined], vec![]);
                graph.dense(at, &joined, &layer.weight, &layer.bias, true)
            }
            _ => graph.recurrent(at, &current, layer, reads, top),
        };
    }
    graph.constant("target_mean", &[network.targets], &scaling.target_mean);
    graph.constant(
        "target_deviation",
        &[network.targets],
        &scaling.target_deviation,
    );
    graph.node(
        "Mul",
        &[&current, "target_deviation"],
        &["force_centred"],
        vec![],
    );
    graph.node("Add", &["force_centred", "target_mean"], &["force"], vec![]);
    let output = match reads {
        Reads::Carried => vec![any("rows"), any("batch"), fixed(network.targets)],
        Reads::Row | Reads::Window => vec![any("batch"), fixed(network.targets)],
    };
    graph.output.insert(0, value("force", output));
    graph
}

impl GraphProto {
    fn node(
        &mut self,
        operator: &str,
        input: &[&str],
        output: &[&str],
        attribute: Vec<AttributeProto>,
    ) {
        let own = |names: &[&str]| {
            names
                .iter()
                .map(|&name| name.to_owned())
                .collect::<Vec<_>>()
        };
        self.node.push(NodeProto {
            name: format!(
                "{operator}_{}",
                output.iter().find(|name| !name.is_empty()).unwrap_or(&"")
            ),
            op_type: operator.into(),
            input: own(input),
            output: own(output),
            attribute,
        });
    }

    fn constant(&mut self, name: &str, shape: &[usize], values: &[f32]) {
        self.initializer.push(TensorProto {
            dims: shape.iter().map(|&size| size as i64).collect(),
            data_type: FLOAT,
            name: name.into(),
            raw_data: values
                .iter()
                .flat_map(|value| value.to_le_bytes())
                .collect(),
        });
    }

    fn shape(&mut self, name: &str, values: &[i64]) {
        self.initializer.push(TensorProto {
            dims: vec![values.len() as i64],
            data_type: INT64,
            name: name.into(),
            raw_data: values
                .iter()
                .flat_map(|value| value.to_le_bytes())
                .collect(),
        });
    }

    /// A dense layer. Returns the name of its output.
    fn dense(
        &mut self,
        at: usize,
        input: &str,
        weight: &Matrix,
        bias: &Matrix,
        relu: bool,
    ) -> String {
        let name = |what: &str| format!("layer_{at}_{what}");
        self.constant(
            &name("weight"),
            &[weight.rows, weight.columns],
            &weight.values,
        );
        self.constant(&name("bias"), &[bias.columns], &bias.values);
        self.node(
            "MatMul",
            &[input, &name("weight")],
            &[&name("product")],
            vec![],
        );
        self.node(
            "Add",
            &[&name("product"), &name("bias")],
            &[&name("sum")],
            vec![],
        );
        if !relu {
            return name("sum");
        }
        self.node("Relu", &[&name("sum")], &[&name("output")], vec![]);
        name("output")
    }

    /// A recurrent layer on `[rows, batch, inputs]`. Returns the name of its output: of the top
    /// layer of a windowed network the last state, `[batch, units]`, else all states,
    /// `[rows, batch, units]`.
    fn recurrent(
        &mut self,
        at: usize,
        input: &str,
        layer: &Layer,
        reads: Reads,
        top: bool,
    ) -> String {
        let name = |what: &str| format!("layer_{at}_{what}");
        let units = layer.outputs();
        let (operator, gates, weights, mut attributes) = operator_weights(layer);
        self.constant(
            &name("input"),
            &[1, gates * units, weights[0].columns],
            &weights[0].values,
        );
        self.constant(
            &name("recurrent"),
            &[1, gates * units, units],
            &weights[1].values,
        );
        self.constant(&name("bias"), &[1, 2 * gates * units], &weights[2].values);
        attributes.push(int("hidden_size", units as i64));
        let (state, next) = (format!("state_{at}"), format!("next_state_{at}"));
        let mut inputs = vec![
            input.to_owned(),
            name("input"),
            name("recurrent"),
            name("bias"),
        ];
        if reads == Reads::Carried {
            // No lengths of sequences: all are as long as the input.
            inputs.extend([String::new(), state.clone()]);
            let shape = || vec![Size::Fixed(1), Size::Any("batch"), Size::Fixed(units)];
            self.input.push(value(&state, shape()));
            self.output.push(value(&next, shape()));
        }
        let inputs: Vec<&str> = inputs.iter().map(String::as_str).collect();
        self.node(operator, &inputs, &[&name("states"), &next], attributes);
        // States are [rows, directions, batch, units], the last state is
        // [directions, batch, units].
        let (from, axis) = if top && reads == Reads::Window {
            (next, 0)
        } else {
            (name("states"), 1)
        };
        self.shape(&name("axis"), &[axis]);
        self.node(
            "Squeeze",
            &[&from, &name("axis")],
            &[&name("output")],
            vec![],
        );
        name("output")
    }
}

/// The operator of a recurrent layer, its number of gates, its weights in ONNX's order and form,
/// its attributes.
fn operator_weights(layer: &Layer) -> (&'static str, usize, [Matrix; 3], Vec<AttributeProto>) {
    match layer {
        Layer::Gru(gru) => {
            let bias = Matrix::beside(&[gru.bias.clone(), gru.recurrent_bias.clone()]);
            (
                "GRU",
                3,
                [gru.input.transposed(), gru.recurrent.transposed(), bias],
                vec![int("linear_before_reset", 1)],
            )
        }
        Layer::Lstm(lstm) => {
            let ordered = |matrix: &Matrix| in_onnx_order(lstm, matrix);
            let none = Matrix::filled(1, lstm.bias.columns, 0.0);
            let bias = Matrix::beside(&[ordered(&lstm.bias), none]);
            (
                "LSTM",
                4,
                [
                    ordered(&lstm.input).transposed(),
                    ordered(&lstm.recurrent).transposed(),
                    bias,
                ],
                vec![],
            )
        }
        Layer::Dense(_) | Layer::BatchNorm(_) | Layer::Convolution(_) => {
            unreachable!("not recurrent")
        }
    }
}

/// Gates input, output, forget, candidate rather than input, forget, candidate, output.
fn in_onnx_order(lstm: &Lstm, matrix: &Matrix) -> Matrix {
    let units = lstm.units();
    let gate = |at: usize| matrix.slice(at * units, units);
    Matrix::beside(&[gate(0), gate(3), gate(1), gate(2)])
}

fn int(name: &str, value: i64) -> AttributeProto {
    AttributeProto {
        name: name.into(),
        i: Some(value),
        ints: vec![],
        kind: INT,
    }
}

fn ints(name: &str, values: &[i64]) -> AttributeProto {
    AttributeProto {
        name: name.into(),
        i: None,
        ints: values.into(),
        kind: INTS,
    }
}

fn value(name: &str, shape: Vec<Size>) -> ValueInfoProto {
    let dim = (shape.into_iter())
        .map(|size| match size {
            Size::Fixed(size) => DimensionProto {
                dim_value: Some(size as i64),
                dim_param: None,
            },
            Size::Any(name) => DimensionProto {
                dim_value: None,
                dim_param: Some(name.into()),
            },
        })
        .collect();
    let tensor_type = TensorTypeProto {
        elem_type: FLOAT,
        shape: Some(TensorShapeProto { dim }),
    };
    ValueInfoProto {
        name: name.into(),
        kind: Some(TypeProto {
            tensor_type: Some(tensor_type),
        }),
    }
}
