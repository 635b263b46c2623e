//! Whom three viewpoints show in a detection pass, told by sightings that fit each other best.

use std::collections::{BTreeMap, BTreeSet};

use farfield_proto::id::ViewpointIndex;
use nalgebra::Vector3;

use super::super::super::geometry::meeting;
use super::super::super::pairs::{best_matches, cost};
use super::super::super::samples::COMPARED;
use super::super::Judge;
use super::places::{Places, Sight};

/// Keypoints that two must have in common.
const MIN_COMMON: usize = 5;
/// Pairs of cameras in a pass that are compared, all passes together.
const MAX_PAIRS: usize = 1200;
/// Viewpoints that must show somebody.
const MIN_VIEWPOINTS: usize = 3;
/// People who tell, keypoints of them, at most so many of these, and of each viewpoint so many.
const MIN_PEOPLE: usize = 6;
const MIN_POINTS: usize = 100;
const MAX_POINTS: usize = 500;
const MIN_OF_VIEWPOINT: usize = 40;
/// Most viewpoints by which one keypoint is told: more tell little more, and each is held against each.
const MOST_SIGHTS: usize = 12;

/// A sighting: the camera, and which of those that it has in a pass.
type Shown = (usize, usize);

impl Judge<'_> {
    /// The keypoints of people whom three viewpoints show; `None` where they are too few.
    pub(super) fn places(&self) -> Option<Places> {
        let pairs = self.pairs_of(&self.showing());
        let most = (MAX_PAIRS / pairs.len().max(1)).max(1);
        let step = self.passes.len().div_ceil(most).max(1);
        let viewpoints: BTreeSet<ViewpointIndex> = pairs
            .iter()
            .flat_map(|&(a, b)| [a, b])
            .map(|camera| self.cameras[camera].viewpoint)
            .collect();
        let viewpoints: Vec<ViewpointIndex> = viewpoints.into_iter().collect();
        let (mut points, mut ankles, mut people) = (Vec::new(), Vec::new(), 0);
        let names = self.venue.keypoints.names();
        let is_ankle = |keypoint: usize| names[keypoint].ends_with("_ankle");
        for pass in (0..self.passes.len()).step_by(step) {
            for person in self.people_of(pass, &pairs) {
                let of_person = self.points_of(pass, &person, &viewpoints);
                people += usize::from(!of_person.is_empty());
                let own = of_person.iter().filter(|(keypoint, _)| is_ankle(*keypoint));
                ankles.extend(own.map(|(_, point)| point.clone()));
                points.extend(of_person.into_iter().map(|(_, point)| point));
            }
        }
        let points = most_of(points);
        if people < MIN_PEOPLE || points.len() < MIN_POINTS {
            return None;
        }
        let shown = |viewpoint: usize| {
            let of = |point: &&Vec<Sight>| point.iter().any(|it| it.viewpoint == viewpoint);
            points.iter().filter(of).count()
        };
        let are_shown = (0..viewpoints.len()).all(|of| shown(of) >= MIN_OF_VIEWPOINT);
        are_shown.then(|| Places::new((points, most_of(ankles)), viewpoints))
    }

    /// Sightings of one pass that are of one person, each of another camera.
    fn people_of(&self, pass: usize, pairs: &[(usize, usize)]) -> Vec<Vec<Shown>> {
        let mut fitting: BTreeMap<Shown, Vec<Shown>> = BTreeMap::new();
        for &(a, b) in pairs {
            let of = |camera: usize| self.bodies(pass, camera);
            let (few, many) = if of(a).len() <= of(b).len() {
                (a, b)
            } else {
                (b, a)
            };
            let of_two = |own: usize, other: usize| {
                self.cost_of((few, &of(few)[own]), (many, &of(many)[other]))
            };
            for [own, other] in best_matches(of(few).len(), of(many).len(), of_two) {
                let both = [(few, own), (many, other)];
                fitting.entry(both[0]).or_default().push(both[1]);
                fitting.entry(both[1]).or_default().push(both[0]);
            }
        }
        let mut people = Vec::new();
        while let Some((&first, _)) = fitting.first_key_value() {
            let (mut person, mut next) = (Vec::new(), vec![first]);
            while let Some(shown) = next.pop() {
                if let Some(others) = fitting.remove(&shown) {
                    person.push(shown);
                    next.extend(others);
                }
            }
            let cameras: BTreeSet<usize> = person.iter().map(|(camera, _)| *camera).collect();
            // Who is two people in one camera is nobody.
            if cameras.len() == person.len() {
                people.push(person);
            }
        }
        people
    }

    fn bodies(&self, pass: usize, camera: usize) -> &[Vec<Vector3<f64>>] {
        let bodies = &self.as_it_is[camera].of_pass[pass];
        &bodies[..bodies.len().min(COMPARED)]
    }

    /// What it costs to take two sightings for one person, 0 to 1; `None` where too few keypoints are in both.
    fn cost_of(
        &self,
        (a, one): (usize, &[Vector3<f64>]),
        (b, other): (usize, &[Vector3<f64>]),
    ) -> Option<f64> {
        let [a_m, b_m] = [a, b].map(|camera| &self.lines[camera].center_m);
        let both = one.iter().zip(other);
        let costs = both.filter_map(|(p, q)| Some(cost(meeting((a_m, p), (b_m, q))?.gap_m)));
        let (sum, n) = costs.fold((0.0, 0), |(sum, n), cost| (sum + cost, n + 1));
        (n >= MIN_COMMON).then(|| sum / n as f64)
    }

    /// The lines of sight of each keypoint of somebody whom three viewpoints show, with which keypoint it is.
    fn points_of(
        &self,
        pass: usize,
        person: &[Shown],
        viewpoints: &[ViewpointIndex],
    ) -> Vec<(usize, Vec<Sight>)> {
        let n_keypoints = self.partners.len();
        let of_keypoint = |keypoint: usize| {
            let sights = person.iter().filter_map(|&(camera, body)| {
                let direction = self.bodies(pass, camera)[body].get(keypoint)?;
                let of = self.cameras[camera].viewpoint;
                let viewpoint = viewpoints.iter().position(|it| *it == of)?;
                let unit = direction.try_normalize(0.0)?;
                Some(Sight::new(viewpoint, self.lines[camera].center_m, &unit))
            });
            let sights: Vec<Sight> = sights.collect();
            let seen: BTreeSet<usize> = sights.iter().map(|sight| sight.viewpoint).collect();
            (seen.len() >= MIN_VIEWPOINTS).then_some((keypoint, sights))
        };
        (0..n_keypoints).filter_map(of_keypoint).collect()
    }
}

/// Those of all keypoints that count, spread over them.
fn most_of(points: Vec<Vec<Sight>>) -> Vec<Vec<Sight>> {
    let step = points.len().div_ceil(MAX_POINTS).max(1);
    let points = points.into_iter().step_by(step).enumerate();
    points.map(|(at, point)| few_of(point, at)).collect()
}

/// Those of a keypoint's sights that count, other ones of each keypoint: `at` is its number.
fn few_of(point: Vec<Sight>, at: usize) -> Vec<Sight> {
    let step = point.len().div_ceil(MOST_SIGHTS).max(1);
    let first = at % step;
    point.into_iter().skip(first).step_by(step).collect()
}
