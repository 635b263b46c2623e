//! The camera model: a pinhole with OpenCV's lens distortion (Ohashi 2020, eq. (A.1) and (A.2)), or
//! OpenCV's fisheye.
//!
//! Fusion uses only ideal pinholes ([`Undistorted`] pixels); the edge applies the lens
//! ([`Distorted`] pixels). A lens model is used only where it is monotonic. Beyond that radius a
//! polynomial folds back, and a point far outside the view would land inside the image.
//!
//! A fisheye is used up to [`FISHEYE_HALF_VIEW_RAD`] off its axis. The rest of its picture counts
//! as unknown, like the area outside a picture. Therefore the lens draws no pixel of the pinhole
//! there ([`CameraModel::distort`], [`CameraModel::sees`]) and undistorts none
//! ([`CameraModel::undistort`]). The pinhole itself ([`CameraModel::project`],
//! [`CameraModel::projection_matrix`]) has no such limit.

mod fisheye;
mod lens;
mod rational;

use nalgebra::{Matrix3x4, Point3, Unit, Vector2, Vector3};

pub use fisheye::FISHEYE_HALF_VIEW_RAD;
pub use lens::LensModel;
use lens::{Lens, ViewPart};
pub use rational::Distortion;

use crate::frames::{Camera, Distorted, Pixel, Point, Transform, Undistorted, World};

/// Points at this depth or nearer are not projected, metres: in front of every lens, and far enough
/// from zero that a pixel stays finite.
pub const NEAR_PLANE_M: f64 = 0.05;

/// Largest residual of an undistorted pixel, pixels: a tenth of the accuracy of
/// [`CameraModel::undistort`].
const RESIDUAL_PX: f64 = 1e-10;

/// Accepted focal lengths, pixels: a lens of a tenth of a degree on a large sensor has 1e6.
const FOCAL_PX: [f64; 2] = [1.0, 1e6];

/// Largest distance of the principal point from the first pixel along either axis, pixels.
const MAX_PRINCIPAL_PX: f64 = 1e6;

/// Largest coordinate of a translation, metres. Sums of squares stay exact to micrometres. A hall
/// in millimetres still passes this check; its size reveals the unit later.
pub(crate) const MAX_TRANSLATION_M: f64 = 1e5;

/// Points per image edge at which a model is checked for folds.
const EDGE_POINTS: u32 = 32;

/// Focal lengths and principal point of a pinhole, pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intrinsics {
    /// Focal length along the rows, pixels.
    pub fx_px: f64,
    /// Focal length along the columns, pixels.
    pub fy_px: f64,
    /// Column of the principal point, pixels.
    pub cx_px: f64,
    /// Row of the principal point, pixels.
    pub cy_px: f64,
}

/// Why a camera model cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CameraError {
    /// The image has no pixels.
    #[error("camera `{camera}`: its size is {} x {} pixels, expected both above 0", size_px[0], size_px[1])]
    EmptyImage {
        /// The camera's name.
        camera: String,
        /// Width and height.
        size_px: [u32; 2],
    },
    /// A focal length or the principal point is out of range.
    #[error(
        "camera `{camera}`: `{field}`: found {value:?}, expected a number from {min} to {max} pixels"
    )]
    Intrinsics {
        /// The camera's name.
        camera: String,
        /// Name of the number.
        field: &'static str,
        /// Its value.
        value: f64,
        /// The accepted minimum.
        min: f64,
        /// The accepted maximum.
        max: f64,
    },
    /// A distortion coefficient is not finite.
    #[error(
        "camera `{camera}`: distortion coefficient `{coefficient}` is {value:?}, expected a finite number"
    )]
    Distortion {
        /// The camera's name.
        camera: String,
        /// Which coefficient.
        coefficient: &'static str,
        /// Its value.
        value: f64,
    },
    /// The extrinsics contain a number that is not finite.
    #[error("camera `{camera}`: its rotation or translation is not finite")]
    Extrinsics {
        /// The camera's name.
        camera: String,
    },
    /// The translation is out of range.
    #[error(
        "camera `{camera}`: found {translation_m:?}, expected metres from {} to {MAX_TRANSLATION_M}",
        -MAX_TRANSLATION_M
    )]
    Translation {
        /// The camera's name.
        camera: String,
        /// World to camera.
        translation_m: [f64; 3],
    },
    /// The lens model is not monotonic over the image.
    #[error(
        "camera `{camera}`: its lens distortion folds inside its image: it is monotonic only up to {monotonic_px:.0} px \
         from the principal point, and the image point ({:.1}, {:.1}) is {needed_px:.0} px away",
        at_px[0], at_px[1]
    )]
    Folds {
        /// The camera's name.
        camera: String,
        /// A distorted pixel on the edge of the image that the model does not reach.
        at_px: [f64; 2],
        /// Distorted distance from the principal point that the model reaches, pixels.
        monotonic_px: f64,
        /// Distance of `at_px` from the principal point, pixels.
        needed_px: f64,
    },
}

