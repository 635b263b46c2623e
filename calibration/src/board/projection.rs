//! The projection of a point in the camera by a lens, with derivatives by the point and by the lens's parameters.

use farfield_proto::camera::{Distortion, Intrinsics};
use nalgebra::{Matrix2x3, Vector2, Vector3};

use crate::formats::LensModel;

/// The coefficients of the lens that are fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Coefficients {
    /// k1, k2, p1, p2, k3 of OpenCV's model.
    #[default]
    Five,
    /// Also k4, k5, k6 of its denominator: for wide lenses, with twenty or more pictures.
    Eight,
    /// The four of the fisheye model ([`LensModel::KannalaBrandt`]).
    Fisheye,
}

impl Coefficients {
    /// Their names in the order of the parameters.
    pub fn names(self) -> &'static [&'static str] {
        match self {
            Self::Five => &["k1", "k2", "p1", "p2", "k3"],
            Self::Eight => &["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"],
            Self::Fisheye => &["k1", "k2", "k3", "k4"],
        }
    }

    /// The number of parameters: fx, fy, cx, cy and the coefficients.
    pub(super) fn count(self) -> usize {
        4 + self.names().len()
    }
}

/// Most parameters of a camera.
pub(super) const MOST: usize = 12;

/// The fitted parameters of a camera: fx, fy, cx, cy (pixels), then the coefficients.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Optics {
    pub(super) coefficients: Coefficients,
    pub(super) values: [f64; MOST],
}

/// A projected point and its derivatives.
pub(super) struct Drawn {
    /// Pixels.
    pub(super) pixel: Vector2<f64>,
    /// By the point in the camera, pixels per metre.
    pub(super) by_point: Matrix2x3<f64>,
    /// By each parameter.
    pub(super) by_parameter: [Vector2<f64>; MOST],
}

impl Optics {
    pub(super) fn new(intrinsics: &Intrinsics, lens: &LensModel) -> Self {
        let coefficients = match lens {
            LensModel::KannalaBrandt(_) => Coefficients::Fisheye,
            LensModel::Rational(_) => Coefficients::Eight,
        };
        let mut list = lens.coefficients();
        list.resize(coefficients.names().len(), 0.0);
        let k = intrinsics;
        let all = [k.fx_px, k.fy_px, k.cx_px, k.cy_px].into_iter().chain(list);
        let mut values = [0.0; MOST];
        for (value, given) in values.iter_mut().zip(all) {
            *value = given;
        }
        Self {
            coefficients,
            values,
        }
    }

    pub(super) fn intrinsics(&self) -> Intrinsics {
        let [fx_px, fy_px, cx_px, cy_px, ..] = self.values;
        Intrinsics {
            fx_px,
            fy_px,
            cx_px,
            cy_px,
        }
    }

    pub(super) fn lens(&self) -> LensModel {
        let [_, _, _, _, k1, k2, p1, p2, k3, k4, k5, k6] = self.values;
        match self.coefficients {
            Coefficients::Fisheye => LensModel::KannalaBrandt([k1, k2, p1, p2]),
            _ => LensModel::Rational(Distortion {
                k1,
                k2,
                p1,
                p2,
                k3,
                k4,
                k5,
                k6,
            }),
        }
    }

    /// Projects `p` (metres, in the camera); `None` outside the range of the lens: behind a pinhole, on the back of the axis.
    pub(super) fn draw(&self, p: &Vector3<f64>) -> Option<Drawn> {
        let [fx, fy, cx, cy, ..] = self.values;
        let mut by_parameter = [Vector2::zeros(); MOST];
        let (at, mut by_point) = match self.coefficients {
            Coefficients::Fisheye => self.fisheye(p, &mut by_parameter)?,
            _ => self.rational(p, &mut by_parameter)?,
        };
        for derivative in &mut by_parameter {
            derivative.x *= fx;
            derivative.y *= fy;
        }
        let [by_fx, by_fy, by_cx, by_cy, ..] = &mut by_parameter;
        (*by_fx, *by_fy) = (Vector2::new(at.x, 0.0), Vector2::new(0.0, at.y));
        (*by_cx, *by_cy) = (Vector2::x(), Vector2::y());
        by_point.row_mut(0).scale_mut(fx);
        by_point.row_mut(1).scale_mut(fy);
        let pixel = Vector2::new(fx * at.x + cx, fy * at.y + cy);
        pixel.iter().all(|v| v.is_finite()).then_some(Drawn {
            pixel,
            by_point,
            by_parameter,
        })
    }

