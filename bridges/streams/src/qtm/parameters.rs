//! Parameters as XML, in the format of the client's protocol version.
//!
//! Clients use parsers that reject documents with missing elements. So elements that do not apply
//! here (time bases, triggers, processing) are present, with the values of a system without them.

use farfield_export::skeleton::{Bone, Rig};
use farfield_fusion::body::skeleton::Joint;
use nalgebra::Vector3;

use super::command::Topic;
use super::{Version, segment_name};
use crate::frame::{REST, Roster, RosterEntry};

/// Colours of people, as red + 256 green + 65536 blue.
const COLOURS: [u32; 6] = [
    0x00_40_ff, 0xff_90_30, 0x30_c0_30, 0x00_c0_ff, 0xc0_40_c0, 0xc0_c0_30,
];

/// The document of these topics.
pub fn parameters(topics: &[Topic], version: Version, rate_hz: f64, roster: &Roster) -> String {
    let mut xml = Xml::default();
    let root = format!("QTM_Parameters_Ver_{}.{}", version.major, version.minor);
    xml.element(&root, |xml| {
        for topic in topics {
            match *topic {
                Topic::General => general(xml, rate_hz),
                Topic::Markers => markers(xml, roster),
                Topic::Bodies if version.nests_segments() => bodies(xml, roster),
                Topic::Bodies => flat_bodies(xml, roster),
                Topic::Skeletons { global } => skeletons(xml, roster, version, global),
                Topic::Force => xml.element("Force", |xml| {
                    xml.text("Unit_Length", "mm");
                    xml.text("Unit_Force", "N");
                }),
                Topic::Nothing => {}
            }
        }
    });
    xml.0
}

