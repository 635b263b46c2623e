//! One scene through the whole system, in lock-step in this process, with the data for studies; parameters, shared sources and
//! traffic of such runs.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use farfield_edge::pipeline::{EdgeOutput, StandIn};
use farfield_edge::source::{Frame, FrameSource, SourceError};
use farfield_fusion::body::skeleton::Joints;
use farfield_fusion::estimate::estimator::Estimator;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::identity_event::IdentityEvent;
use farfield_proto::tick::Tick;
use farfield_proto::toml_file::{FileError, TomlFile};
use farfield_proto::venue::Parameters;
use farfield_proto::wire;
use farfield_score::lines::{PoseLines, TruthExtent};
use farfield_score::points::PointSet;
use farfield_score::{Scores, errors_over_time, matches_at, score};
use farfield_sim::scene::Scene;
use farfield_sim::simulated::in_memory::{Input, sources_of, venue_of};
use nalgebra::{Matrix3x4, Vector3};

use super::baseline::PersonView;
use super::people::id_changes::IdChange;
use super::people::presence::{self, ScenePresence};
use super::people::{People, add_poses};
use crate::conditions::{Cuts, FarLinks};
use crate::in_process::InProcess;
use crate::view_peaks::PeakReader;

/// How a scene is run.
#[derive(Clone, Default)]
pub struct SceneRunPlan {
    /// The method's parameters.
    pub parameters: Parameters,
    /// Whether to keep the peaks of every patch, for the baseline.
    pub keep_peaks: bool,
    /// Whether to keep the stages of every track, for the error budget.
    pub keep_stages: bool,
    /// Whether to smooth poses in two passes, instead of with the delay of the parameters.
    pub two_passes: bool,
    /// Periods in which no message of the edges reaches fusion.
    pub cuts: Option<Cuts>,
    /// Delay and loss of the links.
    pub links: FarLinks,
    /// Makes a codec for every edge that replaces ours.
    pub stand_in: Option<Arc<dyn Fn() -> Box<dyn StandIn>>>,
}

impl SceneRunPlan {
    /// Runs with `parameters`, and keeps only poses.
    pub fn with(parameters: Parameters) -> Self {
        Self {
            parameters,
            ..Self::default()
        }
    }
}

/// One person of fusion between the stages of a tick, world metres.
#[derive(Debug, Clone)]
pub struct Stages {
    /// Predicted keypoints.
    pub predicted_m: Vec<Vector3<f64>>,
    /// Lattice results, and whether any view supports them.
    pub lattice_m: Vec<(Vector3<f64>, bool)>,
    /// After the first inverse kinematics.
    pub ik1_m: Joints,
    /// After the filter.
    pub filtered_m: Joints,
    /// After the second inverse kinematics: the published pose.
    pub ik2_m: Joints,
    /// The filter's velocity, m/s.
    pub velocity_m_s: Joints,
}

impl Stages {
    fn read(track: &Estimator) -> Self {
        let lattice = track.estimates().iter();
        Self {
            predicted_m: track.predicted_m().to_vec(),
            lattice_m: lattice.map(|e| (e.position_m, e.weight > 0.0)).collect(),
            ik1_m: *track.measured_m(),
            filtered_m: *track.smoothed_m(),
            ik2_m: *track.joints_m(),
            velocity_m_s: *track.motion().velocity_m_s(),
        }
    }
}

/// Results of a scene.
pub struct SceneRun {
    /// The scene.
    pub scene: Arc<Scene>,
    /// The true people who count in scores, by number.
    pub truth: PoseLines,
    /// The first tick of each in the truth.
    pub since: BTreeMap<u32, Tick>,
    /// Live poses at each tick; here and in the files without poses of people who do not count.
    pub causal: PoseLines,
    /// Final poses of the files: the same, with the tentative ticks of people who were confirmed later.
    pub finished: PoseLines,
    /// Smoothed poses, if there is a delay.
    pub smoothed: PoseLines,
    /// The keypoints of the maps.
    pub keypoints: KeypointSet,
    /// Per camera of the venue, world metres to homogeneous undistorted pixels.
    pub pixel_from_world: Vec<Matrix3x4<f64>>,
    presence: ScenePresence,
    /// Identity events, in order.
    pub events: Vec<(Tick, IdentityEvent)>,
    /// Traffic of the edges.
    pub traffic: Traffic,
    /// Peaks by tick, id on the wire and camera; empty unless the plan keeps them.
    peaks: BTreeMap<Tick, BTreeMap<u32, Vec<PersonView>>>,
    /// Final id by id on the wire. A person who returns has one wire id for each stay.
    id_of_wire: BTreeMap<u32, u32>,
    /// Per tick and id of fusion; empty unless the plan keeps it.
    stages: BTreeMap<Tick, BTreeMap<u32, Stages>>,
}

