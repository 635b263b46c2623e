//! A body that shows the skeleton: one spindle per bone, moved by that bone only.

use std::collections::BTreeMap;

use gltf_json as json;
use json::mesh::Semantic;
use json::validation::Checked::Valid;
use nalgebra::Vector3;

use super::bytes::{Bytes, Shape};
use super::single;
use crate::skeleton::{Bone, Rig};

/// Position of a spindle's widest part, as a share of its length.
const WAIST: f64 = 0.2;
/// Width as a share of the length, and its maximum, metres.
const THICKNESS: f64 = 0.12;
const THICKEST_M: f64 = 0.035;
/// Shorter bones are not drawn, metres.
const SHORTEST_M: f64 = 1e-3;

#[derive(Default)]
struct Vertices {
    positions_m: Vec<f32>,
    normals: Vec<f32>,
    joints: Vec<[u8; 4]>,
}

/// Adds the body of `rig`, with the resting hips at `hips_m`.
pub(super) fn push(
    root: &mut json::Root,
    bytes: &mut Bytes,
    rig: &Rig,
    hips_m: &Vector3<f64>,
    name: &str,
) -> json::Index<json::Mesh> {
    let heads_m = rig.rest_heads_m().map(|head_m| head_m + hips_m);
    let mut vertices = Vertices::default();
    for bone in Bone::ALL {
        let from_m = heads_m[bone.index()];
        for child in bone.children() {
            vertices.push_spindle(&from_m, &heads_m[child.index()], bone);
        }
        if let Some(tip_m) = rig.tip_m[bone.index()] {
            vertices.push_spindle(&from_m, &(from_m + tip_m), bone);
        }
    }
    let n = vertices.joints.len();
    let indices: Vec<u16> = (0..n as u16).collect();
    let weights: Vec<f32> = [1.0, 0.0, 0.0, 0.0].repeat(n);
    let attributes = BTreeMap::from([
        (
            Valid(Semantic::Positions),
            bytes.push_floats(root, &vertices.positions_m, Shape::Positions),
        ),
        (
            Valid(Semantic::Normals),
            bytes.push_floats(root, &vertices.normals, Shape::Normals),
        ),
        (
            Valid(Semantic::Joints(0)),
            bytes.push_joints(root, &vertices.joints),
        ),
        (
            Valid(Semantic::Weights(0)),
            bytes.push_floats(root, &weights, Shape::Weights),
        ),
    ]);
    let primitive = json::mesh::Primitive {
        attributes,
        extensions: None,
        extras: None,
        indices: Some(bytes.push_indices(root, &indices)),
        material: None,
        mode: Valid(json::mesh::Mode::Triangles),
        targets: None,
    };
    root.push(json::Mesh {
        extensions: None,
        extras: None,
        name: Some(format!("body_{name}")),
        primitives: vec![primitive],
        weights: None,
    })
}

impl Vertices {
    /// Eight triangles from `from_m` over four corners to `to_m`.
    fn push_spindle(&mut self, from_m: &Vector3<f64>, to_m: &Vector3<f64>, bone: Bone) {
        let along_m = to_m - from_m;
        let length_m = along_m.norm();
        if length_m < SHORTEST_M {
            return;
        }
        let along = along_m / length_m;
        // Perpendicular to the bone, derived from the axis with which it is least aligned.
        let across = along.cross(&if along.x.abs() < 0.7 {
            Vector3::x()
        } else {
            Vector3::y()
        });
        let across = across.normalize();
        let thick_m = (THICKNESS * length_m).min(THICKEST_M);
        let waist_m = from_m + along_m * WAIST;
        let other = along.cross(&across);
        let corners = [across, other, -across, -other].map(|out| waist_m + out * thick_m);
        for k in 0..4 {
            let (a, b) = (corners[k], corners[(k + 1) % 4]);
            self.push_triangle([*from_m, b, a], bone);
            self.push_triangle([*to_m, a, b], bone);
        }
    }

    fn push_triangle(&mut self, corners_m: [Vector3<f64>; 3], bone: Bone) {
        let [a, b, c] = corners_m;
        let normal = (b - a).cross(&(c - a)).normalize();
        for corner_m in corners_m {
            self.positions_m.extend(single(&corner_m));
            self.normals.extend(single(&normal));
            self.joints.push([bone.index() as u8, 0, 0, 0]);
        }
    }
}
