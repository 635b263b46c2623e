//! Known facts about the venue, and the similarity that follows from them.

use std::collections::BTreeSet;

use nalgebra::{Matrix3, Vector3};

use super::floor::floor;
use super::mark_fit::{MarkFit, fit_marks};
use super::marks::{Click, FoundPlace, MarkFreedom, Marks, camera, meeting};
use super::similarity::{Similarity, SimilarityError, mirrored_rms, rms};
use super::wand::wand_scale;
use crate::adjustment::CameraState;

/// A mirror image is reported if it fits this much better, and the proper fit is worse than a share of the extent.
const MIRROR_GAIN: f64 = 0.3;
const MIRROR_SHARE: f64 = 0.01;

/// Least extent of known places across their best line, relative to the extent along it (lengths).
const LEAST_SPREAD: f64 = 0.05;

/// Places in the world of the cameras, and in the venue.
type Places = (Vec<Vector3<f64>>, Vec<Vector3<f64>>);

/// A point of the venue at a known place, with its clicks.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownPoint {
    /// Its name in errors.
    pub name: String,
    /// Its place in the venue, metres.
    pub position_m: [f64; 3],
    /// Its clicks in at least two cameras.
    pub clicks: Vec<Click>,
}

/// A distance between the pinholes of two cameras.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownDistance {
    /// One camera's name.
    pub first: String,
    /// The other's.
    pub second: String,
    /// Metres.
    pub distance_m: f64,
}

/// Known facts about the venue; all lists can be empty.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Anchors {
    /// Places of cameras by name, venue, metres.
    pub centers_m: Vec<(String, [f64; 3])>,
    /// Known points.
    pub points: Vec<KnownPoint>,
    /// Known distances; they give the scale if fewer than three places are known.
    pub distances: Vec<KnownDistance>,
    /// Points of the floor, each with clicks in at least two cameras. Three points give the height of the floor and the
    /// direction of up if fewer than three places are known.
    pub floor: Vec<Vec<Click>>,
    /// Clicks in pictures, in addition to all of the above.
    pub marks: Option<Marks>,
}

/// The alignment to the venue that follows from the anchors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alignment {
    /// From the world of the adjustment to the venue.
    pub venue_from_found: Similarity,
    /// Whether lengths are metres.
    pub has_scale: bool,
    /// Whether z is up and the floor at zero.
    pub has_floor: bool,
    /// Root of the mean squared residual of the known places, metres; `None` without any.
    pub rms_m: Option<f64>,
}

impl Anchors {
    /// The cameras that it names; a camera can occur more than once.
    pub fn cameras(&self) -> impl Iterator<Item = &str> {
        let centers = self.centers_m.iter().map(|(name, _)| name);
        let distances = self.distances.iter().flat_map(|it| [&it.first, &it.second]);
        let clicks = self.points.iter().map(|it| &it.clicks).chain(&self.floor);
        let clicks = clicks.flatten().map(|(name, _)| name);
        let marks = self.marks.iter().flat_map(Marks::cameras);
        let named = centers.chain(distances).chain(clicks);
        named.map(String::as_str).chain(marks)
    }

    /// The anchors without the cameras `names`, which have no pose.
    #[must_use]
    pub fn without(&self, names: &[&str]) -> Self {
        let has = |name: &String| !names.contains(&name.as_str());
        let mut left = self.clone();
        left.centers_m.retain(|(name, _)| has(name));
        left.distances
            .retain(|it| has(&it.first) && has(&it.second));
        for point in &mut left.points {
            point.clicks.retain(|(name, _)| has(name));
        }
        left.points.retain(|point| point.clicks.len() >= 2);
        for clicks in &mut left.floor {
            clicks.retain(|(name, _)| has(name));
        }
        left.floor.retain(|clicks| clicks.len() >= 2);
        left.marks = left.marks.map(|marks| marks.without(names));
        left
    }

    /// A message about the facts that are ignored because their cameras have no pose; `None` if all count.
    pub fn lost(&self, has_pose: impl Fn(&str) -> bool) -> Option<String> {
        let without: BTreeSet<&str> = self.cameras().filter(|name| !has_pose(name)).collect();
        let (whose, why) = match without.len() {
            0 => return None,
            1 => ("camera", "it did not join the others and has no pose"),
            _ => ("cameras", "they did not join the others and have no pose"),
        };
        let names: Vec<&str> = without.into_iter().collect();
        Some(format!(
            "what is known of {whose} `{}` does not count, as {why}",
            names.join("`, `")
        ))
    }

