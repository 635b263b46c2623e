//! The short form of boxes on the wire: integers.
//!
//! Fusion makes boxes with quarter pixels ([`CameraBox::snapped`]), as for crops. Torso and neck
//! are relative to the centre of their box. A box that does not fit this form is written in full.
//! Both forms are lossless.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::bounding_box::{BoundingBox, BoxRate};
use crate::id::CameraIndex;
use crate::message::CameraBox;

/// Positions and sizes are multiples of 1/4 pixel.
const PER_PX: f32 = 4.0;
/// Rates of positions and sizes are multiples of 1/16 pixel per tick.
const PER_PX_A_TICK: f32 = 16.0;
/// Rotations are multiples of 1/512 radian.
const PER_RAD: f32 = 512.0;
/// Rates of rotation are multiples of 1/4096 radian per tick.
const PER_RAD_A_TICK: f32 = 4096.0;
/// Integers up to here are exact in single precision.
const MOST: f32 = 16_777_216.0;

/// A [`CameraBox`] on the wire.
#[derive(Serialize, Deserialize)]
enum Form {
    /// As integers: centre, size, torso and neck relative to the centre, rotation, and the rates of
    /// centre, size and rotation.
    Whole(CameraIndex, [[i32; 2]; 4], i32, [[i32; 2]; 2], i32),
    Other(CameraIndex, BoundingBox, BoxRate, [f32; 2], [f32; 2]),
}

impl CameraBox {
    /// The box on the grid of the short form: quarter pixels, sixteenths of a pixel per tick, and
    /// 1/512 rad (0.1 degrees). Values too large for the grid are unchanged.
    #[must_use]
    pub fn snapped(&self) -> Self {
        self.whole().map_or(*self, |form| form.read())
    }

    /// The nearest box in integers; `None` if a number is too large or not finite.
    fn whole(&self) -> Option<Form> {
        let BoundingBox {
            center_px,
            size_px,
            rotation_rad,
        } = self.bounding_box;
        let [center, size, torso, neck] =
            [center_px, size_px, self.torso_px, self.neck_px].map(|px| pair(px, PER_PX));
        let (center, rate) = (center?, self.rate);
        let from_center = |[x, y]: [i32; 2]| [x - center[0], y - center[1]];
        Some(Form::Whole(
            self.camera,
            [center, size?, from_center(torso?), from_center(neck?)],
            near(rotation_rad, PER_RAD)?,
            [
                pair(rate.center_px, PER_PX_A_TICK)?,
                pair(rate.size_px, PER_PX_A_TICK)?,
            ],
            near(rate.rotation_rad, PER_RAD_A_TICK)?,
        ))
    }
}

impl Form {
    fn read(&self) -> CameraBox {
        match *self {
            Self::Whole(
                camera,
                [center, size, torso, neck],
                turn,
                [center_rate, size_rate],
                turn_rate,
            ) => {
                let px = |[x, y]: [i32; 2]| [x as f32 / PER_PX, y as f32 / PER_PX];
                let a_tick =
                    |[x, y]: [i32; 2]| [x as f32 / PER_PX_A_TICK, y as f32 / PER_PX_A_TICK];
                // Received numbers may have any size.
                let of_center = |[x, y]: [i32; 2]| {
                    px([x.saturating_add(center[0]), y.saturating_add(center[1])])
                };
                CameraBox {
                    camera,
                    bounding_box: BoundingBox {
                        center_px: px(center),
                        size_px: px(size),
                        rotation_rad: turn as f32 / PER_RAD,
                    },
                    rate: BoxRate {
                        center_px: a_tick(center_rate),
                        size_px: a_tick(size_rate),
                        rotation_rad: turn_rate as f32 / PER_RAD_A_TICK,
                    },
                    torso_px: of_center(torso),
                    neck_px: of_center(neck),
                }
            }
            Self::Other(camera, bounding_box, rate, torso_px, neck_px) => CameraBox {
                camera,
                bounding_box,
                rate,
                torso_px,
                neck_px,
            },
        }
    }
}

