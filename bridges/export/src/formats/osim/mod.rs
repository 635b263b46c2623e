//! A scaled `OpenSim` model of one person: our tree of 40 degrees of freedom with `OpenSim`'s
//! names.
//!
//! Coordinates have the names and meanings of the columns of our MOT files, and markers those of
//! our TRC files, so the three can be opened together. Metres; ground and bodies have x forward, y
//! up, z to the right; ground (x, y, z) = world (y, z, x). Lengths are the final ones of the run,
//! left and right as measured. Masses are estimates: images do not determine them, and inverse
//! kinematics does not need them.

mod segments;

use std::io::{self, Write};

use farfield_fusion::body::skeleton::angles::is_translation;
use farfield_fusion::body::skeleton::{ANGLE_NAMES, Joint, RangeOfMotion};
use farfield_fusion::export::marker_names::opensim_name;
use nalgebra::Vector3;

use self::segments::{Coordinate, SEGMENTS, Segment, segment_of};
use super::{determined, names};
use crate::skeleton::Offsets;
use crate::subject::Subject;

/// `OpenSim` document version 4.0, which all versions 4 read.
const VERSION: &str = "40000";
/// Mass of a person over the square of the stature, kg/m²: the middle of the normal range.
const MASS_PER_SQUARE: f64 = 22.0;
/// From the sole to the centre of the head, in statures: 0.53 + 0.07 + 0.22 + 0.10 (`Proportions`).
const HEAD_HEIGHT: f64 = 0.92;
/// Thickness of a segment as a share of its length, for its inertia and its shape.
const THICKNESS: f64 = 0.15;
/// Length of a segment without an end, metres.
const SHORT_M: f64 = 0.1;

/// Writes the model of a person.
///
/// # Errors
/// Errors of `out`.
pub fn write_model(mut out: impl Write, subject: &Subject<'_>) -> io::Result<()> {
    let offsets = &subject.survey.offsets;
    let mut xml = Xml::default();
    xml.open(&format!("OpenSimDocument Version=\"{VERSION}\""));
    xml.open_named("Model", &opensim_name(&format!("person_{}", subject.name)));
    xml.leaf(
        "credits",
        "Written by Farfield. Masses are guesses from the stature.",
    );
    xml.leaf("length_units", "meters");
    xml.leaf("force_units", "N");
    xml.leaf("gravity", "0 -9.80665 0");
    xml.set("BodySet", "bodyset", |xml| {
        for segment in &SEGMENTS {
            push_body(xml, segment, offsets);
        }
    });
    xml.set("JointSet", "jointset", |xml| {
        for segment in &SEGMENTS {
            push_joint(xml, segment, offsets);
        }
    });
    xml.set("MarkerSet", "markerset", |xml| push_markers(xml, subject));
    xml.close("Model");
    xml.close("OpenSimDocument");
    out.write_all(xml.text().as_bytes())
}

/// Converts our link axes (forward, left, up) to `OpenSim`'s (forward, up, right), as text, metres.
fn vector(ours: &Vector3<f64>) -> String {
    let numbers =
        [ours.x, ours.z, -ours.y].map(|v| format!("{:.6}", (v * 1e6).round() / 1e6 + 0.0));
    numbers.join(" ")
}

/// Position of `joint` in the link that holds it, relative to the link's origin, metres.
fn in_link_m(joint: Joint, offsets: &Offsets) -> Vector3<f64> {
    let origin = segment_of(joint.link()).map(|segment| segment.origin);
    let (mut at_m, mut at) = (Vector3::zeros(), joint);
    while Some(at) != origin {
        at_m += offsets.of_joint(at);
        match at.parent() {
            Some(parent) => at = parent,
            None => break,
        }
    }
    at_m
}

