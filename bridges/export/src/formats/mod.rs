//! The formats, each as a writer of bytes that knows no file.

pub mod bvh;
pub mod c3d;
pub mod foxglove;
pub mod gltf;
pub mod osim;
pub mod parquet;
mod points;
pub mod table;
pub mod trc_mot;
