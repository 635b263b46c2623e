//! Checks the ranges of a scene file's numbers and the consistency of its parts.

use std::collections::BTreeSet;

use farfield_proto::toml_file::{FileError, Place, TomlFile};

use super::entries::{PersonTable, SceneTable, ViewpointTable};
use super::{
    CameraSource, GeneratedCameras, MAX_CAMERAS, MAX_FIGURES, MAX_MIRRORS, MAX_PEOPLE,
    MAX_PERSON_SECONDS, MAX_TICKS,
};

/// Largest number of clips of one person, and of points of one path.
const MAX_LIST: usize = 1000;

/// The checks that types cannot make.
pub(super) struct Check<'a> {
    pub(super) file: &'a TomlFile<'a>,
}

impl Check<'_> {
    /// Refuses values outside `min` to `max`, and NaN.
    fn range(&self, place: &Place, value: f64, [min, max]: [f64; 2]) -> Result<(), FileError> {
        if (min..=max).contains(&value) {
            return Ok(());
        }
        let problem = format!("found {value:?}, expected a number from {min} to {max}");
        Err(self.file.error(place, problem))
    }

    fn count(&self, place: &Place, n: usize, [min, max]: [usize; 2]) -> Result<(), FileError> {
        if (min..=max).contains(&n) {
            return Ok(());
        }
        let problem = format!("found {n}, expected from {min} to {max}");
        Err(self.file.error(place, problem))
    }

    fn point(&self, place: &Place, point_m: [f64; 2]) -> Result<(), FileError> {
        for (i, value) in point_m.into_iter().enumerate() {
            self.range(&place.index(i), value, [-2000.0, 2000.0])?;
        }
        Ok(())
    }

    fn name(&self, place: &Place, name: &str) -> Result<(), FileError> {
        let plain = |c: char| c.is_alphanumeric() || "-_.".contains(c);
        if !name.is_empty() && name.len() <= 64 && name.chars().all(plain) {
            return Ok(());
        }
        let problem = format!("found {name:?}, expected letters, digits, `-`, `_` or `.`");
        Err(self.file.error(place, problem))
    }

    pub(super) fn scene(&self, raw: &SceneTable) -> Result<(), FileError> {
        self.range(&Place::field("rate_hz"), raw.rate_hz, [1.0, 1000.0])?;
        let longest_s = MAX_TICKS / raw.rate_hz;
        self.range(&Place::field("seconds"), raw.seconds, [0.0, longest_s])?;
        for (i, size_m) in raw.size_m.into_iter().enumerate() {
            self.range(&Place::field("size_m").index(i), size_m, [1.0, 1000.0])?;
        }
        self.range(&Place::field("floor_m"), raw.floor_m, [-100.0, 100.0])?;
        Ok(())
    }

    pub(super) fn cameras(&self, raw: &SceneTable) -> Result<CameraSource, FileError> {
        let place = Place::field("cameras");
        match (&raw.cameras, &raw.calibration) {
            (Some(_), Some(_)) => Err(self.file.error(
                &Place::field("calibration"),
                "found together with `[cameras]`, expected one of the two",
            )),
            (None, None) => Err(self.file.error(
                &place,
                "found neither `[cameras]` nor `calibration`, expected one of the two",
            )),
            (Some(_), None) if !raw.viewpoint.is_empty() => Err(self.file.error(
                &Place::field("viewpoint").index(0),
                "found together with `[cameras]`, expected it only with `calibration`",
            )),
            (Some(cameras), None) => {
                self.generated(&place, cameras)?;
                Ok(CameraSource::Generated(cameras.clone()))
            }
            (None, Some(calibration)) => Ok(CameraSource::Calibrated {
                calibration: self.file.resolve(calibration),
                viewpoints: self.viewpoints(&raw.viewpoint)?,
            }),
        }
    }

    fn generated(&self, place: &Place, cameras: &GeneratedCameras) -> Result<(), FileError> {
        let GeneratedCameras {
            viewpoints,
            per_viewpoint,
            ..
        } = *cameras;
        self.count(&place.key("viewpoints"), viewpoints, [1, MAX_CAMERAS])?;
        let most = MAX_CAMERAS / viewpoints;
        self.count(&place.key("per_viewpoint"), per_viewpoint, [1, most])?;
        self.range(&place.key("height_m"), cameras.height_m, [0.2, 200.0])?;
        self.range(&place.key("setback_m"), cameras.setback_m, [0.2, 500.0])?;
        for (i, size_px) in cameras.size_px.into_iter().enumerate() {
            let size_px = f64::from(size_px);
            self.range(&place.key("size_px").index(i), size_px, [16.0, 8192.0])?;
        }
        Ok(())
    }

    fn viewpoints(&self, raw: &[ViewpointTable]) -> Result<Vec<(String, Vec<String>)>, FileError> {
        let place = Place::field("viewpoint");
        let n_cameras = raw.iter().map(|v| v.camera.len()).sum();
        self.count(&place, n_cameras, [1, MAX_CAMERAS])?;
        let (mut names, mut cameras) = (BTreeSet::new(), BTreeSet::new());
        for (i, viewpoint) in raw.iter().enumerate() {
            let place = place.index(i);
            self.name(&place.key("name"), &viewpoint.name)?;
            self.unique(&place.key("name"), &viewpoint.name, &mut names)?;
            self.count(&place.key("camera"), viewpoint.camera.len(), [1, n_cameras])?;
            for (j, camera) in viewpoint.camera.iter().enumerate() {
                let place = place.key("camera").index(j).key("name");
                self.unique(&place, &camera.name, &mut cameras)?;
            }
        }
        let named = |v: &ViewpointTable| {
            let cameras = v.camera.iter().map(|camera| camera.name.clone());
            (v.name.clone(), cameras.collect())
        };
        Ok(raw.iter().map(named).collect())
    }

    fn unique<'n>(
        &self,
        place: &Place,
        name: &'n str,
        taken: &mut BTreeSet<&'n str>,
    ) -> Result<(), FileError> {
        if taken.insert(name) {
            return Ok(());
        }
        Err(self.file.error(place, format!("a second `{name}`")))
    }

    pub(super) fn people(&self, raw: &SceneTable) -> Result<(), FileError> {
        let all = Place::field("person");
        self.count(&all, raw.person.len(), [0, MAX_PEOPLE])?;
        if raw.person.len() as f64 * raw.seconds > MAX_PERSON_SECONDS {
            let problem = format!(
                "found {:?} for {} people, expected at most {MAX_PERSON_SECONDS} for all people together",
                raw.seconds,
                raw.person.len()
            );
            return Err(self.file.error(&Place::field("seconds"), problem));
        }
        let mut names = BTreeSet::new();
        for (i, person) in raw.person.iter().enumerate() {
            let place = all.index(i);
            self.person(&place, person)?;
            self.unique(&place.key("name"), &person.name, &mut names)?;
            let Some(group) = &person.group else { continue };
            let first = raw.person.iter().find(|p| p.group.as_ref() == Some(group));
            if first.is_some_and(|first| first.clips.len() != person.clips.len()) {
                let problem = format!(
                    "found {} clips, expected as many as the first of group `{group}` has",
                    person.clips.len()
                );
                return Err(self.file.error(&place.key("clips"), problem));
            }
        }
        Ok(())
    }

    /// Checks mirrors, posters and `[[lost]]` entries.
    pub(super) fn surroundings(&self, raw: &SceneTable) -> Result<(), FileError> {
        let (mirrors, posters) = (Place::field("mirror"), Place::field("poster"));
        self.count(&mirrors, raw.mirror.len(), [0, MAX_MIRRORS])?;
        let shown = raw.person.len() * (1 + raw.mirror.len());
        let Some(most) = MAX_FIGURES.checked_sub(shown) else {
            let problem = format!(
                "found {}, which make {shown} figures of {} people, expected at most {MAX_FIGURES}",
                raw.mirror.len(),
                raw.person.len()
            );
            return Err(self.file.error(&mirrors, problem));
        };
        self.count(&posters, raw.poster.len(), [0, most])?;
        for (i, mirror) in raw.mirror.iter().enumerate() {
            let place = mirrors.index(i);
            self.point(&place.key("from_m"), mirror.from_m)?;
            self.point(&place.key("to_m"), mirror.to_m)?;
            self.range(&place.key("height_m"), mirror.height_m, [0.1, 100.0])?;
            let width_m = distance_m(mirror.from_m, mirror.to_m);
            if width_m < 0.1 {
                let problem =
                    format!("found {width_m:.3} m from `from_m`, expected at least 0.1 m");
                return Err(self.file.error(&place.key("to_m"), problem));
            }
        }
        for (i, poster) in raw.poster.iter().enumerate() {
            let place = posters.index(i);
            self.point(&place.key("at_m"), poster.at_m)?;
            let heading = place.key("heading_rad");
            self.range(&heading, poster.heading_rad, [-100.0, 100.0])?;
            self.range(&place.key("height_m"), poster.height_m, [0.3, 2.6])?;
            self.range(&place.key("time_s"), poster.time_s, [0.0, 1e6])?;
        }
        self.count(&Place::field("lost"), raw.lost.len(), [0, MAX_LIST])?;
        for (i, lost) in raw.lost.iter().enumerate() {
            let place = Place::field("lost").index(i);
            self.range(&place.key("from_s"), lost.from_s, [0.0, 1e6])?;
            self.range(&place.key("until_s"), lost.until_s, [lost.from_s, 1e6])?;
        }
        Ok(())
    }

    fn person(&self, place: &Place, person: &PersonTable) -> Result<(), FileError> {
        self.name(&place.key("name"), &person.name)?;
        self.count(&place.key("clips"), person.clips.len(), [1, MAX_LIST])?;
        self.range(&place.key("blend_s"), person.blend_s, [0.0, 10.0])?;
        self.point(&place.key("at_m"), person.at_m)?;
        self.range(
            &place.key("heading_rad"),
            person.heading_rad,
            [-100.0, 100.0],
        )?;
        self.range(&place.key("height_m"), person.height_m, [0.3, 2.6])?;
        self.range(&place.key("enter_s"), person.enter_s, [0.0, 1e6])?;
        if let Some(leave_s) = person.leave_s {
            self.range(&place.key("leave_s"), leave_s, [person.enter_s, 1e6])?;
        }
        let Some(path) = &person.path else {
            return Ok(());
        };
        let place = place.key("path");
        if person.group.is_some() {
            let problem = "found in a group, whose people keep their clips' common frame";
            return Err(self.file.error(&place, problem));
        }
        let points = place.key("points_m");
        self.count(&points, path.points_m.len(), [1, MAX_LIST])?;
        for (i, point_m) in path.points_m.iter().enumerate() {
            self.point(&points.index(i), *point_m)?;
        }
        self.range(&place.key("speed_m_s"), path.speed_m_s, [0.0, 15.0])?;
        // Limits the laps back and forth to a few per second.
        let length_m: f64 = path
            .points_m
            .windows(2)
            .map(|w| distance_m(w[0], w[1]))
            .sum();
        if path.speed_m_s > 0.0 && path.points_m.len() > 1 && length_m < 0.1 {
            let problem = format!("found {length_m:.3} m of path, expected at least 0.1 m");
            return Err(self.file.error(&points, problem));
        }
        Ok(())
    }
}

fn distance_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}