fn push_body(xml: &mut Xml, segment: &Segment, offsets: &Offsets) {
    let stature_m = stature_m(offsets);
    let mass_kg = segment.mass_share * MASS_PER_SQUARE * stature_m * stature_m;
    let along_m = segment
        .end
        .map_or(Vector3::zeros(), |end| in_link_m(end, offsets));
    let length_m = along_m.norm().max(SHORT_M);
    let thick_m = THICKNESS * length_m;
    let [around, across] = cylinder_kg_m2(mass_kg, thick_m / 2.0, length_m);
    // Feet lie along x, all other segments with an end along y.
    let [xx, yy] = match segment.end {
        Some(_) if !segment.is_upright => [around, across],
        _ => [across, around],
    };
    xml.open_named("Body", segment.name);
    xml.leaf("mass", &format!("{mass_kg:.6}"));
    xml.leaf("mass_center", &vector(&(along_m / 2.0)));
    xml.leaf("inertia", &format!("{xx:.6} {yy:.6} {across:.6} 0 0 0"));
    if segment.is_upright {
        xml.open("components");
        xml.open_named("PhysicalOffsetFrame", "stick");
        xml.leaf("socket_parent", "..");
        xml.leaf("translation", &vector(&(along_m / 2.0)));
        xml.open("attached_geometry");
        xml.open_named("Cylinder", "shape");
        xml.leaf("socket_frame", "..");
        xml.leaf("radius", &format!("{:.6}", thick_m / 2.0));
        xml.leaf("half_height", &format!("{:.6}", length_m / 2.0));
        for name in [
            "Cylinder",
            "attached_geometry",
            "PhysicalOffsetFrame",
            "components",
        ] {
            xml.close(name);
        }
    } else {
        xml.open("attached_geometry");
        xml.open_named("Sphere", "shape");
        xml.leaf("socket_frame", "..");
        xml.leaf("radius", "0.03");
        xml.close("Sphere");
        xml.close("attached_geometry");
    }
    xml.close("Body");
}

/// Moments of inertia of a solid cylinder about its own axis, and across it through its middle, kg
/// m²: m r²/2 and m (3 r² + l²)/12.
fn cylinder_kg_m2(mass_kg: f64, radius_m: f64, length_m: f64) -> [f64; 2] {
    let square = radius_m * radius_m;
    let across = mass_kg * (3.0 * square + length_m * length_m) / 12.0;
    [mass_kg * square / 2.0, across]
}

/// From the soles to the top of the head when standing upright, metres.
pub(crate) fn stature_m(offsets: &Offsets) -> f64 {
    let upward = [Joint::Spine, Joint::Neck, Joint::Head];
    let above_m: f64 = upward
        .iter()
        .map(|&joint| offsets.of_joint(joint).norm())
        .sum();
    (offsets.pelvis_height_m() + above_m) / HEAD_HEIGHT
}

fn push_joint(xml: &mut Xml, segment: &Segment, offsets: &Offsets) {
    let parent = segment.parent.unwrap_or("ground");
    let path = match segment.parent {
        Some(parent) => format!("/bodyset/{parent}"),
        None => "/ground".to_owned(),
    };
    xml.open_named("CustomJoint", &format!("{parent}_{}", segment.name));
    xml.leaf("socket_parent_frame", &format!("{parent}_offset"));
    xml.leaf("socket_child_frame", &format!("{}_offset", segment.name));
    xml.open("coordinates");
    for coordinate in segment.translations.iter().chain(segment.rotations) {
        push_coordinate(xml, coordinate);
    }
    xml.close("coordinates");
    xml.open("frames");
    let at_m = match segment.parent {
        Some(_) => in_link_m(segment.origin, offsets),
        None => Vector3::zeros(),
    };
    for (name, path, at_m) in [
        (parent, path, at_m),
        (
            segment.name,
            format!("/bodyset/{}", segment.name),
            Vector3::zeros(),
        ),
    ] {
        xml.open_named("PhysicalOffsetFrame", &format!("{name}_offset"));
        xml.leaf("socket_parent", &path);
        xml.leaf("translation", &vector(&at_m));
        xml.leaf("orientation", "0 0 0");
        xml.close("PhysicalOffsetFrame");
    }
    xml.close("frames");
    xml.open("SpatialTransform");
    push_axes(
        xml,
        "rotation",
        segment.rotations,
        ["0 0 1", "1 0 0", "0 1 0"],
    );
    push_axes(
        xml,
        "translation",
        segment.translations,
        ["1 0 0", "0 1 0", "0 0 1"],
    );
    xml.close("SpatialTransform");
    xml.close("CustomJoint");
}

fn push_coordinate(xml: &mut Xml, coordinate: &Coordinate) {
    xml.open_named("Coordinate", coordinate.name);
    let [low, high] = range_of(coordinate.name);
    // Start value of OpenSim's inverse kinematics. From a straight knee or elbow it may bend the
    // limb backwards, rotated by half a turn, which fits all markers too.
    let hinges = ["knee_angle_", "elbow_flex_"];
    let is_hinge = hinges.iter().any(|name| coordinate.name.starts_with(name));
    xml.leaf("default_value", if is_hinge { "0.3" } else { "0" });
    xml.leaf("range", &format!("{low:.6} {high:.6}"));
    // Measured values are shown, even if a venue allows more.
    xml.leaf("clamped", "false");
    xml.leaf("locked", "false");
    xml.close("Coordinate");
}