    /// OpenCV's rational model, in focal lengths.
    fn rational(
        &self,
        p: &Vector3<f64>,
        by: &mut [Vector2<f64>; MOST],
    ) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
        if p.z < 1e-9 {
            return None;
        }
        let [_, _, _, _, k1, k2, p1, p2, k3, k4, k5, k6] = self.values;
        let (x, y) = (p.x / p.z, p.y / p.z);
        let r2 = x * x + y * y;
        let numerator = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let denominator = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6));
        let g = numerator / denominator;
        let slope = (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3)
            - g * (k4 + r2 * (2.0 * k5 + 3.0 * r2 * k6)))
            / denominator;
        let at = Vector2::new(
            x * g + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * g + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        );
        let across = 2.0 * (slope * x * y + p1 * x + p2 * y);
        let xx = g + 2.0 * slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x;
        let yy = g + 2.0 * slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x;
        let by_point = Matrix2x3::new(
            xx,
            across,
            -(xx * x + across * y),
            across,
            yy,
            -(across * x + yy * y),
        ) / p.z;
        let ray = Vector2::new(x, y) / denominator;
        let radial = [r2, r2 * r2, r2 * r2 * r2];
        let [
            _,
            _,
            _,
            _,
            by_k1,
            by_k2,
            by_p1,
            by_p2,
            by_k3,
            by_k4,
            by_k5,
            by_k6,
        ] = by;
        (*by_k1, *by_k2, *by_k3) = (ray * radial[0], ray * radial[1], ray * radial[2]);
        *by_p1 = Vector2::new(2.0 * x * y, r2 + 2.0 * y * y);
        *by_p2 = Vector2::new(r2 + 2.0 * x * x, 2.0 * x * y);
        (*by_k4, *by_k5, *by_k6) = (
            -ray * g * radial[0],
            -ray * g * radial[1],
            -ray * g * radial[2],
        );
        Some((at, by_point))
    }

    /// Kannala and Brandt 2006 as in OpenCV, in focal lengths.
    fn fisheye(
        &self,
        p: &Vector3<f64>,
        by: &mut [Vector2<f64>; MOST],
    ) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
        let [_, _, _, _, k1, k2, k3, k4, ..] = self.values;
        let rho = libm::hypot(p.x, p.y);
        if rho < 1e-9 * p.z.abs() || rho == 0.0 {
            return (p.z > 0.0).then(|| {
                let at = p.xy() / p.z;
                (at, Matrix2x3::new(1.0, 0.0, -at.x, 0.0, 1.0, -at.y) / p.z)
            });
        }
        let theta = libm::atan2(rho, p.z);
        let t2 = theta * theta;
        let d = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))));
        let slope = 1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)));
        let (u, v) = (p.x / rho, p.y / rho);
        let squared = rho * rho + p.z * p.z;
        let (by_rho, by_z) = (slope * p.z / squared, -slope * rho / squared);
        let turn = d / rho;
        let across = u * v * (by_rho - turn);
        let by_point = Matrix2x3::new(
            by_rho * u * u + turn * v * v,
            across,
            by_z * u,
            across,
            by_rho * v * v + turn * u * u,
            by_z * v,
        );
        let ray = Vector2::new(u, v);
        let mut power = theta;
        for derivative in by.iter_mut().skip(4).take(4) {
            power *= t2;
            *derivative = ray * power;
        }
        Some((ray * d, by_point))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn any_optics() -> impl Strategy<Value = Optics> {
        (0usize..3, prop::array::uniform8(-0.1f64..0.1)).prop_map(|(which, k)| {
            let coefficients = [
                Coefficients::Five,
                Coefficients::Eight,
                Coefficients::Fisheye,
            ][which];
            let mut values = [0.0; MOST];
            values[..4].copy_from_slice(&[900.0, 950.0, 640.0, 360.0]);
            let count = coefficients.names().len();
            values[4..4 + count].copy_from_slice(&k[..count]);
            Optics {
                coefficients,
                values,
            }
        })
    }

    proptest! {
        #[test]
        fn derivatives_match_finite_differences(
            optics in any_optics(), x in -1.5f64..1.5, y in -1.5f64..1.5, z in 2.0f64..5.0,
        ) {
            const STEP: f64 = 1e-6;
            let p = Vector3::new(x, y, z);
            let drawn = optics.draw(&p).expect("in front");
            for axis in 0..3 {
                let mut h = Vector3::zeros();
                h[axis] = STEP;
                let [a, b] = [p + h, p - h].map(|p| optics.draw(&p).expect("in front").pixel);
                let slope = (a - b) / (2.0 * STEP);
                prop_assert!((slope - drawn.by_point.column(axis)).norm() < 1e-4, "{slope} {}", drawn.by_point);
            }
            for i in 0..optics.coefficients.count() {
                let moved = [STEP, -STEP].map(|step| {
                    let mut optics = optics;
                    optics.values[i] += step;
                    optics.draw(&p).expect("in front").pixel
                });
                let slope = (moved[0] - moved[1]) / (2.0 * STEP);
                prop_assert!((slope - drawn.by_parameter[i]).norm() < 1e-4, "{i}: {slope} {}", drawn.by_parameter[i]);
            }
        }
    }

    #[test]
    fn a_fisheye_projects_as_in_opencvs_documentation() {
        let lens = LensModel::KannalaBrandt([0.1, -0.02, 0.0, 0.0]);
        let intrinsics = Intrinsics {
            fx_px: 500.0,
            fy_px: 500.0,
            cx_px: 320.0,
            cy_px: 240.0,
        };
        let drawn = Optics::new(&intrinsics, &lens)
            .draw(&Vector3::new(1.0, 0.0, 1.0))
            .expect("in front");
        let theta = std::f64::consts::FRAC_PI_4;
        let expected = 320.0 + 500.0 * (theta + 0.1 * theta.powi(3) - 0.02 * theta.powi(5));
        assert!((drawn.pixel - Vector2::new(expected, 240.0)).norm() < 1e-9);
    }
}
