//! Paints an observation as maps, crop by crop, and lists the people that a detector finds.

use farfield_edge::source::{KeypointCandidate, MapCrop, MapPainter};
use farfield_proto::frames::Pixel;
use farfield_proto::grid::CellGrid;
use farfield_proto::patch::{MAX_SIDE, Maps};
use nalgebra::Vector2;

use super::observe::{
    ImagedPerson, KeypointPeaks, LEAST_KEYPOINTS, MapObservation, SimulatedPeak, mixed,
};
use super::streams::N_KEYPOINTS;

/// A detector's crop is the bounding box of a person's keypoints, enlarged by this factor.
const DETECTION_MARGIN: f64 = 1.25;
/// Mean brightness reported for pictures that are not rendered, 0 to 255.
const BRIGHTNESS: f64 = 128.0;
/// Values below half a step of a cell are not drawn.
const HALF_STEP: f64 = 0.5 / 255.0;

/// A network describes the person in the middle of its crop.
///
/// This is the person whose projected pelvis and neck together are nearest to the box's projected
/// torso and neck, among those with at least one of the two inside the crop. A crop without a
/// person contains only noise. Other people appear only where they leak into the maps of a person.
impl MapPainter for MapObservation {
    fn paint(&self, crop: &MapCrop<'_>, into: &mut Maps) {
        let owner = self.owner(crop);
        let mut painter = MapBrush {
            sigma: crop.sigma_cells,
            noise: self.noise,
            floor: crop.floor,
            key: mixed(self.noise_key ^ owner.map_or(0, |seen| 1 + seen.person as u64)),
        };
        for k in 0..into.keypoints() {
            painter.key = mixed(painter.key);
            let width = into.width();
            let cells = into.cells_mut(k);
            painter.fill(cells);
            let Some(evidence) = owner.and_then(|seen| seen.keypoints.get(k)) else {
                continue;
            };
            let leaked = evidence
                .leaked
                .filter(|peak| is_inside(crop.grid, cell_of(crop.grid, peak.at_px)));
            for peak in [evidence.own, evidence.mirrored, leaked]
                .into_iter()
                .flatten()
            {
                let cell = cell_of(crop.grid, peak.at_px);
                painter.draw(cells, width, cell, peak.height);
            }
        }
    }

    /// The noise identifies a picture: no two ticks of a camera share it, and only a black picture
    /// has none.
    fn picture_sample(&self) -> Option<(u64, f64)> {
        let is_black = self.noise_key == 0;
        Some((self.noise_key, if is_black { 0.0 } else { BRIGHTNESS }))
    }

    /// The people with at least six keypoints in the image that no other body covers. The position
    /// of a keypoint is its highest peak, even a false one, as in the maps of a real network.
    fn persons(&self) -> Vec<Vec<Option<KeypointCandidate>>> {
        self.people
            .iter()
            .filter_map(|seen| self.sighting(seen))
            .collect()
    }
}

impl MapObservation {
    fn owner(&self, crop: &MapCrop<'_>) -> Option<&ImagedPerson> {
        let [torso_px, neck_px] = [crop.region.torso_px, crop.region.neck_px]
            .map(|[x, y]| Vector2::new(f64::from(x), f64::from(y)));
        let inside = |px| is_inside(crop.grid, cell_of(crop.grid, px));
        let distance = |seen: &ImagedPerson| {
            (seen.torso_px - torso_px).norm() + (seen.neck_px - neck_px).norm()
        };
        self.people
            .iter()
            .filter(|seen| inside(seen.torso_px) || inside(seen.neck_px))
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))
    }

    fn sighting(&self, seen: &ImagedPerson) -> Option<Vec<Option<KeypointCandidate>>> {
        let open = seen.keypoints.iter().filter(|e| e.in_the_open);
        if open.count() < LEAST_KEYPOINTS {
            return None;
        }
        let own = || seen.keypoints.iter().filter_map(|e| e.own);
        let mut around = own().map(|peak| (peak.at_px, peak.at_px));
        let first = around.next()?;
        let (min, max) = around.fold(first, |(a, b), (p, q)| (a.inf(&p), b.sup(&q)));
        let (center, reach) = ((min + max) / 2.0, (max - min) * (DETECTION_MARGIN / 2.0));
        let inside = |peak: &SimulatedPeak| {
            let from_center = (peak.at_px - center).abs();
            from_center.x <= reach.x && from_center.y <= reach.y
        };
        let candidate = |evidence: &KeypointPeaks| {
            let leaked = evidence.leaked.filter(inside);
            let peaks = [evidence.own, evidence.mirrored, leaked];
            let best = peaks.into_iter().flatten();
            let best = best.max_by(|a, b| a.height.total_cmp(&b.height))?;
            let pixel = Pixel::new(best.at_px.x, best.at_px.y);
            Some(KeypointCandidate {
                position: self.camera.distort(pixel)?,
                score: best.height.min(1.0) as f32,
            })
        };
        Some(seen.keypoints.iter().map(candidate).collect())
    }
}