/// The range of motion of an angle, radians; a full turn if unlimited, and 100 m for translations.
fn range_of(name: &str) -> [f64; 2] {
    const FULL: [f64; 2] = [-std::f64::consts::PI, std::f64::consts::PI];
    const FAR_M: [f64; 2] = [-100.0, 100.0];
    let Some(angle) = ANGLE_NAMES.iter().position(|known| *known == name) else {
        return FULL;
    };
    if is_translation(angle) {
        return FAR_M;
    }
    let (low, high) = RangeOfMotion::default().reported_range(angle);
    [low.max(FULL[0]), high.min(FULL[1])]
}

/// Three axes; those without a coordinate are fixed, along the remaining axes in `spare`.
fn push_axes(xml: &mut Xml, what: &str, coordinates: &[Coordinate], spare: [&str; 3]) {
    for (k, spare) in spare.iter().enumerate() {
        xml.open_named("TransformAxis", &format!("{what}{}", k + 1));
        if let Some(coordinate) = coordinates.get(k) {
            xml.leaf("coordinates", coordinate.name);
            xml.leaf("axis", coordinate.axis);
            xml.open_named("LinearFunction", "function");
            xml.leaf("coefficients", "1 0");
            xml.close("LinearFunction");
        } else {
            xml.leaf("coordinates", "");
            xml.leaf("axis", spare);
            xml.open_named("Constant", "function");
            xml.leaf("value", "0");
            xml.close("Constant");
        }
        xml.close("TransformAxis");
    }
}

fn push_markers(xml: &mut Xml, subject: &Subject<'_>) {
    let names = names(subject.keypoints);
    let keypoints = subject
        .keypoints
        .iter()
        .map(|name| subject.survey.sites_m.get(name).copied());
    let is_marker = determined(subject.keypoints);
    let joints = Joint::ALL.iter().zip(is_marker);
    let joints = joints.map(|(&joint, is_marker)| is_marker.then_some((joint, Vector3::zeros())));
    for (name, marker) in names.iter().zip(joints.chain(keypoints)) {
        let Some((joint, site_m)) = marker else {
            continue;
        };
        let Some(segment) = segment_of(joint.link()) else {
            continue;
        };
        xml.open_named("Marker", name);
        xml.leaf("socket_parent_frame", &format!("/bodyset/{}", segment.name));
        xml.leaf(
            "location",
            &vector(&(in_link_m(joint, &subject.survey.offsets) + site_m)),
        );
        xml.leaf("fixed", "true");
        xml.close("Marker");
    }
}

/// A document under construction.
#[derive(Debug)]
struct Xml {
    text: String,
    depth: usize,
}

impl Default for Xml {
    fn default() -> Self {
        Self {
            text: "<?xml version=\"1.0\" encoding=\"UTF-8\" ?>\n".to_owned(),
            depth: 0,
        }
    }
}

impl Xml {
    /// Opens an element; `tag` is its name and attributes.
    fn open(&mut self, tag: &str) {
        self.line(&["<", tag, ">"]);
        self.depth += 1;
    }

    /// Opens an element with the attribute `name`.
    fn open_named(&mut self, tag: &str, name: &str) {
        self.line(&["<", tag, " name=\"", &escaped(name), "\">"]);
        self.depth += 1;
    }

    /// Closes an element.
    fn close(&mut self, tag: &str) {
        self.depth = self.depth.saturating_sub(1);
        self.line(&["</", tag, ">"]);
    }

    /// An element with text.
    fn leaf(&mut self, tag: &str, text: &str) {
        self.line(&["<", tag, ">", &escaped(text), "</", tag, ">"]);
    }

    /// A set of objects.
    fn set(&mut self, tag: &str, name: &str, objects: impl FnOnce(&mut Self)) {
        self.open_named(tag, name);
        self.open("objects");
        objects(self);
        self.close("objects");
        self.close(tag);
    }

    /// The whole document.
    fn text(&self) -> &str {
        &self.text
    }

    fn line(&mut self, parts: &[&str]) {
        self.text.extend(std::iter::repeat_n('\t', self.depth));
        self.text.extend(parts.iter().copied());
        self.text.push('\n');
    }
}

fn escaped(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            c => safe.push(c),
        }
    }
    safe
}

#[cfg(test)]
mod tests;
