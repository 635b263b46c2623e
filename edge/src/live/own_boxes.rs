//! Boxes that an edge makes while fusion is silent: the last box of each person, moved by what its
//! maps show.
//!
//! Fusion predicts boxes from all viewpoints; an edge alone has only its own maps. They keep a
//! person in the crop for some seconds, so that the ring stores patches of the outage and not only
//! sightings. The box follows the median motion of its keypoints and grows with their spread. If
//! two boxes of a camera show one person, as when people pass each other, the person belongs to the
//! box that expected it there. The other box continues its motion.

use std::collections::BTreeMap;

use farfield_proto::id::{CameraIndex, PersonId};
use farfield_proto::message::{BoxSet, CameraBox, PatchSet, PersonBoxes, PersonPatch};
use farfield_proto::order_statistics::upper_median;
use farfield_proto::patch::{Decoder, Encoder, Maps};
use farfield_proto::tick::Tick;

use super::Micros;

/// Least height of a peak, of 255.
const MIN_PEAK: f32 = 77.0;
/// Keypoints that must be seen at two ticks for a box to follow them.
const MIN_KEYPOINTS: usize = 4;
/// Weight of a new measurement of a box's velocity.
const RATE_SHARE: f32 = 0.3;
/// Weight of a new measurement of a keypoint's place on the body. Limbs move, but the median of all
/// keypoints hardly.
const BODY_SHARE: f32 = 0.1;
/// Largest growth or shrinkage of a box per measurement.
const MAX_GROWTH: f32 = 1.03;
/// Two boxes show one person if the median distance of their keypoints is below this share of a
/// box's height.
const SAME_SHARE: f32 = 0.08;
/// Time for which a person is followed without being visible in the maps, seconds.
const UNSEEN_S: f64 = 0.5;
/// Silence of fusion after which people are observed, microseconds. Fusion sends at least ten times
/// a second.
const WATCH_FROM_US: Micros = 150_000;
/// Silence of fusion after which boxes come from observations instead of predictions, microseconds.
const LEAD_FROM_US: Micros = 300_000;
/// Time for which own boxes continue after fusion returns, microseconds. Fusion predicted people
/// from before the silence and needs a round trip and a detection pass. Until then the patches show
/// it the current positions.
const HAND_BACK_US: Micros = 400_000;

/// The source of the boxes at a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lead {
    /// Fusion's boxes alone.
    Fusion,
    /// Fusion's boxes; people are also observed.
    Watched,
    /// The edge's own boxes: fusion is silent.
    Own,
    /// The edge's own boxes, and fusion's for people that the edge does not follow: fusion has just
    /// returned.
    HandingBack,
}

/// One person in one camera.
#[derive(Debug, Clone)]
struct Followed {
    at: CameraBox,
    /// The tick of [`Self::at`], at which the person was last seen.
    tick: Tick,
    /// Positions of the keypoints relative to the middle of the box, divided by the box's height.
    body: Vec<Option<[f32; 2]>>,
}

/// Position of each keypoint in a picture, undistorted pixels, if visible.
type Keypoints = Vec<Option<[f32; 2]>>;

/// Content of a patch: a person in a camera.
#[derive(Debug, Clone, Copy)]
struct Seen<'a> {
    key: (PersonId, CameraIndex),
    keypoints_px: &'a Keypoints,
    /// Distance from the expected position and height of the box, pixels; `None` if the person is
    /// not followed.
    off_px: Option<(f32, f32)>,
}

/// The people of a viewpoint as followed by the edge itself.
#[derive(Debug, Default)]
pub struct OwnBoxes {
    /// End of the lead of own boxes.
    leads_until_us: Option<Micros>,
    followed: BTreeMap<(PersonId, CameraIndex), Followed>,
    decoder: Decoder,
    /// Finds the peaks of decoded maps with the same code as in encoding.
    fitter: Encoder,
    maps: Option<Maps>,
}

