//! A person with a box at one tick: choice of the camera and crops of its picture.

use farfield_proto::id::PersonId;
use farfield_proto::message::{CameraBox, PersonBoxes};

use super::EdgePipeline;
use super::camera::EdgeCamera;
use crate::choose::{CameraCandidate, choose};
use crate::crop::{CropGeometry, enclosing_upright};
use crate::source::{Frame, FrameContent};

/// Tilt of a box from which the legs get a separate upright crop, radians (10 degrees). Below, one
/// crop suffices for networks trained on rotations of up to 40 degrees.
const TWO_CROPS_FROM_RAD: f32 = 0.175;

/// Most ticks by which a box is moved in either direction; its rates are not extrapolated further.
const MAX_TICKS: i64 = 60;

/// One person at this tick: id, camera and crops.
pub(super) struct Tracked {
    pub(super) person: PersonId,
    /// Index among the cameras of the viewpoint.
    pub(super) camera: usize,
    /// Expected region in that camera.
    pub(super) region: CameraBox,
    pub(super) crops: Vec<CropGeometry>,
    pub(super) crop_of_keypoint: Vec<u8>,
    /// Index of the first crop in the batch.
    pub(super) input: usize,
}

impl EdgePipeline {
    /// Chooses the camera for a person and cuts the crops; `None` if no camera sees the person.
    pub(super) fn track(
        &mut self,
        boxes: &PersonBoxes,
        age: i64,
        frames: &[Option<Frame>],
    ) -> Option<Tracked> {
        let mut at = Vec::with_capacity(self.cameras.len());
        let mut views = Vec::with_capacity(self.cameras.len());
        for (i, camera) in self
            .cameras
            .iter()
            .enumerate()
            .filter(|&(i, _)| frames[i].is_some())
        {
            if let Some(camera_box) = boxes.cameras.iter().find(|b| b.camera == camera.index) {
                at.push(i);
                views.push(CameraCandidate {
                    model: &camera.model,
                    camera_box: moved_on(camera_box, age),
                });
            }
        }
        let last = self.last_camera.get(&boxes.person);
        let last = last.and_then(|&index| at.iter().position(|&i| self.cameras[i].index == index));
        let chosen = choose(self.choice, &views, last)?;
        let (camera, region) = (at[chosen], views[chosen].camera_box);
        let bounding_box = region.bounding_box;
        self.last_camera
            .insert(boxes.person, self.cameras[camera].index);
        let EdgeCamera { drawing, .. } = &self.cameras[camera];
        let mut crop_of_keypoint = vec![0; self.keypoints.len()];
        if let Some(drawing) = drawing {
            // Drawn maps do not depend on the rotation of the crop.
            let crops = vec![CropGeometry::new(&bounding_box, drawing.shape)?];
            return Some(Tracked {
                person: boxes.person,
                camera,
                region,
                crops,
                crop_of_keypoint,
                input: 0,
            });
        }
        let (batch, FrameContent::Image(_)) =
            (self.batch.as_mut()?, &frames[camera].as_ref()?.content)
        else {
            return None;
        };
        let mut crops = vec![CropGeometry::new(&bounding_box, batch.shape())?];
        if self.second_crops && is_turned(&region) {
            crops.push(CropGeometry::new(
                &enclosing_upright(&bounding_box),
                batch.shape(),
            )?);
            for (keypoint, crop) in crop_of_keypoint.iter_mut().enumerate() {
                *crop = u8::from(!self.keypoints.is_upper(keypoint));
            }
        }
        let inputs: Vec<usize> = crops.iter().map(|crop| batch.push(camera, *crop)).collect();
        Some(Tracked {
            person: boxes.person,
            camera,
            region,
            crops,
            crop_of_keypoint,
            input: inputs[0],
        })
    }
}

/// The box and the projected joints of a person, moved by `ticks`, which can be negative.
pub(super) fn moved_on(camera_box: &CameraBox, ticks: i64) -> CameraBox {
    let ticks = ticks.clamp(-MAX_TICKS, MAX_TICKS);
    let n = ticks as f32;
    let along = |p: [f32; 2]| [0, 1].map(|i| p[i] + n * camera_box.rate.center_px[i]);
    CameraBox {
        bounding_box: camera_box.bounding_box.moved_on(&camera_box.rate, ticks),
        torso_px: along(camera_box.torso_px),
        neck_px: along(camera_box.neck_px),
        ..*camera_box
    }
}

/// Whether the person is so tilted that the legs get a separate crop.
pub(super) fn is_turned(camera_box: &CameraBox) -> bool {
    turned_by(camera_box.bounding_box.rotation_rad) > TWO_CROPS_FROM_RAD
}

/// Angle between a rotation and upright, 0 to pi.
fn turned_by(rotation_rad: f32) -> f32 {
    let turn = rotation_rad.rem_euclid(std::f32::consts::TAU);
    turn.min(std::f32::consts::TAU - turn)
}