struct Running {
    nodes: InProcess,
    plan: SceneRunPlan,
    reader: PeakReader,
    causal: People,
    finished: People,
    smoothed: People,
    traffic: Traffic,
    events: Vec<(Tick, IdentityEvent)>,
    peaks: BTreeMap<Tick, BTreeMap<u32, Vec<PersonView>>>,
    id_of_wire: BTreeMap<u32, u32>,
    stages: BTreeMap<Tick, BTreeMap<u32, Stages>>,
}

impl Running {
    fn new(nodes: InProcess, plan: SceneRunPlan) -> Self {
        Self {
            nodes,
            plan,
            reader: PeakReader::default(),
            causal: People::new(),
            finished: People::new(),
            smoothed: People::new(),
            traffic: Traffic::default(),
            events: Vec::new(),
            peaks: BTreeMap::new(),
            id_of_wire: BTreeMap::new(),
            stages: BTreeMap::new(),
        }
    }

    /// Computes the next tick; whether there was one.
    fn step(&mut self) -> anyhow::Result<bool> {
        let Some(trace) = self.nodes.step()? else {
            return Ok(false);
        };
        let keypoints = self.nodes.keypoints();
        add_poses(&mut self.causal, &trace.poses, keypoints);
        for poses in &trace.finished {
            add_poses(&mut self.finished, poses, keypoints);
        }
        self.traffic.add(&trace.edges);
        let events = trace.events.iter();
        self.events.extend(events.map(|event| (trace.tick, *event)));
        for poses in &trace.smoothed {
            add_poses(&mut self.smoothed, poses, keypoints);
        }
        if self.plan.keep_peaks {
            let views = views_of(&trace.edges, &mut self.reader);
            self.peaks.insert(trace.tick, views);
            let tracks = self.nodes.tracks().iter();
            self.id_of_wire
                .extend(tracks.map(|track| (track.wire_id().0, track.id().0)));
        }
        if self.plan.keep_stages {
            let tracks = self.nodes.tracks().iter();
            let tracks = tracks.filter(|track| !track.is_tentative());
            let of_tick = tracks.map(|track| (track.id().0, Stages::read(track.estimator())));
            self.stages.insert(trace.tick, of_tick.collect());
        }
        Ok(true)
    }

    fn finish(mut self, scene: &Arc<Scene>) -> SceneRun {
        let keypoints = self.nodes.keypoints().clone();
        for poses in self.nodes.finish() {
            add_poses(&mut self.finished, &poses, &keypoints);
        }
        for poses in self.nodes.finish_smoothed() {
            add_poses(&mut self.smoothed, &poses, &keypoints);
        }
        let cameras = self.nodes.venue().cameras.iter();
        let presence = ScenePresence::new(scene);
        let scorable = |people| {
            let poses = PoseLines::from_people(PointSet::Joints, people);
            presence.scorable(&poses)
        };
        SceneRun {
            scene: Arc::clone(scene),
            truth: presence.truth.clone(),
            since: presence.since.clone(),
            causal: scorable(self.causal),
            finished: scorable(self.finished),
            smoothed: scorable(self.smoothed),
            keypoints,
            pixel_from_world: cameras.map(|c| c.model.projection_matrix()).collect(),
            presence,
            traffic: self.traffic,
            events: self.events,
            peaks: self.peaks,
            id_of_wire: self.id_of_wire,
            stages: self.stages,
        }
    }
}