impl OwnBoxes {
    /// The source of the boxes at `now_us`, if fusion has been silent for `silent_us`; after
    /// `longest_us` own boxes end.
    pub fn lead(&mut self, silent_us: Micros, longest_us: Micros, now_us: Micros) -> Lead {
        if (LEAD_FROM_US..=longest_us).contains(&silent_us) {
            self.leads_until_us = Some(now_us + HAND_BACK_US);
            return Lead::Own;
        }
        if silent_us < LEAD_FROM_US && self.leads_until_us.is_some_and(|until| now_us < until) {
            return Lead::HandingBack;
        }
        self.leads_until_us = None;
        if silent_us >= WATCH_FROM_US {
            Lead::Watched
        } else {
            Lead::Fusion
        }
    }

    /// Removes all people, because fusion reports them again.
    pub fn clear(&mut self) {
        self.followed.clear();
    }

    /// Adds the content of the patches of `sets`, cut by `boxes`; ticks must rise.
    pub fn see(&mut self, boxes: &BoxSet, sets: &[PatchSet], rate_hz: f64) {
        for set in sets {
            let keypoints = set.persons.iter().map(|patch| self.keypoints(patch));
            let keypoints: Vec<Option<Keypoints>> = keypoints.collect();
            let seen = set.persons.iter().zip(&keypoints);
            let seen: Vec<Seen<'_>> = seen
                .filter_map(|(patch, keypoints_px)| {
                    Some(self.compared(patch, keypoints_px.as_ref()?, set.tick))
                })
                .collect();
            for own in &seen {
                if !seen.iter().any(|other| other.has_taken(own)) {
                    self.take(boxes, own, set.tick);
                }
            }
            let longest = (UNSEEN_S * rate_hz) as i64;
            self.followed
                .retain(|_, followed| set.tick - followed.tick <= longest);
        }
    }

    /// The boxes of `tick` in place of those of `before`; `None` if no person is followed.
    pub fn at(&self, tick: Tick, before: &BoxSet) -> Option<BoxSet> {
        let mut persons: Vec<PersonBoxes> = Vec::new();
        for ((person, _), followed) in &self.followed {
            let at = carried(&followed.at, tick - followed.tick);
            match persons.last_mut().filter(|last| last.person == *person) {
                Some(last) => last.cameras.push(at),
                None => persons.push(PersonBoxes {
                    person: *person,
                    cameras: vec![at],
                }),
            }
        }
        (!persons.is_empty()).then(|| BoxSet {
            tick,
            persons,
            detection_cameras: Vec::new(),
            ..before.clone()
        })
    }

    /// The same, with those of `boxes` for people that are not followed.
    pub fn merged_with(&self, tick: Tick, boxes: &BoxSet) -> Option<BoxSet> {
        let mut set = self.at(tick, boxes)?;
        let is_followed = |id| self.followed.keys().any(|(person, _)| *person == id);
        let others = boxes.persons.iter().filter(|it| !is_followed(it.person));
        let moved = |it: &PersonBoxes| PersonBoxes {
            person: it.person,
            cameras: it
                .cameras
                .iter()
                .map(|at| carried(at, tick - boxes.tick))
                .collect(),
        };
        set.persons.extend(others.map(moved));
        set.persons.sort_by_key(|it| it.person);
        Some(set)
    }

