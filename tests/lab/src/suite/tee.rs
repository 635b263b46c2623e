
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use farfield_edge::source::{Frame, FrameSource, SourceError};

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

#[cfg(test)]
mod tests {
    use farfield_edge::source::{FrameContent, KeypointFrame};
    use farfield_proto::tick::Tick;

    use super::*;

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
