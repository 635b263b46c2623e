//! What blocks the view of a camera apart from bodies. Mirrors hide what is behind them and reflect
//! what is in front of them.
//!
//! A figure that is not visible to a camera hides nothing from it: for example a person hidden by
//! `[[lost]]`, or a poster seen from behind.

use std::sync::Arc;

use nalgebra::Vector3;

use super::crowd::{FigureKind, Subject};
use crate::scene::Scene;

/// A camera among the mirrors and posters of its scene.
#[derive(Debug, Clone)]
pub(super) struct Standpoint {
    scene: Arc<Scene>,
    /// Index of its viewpoint in the scene.
    viewpoint: usize,
    eye_m: Vector3<f64>,
}

impl Standpoint {
    /// The standpoint of camera `camera` of the scene.
    pub(super) fn new(scene: &Arc<Scene>, camera: usize) -> Self {
        let of_camera = scene
            .viewpoints()
            .iter()
            .position(|v| v.cameras.contains(&camera));
        Self {
            viewpoint: of_camera.unwrap_or(0),
            eye_m: scene.cameras()[camera].center().coordinates_m().coords,
            scene: Arc::clone(scene),
        }
    }

    /// Whether any part of `subject` can be visible from here.
    pub(super) fn faces(&self, subject: &Subject) -> bool {
        let to_all = match subject.figure {
            FigureKind::Body => true,
            FigureKind::Reflection(mirror) => self.scene.mirrors()[mirror].is_before(&self.eye_m),
            FigureKind::Poster(poster) => self.scene.posters()[poster].is_before(&self.eye_m),
        };
        to_all && subject.seen_by & (1 << self.viewpoint) != 0
    }

    /// Whether a point of `subject` is visible: not behind a mirror, or, for a reflection, inside
    /// the glass.
    pub(super) fn reaches(&self, subject: &Subject, point_m: &Vector3<f64>) -> bool {
        let mut mirrors = self.scene.mirrors().iter().enumerate();
        mirrors.all(|(index, mirror)| {
            let in_its_glass = subject.figure == FigureKind::Reflection(index);
            mirror.is_between(&self.eye_m, point_m) == in_its_glass
        })
    }