    /// Compares a patch with the expected position of its person.
    fn compared<'a>(
        &self,
        patch: &PersonPatch,
        keypoints_px: &'a Keypoints,
        tick: Tick,
    ) -> Seen<'a> {
        let key = (patch.person, patch.camera);
        let off_px = self.followed.get(&key).and_then(|followed| {
            let at = carried(&followed.at, tick - followed.tick);
            let height_px = at.bounding_box.size_px[1];
            let expected = followed.body.iter().map(|own| {
                own.map(|own| [0, 1].map(|i| at.bounding_box.center_px[i] + height_px * own[i]))
            });
            Some((distance_px(expected, keypoints_px)?, height_px))
        });
        Seen {
            key,
            keypoints_px,
            off_px,
        }
    }

    /// Adds the content of one patch.
    fn take(&mut self, boxes: &BoxSet, seen: &Seen<'_>, tick: Tick) {
        if let Some(followed) = self.followed.get_mut(&seen.key) {
            followed.see(seen.keypoints_px, tick);
            return;
        }
        let (person, camera) = seen.key;
        let person = boxes.persons.iter().find(|p| p.person == person);
        let own = person.and_then(|p| p.cameras.iter().find(|c| c.camera == camera));
        if let Some(at) = own {
            let at = carried(at, tick - boxes.tick);
            let followed = Followed {
                body: body(&at, seen.keypoints_px),
                at,
                tick,
            };
            self.followed.insert(seen.key, followed);
        }
    }

    /// The highest clear peak of each map; `None` if the maps cannot be read.
    fn keypoints(&mut self, patch: &PersonPatch) -> Option<Keypoints> {
        let maps = self.maps.get_or_insert_with(|| Maps::new(1, 1, 1));
        self.decoder.decode(&patch.maps, maps).ok()?;
        let place = |(keypoint, peak): (usize, Option<([f32; 2], f32)>)| {
            let ([x, y], _) = peak.filter(|(_, height)| *height >= MIN_PEAK)?;
            let crop = usize::from(*patch.crop_of_keypoint.get(keypoint)?);
            let px = patch.crops.get(crop)?.pixel(x.into(), y.into());
            Some([px.x() as f32, px.y() as f32])
        };
        let peaks = self.fitter.peaks(maps).into_iter();
        Some(peaks.enumerate().map(place).collect())
    }
}

impl Seen<'_> {
    /// Whether `other` shows the same person, which was expected nearer to this box.
    fn has_taken(&self, other: &Self) -> bool {
        let (Some((off_px, height_px)), Some((other_off_px, _))) = (self.off_px, other.off_px)
        else {
            return false;
        };
        self.key != other.key
            && self.key.1 == other.key.1
            && (off_px, self.key) < (other_off_px, other.key)
            && distance_px(self.keypoints_px.iter().copied(), other.keypoints_px)
                .is_some_and(|px| px < SAME_SHARE * height_px)
    }
}

/// Median distance of the common keypoints, pixels; `None` if there are few.
fn distance_px(a: impl Iterator<Item = Option<[f32; 2]>>, b: &Keypoints) -> Option<f32> {
    let pairs = a.zip(b).filter_map(|(a, b)| Some((a?, (*b)?)));
    let apart: Vec<f64> = pairs
        .map(|(a, b)| f64::from((a[0] - b[0]).hypot(a[1] - b[1])))
        .collect();
    if apart.len() < MIN_KEYPOINTS {
        return None;
    }
    upper_median(apart).map(|px| px as f32)
}

