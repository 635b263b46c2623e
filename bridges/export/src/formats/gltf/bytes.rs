//! The buffer of a file, and the accessors that describe its content.

use gltf_json as json;
use json::accessor::{ComponentType, GenericComponentType, Type};
use json::buffer::Target;
use json::validation::Checked::Valid;

/// All data of a file.
#[derive(Debug, Default)]
pub(super) struct Bytes(Vec<u8>);

/// Type of the values of an accessor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shape {
    /// Single seconds, with minimum and maximum.
    Times,
    /// Three numbers.
    Vec3,
    /// Three numbers per vertex, with minimum and maximum.
    Positions,
    /// Three numbers per vertex.
    Normals,
    /// Four numbers.
    Vec4,
    /// Four numbers per vertex.
    Weights,
    /// Sixteen numbers.
    Mat4,
}

impl Shape {
    const fn kind(self) -> Type {
        match self {
            Self::Times => Type::Scalar,
            Self::Vec3 | Self::Positions | Self::Normals => Type::Vec3,
            Self::Vec4 | Self::Weights => Type::Vec4,
            Self::Mat4 => Type::Mat4,
        }
    }

    const fn target(self) -> Option<Target> {
        match self {
            Self::Positions | Self::Normals | Self::Weights => Some(Target::ArrayBuffer),
            _ => None,
        }
    }

    const fn has_bounds(self) -> bool {
        matches!(self, Self::Times | Self::Positions)
    }
}

impl Bytes {
    /// Adds numbers.
    pub(super) fn push_floats(
        &mut self,
        root: &mut json::Root,
        values: &[f32],
        shape: Shape,
    ) -> json::Index<json::Accessor> {
        let n = shape.kind().multiplicity();
        let bound = |pick: fn(f32, f32) -> f32| {
            let component_of = |k: usize| values.iter().skip(k).step_by(n).copied().reduce(pick);
            let all: Vec<f32> = (0..n).filter_map(component_of).collect();
            shape.has_bounds().then(|| json::Value::from(all))
        };
        let (min, max) = (bound(f32::min), bound(f32::max));
        let data: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let accessor = Layout {
            count: values.len() / n,
            component: ComponentType::F32,
            kind: shape.kind(),
            target: shape.target(),
        };
        let index = self.push(root, &data, &accessor);
        if let Some(accessor) = root.accessors.get_mut(index.value()) {
            (accessor.min, accessor.max) = (min, max);
        }
        index
    }

    /// Adds the bones of vertices, four each.
    pub(super) fn push_joints(
        &mut self,
        root: &mut json::Root,
        joints: &[[u8; 4]],
    ) -> json::Index<json::Accessor> {
        let layout = Layout {
            count: joints.len(),
            component: ComponentType::U8,
            kind: Type::Vec4,
            target: Some(Target::ArrayBuffer),
        };
        self.push(root, joints.as_flattened(), &layout)
    }

    /// Adds the vertices of triangles.
    pub(super) fn push_indices(
        &mut self,
        root: &mut json::Root,
        indices: &[u16],
    ) -> json::Index<json::Accessor> {
        let data: Vec<u8> = indices.iter().flat_map(|i| i.to_le_bytes()).collect();
        let layout = Layout {
            count: indices.len(),
            component: ComponentType::U16,
            kind: Type::Scalar,
            target: Some(Target::ElementArrayBuffer),
        };
        self.push(root, &data, &layout)
    }

    /// All data, a multiple of four bytes.
    pub(super) fn into_data(self) -> Vec<u8> {
        self.0
    }

    fn push(
        &mut self,
        root: &mut json::Root,
        data: &[u8],
        layout: &Layout,
    ) -> json::Index<json::Accessor> {
        let offset = self.0.len();
        self.0.extend_from_slice(data);
        self.0.resize(self.0.len().next_multiple_of(4), 0);
        let view = root.push(json::buffer::View {
            buffer: json::Index::new(0),
            byte_length: data.len().into(),
            byte_offset: Some(offset.into()),
            byte_stride: None,
            name: None,
            target: layout.target.map(Valid),
            extensions: None,
            extras: None,
        });
        root.push(json::Accessor {
            buffer_view: Some(view),
            byte_offset: None,
            count: layout.count.into(),
            component_type: Valid(GenericComponentType(layout.component)),
            extensions: None,
            extras: None,
            type_: Valid(layout.kind),
            min: None,
            max: None,
            name: None,
            normalized: false,
            sparse: None,
        })
    }
}

/// Layout of data in the buffer.
struct Layout {
    count: usize,
    component: ComponentType,
    kind: Type,
    target: Option<Target>,
}
