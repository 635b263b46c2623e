//! The ticks of a run, from its sources and the requested range.

use std::ops::Range;

use farfield_proto::tick::Tick;

use super::{SourceError, SourceInfo};

/// The ticks of the run. `asked` must lie inside every recording. Without `asked`, all recordings
/// must have the same ticks. Live sources (without `ticks`) fit any range.
///
/// # Errors
/// [`SourceError::NoTicks`] if `asked` is empty, [`SourceError::OutsideClip`] if a recording does
/// not contain it, [`SourceError::Lengths`] without `asked` if the recordings differ,
/// [`SourceError::Endless`] without `asked` if all sources are live.
pub fn common_ticks(
    infos: &[(String, SourceInfo)],
    asked: Option<Range<Tick>>,
) -> Result<Range<Tick>, SourceError> {
    let mut recorded = infos
        .iter()
        .filter_map(|(name, info)| Some((name, info.ticks.as_ref()?)));
    if let Some(asked) = asked {
        if asked.is_empty() {
            return Err(SourceError::NoTicks { asked });
        }
        return match recorded.find(|(_, has)| asked.start < has.start || asked.end > has.end) {
            None => Ok(asked),
            Some((name, has)) => Err(SourceError::OutsideClip {
                camera: name.clone(),
                asked,
                has: has.clone(),
            }),
        };
    }
    let Some(a) = recorded.next() else {
        return Err(SourceError::Endless);
    };
    let mut shared = a.1.clone();
    let mut other = None;
    for b in recorded {
        shared = shared.start.max(b.1.start)..shared.end.min(b.1.end);
        if b.1 != a.1 {
            other.get_or_insert(b);
        }
    }
    match other {
        None => Ok(shared),
        Some(b) => Err(SourceError::Lengths {
            a: (a.0.clone(), a.1.clone()),
            b: (b.0.clone(), b.1.clone()),
            shared: (!shared.is_empty()).then_some(shared),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ticks(start: i64, end: i64) -> Range<Tick> {
        Tick(start)..Tick(end)
    }

    fn infos(ranges: &[Option<(i64, i64)>]) -> Vec<(String, SourceInfo)> {
        ranges
            .iter()
            .enumerate()
            .map(|(i, range)| {
                let ticks = range.map(|(start, end)| ticks(start, end));
                (
                    format!("cam{i}"),
                    SourceInfo {
                        ticks,
                        ..SourceInfo::default()
                    },
                )
            })
            .collect()
    }

    #[test]
    fn equal_recordings_are_run_whole() {
        let got = common_ticks(&infos(&[Some((300, 601)), None, Some((300, 601))]), None);
        assert_eq!(got, Ok(ticks(300, 601)));
    }

    #[test]
    fn different_lengths_are_refused_with_both_and_the_common_range() {
        let infos = infos(&[Some((0, 100)), Some((0, 100)), Some((5, 90))]);
        let differ = SourceError::Lengths {
            a: ("cam0".to_owned(), ticks(0, 100)),
            b: ("cam2".to_owned(), ticks(5, 90)),
            shared: Some(ticks(5, 90)),
        };
        assert_eq!(common_ticks(&infos, None), Err(differ));
        assert_eq!(common_ticks(&infos, Some(ticks(5, 90))), Ok(ticks(5, 90)));
    }

    #[test]
    fn ticks_outside_a_recording_are_refused_with_its_name() {
        let infos = infos(&[Some((0, 100)), Some((0, 90))]);
        let error = common_ticks(&infos, Some(ticks(50, 91)))
            .unwrap_err()
            .to_string();
        assert_eq!(
            error,
            "`--ticks` 50..91 is outside the recording of camera `cam1`, which has 0..90"
        );
        assert!(common_ticks(&infos, Some(ticks(-1, 5))).is_err());
    }

    #[test]
    fn an_empty_range_is_refused() {
        let backwards = Tick(7)..Tick(3);
        assert!(matches!(
            common_ticks(&infos(&[Some((0, 9))]), Some(backwards)),
            Err(SourceError::NoTicks { .. })
        ));
    }

    #[test]
    fn live_sources_need_an_end() {
        assert_eq!(
            common_ticks(&infos(&[None]), None),
            Err(SourceError::Endless)
        );
        assert_eq!(
            common_ticks(&infos(&[None]), Some(ticks(3, 7))),
            Ok(ticks(3, 7))
        );
    }
}