impl Followed {
    fn see(&mut self, keypoints_px: &[Option<[f32; 2]>], tick: Tick) {
        let pairs = self.body.iter().zip(keypoints_px);
        let common: Vec<([f32; 2], [f32; 2])> =
            pairs.filter_map(|(a, b)| Some(((*a)?, (*b)?))).collect();
        if common.len() < MIN_KEYPOINTS {
            return;
        }
        let ticks = tick - self.tick;
        let before = carried(&self.at, ticks);
        let height_px = before.bounding_box.size_px[1];
        let [known, now_px] = [
            spread(common.iter().map(|(a, _)| *a)),
            spread(common.iter().map(|(_, b)| *b)),
        ];
        let growth = now_px / (known * height_px).max(1.0);
        let growth = growth.clamp(1.0 / MAX_GROWTH, MAX_GROWTH);
        let scale_px = growth * height_px;
        // A keypoint that jumps to another person or side hardly changes the median.
        let place = |i: usize| median(common.iter().map(|(a, b)| b[i] - scale_px * a[i]));
        let mut at = before;
        for i in [0, 1] {
            let moved = place(i) - before.bounding_box.center_px[i];
            let rate = self.at.rate.center_px[i] + moved / ticks.max(1) as f32;
            at.rate.center_px[i] += RATE_SHARE * (rate - at.rate.center_px[i]);
            at.bounding_box.center_px[i] += moved;
            at.bounding_box.size_px[i] *= growth;
            at.torso_px[i] += moved;
            at.neck_px[i] += moved;
        }
        (at.rate.size_px, at.rate.rotation_rad) = ([0.0; 2], 0.0);
        if !at.bounding_box.is_valid() {
            return;
        }
        for (known, now) in self.body.iter_mut().zip(body(&at, keypoints_px)) {
            match (&mut *known, now) {
                (Some(known), Some(now)) => {
                    for i in [0, 1] {
                        known[i] += BODY_SHARE * (now[i] - known[i]);
                    }
                }
                (None, Some(_)) => *known = now,
                (_, None) => {}
            }
        }
        (self.at, self.tick) = (at, tick);
    }
}

/// Positions of keypoints relative to the middle of a box, divided by its height.
fn body(at: &CameraBox, keypoints_px: &[Option<[f32; 2]>]) -> Vec<Option<[f32; 2]>> {
    let (center_px, height_px) = (at.bounding_box.center_px, at.bounding_box.size_px[1]);
    let own = |px: &[f32; 2]| [0, 1].map(|i| (px[i] - center_px[i]) / height_px);
    keypoints_px.iter().map(|px| px.as_ref().map(own)).collect()
}

/// The box moved by `ticks`, without growth by its age.
fn carried(at: &CameraBox, ticks: i64) -> CameraBox {
    let (mut moved, n) = (*at, ticks as f32);
    for i in [0, 1] {
        let by = n * at.rate.center_px[i];
        moved.bounding_box.center_px[i] += by;
        moved.torso_px[i] += by;
        moved.neck_px[i] += by;
    }
    moved
}

fn median(values: impl Iterator<Item = f32>) -> f32 {
    upper_median(values.map(f64::from).collect()).unwrap_or(0.0) as f32
}

/// Median distance of the points from their median.
fn spread(points: impl Iterator<Item = [f32; 2]> + Clone) -> f32 {
    let middle = [0, 1].map(|i| median(points.clone().map(|p| p[i])));
    median(points.map(|p| (p[0] - middle[0]).hypot(p[1] - middle[1])))
}

#[cfg(test)]
mod tests {
    use farfield_proto::bounding_box::{BoundingBox, BoxRate};
    use farfield_proto::frames::Pixel;
    use farfield_proto::grid::CellGrid;
    use farfield_proto::id::{SessionId, ViewpointIndex};
    use farfield_proto::message::Order;
    use farfield_proto::patch::CompressionLevel;

    use super::*;

    const RATE_HZ: f64 = 60.0;
    /// Positions of the keypoints relative to the middle of the person, pixels.
    const BODY: [[f32; 2]; 6] = [
        [0.0, -80.0],
        [-20.0, -50.0],
        [20.0, -50.0],
        [-15.0, 10.0],
        [15.0, 10.0],
        [0.0, 70.0],
    ];

    fn camera_box(center_px: [f32; 2]) -> CameraBox {
        CameraBox {
            camera: CameraIndex(2),
            bounding_box: BoundingBox {
                center_px,
                size_px: [120.0, 220.0],
                rotation_rad: 0.0,
            },
            rate: BoxRate {
                center_px: [3.0, 0.0],
                ..BoxRate::default()
            },
            torso_px: center_px,
            neck_px: [center_px[0], center_px[1] - 60.0],
        }
    }

