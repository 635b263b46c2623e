//! Replays a recording, tick by tick, in lock-step with the file.

use std::io::{Read, Seek};

use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::decision::{Decision, UsedSet};
use farfield_proto::message::{BoxSet, PoseSet};
use farfield_proto::tick::Tick;

use super::reader::{AnySet, Recording, RecordingError, SessionPart};
use super::renumber::Renumber;
use crate::align::{Gather, TickGroup};
use crate::camera_agreement::AgreementSamples;
use crate::pipeline::{Pipeline, Stage, StepOutput};

/// Most empty ticks of a replay per recorded set, in addition to [`MAX_EMPTY`]: a longer range is
/// not one run.
const MAX_EMPTY_PER_SET: u64 = 64;
/// See [`MAX_EMPTY_PER_SET`]; a decision farther from its neighbours does not belong to the run.
const MAX_EMPTY: u64 = 36_000;

/// Which of the recorded sets a replay uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choice {
    /// Those that fusion used.
    Decided,
    /// All, also late ones and those delivered after an outage.
    All,
}

/// Owners of patches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PatchOwners {
    /// The recorded person: the replay has the same ids as the recorded run, because it has the
    /// same input.
    AsRecorded,
    /// The person whose predicted boxes fit: tracks may be initiated at other ticks.
    ByPlace,
}

/// Counts of a replay so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ReplayTally {
    /// Computed ticks.
    pub ticks: u64,
    /// Ticks whose poses equal the published ones, bit for bit.
    pub same: u64,
    /// Ticks whose poses differ from the published ones.
    pub different: u64,
    /// Used sets.
    pub sets: u64,
    /// Ticks without a recorded decision: all of their sets were used.
    pub undecided: u64,
    /// Sets that fusion used, and that are not in the file.
    pub missing: u64,
    /// Sets that contradict another of their tick.
    pub refused: u64,
    /// Patches of persons that the replay does not have (see [`PatchOwners::ByPlace`]).
    pub nobodys: u64,
    /// Decisions far from those of the run, which were skipped.
    pub far: u64,
}

/// Input of fusion at a tick.
pub struct RecordedTick {
    /// The used sets.
    pub group: TickGroup,
    /// How many ticks ahead the boxes of each viewpoint were made, if recorded.
    horizons_ticks: Vec<f64>,
}

/// Why a recording cannot be replayed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The file cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The ticks are not those of one run.
    #[error("its ticks are too far apart for {sets} sets: {from} to {to}")]
    Span {
        /// First tick.
        from: Tick,
        /// Last tick.
        to: Tick,
        /// Sets in the file.
        sets: usize,
    },
}

/// A session of a recording in replay.
pub struct Replay<R> {
    recording: Recording<R>,
    part: SessionPart,
    pipeline: Pipeline,
    n_viewpoints: usize,
    choice: Choice,
    renumber: Option<Renumber>,
    boxes: Vec<BoxSet>,
    /// The remaining ticks, the last first.
    to_do: Vec<Tick>,
    tally: ReplayTally,
}

impl<R: Read + Seek> Replay<R> {
    /// Begins `part` of `recording`. `pipeline` must be new, and of the part's session. Without
    /// recorded decisions, every set is used.
    ///
    /// # Errors
    /// [`ReplayError::Span`].
    pub fn new(
        recording: Recording<R>,
        mut part: SessionPart,
        pipeline: Pipeline,
        choice: Choice,
        names: PatchOwners,
    ) -> Result<Self, ReplayError> {
        let choice = if part.decisions.is_empty() {
            Choice::All
        } else {
            choice
        };
        let far = remove_far_decisions(&mut part);
        let mut replay = Self {
            recording,
            part,
            n_viewpoints: 0,
            boxes: Vec::new(),
            pipeline,
            choice,
            renumber: (names == PatchOwners::ByPlace).then(Renumber::default),
            to_do: Vec::new(),
            tally: ReplayTally {
                far,
                ..ReplayTally::default()
            },
        };
        replay.begin()?;
        Ok(replay)
    }

    /// Restarts before the first tick. `pipeline` must be new, and of the part's session.
    ///
    /// # Errors
    /// [`ReplayError::Span`].
    pub fn rewind(&mut self, pipeline: Pipeline) -> Result<(), ReplayError> {
        self.pipeline = pipeline;
        self.tally = ReplayTally {
            far: self.tally.far,
            ..ReplayTally::default()
        };
        if let Some(renumber) = &mut self.renumber {
            *renumber = Renumber::default();
        }
        self.begin()
    }

