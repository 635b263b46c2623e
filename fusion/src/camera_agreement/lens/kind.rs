//! Whether lines of sight would meet better if lenses were of the other kind: `fisheye` is said of ordinary lenses, or is not
//! said of fisheyes, and the coefficients are read in the other model.
//!
//! ```text
//!   y -> where the calibrated lens draws it -> y' by a lens of the other kind with the same coefficients
//! ```
//!
//! Nothing is fitted: a lens is of one kind or of the other.

use farfield_proto::camera::{CameraModel, Distortion, LensModel};
use farfield_proto::frames::Pixel;
use nalgebra::Vector2;

use super::LensPoints;
use super::distortion::distortion;

/// What the other kind leaves of the cost. Where one or all are called fisheyes 0.78 to 0.95 was left of the sample and the Shelf
/// (but for one camera of this, 0.99), 1.01 or more where all is right, and 0.995 where all sources are exchanged.
const TOLD: f64 = 0.95;
/// What it must leave at most of what another distortion leaves.
const BEYOND_DISTORTION: f64 = 0.97;
/// How many times as much as the next choice of cameras it must explain.
const STANDS_OUT: f64 = 1.3;

/// Lenses of the other kind.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::camera_agreement) struct OtherKind {
    /// The cameras: one, or all that are calibrated as that kind.
    pub(in crate::camera_agreement) cameras: Vec<usize>,
    /// Whether they are calibrated as fisheyes.
    pub(in crate::camera_agreement) are_called_fisheyes: bool,
    /// What it leaves of the cost.
    pub(in crate::camera_agreement) ratio: f64,
}

/// The cameras whose lenses are surely of the other kind than `models`, in the order of the venue's cameras, say.
pub(in crate::camera_agreement) fn other_kind(
    points: &LensPoints<'_>,
    models: &[&CameraModel],
) -> Option<OtherKind> {
    let others: Vec<Option<CameraModel>> = models.iter().map(|m| of_other_kind(m)).collect();
    let shown = points.counts(models.len());
    let may_be = |&camera: &usize| others[camera].is_some() && shown[camera] >= super::MIN_POINTS;
    let all: Vec<usize> = (0..models.len()).filter(may_be).collect();
    let is_fisheye = |camera: usize| models[camera].lens().is_fisheye();
    let of_kind = [true, false].map(|kind| {
        let own = all
            .iter()
            .copied()
            .filter(|&camera| is_fisheye(camera) == kind);
        own.collect::<Vec<usize>>()
    });
    let alone = all.iter().map(|&camera| vec![camera]);
    let together = of_kind.into_iter().filter(|cameras| cameras.len() > 1);
    let calibrated = points.lines_of_sight();
    let before = points.mean_cost(&calibrated, |_, _| None);
    let before = before.max(f64::MIN_POSITIVE);
    let fits = together.chain(alone).map(|cameras| {
        let cost = points.mean_cost(&calibrated, |of, y| {
            let own = cameras
                .contains(&of)
                .then(|| through(y, (models[of], others[of].as_ref()?)));
            own.flatten()
        });
        OtherKind {
            are_called_fisheyes: is_fisheye(cameras[0]),
            cameras,
            ratio: cost / before,
        }
    });
    let mut fits: Vec<OtherKind> = fits.collect();
    fits.sort_by(|a, b| a.ratio.total_cmp(&b.ratio));
    let best = fits.first()?;
    let gain = |fit: &OtherKind| 1.0 - fit.ratio;
    let stands_out = fits
        .get(1)
        .is_none_or(|next| gain(best) > STANDS_OUT * gain(next));
    if !stands_out || best.ratio >= TOLD {
        return None;
    }
    // What another distortion explains better is one.
    let bent = distortion(points).map(|bent| bent.ratio);
    let is_kind = bent.is_none_or(|bent| best.ratio < BEYOND_DISTORTION * bent);
    is_kind.then(|| best.clone())
}

/// The camera with a lens of the other kind that has the same coefficients; `None` where there is none.
fn of_other_kind(model: &CameraModel) -> Option<CameraModel> {
    let lens = match *model.lens() {
        LensModel::Rational(Distortion { k1, k2, p1, p2, .. }) => {
            LensModel::KannalaBrandt([k1, k2, p1, p2])
        }
        LensModel::KannalaBrandt([k1, k2, p1, p2]) => LensModel::Rational(Distortion {
            k1,
            k2,
            p1,
            p2,
            ..Distortion::default()
        }),
    };
    CameraModel::new(
        model.name(),
        model.size_px(),
        *model.intrinsics(),
        lens,
        *model.camera_from_world(),
    )
    .ok()
}

/// Where the `other` lens has what is at a place by the calibrated one, both normalised and undistorted.
fn through(
    own: Vector2<f64>,
    (model, other): (&CameraModel, &CameraModel),
) -> Option<Vector2<f64>> {
    let lens = model.intrinsics();
    let px = Pixel::new(
        own.x * lens.fx_px + lens.cx_px,
        own.y * lens.fy_px + lens.cy_px,
    );
    let undistorted = other.undistort(model.distort(px)?)?;
    Some(Vector2::new(
        (undistorted.x() - lens.cx_px) / lens.fx_px,
        (undistorted.y() - lens.cy_px) / lens.fy_px,
    ))
}