impl SceneRun {
    /// Runs `scene` once.
    ///
    /// # Errors
    /// The network cannot be loaded or fails, or no thread is left to render with.
    pub fn make(scene: &Arc<Scene>, input: &Input, plan: SceneRunPlan) -> anyhow::Result<Self> {
        let [run] = Self::make_all(scene, input, [plan])?;
        Ok(run)
    }

    /// Runs `scene` once per plan, over the same frames, which are made once.
    ///
    /// # Errors
    /// See [`Self::make`].
    pub fn make_all<const N: usize>(
        scene: &Arc<Scene>,
        input: &Input,
        plans: [SceneRunPlan; N],
    ) -> anyhow::Result<[Self; N]> {
        let mut sources: [Vec<Box<dyn FrameSource>>; N] = std::array::from_fn(|_| Vec::new());
        for source in sources_of(scene, input)? {
            for (branches, branch) in sources.iter_mut().zip(tee(source, N)) {
                branches.push(branch);
            }
        }
        let mut runs = Vec::with_capacity(N);
        for (plan, sources) in plans.into_iter().zip(sources) {
            let venue = venue_of(scene, input, plan.parameters.clone());
            let mut nodes = InProcess::new(venue, sources, scene.ticks())?.with_cuts(plan.cuts);
            if plan.links != FarLinks::default() {
                nodes = nodes.with_links(plan.links);
            }
            if plan.two_passes {
                nodes = nodes.in_two_passes();
            }
            if let Some(stand_in) = &plan.stand_in {
                nodes.set_stand_in(&**stand_in);
            }
            runs.push(Running::new(nodes, plan));
        }
        let mut goes_on = true;
        while goes_on {
            for run in &mut runs {
                goes_on = run.step()?;
            }
        }
        let runs: Vec<Self> = runs.into_iter().map(|run| run.finish(scene)).collect();
        runs.try_into()
            .map_err(|_| anyhow::anyhow!("as many runs as plans"))
    }

    /// Per actor, the first tick at which a live observer receives it. Actors that are never tracked are missing.
    pub fn first_ticks(&self) -> BTreeMap<u32, Tick> {
        let mut first_ticks = BTreeMap::new();
        for tick in self.truth.ticks() {
            for actor in matches_at(tick, &self.causal, &self.truth).into_keys() {
                first_ticks.entry(actor).or_insert(tick);
            }
        }
        first_ticks
    }

    /// The truth from each actor's first tick on, since before it a live observer has no pose. All of an actor that is not in
    /// `first_ticks`.
    pub fn truth_since(&self, first_ticks: &BTreeMap<u32, Tick>) -> PoseLines {
        let mut people = People::new();
        for tick in self.truth.ticks() {
            let there = self.truth.people_at(tick).into_iter().flatten();
            let counts = there
                .filter(|(actor, _)| first_ticks.get(actor).is_none_or(|first| *first <= tick));
            let counts: BTreeMap<_, _> = counts.map(|(id, body)| (*id, body.clone())).collect();
            if !counts.is_empty() {
                people.insert(tick, counts);
            }
        }
        PoseLines::from_people(PointSet::Joints, people)
    }

    /// Scores `poses` against all of the truth: the ticks until a person is found are gaps.
    pub fn score(&self, poses: &PoseLines) -> Scores {
        let rate_hz = Some(self.scene.rate_hz());
        let poses = self.presence.scorable(poses);
        score(&poses, &self.truth, TruthExtent::Whole, rate_hz)
    }

    /// Scores `poses` against the truth since the first tick of each actor: for outputs of one run that begin at different
    /// ticks.
    pub fn score_since(&self, poses: &PoseLines, first_ticks: &BTreeMap<u32, Tick>) -> Scores {
        let rate_hz = Some(self.scene.rate_hz());
        let (poses, truth) = (self.presence.scorable(poses), self.truth_since(first_ticks));
        score(&poses, &truth, TruthExtent::Whole, rate_hz)
    }

    /// Changes of ids in `poses`.
    pub fn id_changes(&self, poses: &PoseLines) -> Vec<IdChange> {
        let poses = self.presence.scorable(poses);
        IdChange::all(&poses, &self.truth, self.scene.rate_hz())
    }