fn pair([x, y]: [f32; 2], per: f32) -> Option<[i32; 2]> {
    Some([near(x, per)?, near(y, per)?])
}

fn near(value: f32, per: f32) -> Option<i32> {
    let whole = (value * per).round();
    (whole.abs() <= MOST).then_some(whole as i32)
}

impl Serialize for CameraBox {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let other = || {
            let Self {
                camera,
                bounding_box,
                rate,
                torso_px,
                neck_px,
            } = *self;
            Form::Other(camera, bounding_box, rate, torso_px, neck_px)
        };
        // Compares bits, because -0 is equal to 0.
        let whole = self
            .whole()
            .filter(|form| form.read().bits() == self.bits());
        whole.unwrap_or_else(other).serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for CameraBox {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Form::deserialize(deserializer).map(|form| form.read())
    }
}

impl CameraBox {
    fn bits(&self) -> [u32; 14] {
        let (of, rate) = (self.bounding_box, self.rate);
        let [a, b, c, d] = [of.center_px, of.size_px, self.torso_px, self.neck_px];
        let [e, f] = [rate.center_px, rate.size_px];
        let turns = [of.rotation_rad, rate.rotation_rad];
        let mut bits = [0; 14];
        let values = [a, b, c, d, e, f, turns].into_iter().flatten();
        for (bits, value) in bits.iter_mut().zip(values) {
            *bits = value.to_bits();
        }
        bits
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn usual() -> CameraBox {
        CameraBox {
            camera: CameraIndex(3),
            bounding_box: BoundingBox {
                center_px: [1_203.3, 611.9],
                size_px: [84.1, 202.7],
                rotation_rad: 0.0,
            },
            rate: BoxRate {
                center_px: [-3.1, 0.2],
                size_px: [0.1, 0.3],
                rotation_rad: 0.0,
            },
            torso_px: [1_202.0, 620.0],
            neck_px: [1_204.0, 560.0],
        }
    }

    #[test]
    fn a_usual_box_takes_two_dozen_bytes() {
        let bytes = postcard::to_allocvec(&usual().snapped()).unwrap();
        assert!(bytes.len() <= 24, "{}", bytes.len());
        assert!(postcard::to_allocvec(&usual()).unwrap().len() > 56);
    }

    fn any_box() -> impl Strategy<Value = CameraBox> {
        let number = prop_oneof![-4000.0f32..4000.0, any::<f32>()];
        (any::<u16>(), prop::collection::vec(number, 14)).prop_map(|(camera, n)| CameraBox {
            camera: CameraIndex(camera),
            bounding_box: BoundingBox {
                center_px: [n[0], n[1]],
                size_px: [n[2], n[3]],
                rotation_rad: n[4],
            },
            rate: BoxRate {
                center_px: [n[5], n[6]],
                size_px: [n[7], n[8]],
                rotation_rad: n[9],
            },
            torso_px: [n[10], n[11]],
            neck_px: [n[12], n[13]],
        })
    }

    proptest! {
        #[test]
        fn every_written_box_is_read_back(one in any_box(), snap in any::<bool>()) {
            let one = if snap { one.snapped() } else { one };
            let bytes = postcard::to_allocvec(&one).unwrap();
            let again: CameraBox = postcard::from_bytes(&bytes).unwrap();
            prop_assert_eq!(again.bits(), one.bits());
        }

        #[test]
        fn a_snapped_box_moves_at_most_half_a_grid_step(x in -4000.0f32..4000.0) {
            let mut moved = usual();
            moved.bounding_box.center_px[0] = x;
            let snapped = moved.snapped();
            prop_assert!((snapped.bounding_box.center_px[0] - x).abs() <= 0.126);
            prop_assert_eq!(snapped.snapped(), snapped);
        }

        #[test]
        fn arbitrary_bytes_are_a_box_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..80)) {
            let _read: Result<CameraBox, _> = postcard::from_bytes(&bytes);
        }
    }
}