    /// Whether `other` can hide a part of `subject`. A figure that this camera does not see hides
    /// nothing. A reflection hides only figures in the same glass. Objects behind the mirror do not
    /// hide a reflection.
    pub(super) fn may_hide(&self, other: &Subject, subject: &Subject) -> bool {
        if !self.faces(other) {
            return false;
        }
        match (other.figure, subject.figure) {
            (FigureKind::Reflection(a), FigureKind::Reflection(b)) => a == b,
            (FigureKind::Reflection(_), _) => false,
            (_, FigureKind::Reflection(mirror)) => {
                self.scene.mirrors()[mirror].is_before(&other.torso_m)
            }
            _ => true,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use farfield_edge::source::MapPainter as _;
    use farfield_proto::tick::Tick;

    use super::super::observe::{ImagedPerson, MapObservation};
    use super::super::{MapFaults, SceneCrowd};
    use super::*;
    use crate::embedded::CLIPS;
    use crate::motion::Clip;

    /// One person in the middle, two viewpoints in the south, two in the north, and only the faults
    /// in `added`.
    fn scene(added: &str) -> Arc<Scene> {
        let text = format!(
            "rate_hz = 60\nseconds = 4\nsize_m = [7, 5]\n\
             [cameras]\nviewpoints = 4\nper_viewpoint = 1\n\
             [[person]]\nname = \"1\"\nclips = [\"idle.bvh\"]\nheight_m = 1.8\n{added}"
        );
        let idle = CLIPS.iter().find(|(name, _)| *name == "idle").unwrap();
        let clip = &mut |path: &Path| Ok(Arc::new(Clip::parse(idle.1, path)?));
        Arc::new(Scene::parse(&text, Path::new("a.toml"), clip).unwrap())
    }

    /// What the camera of a viewpoint observes at `time_s`.
    fn observed(scene: &Arc<Scene>, viewpoint: &str, time_s: f64) -> MapObservation {
        let crowd = Arc::new(SceneCrowd::new(Arc::clone(scene)));
        let names = scene.viewpoints().iter();
        let found = names.clone().find(|v| v.name == viewpoint).unwrap();
        let tick = Tick((time_s * 60.0).round() as i64);
        MapFaults::with_crowd(crowd, found.cameras[0]).observe(tick)
    }

    fn of_figure(observation: &MapObservation, person: usize) -> Option<&ImagedPerson> {
        observation.people.iter().find(|seen| seen.person == person)
    }

    /// The person is in front of the mirror; the northern viewpoints are behind it.
    const MIRROR: &str = "[[mirror]]\nfrom_m = [3, 1.5]\nto_m = [-3, 1.5]\nheight_m = 2.4\n";

    #[test]
    fn a_mirror_doubles_people_in_front_and_hides_people_behind() {
        let scene = scene(MIRROR);
        for south in ["south-west", "south-east"] {
            let seen = observed(&scene, south, 0.0);
            assert_eq!((seen.people.len(), seen.persons().len()), (2, 2));
            let truth = scene.person_at(0, 0.0).unwrap();
            let camera = &seen.camera;
            let reflected_m = scene.mirrors()[0].reflected(&truth.sites_m[9]);
            let expected = camera.project(farfield_proto::frames::Point::new(reflected_m.into()));
            let right_wrist = of_figure(&seen, 1).unwrap().keypoints[10].own.unwrap();
            let off_px = right_wrist.at_px - expected.unwrap().vector_px();
            assert!(off_px.norm() < 1e-6, "the left hand looks like a right one");
        }
        for north in ["north-west", "north-east"] {
            let seen = observed(&scene, north, 0.0);
            let feet = of_figure(&seen, 0).map(|seen| seen.keypoints[15]);
            assert!(feet.is_none_or(|feet| feet.own.is_none()), "{feet:?}");
            assert!(of_figure(&seen, 1).is_none(), "mirrors have a back");
        }
    }

    #[test]
    fn a_nearby_reflection_leaks_into_the_maps_of_a_person() {
        let scene = scene(&format!(
            "{MIRROR}[faults]\nleak = {{ probability = 1.0 }}\n"
        ));
        let seen = observed(&scene, "south-west", 0.0);
        let (body, reflection) = (of_figure(&seen, 0).unwrap(), of_figure(&seen, 1).unwrap());
        let leaked = body.keypoints[0].leaked.unwrap();
        assert!((leaked.at_px - reflection.keypoints[0].own.unwrap().at_px).norm() < 1e-6);
        assert!(reflection.keypoints.iter().all(|k| k.leaked.is_none()));
    }

    #[test]
    fn a_poster_is_sighted_from_the_front_and_hides_people_behind() {
        let poster = "[[poster]]\nat_m = [-1.5, -1.2]\nheading_rad = 3.8\nheight_m = 1.8\n\
                      clip = \"idle.bvh\"\n";
        let scene = scene(poster);
        let seen = observed(&scene, "south-west", 0.0);
        assert!(of_figure(&seen, 1).is_some());
        let behind = of_figure(&seen, 0).unwrap().keypoints;
        assert!(behind.iter().any(|keypoint| !keypoint.in_the_open));
        let again = observed(&scene, "south-west", 3.0);
        let places = |seen: &MapObservation| of_figure(seen, 1).unwrap().keypoints;
        assert_eq!(places(&seen), places(&again), "it does not move");
        assert!(of_figure(&observed(&scene, "north-east", 0.0), 1).is_none());
    }

    #[test]
    fn a_lost_person_is_visible_only_to_the_exceptions_until_the_end() {
        let lost = "[[lost]]\nperson = \"1\"\nfrom_s = 1\nuntil_s = 2\nexcept = [\"north-east\"]\n";
        let scene = scene(lost);
        for (time_s, elsewhere) in [(0.9, 1), (1.0, 0), (1.9, 0), (2.0, 1)] {
            let n = |viewpoint| observed(&scene, viewpoint, time_s).people.len();
            assert_eq!((n("north-east"), n("south-west")), (1, elsewhere));
        }
        assert!(scene.is_in_truth(0));
    }

    #[test]
    fn a_person_lost_to_a_camera_hides_no_other_person_from_it() {
        let near = "[[person]]\nname = \"2\"\nclips = [\"idle.bvh\"]\nheight_m = 1.8\n\
                    at_m = [-1.5, -1.2]\nkeep_inside = false\n";
        let lost = "[[lost]]\nperson = \"2\"\nfrom_s = 1\nuntil_s = 2\n";
        let scene = scene(&format!("{near}{lost}"));
        let hidden = |time_s| {
            let seen = observed(&scene, "south-west", time_s);
            let behind = of_figure(&seen, 0).unwrap().keypoints;
            let is_hidden = behind.iter().any(|keypoint| !keypoint.in_the_open);
            (seen.people.len(), is_hidden)
        };
        assert_eq!(hidden(0.5), (2, true));
        assert_eq!(hidden(1.5), (1, false));
    }

    #[test]
    fn a_bystander_seen_by_one_viewpoint_is_not_in_the_truth() {
        let scene = scene("seen_by = [\"south-west\"]\n");
        assert_eq!(observed(&scene, "south-west", 0.0).persons().len(), 1);
        assert_eq!(observed(&scene, "south-east", 0.0).persons().len(), 0);
        assert!(scene.person_at(0, 0.0).is_some() && scene.truth_at(0, Tick(0)).is_none());
    }
}
