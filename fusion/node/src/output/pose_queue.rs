//! The queue of the thread that writes the pose files.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use farfield_node::clock;
use farfield_proto::message::{PersonPose, PoseSet};

/// Most queued ticks.
const QUEUE: usize = 1 << 16;
/// Most queued bytes: a hanging disk must not fill the memory.
const QUEUE_BYTES: usize = 64 << 20;

/// Final poses of a tick.
#[derive(Debug)]
pub(crate) enum FinalPoses {
    /// The causal poses, as a live client gets them.
    Live(PoseSet),
    /// Poses of the fixed-lag smoother.
    Smoothed(PoseSet),
}

impl FinalPoses {
    /// Their approximate size in memory.
    fn bytes(&self) -> usize {
        let (Self::Live(set) | Self::Smoothed(set)) = self;
        let person = |pose: &PersonPose| {
            size_of::<PersonPose>()
                + size_of_val(pose.joints_m.as_slice())
                + size_of_val(pose.keypoints_m.as_slice())
                + size_of_val(pose.sigma_m.as_slice())
                + size_of_val(pose.angles.as_slice())
        };
        size_of::<Self>() + set.persons.iter().map(person).sum::<usize>()
    }
}

/// Poses on their way to the disk, in order.
#[derive(Debug, Default)]
pub(crate) struct PoseQueue {
    state: Mutex<Waiting>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct Waiting {
    poses: VecDeque<FinalPoses>,
    bytes: usize,
    /// Whether no more poses will be added.
    is_over: bool,
    /// Whether no more poses will be taken.
    is_abandoned: bool,
}

/// The result of [`PoseQueue::take`].
#[derive(Debug)]
pub(crate) enum Taken {
    Poses(FinalPoses),
    /// None yet.
    Nothing,
    /// No more poses will be added.
    End,
}

impl PoseQueue {
    /// Adds `poses` if there is a place for them; otherwise returns them.
    pub(super) fn offer(&self, poses: FinalPoses) -> Result<(), FinalPoses> {
        let bytes = poses.bytes();
        Self::put(&mut self.lock(), poses, bytes)?;
        self.changed.notify_all();
        Ok(())
    }

    /// Adds `poses`, waiting for a place; returns them if the queue is abandoned.
    pub(super) fn push(&self, poses: FinalPoses) -> Result<(), FinalPoses> {
        let bytes = poses.bytes();
        let has_no_place =
            |waiting: &mut Waiting| !waiting.has_place(bytes) && !waiting.is_abandoned;
        let waiting = self.changed.wait_while(self.lock(), has_no_place);
        let mut waiting = waiting.unwrap_or_else(PoisonError::into_inner);
        Self::put(&mut waiting, poses, bytes)?;
        drop(waiting);
        self.changed.notify_all();
        Ok(())
    }

    fn put(waiting: &mut Waiting, poses: FinalPoses, bytes: usize) -> Result<(), FinalPoses> {
        if waiting.is_abandoned || !waiting.has_place(bytes) {
            return Err(poses);
        }
        waiting.bytes += bytes;
        waiting.poses.push_back(poses);
        Ok(())
    }

    /// Takes the next poses, waiting for them until `until`.
    pub(super) fn take(&self, until: Instant) -> Taken {
        let patience = until.saturating_duration_since(clock::now());
        let is_idle = |waiting: &mut Waiting| waiting.poses.is_empty() && !waiting.is_over;
        let waited = self.changed.wait_timeout_while(
            self.lock(),
            patience.max(Duration::from_millis(1)),
            is_idle,
        );
        let (mut waiting, _) = waited.unwrap_or_else(PoisonError::into_inner);
        let Some(poses) = waiting.poses.pop_front() else {
            return if waiting.is_over {
                Taken::End
            } else {
                Taken::Nothing
            };
        };
        waiting.bytes -= poses.bytes().min(waiting.bytes);
        drop(waiting);
        self.changed.notify_all();
        Taken::Poses(poses)
    }

    /// Marks the end: no more poses will be added.
    pub(super) fn end(&self) {
        self.lock().is_over = true;
        self.changed.notify_all();
    }

    /// Marks the queue as abandoned; callers that wait for a place return.
    pub(super) fn abandon(&self) {
        self.lock().is_abandoned = true;
        self.changed.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, Waiting> {
        // No thread panics in the middle of a change.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Waiting {
    /// A tick larger than the whole queue is still accepted, alone.
    fn has_place(&self, bytes: usize) -> bool {
        self.poses.is_empty() || self.poses.len() < QUEUE && self.bytes + bytes <= QUEUE_BYTES
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use farfield_proto::id::SessionId;
    use farfield_proto::tick::Tick;

    use super::*;

    fn poses(tick: i64, n_persons: usize) -> FinalPoses {
        let pose = farfield_fusion::export::fixture::pose(
            1,
            farfield_proto::message::PersonState::Tracked,
        );
        FinalPoses::Live(PoseSet {
            session: SessionId(1),
            tick: Tick(tick),
            persons: vec![pose; n_persons],
        })
    }

    impl PoseQueue {
        fn is_full(&self, n_persons: usize) -> bool {
            !self.lock().has_place(poses(0, n_persons).bytes())
        }
    }

    fn next(queue: &PoseQueue) -> Option<i64> {
        match queue.take(clock::now()) {
            Taken::Poses(FinalPoses::Live(set)) => Some(set.tick.0),
            _ => None,
        }
    }

    #[test]
    fn the_queue_is_bounded_by_its_bytes_and_ordered() {
        let queue = PoseQueue::default();
        // Four fit, with a tenth of the room left.
        let n_persons = QUEUE_BYTES * 9 / 40 / (poses(0, 2).bytes() - poses(0, 1).bytes());
        let taken = (0..10).take_while(|&tick| queue.offer(poses(tick, n_persons)).is_ok());
        assert_eq!(taken.count(), 4);
        assert_eq!(next(&queue), Some(0));
        queue.offer(poses(10, n_persons)).unwrap();
        assert!(queue.offer(poses(11, n_persons)).is_err());
        let left: Vec<_> = std::iter::from_fn(|| next(&queue)).collect();
        assert_eq!(left, [1, 2, 3, 10]);
        queue.end();
        assert!(matches!(queue.take(clock::now()), Taken::End));
    }

    #[test]
    fn a_waiting_caller_gets_a_place_or_returns_when_abandoned() {
        let queue = Arc::new(PoseQueue::default());
        let n_persons = QUEUE_BYTES / poses(0, 1).bytes();
        queue.push(poses(0, n_persons)).unwrap();
        let waits = std::thread::spawn({
            let queue = Arc::clone(&queue);
            move || [1, 2].map(|tick| queue.push(poses(tick, n_persons)).is_ok())
        });
        assert_eq!(next(&queue), Some(0));
        while !queue.is_full(n_persons) {
            std::thread::yield_now();
        }
        queue.abandon();
        assert_eq!(waits.join().unwrap(), [true, false]);
    }
}