    fn begin(&mut self) -> Result<(), ReplayError> {
        self.to_do = ticks(&self.part)?;
        // With owners by place, a replay may begin in the middle of a run.
        let decision = self.part.decisions.first();
        let first = decision.map(|decision| match self.renumber {
            None => decision.first,
            Some(_) => decision.tick,
        });
        let first = first.or(self.to_do.first().copied());
        self.boxes = first.map_or_else(Vec::new, |first| {
            self.pipeline.expect(&self.part.expected, first);
            self.pipeline.first_boxes(first)
        });
        self.n_viewpoints = self.boxes.len();
        self.to_do.reverse();
        Ok(())
    }

    /// Computes the next tick; `None` at the end.
    ///
    /// # Errors
    /// If the file cannot be read any more.
    pub fn step(&mut self) -> Result<Option<StepOutput>, RecordingError> {
        let Some(recorded) = self.read()? else {
            return Ok(None);
        };
        self.solve(&recorded, &mut |_| {}).map(Some)
    }

    /// Reads the input of the next tick; `None` at the end.
    ///
    /// # Errors
    /// If the file cannot be read any more.
    pub fn read(&mut self) -> Result<Option<RecordedTick>, RecordingError> {
        let Some(tick) = self.to_do.pop() else {
            return Ok(None);
        };
        let decision = self.decision(tick);
        let is_undecided = decision.is_none() && self.choice == Choice::Decided;
        self.tally.undecided += u64::from(is_undecided);
        let mut group = self.group(tick, decision.as_ref())?;
        if let Some(renumber) = &mut self.renumber {
            self.tally.nobodys += renumber.apply(&mut group, &self.boxes);
        }
        let decision = decision.filter(|_| self.renumber.is_none());
        Ok(Some(RecordedTick {
            group,
            horizons_ticks: decision.map_or_else(Vec::new, |decision| decision.horizons_ticks),
        }))
    }

    /// Computes the last read tick. Calls `mark` after each stage.
    ///
    /// # Errors
    /// If the file cannot be read any more.
    pub fn solve(
        &mut self,
        recorded: &RecordedTick,
        mark: &mut dyn FnMut(Stage),
    ) -> Result<StepOutput, RecordingError> {
        let RecordedTick {
            group,
            horizons_ticks,
        } = recorded;
        if !horizons_ticks.is_empty() {
            // They determine for which ticks each edge was asked for a detection pass.
            self.pipeline.set_horizons(horizons_ticks);
        }
        let output = self.pipeline.step(group, mark);
        self.boxes.clone_from(&output.boxes);
        self.tally.ticks += 1;
        if let Some(published) = self.recording.poses(self.part.session, group.tick)? {
            let count = if published == output.poses {
                &mut self.tally.same
            } else {
                &mut self.tally.different
            };
            *count += 1;
        }
        Ok(output)
    }

    /// The keypoints of the poses.
    pub fn keypoints(&self) -> &KeypointSet {
        self.pipeline.keypoints()
    }

    /// Samples for camera agreement, as far as they are stored.
    pub fn agreement(&self) -> AgreementSamples {
        self.pipeline.agreement()
    }

    /// The ticks still held after the last one.
    pub fn finish(&mut self) -> Vec<PoseSet> {
        self.pipeline.finish()
    }

    /// The smoothed poses still held after the last tick, if the pipeline smooths.
    pub fn finish_smoothed(&mut self) -> Vec<PoseSet> {
        self.pipeline.finish_smoothed()
    }

    /// The counts so far.
    pub fn tally(&self) -> ReplayTally {
        self.tally
    }

    /// Which sets are used.
    pub fn choice(&self) -> Choice {
        self.choice
    }

    /// The first and the last remaining tick.
    pub fn span(&self) -> Option<[Tick; 2]> {
        Some([*self.to_do.last()?, *self.to_do.first()?])
    }

    /// Number of remaining ticks.
    pub fn left(&self) -> usize {
        self.to_do.len()
    }

    /// The sets of a tick, under the same rules as messages from the network.
    fn group(
        &mut self,
        tick: Tick,
        decision: Option<&Decision>,
    ) -> Result<TickGroup, RecordingError> {
        let session = self.part.session;
        let used = |sets: &[UsedSet], viewpoint, part| {
            sets.binary_search(&UsedSet { viewpoint, part }).is_ok()
        };
        let wanted = |set: &AnySet| match (decision, set) {
            (None, _) => true,
            (Some(d), AnySet::Patches(set)) => used(&d.patches, set.viewpoint, set.part),
            (Some(d), AnySet::Sightings(set)) => used(&d.sightings, set.viewpoint, set.part),
        };
        let mut gather = Gather::new(session, tick, self.n_viewpoints);
        let mut taken = 0;
        for set in self.recording.sets(session, tick)? {
            if !wanted(&set) {
                continue;
            }
            let added = match set {
                AnySet::Patches(set) => gather.add_patches(set),
                AnySet::Sightings(set) => gather.add_sightings(set),
            };
            taken += u64::from(added.is_ok());
            self.tally.refused += u64::from(added.is_err());
        }
        self.tally.sets += taken;
        if let Some(decision) = decision {
            let there = (decision.patches.len() + decision.sightings.len()) as u64;
            self.tally.missing += there.saturating_sub(taken);
        }
        Ok(gather.take())
    }

