//! Messages in Foxglove's own schemas, for its 3D view: the tip as a pose and as a frame, forces as
//! arrows.
//!
//! Schemas: <https://docs.foxglove.dev/docs/visualization/message-schemas>. Every message is JSON.

use super::table::{Utc, Value as _};
use serde::{Deserialize, Serialize};
use serde_json::{json, Value as Json};

/// Frame of every position and force.
pub const FRAME: &str = "robot_base";

/// The tip as Foxglove's `PoseInFrame`, for its 3D view. The orientation of the tool is not known
/// to the rig.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TipPose {
    /// When.
    pub timestamp: Utc,
    /// [`FRAME`].
    pub frame_id: String,
    /// The pose.
    pub pose: Pose,
}

/// `foxglove.Pose`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// Position, m.
    pub position: Vector,
    /// Orientation, a unit quaternion.
    pub orientation: Quaternion,
}

/// `foxglove.Vector3`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Vector {
    /// x, m.
    pub x: f64,
    /// y, m.
    pub y: f64,
    /// z, m.
    pub z: f64,
}

/// `foxglove.Quaternion`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Quaternion {
    /// x.
    pub x: f64,
    /// y.
    pub y: f64,
    /// z.
    pub z: f64,
    /// w.
    pub w: f64,
}

impl Quaternion {
    /// No rotation.
    pub const IDENTITY: Self = Self {
        x: 0.0,
        y: 0.0,
        z: 0.0,
        w: 1.0,
    };

    /// The shortest rotation of the x axis into a direction of length 1.
    fn of_x_to([x, y, z]: [f64; 3]) -> Self {
        let w = 1.0 + x;
        if w < 1e-9 {
            // Half a turn, about any axis across.
            return Self {
                z: 1.0,
                w: 0.0,
                ..Self::IDENTITY
            };
        }
        let length = (w * w + z * z + y * y).sqrt();
        Self {
            x: 0.0,
            y: -z / length,
            z: y / length,
            w: w / length,
        }
    }
}

impl TipPose {
    /// Topic.
    pub const TOPIC: &'static str = "/tip";
    /// Name of the schema.
    pub const SCHEMA_NAME: &'static str = "foxglove.PoseInFrame";

    /// At a position in the robot's base frame, m.
    #[must_use]
    pub fn new(timestamp: Utc, [x, y, z]: [f64; 3]) -> Self {
        Self {
            timestamp,
            frame_id: FRAME.to_owned(),
            pose: Pose {
                position: Vector { x, y, z },
                orientation: Quaternion::IDENTITY,
            },
        }
    }

    /// JSON schema, as Foxglove publishes it.
    #[must_use]
    pub fn json_schema() -> Json {
        json!({
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "title": Self::SCHEMA_NAME,
            "description": "tip of the robot; the orientation is not known and constant",
            "type": "object",
            "required": ["timestamp", "frame_id", "pose"],
            "properties": {
                "timestamp": Utc::schema(),
                "frame_id": {"type": "string"},
                "pose": pose_schema(),
            },
        })
    }
}

/// Frame of the tip, below [`FRAME`]. It has no orientation of its own.
pub const TIP_FRAME: &str = "tip";

/// The tip's frame: `foxglove.FrameTransform`.
#[derive(Debug)]
pub struct TipTransform;

impl TipTransform {
    /// Topic.
    pub const TOPIC: &'static str = "/tf";
    /// Name of the schema.
    pub const SCHEMA_NAME: &'static str = "foxglove.FrameTransform";

    /// A message for the tip at a position in the robot's base frame, m.
    #[must_use]
    pub fn message(timestamp: Utc, [x, y, z]: [f64; 3]) -> Json {
        json!({
            "timestamp": timestamp,
            "parent_frame_id": FRAME,
            "child_frame_id": TIP_FRAME,
            "translation": Vector { x, y, z },
            "rotation": Quaternion::IDENTITY,
        })
    }

    /// JSON schema.
    #[must_use]
    pub fn json_schema() -> Json {
        json!({
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "title": Self::SCHEMA_NAME,
            "description": "frame of the tip in the robot's base frame; its orientation is that of the base",
            "type": "object",
            "required": ["timestamp", "parent_frame_id", "child_frame_id", "translation", "rotation"],
            "properties": {
                "timestamp": Utc::schema(),
                "parent_frame_id": {"type": "string"},
                "child_frame_id": {"type": "string"},
                "translation": vector_schema(),
                "rotation": quaternion_schema(),
            },
        })
    }
}