/// A half-line in the venue.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Its start: the camera's centre.
    pub origin: Point<World>,
    /// Its direction, world axes.
    pub direction: Unit<Vector3<f64>>,
}

/// One calibrated camera: pinhole, lens and pose.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraModel {
    name: String,
    size_px: [u32; 2],
    intrinsics: Intrinsics,
    lens: Lens,
    camera_from_world: Transform<Camera, World>,
}

impl CameraModel {
    /// A camera of `size_px` (width, height) pixels.
    ///
    /// # Errors
    /// [`CameraError`] when a number is not finite or out of range, the size is zero, or the lens
    /// model folds inside the image (for a fisheye, inside the used part of the image).
    pub fn new(
        name: impl Into<String>,
        size_px: [u32; 2],
        intrinsics: Intrinsics,
        lens: impl Into<LensModel>,
        camera_from_world: Transform<Camera, World>,
    ) -> Result<Self, CameraError> {
        let (camera, lens) = (name.into(), lens.into());
        check_numbers(&camera, size_px, &intrinsics, &lens, &camera_from_world)?;
        let model = Self {
            name: camera,
            size_px,
            intrinsics,
            lens: Lens::new(lens),
            camera_from_world,
        };
        let unreached = model.edge_pixels().find(|px| !model.accounts_for(*px));
        match unreached {
            Some(px) => Err(model.folds_at(px)),
            None => Ok(model),
        }
    }

    /// The name in the calibration.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Width and height of the image, pixels.
    pub fn size_px(&self) -> [u32; 2] {
        self.size_px
    }

    /// Focal lengths and principal point.
    pub fn intrinsics(&self) -> &Intrinsics {
        &self.intrinsics
    }

    /// The lens.
    #[inline]
    pub fn lens(&self) -> &LensModel {
        self.lens.model()
    }

    /// The pose of the camera.
    pub fn camera_from_world(&self) -> &Transform<Camera, World> {
        &self.camera_from_world
    }

    /// The position of the pinhole.
    pub fn center(&self) -> Point<World> {
        self.camera_from_world.inverse() * Point::new(Point3::origin())
    }

    /// Projects `p_w` with the ideal pinhole; `None` at or behind [`NEAR_PLANE_M`]. Paper (A.1).
    pub fn project(&self, p_w: Point<World>) -> Option<Pixel<Undistorted>> {
        let p_c = (self.camera_from_world * p_w).coordinates_m();
        (p_c.z > NEAR_PLANE_M).then(|| {
            let px = self.pixel_of(Vector2::new(p_c.x / p_c.z, p_c.y / p_c.z));
            Pixel::new(px.x, px.y)
        })
    }

    /// The matrix of [`Self::project`]: homogeneous world metres to homogeneous undistorted pixels
    /// (x w, y w, w), where w is the depth in metres.
    pub fn projection_matrix(&self) -> Matrix3x4<f64> {
        let motion = self.camera_from_world.isometry().to_homogeneous();
        let Intrinsics {
            fx_px,
            fy_px,
            cx_px,
            cy_px,
        } = self.intrinsics;
        let pinhole = nalgebra::Matrix3::new(fx_px, 0.0, cx_px, 0.0, fy_px, cy_px, 0.0, 0.0, 1.0);
        pinhole * motion.fixed_view::<3, 4>(0, 0)
    }

