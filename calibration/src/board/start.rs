//! Where a fit of intrinsics begins: Zhang's closed form, and for a fisheye several focal lengths.

use farfield_proto::camera::Intrinsics;
use nalgebra::{DMatrix, Isometry3, Matrix3, Vector2};

use super::adjust::{Sighting, State, adjust, residuals};
use super::homography::{homography, pose};
use super::projection::{Coefficients, MOST, Optics};

/// Focal lengths at which a fisheye is begun, as shares of the picture's longer side.
const FISHEYE_STARTS: [f64; 7] = [0.2, 0.26, 0.33, 0.42, 0.55, 0.75, 1.1];

/// Zhang 2000, section 3.1, with the principal point in the picture's middle: 1/fx^2 and 1/fy^2 are linear in what two
/// columns of a homography must fulfil, h1' w h2 = 0 and h1' w h1 = h2' w h2.
pub(super) fn start_pinhole(
    size_px: [u32; 2],
    sightings: &[Sighting],
    coefficients: Coefficients,
) -> Option<State> {
    let center = size_px.map(|s| 0.5 * (f64::from(s) - 1.0));
    let shift = Matrix3::new(1.0, 0.0, -center[0], 0.0, 1.0, -center[1], 0.0, 0.0, 1.0);
    let homographies = sightings.iter().map(|s| {
        let plane: Vec<Vector2<f64>> = s.board.iter().map(nalgebra::Matrix::xy).collect();
        homography(&plane, &s.pixels).map(|h| shift * h)
    });
    let homographies = homographies.collect::<Option<Vec<_>>>()?;
    let mut rows = Vec::new();
    let mut right = Vec::new();
    for h in &homographies {
        let (a, b) = (h.column(0), h.column(1));
        // Pictures weigh alike, however large the board.
        let scale = 1.0 / (a.norm() * b.norm()).max(1e-300);
        rows.push([a.x * b.x * scale, a.y * b.y * scale]);
        right.push(-a.z * b.z * scale);
        rows.push([
            (a.x * a.x - b.x * b.x) * scale,
            (a.y * a.y - b.y * b.y) * scale,
        ]);
        right.push((b.z * b.z - a.z * a.z) * scale);
    }
    let matrix = DMatrix::from_fn(rows.len(), 2, |i, j| rows.get(i).map_or(0.0, |row| row[j]));
    let svd = matrix.svd(true, true);
    let solved = svd.solve(&nalgebra::DVector::from_vec(right), 1e-12).ok()?;
    let side = f64::from(size_px[0].max(size_px[1]));
    // Where noise makes a square negative: an ordinary lens.
    let focal = |squared: f64| {
        let f = 1.0 / squared.max(0.0).sqrt();
        if (0.1 * side..30.0 * side).contains(&f) {
            f
        } else {
            side
        }
    };
    let mut values = [0.0; MOST];
    let given = [focal(solved[0]), focal(solved[1]), center[0], center[1]];
    for (value, given) in values.iter_mut().zip(given) {
        *value = given;
    }
    let optics = Optics {
        coefficients,
        values,
    };
    let normal =
        Matrix3::from_diagonal(&nalgebra::Vector3::new(1.0 / given[0], 1.0 / given[1], 1.0));
    let poses = homographies
        .iter()
        .map(|h| pose(&(normal * h)))
        .collect::<Option<Vec<_>>>()?;
    Some(State { optics, poses })
}

/// The best of several focal lengths of an equidistant lens.
pub(super) fn start_fisheye(size_px: [u32; 2], sightings: &[Sighting]) -> Option<State> {
    let center = size_px.map(|s| 0.5 * (f64::from(s) - 1.0));
    let side = f64::from(size_px[0].max(size_px[1]));
    let mut best: Option<(f64, State)> = None;
    for share in FISHEYE_STARTS {
        let focal = share * side;
        let mut values = [0.0; MOST];
        for (value, given) in values.iter_mut().zip([focal, focal, center[0], center[1]]) {
            *value = given;
        }
        let optics = Optics {
            coefficients: Coefficients::Fisheye,
            values,
        };
        let poses = sightings
            .iter()
            .map(|s| fisheye_pose(&optics, s))
            .collect::<Option<Vec<_>>>();
        let Some(state) = poses.map(|poses| State { optics, poses }) else {
            continue;
        };
        let Some(fitted) = adjust(state, sightings) else {
            continue;
        };
        let all = fitted
            .poses
            .iter()
            .zip(sightings)
            .map(|(pose, s)| residuals(&fitted.optics, pose, s));
        let Some(all) = all.collect::<Option<Vec<_>>>() else {
            continue;
        };
        let cost: f64 = all.iter().flatten().map(Vector2::norm_squared).sum();
        if best.as_ref().is_none_or(|(lowest, _)| cost < *lowest) {
            best = Some((cost, fitted));
        }
    }
    best.map(|(_, state)| state)
}

/// The pose of a board by its corners within 75 degrees of the axis of an equidistant lens.
fn fisheye_pose(optics: &Optics, sighting: &Sighting) -> Option<Isometry3<f64>> {
    let Intrinsics {
        fx_px,
        fy_px,
        cx_px,
        cy_px,
    } = optics.intrinsics();
    let mut plane = Vec::new();
    let mut image = Vec::new();
    for (board, pixel) in sighting.board.iter().zip(&sighting.pixels) {
        let at = Vector2::new((pixel.x - cx_px) / fx_px, (pixel.y - cy_px) / fy_px);
        let theta = at.norm();
        if theta < 1.3 {
            let stretch = if theta > 1e-9 {
                libm::tan(theta) / theta
            } else {
                1.0
            };
            plane.push(board.xy());
            image.push(at * stretch);
        }
    }
    pose(&homography(&plane, &image)?)
}