    /// The similarity from the world of `cameras` (by name) to the venue.
    ///
    /// # Errors
    /// A message: an unknown camera, clicks that do not meet, places on a line, a mirror image.
    pub fn align(&self, cameras: &[(String, CameraState)]) -> Result<Alignment, String> {
        if let Some(fitted) = self.fit_marks(cameras)? {
            return Ok(Alignment {
                venue_from_found: fitted.venue_from_found,
                has_scale: true,
                has_floor: true,
                rms_m: Some(fitted.rms_m),
            });
        }
        let (found, known) = self.places(cameras)?;
        if known.len() >= 3 {
            return onto(&found, &known);
        }
        let scale = self.scale(cameras)?;
        let scaled = Similarity {
            scale: scale.unwrap_or(1.0),
            ..Similarity::identity()
        };
        let levelled = self.level(cameras)?;
        let turned = levelled.unwrap_or_else(Similarity::identity);
        Ok(Alignment {
            venue_from_found: turned.then(&scaled),
            has_scale: scale.is_some(),
            has_floor: levelled.is_some(),
            rms_m: None,
        })
    }

    /// The fit to the clicks and known places; `None` if no clicked mark has a known position.
    ///
    /// # Errors
    /// As [`fit_marks`].
    pub fn fit_marks(&self, cameras: &[(String, CameraState)]) -> Result<Option<MarkFit>, String> {
        let Some(marks) = self.marks.as_ref().filter(|marks| !marks.known.is_empty()) else {
            return Ok(None);
        };
        let (found, known) = self.places(cameras)?;
        let names = self.centers_m.iter().map(|(name, _)| name);
        let names = names.chain(self.points.iter().map(|point| &point.name));
        let places: Vec<FoundPlace> = names
            .zip(found.into_iter().zip(known))
            .map(|(name, (found, known))| (name.clone(), found, known))
            .collect();
        fit_marks(marks, &places, cameras, MarkFreedom::Similarity).map(Some)
    }

    /// Known places in the world of the cameras and in the venue.
    fn places(&self, cameras: &[(String, CameraState)]) -> Result<Places, String> {
        let mut found = Vec::new();
        let mut known = Vec::new();
        for (name, center_m) in &self.centers_m {
            found.push(camera(cameras, name)?.center_w);
            known.push(Vector3::from(*center_m));
        }
        for point in &self.points {
            found.push(meeting(cameras, &point.clicks, &point.name)?);
            known.push(Vector3::from(point.position_m));
        }
        Ok((found, known))
    }

    /// The known place without which the others fit best, and their root of the mean squared residual then, metres.
    /// `None` for fewer than four places, whose residuals say nothing.
    pub fn odd_place(&self, cameras: &[(String, CameraState)]) -> Option<(String, f64)> {
        let (found, known) = self.places(cameras).ok()?;
        if known.len() < 4 {
            return None;
        }
        let centers = self.centers_m.iter().map(|(name, _)| name);
        let names = centers.chain(self.points.iter().map(|point| &point.name));
        let each = names.enumerate().filter_map(|(index, name)| {
            let (mut found, mut known) = (found.clone(), known.clone());
            found.remove(index);
            known.remove(index);
            let fitted = Similarity::between(&found, &known).ok()?;
            Some((name.clone(), rms(&fitted, &found, &known)))
        });
        each.min_by(|a, b| a.1.total_cmp(&b.1))
    }

    fn scale(&self, cameras: &[(String, CameraState)]) -> Result<Option<f64>, String> {
        let mut lengths = Vec::new();
        for known in &self.distances {
            let first = camera(cameras, &known.first)?.center_w;
            let second = camera(cameras, &known.second)?.center_w;
            let here = (first - second).norm();
            if known.distance_m.is_nan() || known.distance_m <= 0.0 || here <= 0.0 {
                return Err(format!(
                    "distance of `{}` and `{}`: found {} m, expected more than 0",
                    known.first, known.second, known.distance_m
                ));
            }
            lengths.push((here, known.distance_m));
        }
        for length in self.marks.iter().flat_map(|marks| &marks.lengths) {
            let [a, b] = &length.ends;
            let apart =
                meeting(cameras, &a.clicks, &a.name)? - meeting(cameras, &b.clicks, &b.name)?;
            lengths.push((apart.norm(), length.length_m));
        }
        if lengths.is_empty() {
            return Ok(None);
        }
        Ok(Some(wand_scale(&lengths)?.scale))
    }