    fn decision(&self, tick: Tick) -> Option<Decision> {
        if self.choice == Choice::All {
            return None;
        }
        let decisions = &self.part.decisions;
        let found = decisions.binary_search_by_key(&tick, |decision| decision.tick);
        found.ok().and_then(|i| decisions.get(i)).cloned()
    }
}

/// If the decisions are too far apart for one run, removes all except the longest stretch: a forged
/// one must not make the recording unusable. Returns how many were removed.
fn remove_far_decisions(part: &mut SessionPart) -> u64 {
    if !is_too_long(part, span(part)) {
        return 0;
    }
    let decisions = std::mem::take(&mut part.decisions);
    let n = decisions.len();
    part.decisions = longest_stretch(&decisions).to_vec();
    (n - part.decisions.len()) as u64
}

fn longest_stretch(decisions: &[Decision]) -> &[Decision] {
    let is_near = |a: &Decision, b: &Decision| (b.tick - a.tick).unsigned_abs() <= MAX_EMPTY;
    let stretches = decisions.chunk_by(is_near);
    // Of two equally long ones, the first.
    let longest = stretches.rev().max_by_key(|stretch| stretch.len());
    longest.unwrap_or_default()
}

/// The first decision of a replay of `part`, after skipped ones.
pub fn first_decision(part: &SessionPart) -> Option<&Decision> {
    if is_too_long(part, span(part)) {
        longest_stretch(&part.decisions).first()
    } else {
        part.decisions.first()
    }
}

fn span(part: &SessionPart) -> [Tick; 2] {
    match (part.decisions.first(), part.decisions.last()) {
        (Some(first), Some(last)) => [first.tick, last.tick],
        _ => part.ticks,
    }
}

fn is_too_long(part: &SessionPart, [from, to]: [Tick; 2]) -> bool {
    let there = (part.sets + part.decisions.len()) as u64;
    (to - from).unsigned_abs() > there * MAX_EMPTY_PER_SET + MAX_EMPTY
}

/// The ticks to replay, rising: those of a run have no gaps.
fn ticks(part: &SessionPart) -> Result<Vec<Tick>, ReplayError> {
    let [from, to] = span(part);
    if is_too_long(part, [from, to]) {
        return Err(ReplayError::Span {
            from,
            to,
            sets: part.sets,
        });
    }
    Ok((from.0..=to.0).map(Tick).collect())
}

#[cfg(test)]
mod tests {
    use farfield_proto::id::SessionId;

    use super::*;
    use crate::identity::known::KnownPeople;

    fn part(ticks: &[i64]) -> SessionPart {
        let decision = |&tick: &i64| Decision {
            session: SessionId(1),
            first: Tick(ticks[0]),
            tick: Tick(tick),
            horizons_ticks: Vec::new(),
            patches: Vec::new(),
            sightings: Vec::new(),
        };
        SessionPart {
            expected: KnownPeople::default(),
            session: SessionId(1),
            decisions: ticks.iter().map(decision).collect(),
            ticks: [Tick(ticks[0]), Tick(ticks[ticks.len() - 1])],
            sets: 0,
            filled: 0,
        }
    }

    #[test]
    fn decisions_far_from_all_others_are_skipped() {
        for far in [[i64::MIN, 0, 1, 2], [0, 1, 2, 1 << 40], [0, 1, 2, i64::MAX]] {
            let mut part = part(&far);
            assert_eq!(first_decision(&part).map(|it| it.tick), Some(Tick(0)));
            assert_eq!(remove_far_decisions(&mut part), 1);
            assert_eq!(ticks(&part).unwrap(), [0, 1, 2].map(Tick));
        }
    }

    #[test]
    fn a_long_outage_skips_no_decision() {
        let mut part = part(&[0, 1, 2, 30_000]);
        assert_eq!(remove_far_decisions(&mut part), 0);
        assert_eq!(ticks(&part).unwrap().len(), 30_001);
    }
}
