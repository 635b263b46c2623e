//! Poses as JSON, for other programs: one message per tick, each person as in a line of
//! `poses.jsonl`.

use farfield_proto::message::PoseSet;
use farfield_proto::tick::Tick;
use serde::Serialize;

use crate::export::Layout;
use crate::export::line::PoseLine;

/// Name of the schema.
pub const SCHEMA_NAME: &str = "farfield.Poses";

/// The JSON schema of a message.
pub const SCHEMA: &str = r#"{
  "title": "farfield.Poses",
  "description": "The persons of one tick. World frame: metres, z up; angles: radians.",
  "type": "object",
  "properties": {
    "tick": { "type": "integer", "description": "frame number at the venue's rate" },
    "persons": {
      "type": "array",
      "items": {
        "type": "object",
        "properties": {
          "tick": { "type": "integer" },
          "person": { "type": "integer", "description": "id, the same for as long as the person is in the venue" },
          "state": { "type": "string", "enum": ["tentative", "tracked", "coasting"] },
          "joints": { "type": "object", "description": "anatomical joints by name, metres", "additionalProperties": { "type": "array", "items": { "type": "number" } } },
          "keypoints": { "type": "object", "description": "the network's keypoints by name, metres", "additionalProperties": { "type": "array", "items": { "type": "number" } } },
          "sigma_m": { "type": "object", "description": "one standard deviation per joint and axis, metres", "additionalProperties": { "type": "number" } },
          "angles": { "type": "object", "description": "joint angles by name, radians; translations of the root: metres", "additionalProperties": { "type": "number" } },
          "unobserved": { "type": "array", "description": "angles that a prior carries", "items": { "type": "string" } },
          "views": { "type": "integer", "description": "viewpoints that gave evidence" }
        }
      }
    }
  }
}"#;

#[derive(Serialize)]
struct Poses<'a> {
    tick: Tick,
    persons: Vec<PoseLine<'a>>,
}

/// The message of a tick.
#[expect(clippy::missing_panics_doc, reason = "see the message")]
pub fn to_json(poses: &PoseSet, layout: &Layout) -> Vec<u8> {
    let line = |pose| PoseLine {
        tick: poses.tick,
        pose,
        layout,
    };
    let message = Poses {
        tick: poses.tick,
        persons: poses.persons.iter().map(line).collect(),
    };
    serde_json::to_vec(&message).expect("a map with string keys and numbers always serialises")
}

#[cfg(test)]
mod tests {
    use farfield_proto::id::SessionId;
    use farfield_proto::message::PersonState;

    use super::*;
    use crate::export::fixture;

    #[test]
    fn a_message_has_its_lines_and_fits_the_schema() {
        let poses = PoseSet {
            session: SessionId(1),
            tick: Tick(7),
            persons: vec![fixture::pose(3, PersonState::Tracked)],
        };
        let layout = fixture::layout();
        let json: serde_json::Value = serde_json::from_slice(&to_json(&poses, &layout)).unwrap();
        let schema: serde_json::Value = serde_json::from_str(SCHEMA).unwrap();
        let named = &schema["properties"]["persons"]["items"]["properties"];
        let person = json["persons"][0].as_object().unwrap();
        for field in person.keys() {
            assert!(named.get(field).is_some(), "{field}");
        }
        assert_eq!(person.len(), named.as_object().unwrap().len());
        assert_eq!((&json["tick"], &person["person"]), (&7.into(), &3.into()));
    }
}