    /// The rotation and shift after which the floor is z = 0 and the cameras are above it.
    fn level(&self, cameras: &[(String, CameraState)]) -> Result<Option<Similarity>, String> {
        let clicked = self.marks.iter().flat_map(|marks| &marks.floor);
        let clicked = clicked.map(|point| (point.name.clone(), &point.clicks));
        let numbered = self.floor.iter().enumerate();
        let numbered = numbered.map(|(i, clicks)| (format!("floor point {}", i + 1), clicks));
        let points: Vec<Vector3<f64>> = numbered
            .chain(clicked)
            .map(|(name, clicks)| meeting(cameras, clicks, &name))
            .collect::<Result<_, _>>()?;
        if points.len() < 3 {
            return Ok(None);
        }
        let centers: Vec<Vector3<f64>> = cameras.iter().map(|(_, c)| c.center_w).collect();
        Ok(Some(floor(&points, &centers)?.level))
    }
}

/// Refuses places that are so nearly on one line that a rotation about it is undetermined.
fn check_spread(places: &[Vector3<f64>], whose: &str) -> Result<(), String> {
    let middle = places.iter().fold(Vector3::zeros(), |s, p| s + p) / places.len() as f64;
    let spread = places.iter().fold(Matrix3::zeros(), |s, p| {
        s + (p - middle) * (p - middle).transpose()
    });
    let mut lengths = spread.symmetric_eigenvalues().map(|v| v.max(0.0).sqrt());
    lengths.as_mut_slice().sort_by(f64::total_cmp);
    if lengths[1] >= LEAST_SPREAD * lengths[2] && lengths[2] > 0.0 {
        return Ok(());
    }
    Err(format!(
        "{whose} lie nearly on one line: their extent across it is {:.1} % of that along it, expected at least {:.0} %; \
         the direction of up would be undetermined. Add a place that is off the line",
        100.0 * lengths[1] / lengths[2].max(f64::MIN_POSITIVE),
        100.0 * LEAST_SPREAD
    ))
}

fn onto(found: &[Vector3<f64>], known: &[Vector3<f64>]) -> Result<Alignment, String> {
    let message = |error: SimilarityError| format!("known places: {error}");
    check_spread(known, "the known places")?;
    check_spread(found, "the known places, as the cameras see them,")?;
    let venue_from_found = Similarity::between(found, known).map_err(message)?;
    let left_m = rms(&venue_from_found, found, known);
    let mirrored_m = mirrored_rms(found, known).map_err(message)?;
    let middle = known.iter().fold(Vector3::zeros(), |s, p| s + p) / known.len() as f64;
    let extent = known
        .iter()
        .map(|p| (p - middle).norm())
        .fold(0.0, f64::max);
    if mirrored_m < MIRROR_GAIN * left_m && left_m > MIRROR_SHARE * extent {
        return Err(format!(
            "the known places fit a mirror image of the cameras ({mirrored_m:.3} m), but not the cameras ({left_m:.3} m): \
             two axes of the known places are exchanged or one points the wrong way, or the videos are mirrored"
        ));
    }
    Ok(Alignment {
        venue_from_found,
        has_scale: true,
        has_floor: true,
        rms_m: Some(left_m),
    })
}
/// A message about ignored facts of cameras without a pose, for errors that report missing facts.
pub(crate) struct Lost(pub(crate) Option<String>);

impl Lost {
    /// Describes the missing fact `what`, and the ignored facts if there are any.
    pub(crate) fn missing(&self, what: &str) -> String {
        let lost = self.0.as_ref();
        lost.map_or_else(|| what.to_owned(), |lost| format!("{what}; {lost}"))
    }

    /// The remedy; `otherwise` if no facts were ignored.
    pub(crate) fn remedy(&self, otherwise: &str) -> String {
        if self.0.is_none() {
            return otherwise.to_owned();
        }
        format!("first fix the camera without a pose, or {otherwise}")
    }
}