fn cell_of(grid: &CellGrid, px: Vector2<f64>) -> Vector2<f64> {
    grid.cell(Pixel::new(px.x, px.y))
}

/// Whether a cell position is inside the grid.
fn is_inside(grid: &CellGrid, cell: Vector2<f64>) -> bool {
    let within = |c: f64, size: u16| (-0.5..f64::from(size) - 0.5).contains(&c);
    within(cell.x, grid.width) && within(cell.y, grid.height)
}

/// As [`farfield_proto::patch::quantize`] for values of 0 or more, without its call to the C
/// library's rounding, which would take most of the painting time.
fn quantized(value: f32) -> u8 {
    // `as` saturates.
    (value * 255.0 + 0.5) as u8
}

struct MapBrush {
    /// Width of peaks, cells.
    sigma: f64,
    /// Highest noise, 0 to 1.
    noise: f64,
    /// Cells below this value are dropped later.
    floor: u8,
    /// Key of this map's noise.
    key: u64,
}

impl MapBrush {
    /// The noise of a cell, 0 to [`Self::noise`].
    fn noise_at(&self, cell: usize) -> f32 {
        // The upper 24 bits are exact in f32.
        let share = (mixed(self.key ^ cell as u64) >> 40) as f32 / (1u32 << 24) as f32;
        self.noise as f32 * share
    }

    /// Fills every cell with noise, unless the floor drops all of it.
    fn fill(&self, cells: &mut [u8]) {
        if quantized(self.noise as f32) < self.floor || self.noise <= 0.0 {
            return;
        }
        for (i, cell) in cells.iter_mut().enumerate() {
            *cell = quantized(self.noise_at(i));
        }
    }

    /// Draws a Gaussian around `center` (cells) into a map with rows of `width` cells. Each cell
    /// keeps its maximum; cells below the floor are skipped.
    fn draw(&self, cells: &mut [u8], width: usize, center: Vector2<f64>, height: f64) {
        let least = (f64::from(self.floor) / 255.0 - HALF_STEP - self.noise).max(HALF_STEP);
        if height <= least || width == 0 {
            return;
        }
        // height exp(-r^2 / 2 sigma^2) = least
        let reach = self.sigma * (2.0 * (height / least).ln()).sqrt();
        let (mut across, mut down) = ([0.0; MAX_SIDE], [0.0; MAX_SIDE]);
        let columns = self.profile(center.x, reach, width, &mut across);
        let rows = self.profile(center.y, reach, cells.len() / width, &mut down);
        for y in rows {
            let scale = height as f32 * down[y];
            for x in columns.clone() {
                let i = y * width + x;
                let value = scale * across[x] + self.noise_at(i);
                cells[i] = cells[i].max(quantized(value));
            }
        }
    }

    /// A Gaussian of height 1 along one axis: writes its values and returns the range of its cells.
    fn profile(
        &self,
        center: f64,
        reach: f64,
        size: usize,
        values: &mut [f32; MAX_SIDE],
    ) -> std::ops::Range<usize> {
        let first = (center - reach).ceil().clamp(0.0, size as f64) as usize;
        let end = ((center + reach).floor() + 1.0).clamp(0.0, size as f64) as usize;
        let fall = -0.5 / (self.sigma * self.sigma);
        for (i, value) in values.iter_mut().enumerate().take(end).skip(first) {
            *value = (fall * (i as f64 - center).powi(2)).exp() as f32;
        }
        first..end
    }
}