    /// Unexcused gaps of live poses since the first pose of each actor; `live` are the scores of the same. Another figure measures
    /// the time until the first pose.
    pub fn unexcused_gaps(&self, live: &Scores) -> BTreeSet<(Tick, u32)> {
        let poses = self.presence.scorable(&self.causal);
        let truth = self.truth_since(&self.first_ticks());
        presence::unexcused(&self.scene, &poses, &truth, &live.lives.return_gaps)
    }

    /// Mean and largest error of `poses`, metres, at the ticks that `counts`, since the first tick of each actor; `None` if no
    /// actor has a pose.
    pub fn errors_at(
        &self,
        poses: &PoseLines,
        first_ticks: &BTreeMap<u32, Tick>,
        counts: impl Fn(Tick) -> bool,
    ) -> Option<(f64, f64)> {
        let errors = errors_over_time(
            &self.presence.scorable(poses),
            &self.truth_since(first_ticks),
        );
        let of_ticks = errors.values().flatten().filter(|(tick, _)| counts(*tick));
        let errors_m: Vec<f64> = of_ticks.filter_map(|(_, error_m)| *error_m).collect();
        let most_m = errors_m.iter().copied().reduce(f64::max)?;
        Some((errors_m.iter().sum::<f64>() / errors_m.len() as f64, most_m))
    }

    /// The peaks of `actor` (a number of the truth) in the cameras at each tick: from the crops of fusion's person that matched
    /// that actor.
    pub fn views_of(&self, actor: u32) -> BTreeMap<Tick, Vec<PersonView>> {
        let at = |(&tick, people): (&Tick, &BTreeMap<u32, Vec<PersonView>>)| {
            let id = *matches_at(tick, &self.finished, &self.truth).get(&actor)?;
            let views = people
                .iter()
                .find(|(wire, _)| self.id_of_wire.get(*wire) == Some(&id));
            Some((tick, views?.1.clone()))
        };
        self.peaks.iter().filter_map(at).collect()
    }

    /// Each true person (by index in the scene) with the stages of its track, by tick.
    pub fn matched_stages(&self) -> impl Iterator<Item = (Tick, usize, &Stages)> {
        self.stages.iter().flat_map(|(&tick, people)| {
            let matches = matches_at(tick, &self.causal, &self.truth);
            let numbers = self.scene.people().iter().enumerate();
            numbers.filter_map(move |(i, who)| {
                let stages = people.get(matches.get(&who.number)?)?;
                Some((tick, i, stages))
            })
        })
    }
}

fn patches(edges: &[EdgeOutput]) -> impl Iterator<Item = &farfield_proto::message::PersonPatch> {
    let sets = edges.iter().flat_map(|edge| &edge.patch_sets);
    sets.flat_map(|set| &set.persons)
}

fn views_of(edges: &[EdgeOutput], reader: &mut PeakReader) -> BTreeMap<u32, Vec<PersonView>> {
    let mut views: BTreeMap<u32, Vec<PersonView>> = BTreeMap::new();
    for patch in patches(edges) {
        views.entry(patch.person.0).or_default().push(PersonView {
            camera: usize::from(patch.camera.0),
            peaks: reader.read(patch),
        });
    }
    views
}

/// The default parameters changed by TOML `text` such as `tuning.smoothing.cutoff_hz = 6`: the parameters' tables of a venue
/// file, and its `[tuning]`. Ranges are not checked, so that a study may leave them.
///
/// # Errors
/// [`FileError`] if the text is no TOML, or has an unknown table or field.
pub fn parameters(text: &str) -> Result<Parameters, FileError> {
    Parameters::read(&TomlFile::parse(text, Path::new("the overrides"))?)
}

/// The source, and the frames that each run has not taken yet.
struct SharedSource {
    source: Box<dyn FrameSource>,
    waiting: Vec<VecDeque<Option<Frame>>>,
}

/// One run's view of a shared source.
struct Branch {
    shared: Arc<Mutex<SharedSource>>,
    index: usize,
}

