//! Motion clips: BVH files of any skeleton, as anatomical joints over time.
//!
//! ```text
//!   text --bvh--> bones, channels --rig--> positions of the 29 joints on those bones
//!        --clip--> a function of time: Posture (statures, z up, floor at 0)
//! ```
//!
//! The joints of the truth come from the clip's own skeleton and never from fusion's model. Where a
//! clip bends and that model cannot, the difference must appear as an error. [`rig`] describes how
//! each kind of skeleton is read, [`clip`] defines floor and stature, and [`posture`] blends
//! postures and fits them to another body.

pub mod bvh;
pub mod clip;
pub mod posture;
pub mod rig;

pub use clip::Clip;
pub use posture::Posture;

#[cfg(test)]
mod sample;
#[cfg(test)]
mod tests;
