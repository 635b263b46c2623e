//! Coordinate frames as types: a point of one frame cannot be used as a point of another.
//!
//! Transforms are read from right to left, so that neighbours match: `camera_from_world * elbow_w`.
//! Only the constructors assert a frame. Typed frames are used at function borders; the code inside
//! uses plain nalgebra.

use std::marker::PhantomData;
use std::ops::Mul;

use nalgebra::{Isometry3, Point3, Vector2};

/// Venue frame: origin on the floor, right-handed, z up, metres.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum World {}

/// One camera: origin at the pinhole, x right, y down, z forward, metres.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Camera {}

/// A point in metres, in the coordinate frame `F`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point<F> {
    m: Point3<f64>,
    frame: PhantomData<F>,
}

impl<F> Point<F> {
    /// Asserts that `m` (metres) is expressed in `F`.
    pub fn new(m: Point3<f64>) -> Self {
        Self {
            m,
            frame: PhantomData,
        }
    }

    /// The plain coordinates in metres.
    pub fn coordinates_m(&self) -> Point3<f64> {
        self.m
    }
}

/// A rigid motion that maps points of `From` to points of `To`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transform<To, From> {
    isometry: Isometry3<f64>,
    frames: PhantomData<(To, From)>,
}

impl<To, From> Transform<To, From> {
    /// Asserts that `isometry` maps coordinates of `From` to coordinates of `To`.
    pub fn new(isometry: Isometry3<f64>) -> Self {
        Self {
            isometry,
            frames: PhantomData,
        }
    }

    /// The plain rigid motion.
    pub fn isometry(&self) -> &Isometry3<f64> {
        &self.isometry
    }

    /// The inverse motion.
    pub fn inverse(&self) -> Transform<From, To> {
        Transform::new(self.isometry.inverse())
    }
}

impl<To, From> Mul<Point<From>> for Transform<To, From> {
    type Output = Point<To>;

    fn mul(self, p: Point<From>) -> Point<To> {
        Point::new(self.isometry * p.m)
    }
}

impl<A, B, C> Mul<Transform<B, C>> for Transform<A, B> {
    type Output = Transform<A, C>;

    fn mul(self, right: Transform<B, C>) -> Transform<A, C> {
        Transform::new(self.isometry * right.isometry)
    }
}

/// Pixels with lens distortion, as in a recorded image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Distorted {}

/// Pixels of the ideal pinhole with the same intrinsics; boxes and patches use them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Undistorted {}

/// An image position in pixels; (0, 0) is the centre of the top-left pixel, x right, y down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pixel<D> {
    px: Vector2<f64>,
    lens: PhantomData<D>,
}

impl<D> Pixel<D> {
    /// Asserts that (`x`, `y`) are pixels of kind `D`.
    pub fn new(x: f64, y: f64) -> Self {
        Self {
            px: Vector2::new(x, y),
            lens: PhantomData,
        }
    }

    /// Column and row as a vector, in pixels.
    pub fn vector_px(&self) -> Vector2<f64> {
        self.px
    }

    /// Column, in pixels.
    pub fn x(&self) -> f64 {
        self.px.x
    }

    /// Row, in pixels.
    pub fn y(&self) -> f64 {
        self.px.y
    }
}