const _: () = assert!(N_KEYPOINTS <= farfield_proto::patch::MAX_KEYPOINTS);

#[cfg(test)]
mod tests {
    use farfield_proto::bounding_box::{BoundingBox, BoxRate};
    use farfield_proto::camera::CameraModel;
    use farfield_proto::id::CameraIndex;
    use farfield_proto::message::CameraBox;

    use super::super::crowd::Subject;
    use super::super::tests::{
        LEFT_KNEE, NOSE, all, assert_near, camera, faults, projected, standing,
    };
    use super::*;
    use crate::fault_profile::{FaultProfile, Leak};

    /// The crop of a box around a person, with cells of 6 pixels.
    struct TestCrop {
        region: CameraBox,
        grid: CellGrid,
        camera: CameraModel,
    }

    impl TestCrop {
        fn around(subject: &Subject) -> Self {
            let [torso_px, neck_px] = [&subject.torso_m, &subject.neck_m].map(projected);
            let f = |p: Vector2<f64>| [p.x as f32, p.y as f32];
            let bounding_box = BoundingBox {
                center_px: f(torso_px),
                size_px: [288.0, 384.0],
                rotation_rad: 0.0,
            };
            Self {
                region: CameraBox {
                    camera: CameraIndex(1),
                    bounding_box,
                    rate: BoxRate::default(),
                    torso_px: f(torso_px),
                    neck_px: f(neck_px),
                },
                grid: CellGrid {
                    origin_px: f(torso_px - Vector2::new(141.0, 189.0)),
                    step_px: [6.0, 0.0],
                    width: 48,
                    height: 64,
                },
                camera: camera(),
            }
        }

        fn painted(&self, observation: &MapObservation, floor: u8) -> Maps {
            let mut maps = Maps::new(48, 64, 17);
            let crop = MapCrop {
                region: &self.region,
                grid: &self.grid,
                sigma_cells: 2.0,
                camera: &self.camera,
                floor,
            };
            observation.paint(&crop, &mut maps);
            maps
        }
    }

    #[test]
    fn a_peak_is_a_gaussian_with_the_sigma_of_the_source() {
        let subject = standing(0.0, 0.0);
        let crop = TestCrop::around(&subject);
        let site_m = subject.sites_m[LEFT_KNEE];
        let observation = faults(&FaultProfile::none(), 1).observe(0, &all([subject]));
        let maps = crop.painted(&observation, 0);
        let px = projected(&site_m);
        let center = crop.grid.cell(Pixel::new(px.x, px.y));
        for (i, &cell) in maps.cells(LEFT_KNEE).iter().enumerate() {
            let at = Vector2::new((i % 48) as f64, (i / 48) as f64);
            let expected = 255.0 * (-(at - center).norm_squared() / 8.0).exp();
            assert_near("cell", f64::from(cell), expected, 0.51);
        }
    }

    #[test]
    fn a_crop_belongs_to_the_person_in_its_middle() {
        let subjects = [standing(0.0, 0.0), standing(0.0, 0.6)];
        let observation = faults(&FaultProfile::none(), 2).observe(0, &all(subjects.clone()));
        for (i, subject) in subjects.iter().enumerate() {
            let crop = TestCrop::around(subject);
            let maps = crop.painted(&observation, 15);
            for (k, evidence) in observation.people[i].keypoints.iter().enumerate() {
                let px = evidence.own.unwrap().at_px;
                let center = crop.grid.cell(Pixel::new(px.x, px.y));
                let cells = maps.cells(k).iter().enumerate();
                let far = cells.filter(|&(c, &value)| {
                    let at = Vector2::new((c % 48) as f64, (c / 48) as f64);
                    value > 0 && (at - center).norm() > 8.0
                });
                assert_eq!(far.count(), 0, "the other's keypoint {k} is painted");
                assert!(maps.cells(k).iter().any(|&c| c > 200));
            }
        }
    }