/// `n` sources that each give all frames of `source`. Frames that one has taken and another has not are kept in memory, as
/// runs advance together. An error goes to the first caller only, and no frame follows it.
pub fn tee(source: Box<dyn FrameSource>, n: usize) -> Vec<Box<dyn FrameSource>> {
    let waiting = (0..n).map(|_| VecDeque::new()).collect();
    let shared = Arc::new(Mutex::new(SharedSource { source, waiting }));
    (0..n)
        .map(|index| {
            let shared = Arc::clone(&shared);
            Box::new(Branch { shared, index }) as Box<dyn FrameSource>
        })
        .collect()
}

impl FrameSource for Branch {
    fn next_frame(&mut self) -> Result<Option<Frame>, SourceError> {
        let mut shared = self.shared.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(frame) = shared.waiting[self.index].pop_front() {
            return Ok(frame);
        }
        let frame = shared.source.next_frame()?;
        for (index, waiting) in shared.waiting.iter_mut().enumerate() {
            if index != self.index {
                waiting.push_back(frame.clone());
            }
        }
        Ok(frame)
    }
}

/// Traffic of the edges in a run.
#[derive(Debug, Clone, Copy, Default)]
pub struct Traffic {
    /// Persons, views and ticks.
    pub patches: u64,
    /// Bytes of their maps.
    pub map_bytes: u64,
    /// Bytes of all patch messages.
    pub message_bytes: u64,
    /// Number of messages.
    pub messages: u64,
}

impl Traffic {
    /// Adds the traffic of a tick.
    pub fn add(&mut self, edges: &[EdgeOutput]) {
        for set in edges.iter().flat_map(|edge| &edge.patch_sets) {
            let maps = set.persons.iter().map(|person| person.maps.bytes.len());
            self.patches += set.persons.len() as u64;
            self.map_bytes += maps.sum::<usize>() as u64;
            self.message_bytes += wire::encode(set).len() as u64;
            self.messages += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use farfield_edge::source::{FrameContent, KeypointFrame};
    use farfield_proto::tick::Tick;

    use super::*;

    #[test]
    fn unnamed_parameters_keep_their_defaults() {
        let changed =
            parameters("tuning.smoothing.cutoff_hz = 4.5\nrange_of_motion.enabled = false")
                .unwrap();
        let default = Parameters::default();
        assert!((changed.smoothing.cutoff_hz - 4.5).abs() < 1e-12);
        assert!(!changed.range_of_motion.enabled);
        let mut restored = changed.smoothing.clone();
        restored.cutoff_hz = default.smoothing.cutoff_hz;
        assert_eq!(restored, default.smoothing);
        assert_eq!(changed.ik, default.ik);
    }

    #[test]
    fn unknown_names_are_refused() {
        for wrong in [
            "smooth.delay_ms = 4.5",
            "smoothing.dellay_ms = 4",
            "tuning.smooth.cutoff_hz = 4.5",
            "tuning.smoothing.cutof_hz = 4",
            "smoothing.cutoff_hz = 4",
            "name = \"hall\"",
            "x",
        ] {
            assert!(parameters(wrong).is_err(), "{wrong}");
        }
    }

    struct Counting(i64);

    impl FrameSource for Counting {
        fn next_frame(&mut self) -> Result<Option<Frame>, SourceError> {
            self.0 += 1;
            Ok((self.0 <= 3).then(|| Frame {
                tick: Tick(self.0),
                capture_offset_us: 0,
                content: FrameContent::Keypoints(KeypointFrame::default()),
            }))
        }
    }

    #[test]
    fn every_branch_gets_every_frame_in_order() {
        let mut branches = tee(Box::new(Counting(0)), 2);
        let mut next = |branch: usize| {
            let frame = branches[branch].next_frame().unwrap();
            frame.map(|frame| frame.tick.0)
        };
        assert_eq!([next(0), next(0)], [Some(1), Some(2)]);
        assert_eq!([next(1), next(1), next(1)], [Some(1), Some(2), Some(3)]);
        assert_eq!([next(0), next(0), next(1)], [Some(3), None, None]);
    }
}