/// Length of an arrow per force, m/N: 5 N are then as long as the radius of the built-in workspace.
const ARROW_M_PER_N: f64 = 0.02;
/// Diameter of an arrow's shaft, and length and diameter of its head, m: visible at the length of
/// 0.5 N.
const ARROW_SHAFT_M: f64 = 0.003;
const ARROW_HEAD_M: f64 = 0.008;

/// A force that is drawn at the tip.
#[derive(Debug, Clone, Copy)]
pub struct Arrow {
    /// Name of the entity.
    pub id: &'static str,
    /// Force, robot base frame, N.
    pub force_n: [f64; 3],
    /// Red, green, blue, opacity, 0 to 1.
    pub color: [f64; 4],
}

impl Arrow {
    /// The commanded force.
    #[must_use]
    pub const fn commanded(force_n: [f64; 3]) -> Self {
        Self {
            id: "commanded",
            force_n,
            color: [0.6, 0.6, 0.6, 0.6],
        }
    }

    /// The force by the measured tensions.
    #[must_use]
    pub const fn measured(force_n: [f64; 3]) -> Self {
        Self {
            id: "measured",
            force_n,
            color: [0.9, 0.4, 0.1, 1.0],
        }
    }

    fn entity(&self, timestamp: Utc, [x, y, z]: [f64; 3]) -> Json {
        let norm_n = self.force_n.iter().map(|n| n * n).sum::<f64>().sqrt();
        let orientation = if norm_n > 0.0 {
            Quaternion::of_x_to(self.force_n.map(|n| n / norm_n))
        } else {
            Quaternion::IDENTITY
        };
        let length_m = norm_n * ARROW_M_PER_N;
        let head_m = ARROW_HEAD_M.min(length_m);
        let [r, g, b, a] = self.color;
        let mut entity = json!({
            "timestamp": timestamp,
            "frame_id": FRAME,
            "id": self.id,
            // Where the tip is lost no arrow follows, and the last one goes.
            "lifetime": {"sec": 1, "nsec": 0},
            "frame_locked": false,
            "arrows": [{
                "pose": Pose { position: Vector { x, y, z }, orientation },
                "shaft_length": length_m - head_m,
                "shaft_diameter": ARROW_SHAFT_M,
                "head_length": head_m,
                "head_diameter": ARROW_HEAD_M,
                "color": {"r": r, "g": g, "b": b, "a": a},
            }],
        });
        for (kind, _) in OTHER_PRIMITIVES {
            entity[kind] = json!([]);
        }
        entity
    }
}

/// What an entity may have besides arrows, and does not have here.
const OTHER_PRIMITIVES: [(&str, &str); 8] = [
    ("metadata", "foxglove.KeyValuePair"),
    ("cubes", "foxglove.CubePrimitive"),
    ("spheres", "foxglove.SpherePrimitive"),
    ("cylinders", "foxglove.CylinderPrimitive"),
    ("lines", "foxglove.LinePrimitive"),
    ("triangles", "foxglove.TriangleListPrimitive"),
    ("texts", "foxglove.TextPrimitive"),
    ("models", "foxglove.ModelPrimitive"),
];

/// Forces at the tip: `foxglove.SceneUpdate`. An arrow begins at the tip and replaces the one
/// before.
#[derive(Debug)]
pub struct Scene;

impl Scene {
    /// Topic.
    pub const TOPIC: &'static str = "/force";
    /// Name of the schema.
    pub const SCHEMA_NAME: &'static str = "foxglove.SceneUpdate";

    /// A message with arrows at the tip, a position in the robot's base frame, m.
    #[must_use]
    pub fn message(timestamp: Utc, tip_m: [f64; 3], arrows: &[Arrow]) -> Json {
        let entities = arrows.iter().map(|arrow| arrow.entity(timestamp, tip_m));
        json!({"deletions": [], "entities": entities.collect::<Vec<_>>()})
    }

    /// A message that takes all arrows away: where the tip is not known, none of before may stay.
    #[must_use]
    pub fn empty(timestamp: Utc) -> Json {
        // 1: all entities.
        let all = json!({"timestamp": timestamp, "type": 1, "id": ""});
        json!({"deletions": [all], "entities": []})
    }