fn general(xml: &mut Xml, rate_hz: f64) {
    xml.element("General", |xml| {
        // Clients expect an integer.
        xml.text("Frequency", &format!("{}", rate_hz.round().max(1.0)));
        xml.text("Capture_Time", "0.000000");
        for trigger in [
            "Start_On_External_Trigger",
            "Start_On_Trigger_NO",
            "Start_On_Trigger_NC",
            "Start_On_Trigger_Software",
        ] {
            xml.text(trigger, "false");
        }
        xml.element("External_Time_Base", |xml| {
            for (name, value) in [
                ("Enabled", "false"),
                ("Signal_Source", "Control port"),
                ("Signal_Mode", "Periodic"),
                ("Frequency_Multiplier", "1"),
                ("Frequency_Divisor", "1"),
                ("Frequency_Tolerance", "1000"),
                ("Nominal_Frequency", "None"),
                ("Signal_Edge", "Negative"),
                ("Signal_Shutter_Delay", "0"),
                ("Non_Periodic_Timeout", "10.000000"),
            ] {
                xml.text(name, value);
            }
        });
        xml.element("External_Timestamp", |xml| {
            xml.text("Enabled", "false");
            xml.text("Type", "SMPTE");
            xml.text("Frequency", "30");
        });
        let while_running = [
            "AIM",
            "Track6DOF",
            "ForceData",
            "GazeVector",
            "SkeletonSolve",
        ];
        let afterwards = [
            "TwinSystemMerge",
            "SplineFill",
            "AIM",
            "Track6DOF",
            "ForceData",
            "GazeVector",
            "ExportTSV",
            "ExportC3D",
            "ExportMatlabFile",
            "ExportAviFile",
            "ExportFbx",
            "StartProgram",
            "SkeletonSolve",
        ];
        for (name, actions) in [
            ("Processing_Actions", &afterwards[..]),
            ("RealTime_Processing_Actions", &while_running[..]),
            ("Reprocessing_Actions", &afterwards[..]),
        ] {
            xml.element(name, |xml| {
                xml.text("PreProcessing2D", "false");
                xml.text("Tracking", "3D");
                for action in actions {
                    let does = matches!(*action, "Track6DOF" | "SkeletonSolve");
                    xml.text(action, if does { "true" } else { "false" });
                }
            });
        }
        xml.empty("EulerAngles", r#"First="Roll" Second="Pitch" Third="Yaw""#);
    });
}

/// Label of a person's marker.
fn label(entry: &RosterEntry, joint: Joint) -> String {
    format!("{}_{}", entry.name, joint.name())
}

fn colour(i: usize) -> u32 {
    COLOURS[i % COLOURS.len()]
}

fn markers(xml: &mut Xml, roster: &Roster) {
    xml.element("The_3D", |xml| {
        xml.text("AxisUpwards", "+Z");
        xml.text("CalibrationTime", "");
        let n = roster.people.len() * Joint::ALL.len();
        xml.text("Labels", &n.to_string());
        for (i, entry) in roster.people.iter().enumerate() {
            for joint in Joint::ALL {
                xml.element("Label", |xml| {
                    xml.text("Name", &label(entry, joint));
                    xml.text("RGBColor", &colour(i).to_string());
                    xml.text("Trajectory_Type", "Measured");
                });
            }
        }
        xml.element("Bones", |xml| {
            for (i, entry) in roster.people.iter().enumerate() {
                for joint in Joint::ALL {
                    if let Some(parent) = joint.parent() {
                        let (from, to) = (label(entry, parent), label(entry, joint));
                        let (from, to) = (escaped(&from), escaped(&to));
                        let colour = colour(i);
                        xml.empty(
                            "Bone",
                            &format!(r#"From="{from}" To="{to}" Color="{colour}""#),
                        );
                    }
                }
            }
        });
    });
}

fn bodies(xml: &mut Xml, roster: &Roster) {
    xml.element("The_6D", |xml| {
        for (i, entry) in roster.people.iter().enumerate() {
            xml.element("Body", |xml| {
                xml.text("Name", &entry.name);
                xml.text("Enabled", "true");
                let [red, green, blue, _] = colour(i).to_le_bytes();
                xml.empty("Color", &format!(r#"R="{red}" G="{green}" B="{blue}""#));
                xml.text("MaximumResidual", "0.000000");
                xml.text("MinimumMarkersInBody", "0");
                xml.text("BoneLengthTolerance", "0.000000");
                xml.empty("Filter", r#"Preset="No filter""#);
                xml.element("Mesh", |xml| {
                    xml.text("Name", "");
                    xml.empty("Position", &triple(&Vector3::zeros()));
                    xml.empty("Rotation", &triple(&Vector3::zeros()));
                    xml.text("Scale", "1.000000");
                    xml.text("Opacity", "1.000000");
                });
                xml.element("Points", |_| {});
                let origin = format!(r#"{} Relative_body="1""#, triple(&Vector3::zeros()));
                xml.open("Data_origin", &origin);
                xml.close_after("0", "Data_origin");
                let unit = r#"R11="1" R12="0" R13="0" R21="0" R22="1" R23="0" R31="0" R32="0" R33="1" Relative_body="1""#;
                xml.open("Data_orientation", unit);
                xml.close_after("0", "Data_orientation");
            });
        }
    });
}

/// Format before version 1.21.
fn flat_bodies(xml: &mut Xml, roster: &Roster) {
    xml.element("The_6D", |xml| {
        xml.text("Bodies", &roster.people.len().to_string());
        for (i, entry) in roster.people.iter().enumerate() {
            xml.element("Body", |xml| {
                xml.text("Name", &entry.name);
                xml.text("RGBColor", &colour(i).to_string());
            });
        }
        xml.element("Euler", |xml| {
            xml.text("First", "Roll");
            xml.text("Second", "Pitch");
            xml.text("Third", "Yaw");
        });
    });
}

fn skeletons(xml: &mut Xml, roster: &Roster, version: Version, global: bool) {
    xml.element("Skeletons", |xml| {
        for entry in &roster.people {
            let at_rest_mm = at_rest_mm(entry, global);
            xml.open("Skeleton", &format!(r#"Name="{}""#, escaped(&entry.name)));
            if version.nests_segments() {
                xml.text("Scale", "1.000000");
                xml.element("Segments", |xml| segment(xml, Bone::Hips, &at_rest_mm));
            } else {
                for bone in Bone::ALL {
                    xml.open("Segment", &format!("{}{}", named(bone), parent_id(bone)));
                    transform(xml, &at_rest_mm[bone.index()]);
                    xml.close("Segment");
                }
            }
            xml.close("Skeleton");
        }
    });
}

/// Position of every segment at rest, relative to its parent or in the world, millimetres; the hips
/// are at their height.
fn at_rest_mm(entry: &RosterEntry, global: bool) -> Vec<Vector3<f64>> {
    let rig = Rig::new(&entry.offsets, REST);
    let hips_m = Vector3::z() * entry.offsets.pelvis_height_m();
    let heads_m = rig.rest_heads_m();
    let at_m = |bone: Bone| match bone.parent() {
        Some(_) if !global => rig.offset_m[bone.index()],
        _ => hips_m + heads_m[bone.index()],
    };
    Bone::ALL.map(|bone| at_m(bone) * 1000.0).to_vec()
}

fn named(bone: Bone) -> String {
    format!(r#"Name="{}" ID="{}""#, segment_name(bone), bone.index() + 1)
}

fn parent_id(bone: Bone) -> String {
    bone.parent().map_or_else(String::new, |parent| {
        format!(r#" Parent_ID="{}""#, parent.index() + 1)
    })
}

fn transform(xml: &mut Xml, at_mm: &Vector3<f64>) {
    xml.empty("Position", &triple(at_mm));
    xml.empty(
        "Rotation",
        r#"X="0.000000" Y="0.000000" Z="0.000000" W="1.000000""#,
    );
}

fn segment(xml: &mut Xml, bone: Bone, at_rest_mm: &[Vector3<f64>]) {
    let at_mm = at_rest_mm.get(bone.index()).copied().unwrap_or_default();
    xml.open("Segment", &named(bone));
    xml.text("Solver", "None");
    xml.element("Transform", |xml| transform(xml, &at_mm));
    xml.element("DefaultTransform", |xml| transform(xml, &at_mm));
    xml.element("DegreesOfFreedom", |_| {});
    xml.empty("Endpoint", &triple(&Vector3::zeros()));
    xml.element("Markers", |_| {});
    xml.element("RigidBodies", |_| {});
    for child in bone.children() {
        segment(xml, child, at_rest_mm);
    }
    xml.close("Segment");
}

fn triple(v: &Vector3<f64>) -> String {
    format!(r#"X="{:.6}" Y="{:.6}" Z="{:.6}""#, v.x, v.y, v.z)
}

/// Escapes text; characters that XML cannot represent become question marks.
fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => escaped.push('?'),
            c => escaped.push(c),
        }
    }
    escaped
}

/// A document under construction.
#[derive(Debug, Default)]
struct Xml(String);

impl Xml {
    fn push(&mut self, text: std::fmt::Arguments<'_>) {
        self.0.push_str(&std::fmt::format(text));
    }

    fn open(&mut self, name: &str, attributes: &str) {
        self.push(format_args!("<{name} {attributes}>"));
    }

    fn close(&mut self, name: &str) {
        self.push(format_args!("</{name}>"));
    }

    fn close_after(&mut self, text: &str, name: &str) {
        self.push(format_args!("{text}</{name}>"));
    }

    fn element(&mut self, name: &str, content: impl FnOnce(&mut Self)) {
        self.push(format_args!("<{name}>"));
        content(self);
        self.close(name);
    }

    fn text(&mut self, name: &str, text: &str) {
        let text = escaped(text);
        self.push(format_args!("<{name}>{text}</{name}>"));
    }

    fn empty(&mut self, name: &str, attributes: &str) {
        self.push(format_args!("<{name} {attributes}/>"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic;

    fn document(topics: &[Topic], minor: u8) -> String {
        let version = Version { major: 1, minor };
        parameters(topics, version, 60.0, &synthetic::frame(0).roster)
    }

    #[test]
    fn every_label_is_listed_and_names_are_escaped() {
        let xml = document(&[Topic::Markers], 25);
        assert!(xml.starts_with("<QTM_Parameters_Ver_1.25><The_3D><AxisUpwards>+Z<"));
        assert!(xml.contains("<Labels>58</Labels>"));
        assert_eq!(xml.matches("<Label>").count(), 58);
        assert!(xml.contains("<Name>Ada &lt;&amp; &quot;Zoë&quot;&gt;_left_knee</Name>"));
    }

    #[test]
    fn segments_are_nested_since_version_1_21() {
        let topics = [Topic::Skeletons { global: false }];
        let nested = document(&topics, 25);
        assert_eq!(nested.matches("<Segment ").count(), 40);
        assert!(nested.contains(r#"<Segments><Segment Name="Hips" ID="1">"#));
        assert!(!nested.contains("Parent_ID"));
        let flat = document(&topics, 20);
        assert_eq!(flat.matches("<Segment ").count(), 40);
        assert!(flat.contains(r#"<Segment Name="LeftHand" ID="8" Parent_ID="7"><Position X="#));
        assert!(document(&[Topic::Bodies], 20).contains("<The_6D><Bodies>2</Bodies>"));
    }

    #[test]
    fn topics_without_data_give_an_empty_document() {
        assert_eq!(
            document(&[Topic::Nothing], 24),
            "<QTM_Parameters_Ver_1.24></QTM_Parameters_Ver_1.24>"
        );
    }

    #[test]
    fn all_elements_are_closed() {
        for minor in [8, 20, 25] {
            let all = [
                Topic::General,
                Topic::Markers,
                Topic::Bodies,
                Topic::Skeletons { global: true },
                Topic::Force,
            ];
            let xml = document(&all, minor);
            let mut open = Vec::new();
            for tag in xml
                .split('<')
                .skip(1)
                .map(|rest| rest.split('>').next().unwrap())
            {
                match tag.strip_prefix('/') {
                    Some(name) => assert_eq!(open.pop(), Some(name)),
                    None if tag.ends_with('/') => {}
                    None => open.push(tag.split(' ').next().unwrap()),
                }
            }
            assert!(open.is_empty());
        }
    }
}