    fn boxes(tick: i64, cameras: Vec<CameraBox>) -> BoxSet {
        BoxSet {
            session: SessionId(1),
            tick: Tick(tick),
            viewpoint: ViewpointIndex(0),
            part: 0,
            parts: 1,
            order: Order::Track,
            live: None,
            detection_cameras: vec![CameraIndex(2)],
            persons: vec![PersonBoxes {
                person: PersonId(7),
                cameras,
            }],
        }
    }

    /// The network's result for a person at `place_px` of size `scale`, in a crop around `boxes`;
    /// nothing outside.
    fn patches(tick: i64, boxes: &BoxSet, place_px: [f32; 2], scale: f32) -> PatchSet {
        let own = &boxes.persons[0].cameras[0].bounding_box;
        let step_px = own.size_px[1] / 64.0;
        let grid = CellGrid {
            origin_px: [0, 1].map(|i| own.center_px[i] - [24.0, 32.0][i] * step_px),
            step_px: [step_px, 0.0],
            width: 48,
            height: 64,
        };
        let mut maps = Maps::new(48, 64, BODY.len());
        for (k, at) in BODY.iter().enumerate() {
            let px = [0, 1].map(|i| f64::from(place_px[i] + scale * at[i]));
            let cell = grid.cell(Pixel::new(px[0], px[1]));
            for (i, value) in maps.cells_mut(k).iter_mut().enumerate() {
                let (x, y) = ((i % 48) as f64, (i / 48) as f64);
                let squared = (x - cell[0]).powi(2) + (y - cell[1]).powi(2);
                *value = (230.0 * (-squared / 4.5).exp()) as u8;
            }
        }
        let level = CompressionLevel::LOSSLESS;
        let patch = PersonPatch {
            person: PersonId(7),
            camera: CameraIndex(2),
            box_tick: boxes.tick,
            capture_offset_us: 0,
            crops: vec![grid],
            crop_of_keypoint: vec![0; BODY.len()],
            maps: Encoder::new().encode(&maps, level),
        };
        PatchSet {
            session: SessionId(1),
            tick: Tick(tick),
            viewpoint: ViewpointIndex(0),
            part: 0,
            parts: 1,
            sighting_parts: 0,
            timing: None,
            persons: vec![patch],
        }
    }

    #[test]
    fn a_person_who_turns_back_is_followed_by_its_maps() {
        // Without turning, fusion's box would be 900 pixels off at the end.
        let place_px = |tick: i64| {
            let t = tick as f32 / 60.0;
            [500.0 + 90.0 * (2.0 * t).sin(), 400.0 - 12.0 * t]
        };
        let scale = |tick: i64| 1.0 + 0.05 * tick as f32 / 60.0;
        let first = boxes(0, vec![camera_box(place_px(0))]);
        let (mut own, mut used) = (OwnBoxes::default(), first.clone());
        for tick in 0..300 {
            let seen = patches(tick, &used, place_px(tick), scale(tick));
            own.see(&used, &[seen], RATE_HZ);
            used = own.at(Tick(tick + 1), &first).unwrap();
            assert_eq!(used.tick, Tick(tick + 1));
            let at = &used.persons[0].cameras[0].bounding_box;
            let want = place_px(tick + 1);
            let off = [0, 1].map(|i| at.center_px[i] - want[i]);
            assert!(off[0].hypot(off[1]) < 25.0, "{off:?} at {tick}");
        }
        let height = used.persons[0].cameras[0].bounding_box.size_px[1];
        assert!((height / 220.0 - 1.25).abs() < 0.12, "{height}");
        assert!(used.detection_cameras.is_empty());
    }

    #[test]
    fn own_boxes_lead_slightly_longer_than_fusion_is_silent() {
        let mut own = OwnBoxes::default();
        let mut lead = |silent_ms: Micros, now_ms: Micros| {
            own.lead(1_000 * silent_ms, 5_000_000, 1_000 * now_ms)
        };
        assert_eq!(lead(20, 0), Lead::Fusion);
        assert_eq!(lead(200, 200), Lead::Watched);
        assert_eq!(lead(700, 700), Lead::Own);
        assert_eq!(lead(10, 710), Lead::HandingBack);
        assert_eq!(lead(10, 1_090), Lead::HandingBack);
        assert_eq!(lead(10, 1_100), Lead::Fusion);
        assert_eq!(lead(5_001, 6_101), Lead::Watched);
    }

