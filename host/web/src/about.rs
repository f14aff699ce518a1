//! What a page is told first: the rig's name and geometry, and what each fault means.

use control::Fault;
use rig::Rig;
use serde_json::{json, Value};

/// Parameters of the notification `welcome`. `welcome`: the service's answer to `hello`; `name`: of
/// this page, as others see it.
pub(crate) fn welcome(welcome: &Value, name: &str) -> Value {
    let faults: serde_json::Map<String, Value> = Fault::ALL
        .iter()
        .map(|fault| {
            let words = json!({"name": fault.name(), "meaning": fault.meaning(), "way_out": fault.what_to_do()});
            (fault.code().to_string(), words)
        })
        .collect();
    let text = welcome["rig_text"].as_str().unwrap_or_default();
    let file = welcome["rig_file"].as_str().unwrap_or_default();
    // The service has read this file before: without it the page has no picture, and everything
    // else.
    let rig = Rig::parse(file, text).ok().map(|rig| {
        let units: Vec<Value> = rig
            .units
            .iter()
            .map(|unit| json!({"exit_m": unit.exit_m.as_slice(), "tension_min_n": unit.tension_min_n, "tension_max_n": unit.tension_max_n}))
            .collect();
        json!({
            "name": rig.name,
            "units": units,
            "center_m": rig.workspace.center_m.as_slice(),
            "radius_m": rig.workspace.radius_m,
            "force_limit_n": rig.controller.force_limit_n,
        })
    });
    json!({
        "page": name,
        "name": welcome["name"],
        "link": welcome["link"],
        "seed": welcome["seed"],
        "rig": rig,
        "faults": faults,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rig_and_every_fault_are_told() {
        let of = |text: &str| {
            welcome(
                &json!({"name": "rig", "link": "x", "rig_file": "f", "rig_text": text}),
                "page 1",
            )
        };
        let told = of(rig::DEFAULT_TEXT);
        assert_eq!(told["rig"]["units"].as_array().unwrap().len(), 6);
        assert_eq!(
            told["rig"]["units"][0]["exit_m"].as_array().unwrap().len(),
            3
        );
        assert_eq!(told["faults"].as_object().unwrap().len(), Fault::ALL.len());
        assert!(told["faults"]["1"]["way_out"]
            .as_str()
            .unwrap()
            .contains("release the button"));
        assert_eq!(of("no rig")["rig"], Value::Null);
    }
}