    /// JSON schema.
    #[must_use]
    pub fn json_schema() -> Json {
        let length = |what: &str| json!({"type": "number", "description": format!("{what}, m")});
        let mut duration = Utc::schema();
        duration["title"] = "duration".into();
        let arrow = json!({
            "type": "object",
            "title": "foxglove.ArrowPrimitive",
            "properties": {
                "pose": pose_schema(),
                "shaft_length": length("length of the shaft; 20 mm an N with the head"),
                "shaft_diameter": length("diameter of the shaft"),
                "head_length": length("length of the head"),
                "head_diameter": length("diameter of the head"),
                "color": numbers("foxglove.Color", &["r", "g", "b", "a"]),
            },
        });
        let list = |items: Json| json!({"type": "array", "items": items});
        let object = |title: &str| list(json!({"type": "object", "title": title}));
        let mut entity = json!({
            "type": "object",
            "title": "foxglove.SceneEntity",
            "properties": {
                "timestamp": Utc::schema(),
                "frame_id": {"type": "string"},
                "id": {"type": "string"},
                "lifetime": duration,
                "frame_locked": {"type": "boolean"},
                "arrows": list(arrow),
            },
        });
        for (kind, title) in OTHER_PRIMITIVES {
            entity["properties"][kind] = object(title);
        }
        json!({
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "title": Self::SCHEMA_NAME,
            "description": "forces at the tip as arrows: `commanded` and `measured`",
            "type": "object",
            "properties": {
                "deletions": object("foxglove.SceneEntityDeletion"),
                "entities": list(entity),
            },
        })
    }
}

/// Topics of this file with the names of their schemas and the schemas.
#[must_use]
pub fn topics() -> [(&'static str, &'static str, Json); 3] {
    [
        (TipPose::TOPIC, TipPose::SCHEMA_NAME, TipPose::json_schema()),
        (
            TipTransform::TOPIC,
            TipTransform::SCHEMA_NAME,
            TipTransform::json_schema(),
        ),
        (Scene::TOPIC, Scene::SCHEMA_NAME, Scene::json_schema()),
    ]
}

fn numbers(title: &str, names: &[&str]) -> Json {
    let properties: serde_json::Map<_, _> = names
        .iter()
        .map(|name| ((*name).to_owned(), json!({"type": "number"})))
        .collect();
    json!({"type": "object", "title": title, "required": names, "properties": properties})
}

fn vector_schema() -> Json {
    numbers("foxglove.Vector3", &["x", "y", "z"])
}

fn quaternion_schema() -> Json {
    numbers("foxglove.Quaternion", &["x", "y", "z", "w"])
}

fn pose_schema() -> Json {
    json!({
        "type": "object",
        "title": "foxglove.Pose",
        "required": ["position", "orientation"],
        "properties": {"position": vector_schema(), "orientation": quaternion_schema()},
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The x axis turned by a quaternion.
    fn turned(q: &Json) -> [f64; 3] {
        let [x, y, z, w] = ["x", "y", "z", "w"].map(|name| q[name].as_f64().unwrap());
        assert!((x * x + y * y + z * z + w * w - 1.0).abs() < 1e-12);
        [
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y + z * w),
            2.0 * (x * z - y * w),
        ]
    }

    #[test]
    fn an_arrow_is_at_the_tip_points_along_the_force_and_is_as_long_as_it() {
        let validator = jsonschema::validator_for(&Scene::json_schema()).unwrap();
        let forces = [
            [0.0, 2.5, 0.0],
            [-3.0, 0.0, 0.0],
            [1.0, -2.0, 0.5],
            [0.0, 0.0, 0.1],
            [0.0, 0.0, -4.0],
        ];
        for force_n in forces {
            let tip_m = [-0.08, 0.02, -0.14];
            let message = Scene::message(Utc::from_ns(5), tip_m, &[Arrow::measured(force_n)]);
            assert!(validator.is_valid(&message), "{message}");
            let arrow = &message["entities"][0]["arrows"][0];
            assert_eq!(arrow["pose"]["position"]["z"], tip_m[2]);
            let length = |name: &str| arrow[name].as_f64().unwrap();
            let length_m = length("shaft_length") + length("head_length");
            let along = turned(&arrow["pose"]["orientation"]);
            for (along, force_n) in along.iter().zip(force_n) {
                let drawn_n = along * length_m / ARROW_M_PER_N;
                assert!((drawn_n - force_n).abs() < 1e-9, "{drawn_n} {force_n}");
            }
        }
        let none = Scene::message(Utc::from_ns(5), [0.0; 3], &[Arrow::measured([0.0; 3])]);
        let arrow = &none["entities"][0]["arrows"][0];
        assert_eq!(arrow["shaft_length"], 0.0);
        assert_eq!(turned(&arrow["pose"]["orientation"]), [1.0, 0.0, 0.0]);
    }
}