    #[test]
    fn a_crop_without_a_person_contains_only_noise() {
        let observation =
            faults(&FaultProfile::standard(), 1).observe(0, &all([standing(0.0, 0.0)]));
        let empty = TestCrop::around(&standing(0.0, 2.0));
        let maps = empty.painted(&observation, 0);
        let mut counts = [0u32; 6];
        for k in 0..17 {
            for &cell in maps.cells(k) {
                counts[usize::from(cell)] += 1;
            }
        }
        // A noise of 0.02 is 5.1 steps: value 0 takes half a step, value 5 the rest.
        let total = f64::from(counts.iter().sum::<u32>());
        for (value, expected) in [0.5, 1.0, 1.0, 1.0, 1.0, 0.6].into_iter().enumerate() {
            let share = f64::from(counts[value]) / total;
            assert_near("share of a value", share, expected / 5.1, 0.01);
        }
        let cut = empty.painted(&observation, 15);
        assert!((0..17).all(|k| cut.cells(k).iter().all(|&c| c == 0)));
    }

    #[test]
    fn skipping_cells_below_the_floor_changes_no_other_cell() {
        let behind = standing(0.0, 0.0);
        let crop = TestCrop::around(&behind);
        let subjects = all([behind, standing(-1.0, 0.05)]);
        let mut faults = faults(&FaultProfile::standard(), 2);
        for tick in 0..60 {
            let observation = faults.observe(tick, &subjects);
            let whole = crop.painted(&observation, 0);
            for floor in [1, 5, 6, 7, 15, 100] {
                let cut = crop.painted(&observation, floor);
                for k in 0..17 {
                    for (a, b) in whole.cells(k).iter().zip(cut.cells(k)) {
                        assert!(a == b || (*a < floor && *b < floor), "{a} {b} {floor}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_leak_outside_the_crop_is_not_painted() {
        // The ankles of the nearer person are below the crop of the farther one.
        let behind = standing(0.0, 0.0);
        let crop = TestCrop::around(&behind);
        let subjects = all([behind, standing(-3.5, 0.0)]);
        let profile = FaultProfile {
            leak: Some(Leak {
                probability: 1.0,
                ..Leak::default()
            }),
            ..FaultProfile::none()
        };
        let observation = faults(&profile, 2).observe(0, &subjects);
        let seen = &observation.people[0];
        let whole = crop.painted(&observation, 15);
        let mut outside = 0;
        for k in 0..17 {
            let Some(leaked) = seen.keypoints[k].leaked else {
                continue;
            };
            let px = leaked.at_px;
            let cell = crop.grid.cell(Pixel::new(px.x, px.y));
            let inside = (-0.5..47.5).contains(&cell.x) && (-0.5..63.5).contains(&cell.y);
            let highest = whole.cells(k).iter().max().unwrap();
            assert_eq!(*highest > 140, inside, "keypoint {k}");
            outside += usize::from(!inside);
        }
        assert!(outside > 0);
    }

    #[test]
    fn a_detector_finds_people_not_hidden_by_others() {
        let aside = standing(0.0, 2.0);
        let truth_px = projected(&aside.sites_m[NOSE]);
        let subjects = all([standing(0.0, 0.0), standing(-1.0, 0.02), aside]);
        let none = FaultProfile::none();
        let detections = faults(&none, 3).observe(0, &subjects).persons();
        assert_eq!(detections.len(), 2);
        assert!(detections.iter().all(|person| person.len() == 17));
        let camera = camera();
        let nose_px = camera
            .undistort(detections[1][NOSE].unwrap().position)
            .unwrap();
        assert!((nose_px.vector_px() - truth_px).norm() < 1e-6);
        // With faults, missing keypoints are not detected and hidden ones have a low score.
        let mut with_faults = faults(&FaultProfile::standard(), 3);
        let scores: Vec<Option<f32>> = (0..200)
            .flat_map(|tick| with_faults.observe(tick, &subjects).persons())
            .flatten()
            .map(|candidate| candidate.map(|c| c.score))
            .collect();
        assert!(scores.iter().any(Option::is_none));
        assert!(scores.iter().flatten().any(|s| *s < 0.8));
        assert!(scores.iter().flatten().all(|s| *s <= 1.0));
    }
}
