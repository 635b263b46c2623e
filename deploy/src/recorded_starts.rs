//! Whether recordings begin at one moment, as far as their containers and lengths show it. Frame 0 of all must be of one moment, and
//! ten frames at the start of one camera put knees 38 mm off.

use farfield_edge::source::SourceInfo;
use farfield_proto::finding::Advice;
use farfield_proto::venue::{Source, TickFrom, Venue};

/// First times of containers that differ by less come of codecs and sound, seconds.
const APART_S: f64 = 0.1;

/// How the others are cut to a recording that begins `frames` later.
fn cut_others(frames: i64) -> String {
    format!(
        "cut the first {frames} of the others: `ffmpeg -i IN -vf trim=start_frame={frames},setpts=PTS-STARTPTS OUT`"
    )
}

/// The recordings whose ticks are counted from their first frame, and what is known of them.
fn counted<'a>(
    venue: &'a Venue,
    infos: &'a [(String, SourceInfo)],
) -> impl Iterator<Item = (&'a str, &'a SourceInfo)> {
    infos.iter().filter_map(move |(name, info)| {
        let mut cameras = venue.cameras.iter();
        let camera = cameras.find(|camera| camera.model.name() == name)?;
        let is_counted = matches!(camera.source, Source::Video { .. } | Source::Images { .. })
            && camera.tick_from != TickFrom::Timecode;
        is_counted.then_some((name.as_str(), info))
    })
}

/// A container that shows its first frame later than another does.
pub(crate) fn starts_apart(venue: &Venue, infos: &[(String, SourceInfo)]) -> Option<Advice> {
    let starts = counted(venue, infos);
    let mut starts: Vec<(f64, &str)> = starts
        .filter_map(|(name, info)| Some((info.labels.start_s?, name)))
        .collect();
    starts.sort_by(|a, b| a.0.total_cmp(&b.0));
    let ((first_s, first), (last_s, last)) = (*starts.first()?, *starts.last()?);
    let apart_s = last_s - first_s;
    let frames = (apart_s * venue.rate_hz).round() as i64;
    (apart_s > APART_S).then(|| Advice::doubtful(
        format!(
            "by their containers, the recording of camera `{last}` begins {apart_s:.3} s ({frames} frames) after that of `{first}`"
        ),
        format!(
            "if they were not cut to the same moment, {}",
            cut_others(frames)
        ),
    ))
}

/// Recordings with different numbers of frames: those of one may be missing at its start.
pub(crate) fn lengths_apart(venue: &Venue, infos: &[(String, SourceInfo)]) -> Option<Advice> {
    let lengths = counted(venue, infos);
    let mut lengths: Vec<(i64, &str)> = lengths
        .filter_map(|(name, info)| {
            let ticks = info.ticks.as_ref()?;
            Some((ticks.end - ticks.start, name))
        })
        .collect();
    lengths.sort_unstable();
    let ((fewest, short), (most, long)) = (*lengths.first()?, *lengths.last()?);
    let missing = most - fewest;
    (missing > 0).then(|| Advice::doubtful(
        format!(
            "camera `{short}` has {fewest} frames and camera `{long}` {most}: they are taken to begin at one moment"
        ),
        format!(
            "if the {missing} are missing at the start of `{short}`, {}",
            cut_others(missing)
        ),
    ))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use farfield_proto::tick::Tick;

    use super::*;

    /// A venue with two videos, and what their containers say: first time in seconds, number of frames.
    fn said(a: (f64, i64), b: (f64, i64)) -> [Option<Advice>; 2] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("venue.sample.toml");
        let mut venue = farfield_node::files::load_venue(&path).unwrap();
        venue.cameras.truncate(2);
        venue.rate_hz = 60.0;
        let mut infos = Vec::new();
        for (camera, (start_s, frames)) in venue.cameras.iter_mut().zip([a, b]) {
            camera.source = Source::Video {
                path: "a.mp4".into(),
            };
            let mut info = SourceInfo {
                ticks: Some(Tick(0)..Tick(frames)),
                ..SourceInfo::default()
            };
            info.labels.start_s = Some(start_s);
            infos.push((camera.model.name().to_owned(), info));
        }
        [starts_apart(&venue, &infos), lengths_apart(&venue, &infos)]
    }

    #[test]
    fn ten_frames_that_are_missing_at_a_start_are_named_with_how_to_cut_the_others() {
        assert_eq!(said((0.0, 100), (0.067, 100)), [None, None]);
        let [by_container, by_length] = said((0.0, 100), (0.166, 90));
        for remark in [by_container, by_length] {
            let remark = remark.unwrap();
            assert!(remark.remedy.contains("trim=start_frame=10,"), "{remark:?}");
        }
    }
}