    /// The distorted position of an ideal pinhole's `pixel`. `None` beyond the radius up to which
    /// the lens model is monotonic, or beyond the used part of a fisheye. Paper (A.2), with
    /// OpenCV's higher orders.
    pub fn distort(&self, pixel: Pixel<Undistorted>) -> Option<Pixel<Distorted>> {
        self.distort_in(pixel, ViewPart::Used)
    }

    /// The inverse of [`Self::distort`], to 1e-9 px; `None` if no used pixel is drawn there.
    pub fn undistort(&self, pixel: Pixel<Distorted>) -> Option<Pixel<Undistorted>> {
        self.undistort_in(pixel, ViewPart::Used)
    }

    /// As [`Self::distort`], but for a fisheye up to 80 degrees off its axis, to render pictures.
    pub fn distort_wide(&self, pixel: Pixel<Undistorted>) -> Option<Pixel<Distorted>> {
        self.distort_in(pixel, ViewPart::Drawn)
    }

    /// The inverse of [`Self::distort_wide`].
    pub fn undistort_wide(&self, pixel: Pixel<Distorted>) -> Option<Pixel<Undistorted>> {
        self.undistort_in(pixel, ViewPart::Drawn)
    }

    fn distort_in(&self, pixel: Pixel<Undistorted>, part: ViewPart) -> Option<Pixel<Distorted>> {
        if self.lens().is_none() {
            // Exact: normalisation and back would round.
            return Some(Pixel::new(pixel.x(), pixel.y()));
        }
        let drawn = self.lens.draw(self.normalised(pixel.vector_px()), part)?;
        let px = self.pixel_of(drawn);
        Some(Pixel::new(px.x, px.y))
    }

    fn undistort_in(&self, pixel: Pixel<Distorted>, part: ViewPart) -> Option<Pixel<Undistorted>> {
        if self.lens().is_none() {
            return Some(Pixel::new(pixel.x(), pixel.y()));
        }
        let target = self.normalised(pixel.vector_px());
        let found = self.lens.undo(target, part, self.tolerance())?;
        let px = self.pixel_of(found);
        Some(Pixel::new(px.x, px.y))
    }

    /// Tolerance of a drawn point, in focal lengths.
    fn tolerance(&self) -> f64 {
        RESIDUAL_PX / self.intrinsics.fx_px.max(self.intrinsics.fy_px)
    }

    /// Whether the lens model describes `pixel`, or `pixel` is outside the used part.
    fn accounts_for(&self, pixel: Pixel<Distorted>) -> bool {
        let target = self.normalised(pixel.vector_px());
        self.lens().is_none() || self.lens.accounts_for(target, self.tolerance())
    }

    /// Moves `pixel` towards the principal point to the rim of a fisheye's used part, if it is
    /// beyond the rim. Pixels of other lenses are unchanged; their view ends with the picture.
    // Inlined with its callees: for most lenses nothing remains of it, in loops over every joint.
    #[inline]
    pub fn within_view(&self, pixel: Pixel<Undistorted>) -> Pixel<Undistorted> {
        if self.lens().is_fisheye() {
            self.within_fisheye_view(pixel)
        } else {
            pixel
        }
    }

    fn within_fisheye_view(&self, pixel: Pixel<Undistorted>) -> Pixel<Undistorted> {
        let p = self.lens.within_view(self.normalised(pixel.vector_px()));
        let px = self.pixel_of(p);
        Pixel::new(px.x, px.y)
    }

    /// Whether `pixel` is within the used part of a fisheye, inside or outside the picture; always
    /// true for other lenses.
    pub fn is_within_view(&self, pixel: Pixel<Undistorted>) -> bool {
        self.lens.is_within_view(self.normalised(pixel.vector_px()))
    }

    /// The half-line of an ideal pinhole through `pixel`.
    pub fn ray(&self, pixel: Pixel<Undistorted>) -> Ray {
        let p = self.normalised(pixel.vector_px());
        let back = self.camera_from_world.isometry().rotation.inverse();
        let direction = Unit::new_normalize(back * Vector3::new(p.x, p.y, 1.0));
        Ray {
            origin: self.center(),
            direction,
        }
    }

