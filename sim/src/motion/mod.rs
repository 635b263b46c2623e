//! Motion clips: BVH files of any skeleton, as anatomical joints over time.
//!
//! ```text
//!   text --bvh--> bones, channels --rig--> where the 29 joints sit on those bones
//!        --clip--> a function of time: Posture (statures, z up, floor at 0)
//! ```
//!
//! The joints of truth come from the clip's own skeleton and never from the model that fusion
//! solves with: where a clip bends and that model cannot, the difference must show as an error.
//! How each kind of skeleton is read is stated in [`rig`]; what floor and stature mean, in
//! [`clip`]; how postures are blended and fitted to another body, in [`posture`].

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
