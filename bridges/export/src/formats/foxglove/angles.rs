//! A person's angles as JSON: a plot in Foxglove names a field of it, `/person_1/angles.angles_deg.knee_angle_l`.

use std::fmt::Write as _;

use farfield_fusion::body::skeleton::ANGLE_NAMES;
use farfield_fusion::body::skeleton::angles::is_translation;
use serde::ser::SerializeMap as _;
use serde::{Serialize, Serializer};

use super::Body;

pub(super) const SCHEMA_NAME: &str = "farfield.Angles";

/// Says what is in a message of [`angles`]. Foxglove reads schemas of plain types alone: no unions, no references.
pub(super) fn schema() -> String {
    let mut degrees = String::new();
    for (i, name) in ANGLE_NAMES.iter().enumerate() {
        if !is_translation(i) {
            let comma = if degrees.is_empty() { "" } else { "," };
            // Writing to a string does not fail.
            write!(degrees, r#"{comma}"{name}":{{"type":"number"}}"#).ok();
        }
    }
    format!(
        r#"{{"title":"{SCHEMA_NAME}","type":"object","properties":{{
"tick":{{"type":"integer","description":"Tick of the venue's clock"}},
"name":{{"type":"string","description":"What the person is called"}},
"state":{{"type":"string","description":"tentative, tracked or coasting"}},
"views":{{"type":"integer","description":"Viewpoints that gave evidence"}},
"pelvis_m":{{"type":"object","description":"Pelvis in the world, metres, z up","properties":{{"x":{{"type":"number"}},"y":{{"type":"number"}},"z":{{"type":"number"}}}}}},
"angles_deg":{{"type":"object","description":"Degrees in OpenSim's sense; what only a prior tells is left out","properties":{{{degrees}}}}}
}}}}"#
    )
}

#[derive(Serialize)]
struct Message<'a> {
    tick: i64,
    name: &'a str,
    state: farfield_proto::message::PersonState,
    views: u32,
    pelvis_m: Place,
    angles_deg: Degrees<'a>,
}

#[derive(Serialize)]
struct Place {
    x: Rounded<100_000>,
    y: Rounded<100_000>,
    z: Rounded<100_000>,
}

/// A number in parts of 1/`PARTS`.
struct Rounded<const PARTS: u32>(f64);

impl<const PARTS: u32> Serialize for Rounded<PARTS> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let parts = f64::from(PARTS);
        to.serialize_f64((self.0 * parts).round() / parts)
    }
}

struct Degrees<'a>(&'a Body<'a>);

impl Serialize for Degrees<'_> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let Self(body) = self;
        let mut map = to.serialize_map(None)?;
        for (i, (name, angle)) in ANGLE_NAMES.iter().zip(body.angles).enumerate() {
            if !is_translation(i) && body.unobserved >> i & 1 == 0 {
                map.serialize_entry(name, &Rounded::<10_000>(angle.to_degrees()))?;
            }
        }
        map.end()
    }
}

/// A person's angles at a tick.
pub fn angles(tick: i64, body: &Body<'_>) -> Vec<u8> {
    use farfield_fusion::body::skeleton::Joint;

    let at_m = body.joints_m[Joint::Pelvis.index()];
    let message = Message {
        tick,
        name: body.name,
        state: body.state,
        views: body.views,
        pelvis_m: Place {
            x: Rounded(at_m.x),
            y: Rounded(at_m.y),
            z: Rounded(at_m.z),
        },
        angles_deg: Degrees(body),
    };
    // Numbers and strings under keys that are strings cannot fail.
    serde_json::to_vec(&message).unwrap_or_default()
}