    /// Whether the lens draws `pixel` inside the image and in its used part.
    pub fn sees(&self, pixel: Pixel<Undistorted>) -> bool {
        let [width, height] = self.size_px.map(f64::from);
        self.distort(pixel).is_some_and(|px| {
            (-0.5..width - 0.5).contains(&px.x()) && (-0.5..height - 0.5).contains(&px.y())
        })
    }

    fn normalised(&self, px: Vector2<f64>) -> Vector2<f64> {
        let Intrinsics {
            fx_px,
            fy_px,
            cx_px,
            cy_px,
        } = self.intrinsics;
        Vector2::new((px.x - cx_px) / fx_px, (px.y - cy_px) / fy_px)
    }

    fn pixel_of(&self, p: Vector2<f64>) -> Vector2<f64> {
        let Intrinsics {
            fx_px,
            fy_px,
            cx_px,
            cy_px,
        } = self.intrinsics;
        Vector2::new(fx_px * p.x + cx_px, fy_px * p.y + cy_px)
    }

    /// Points along the image's edge; a monotonic model that draws them draws the whole image.
    fn edge_pixels(&self) -> impl Iterator<Item = Pixel<Distorted>> + use<> {
        let [width, height] = self.size_px.map(f64::from);
        (0..EDGE_POINTS).flat_map(move |i| {
            let s = f64::from(i) / f64::from(EDGE_POINTS);
            let (x, y) = (s * width - 0.5, s * height - 0.5);
            let (right, bottom) = (width - 0.5, height - 0.5);
            [
                Pixel::new(x, -0.5),
                Pixel::new(right, y),
                Pixel::new(right - 0.5 - x, bottom),
                Pixel::new(-0.5, bottom - 0.5 - y),
            ]
        })
    }

    fn folds_at(self, px: Pixel<Distorted>) -> CameraError {
        let principal = self.pixel_of(Vector2::zeros());
        let rim = self.lens.rim(self.normalised(px.vector_px()));
        let needed_px = (px.vector_px() - principal).norm();
        let monotonic_px = (self.pixel_of(rim) - principal).norm();
        CameraError::Folds {
            camera: self.name,
            at_px: [px.x(), px.y()],
            monotonic_px,
            needed_px,
        }
    }
}

fn check_numbers(
    camera: &str,
    size_px: [u32; 2],
    intrinsics: &Intrinsics,
    lens: &LensModel,
    camera_from_world: &Transform<Camera, World>,
) -> Result<(), CameraError> {
    let camera = camera.to_owned();
    if size_px.contains(&0) {
        return Err(CameraError::EmptyImage { camera, size_px });
    }
    let Intrinsics {
        fx_px,
        fy_px,
        cx_px,
        cy_px,
    } = *intrinsics;
    let center = [-MAX_PRINCIPAL_PX, MAX_PRINCIPAL_PX];
    for (field, value, [min, max]) in [
        ("fx", fx_px, FOCAL_PX),
        ("fy", fy_px, FOCAL_PX),
        ("cx", cx_px, center),
        ("cy", cy_px, center),
    ] {
        // NaN is in no range.
        if !(min..=max).contains(&value) {
            return Err(CameraError::Intrinsics {
                camera,
                field,
                value,
                min,
                max,
            });
        }
    }
    if let Some((&coefficient, value)) = lens
        .coefficient_names()
        .iter()
        .zip(lens.coefficients())
        .find(|(_, c)| !c.is_finite())
    {
        return Err(CameraError::Distortion {
            camera,
            coefficient,
            value,
        });
    }
    let motion = camera_from_world.isometry();
    let finite = motion
        .translation
        .vector
        .iter()
        .chain(motion.rotation.coords.iter())
        .all(|v| v.is_finite());
    if !finite {
        return Err(CameraError::Extrinsics { camera });
    }
    let translation_m: [f64; 3] = motion.translation.vector.into();
    if translation_m.iter().any(|v| v.abs() > MAX_TRANSLATION_M) {
        return Err(CameraError::Translation {
            camera,
            translation_m,
        });
    }
    Ok(())
}

#[cfg(test)]
mod fisheye_tests;
#[cfg(test)]
mod tests;