    #[test]
    fn a_person_not_followed_keeps_the_box_of_fusion() {
        let first = boxes(0, vec![camera_box([500.0, 400.0])]);
        let mut own = OwnBoxes::default();
        own.see(&first, &[patches(0, &first, [500.0, 400.0], 1.0)], RATE_HZ);
        let mut next = boxes(10, vec![camera_box([900.0, 400.0])]);
        next.session = SessionId(2);
        let mut other = next.persons[0].clone();
        other.person = PersonId(3);
        next.persons.push(other);
        let both = own.merged_with(Tick(12), &next).unwrap();
        assert_eq!(both.session, SessionId(2));
        let at = |i: usize| both.persons[i].cameras[0].bounding_box.center_px[0];
        assert_eq!([both.persons[0].person.0, both.persons[1].person.0], [3, 7]);
        assert!((at(0) - 906.0).abs() < 1e-3, "{}", at(0));
        assert!((at(1) - 536.0).abs() < 1e-3, "{}", at(1));
    }

    #[test]
    fn a_person_who_passes_behind_another_is_found_again() {
        // One person stands, another runs past behind, and both boxes show the one in front.
        let standing = [500.0, 400.0];
        let running = |tick: i64| [380.0 + 6.0 * tick as f32, 402.0];
        let mut first = boxes(0, vec![camera_box(standing)]);
        first.persons[0].cameras[0].rate = BoxRate::default();
        let mut behind = first.persons[0].clone();
        behind.person = PersonId(8);
        behind.cameras[0] = camera_box(running(0));
        behind.cameras[0].rate.center_px = [6.0, 0.0];
        first.persons.push(behind);
        let (mut own, mut used) = (OwnBoxes::default(), first.clone());
        for tick in 0..40 {
            let place = running(tick);
            let is_hidden = (place[0] - standing[0]).abs() < 45.0;
            let mut seen = patches(tick, &used, standing, 1.0);
            let other = BoxSet {
                persons: vec![used.persons[1].clone()],
                ..used.clone()
            };
            let shown = if is_hidden { standing } else { place };
            let mut behind = patches(tick, &other, shown, 1.0);
            behind.persons[0].person = PersonId(8);
            seen.persons.append(&mut behind.persons);
            own.see(&used, &[seen], RATE_HZ);
            used = own.at(Tick(tick + 1), &first).unwrap();
        }
        let at = |i: usize| used.persons[i].cameras[0].bounding_box.center_px[0];
        assert!((at(0) - standing[0]).abs() < 5.0, "{}", at(0));
        assert!((at(1) - running(40)[0]).abs() < 10.0, "{}", at(1));
    }

    #[test]
    fn an_unseen_person_is_dropped_after_half_a_second() {
        let first = boxes(0, vec![camera_box([500.0, 400.0])]);
        let mut own = OwnBoxes::default();
        assert_eq!(own.at(Tick(1), &first), None);
        own.see(&first, &[patches(0, &first, [500.0, 400.0], 1.0)], RATE_HZ);
        let elsewhere = |tick| patches(tick, &first, [9_000.0, 400.0], 1.0);
        own.see(&first, &[elsewhere(30)], RATE_HZ);
        assert!(own.at(Tick(31), &first).is_some());
        own.see(&first, &[elsewhere(31)], RATE_HZ);
        assert_eq!(own.at(Tick(32), &first), None);
        own.see(&first, &[patches(40, &first, [500.0, 400.0], 1.0)], RATE_HZ);
        own.clear();
        assert_eq!(own.at(Tick(41), &first), None);
    }
}
