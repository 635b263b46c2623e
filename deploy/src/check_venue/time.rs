//! Checks that the recordings show the same moments: their rates, lengths, and start times in their containers.

use std::path::Path;

use farfield_edge::live::timecode::Timecode;
use farfield_edge::source::{SourceError, SourceInfo, common_ticks};
use farfield_fusion_node::{check_given_ticks, check_live_or_recorded};
use farfield_proto::venue::{TickFrom, Venue};
use time::{Date, Month, PrimitiveDateTime, Time};

use super::opened::OpenedSource;
use crate::recording_checks::{
    LONGER, LeapingKeypoints, are_apart, held_keypoints, leaping_keypoints, odd_rates,
    starts_apart, too_short, usual_rate_hz,
};
use crate::report_lines::ReportLines;

const TIME: &str = "time";
/// Containers have creation times in whole seconds, and some the time when they were closed.
const CREATED_APART_S: f64 = 2.5;

/// Checks the times of all opened sources.
pub(super) fn check_time(
    venue: &Venue,
    path: &Path,
    opened: &[OpenedSource],
    report: &mut ReportLines,
) {
    let known = venue.cameras.iter().zip(opened);
    let infos: Vec<(String, SourceInfo)> = known
        .filter_map(|(camera, source)| {
            Some((
                camera.model.name().to_owned(),
                source.info.as_ref().ok()?.clone(),
            ))
        })
        .collect();
    if let Err(error) = check_live_or_recorded(venue, path) {
        report.warn(TIME, error.to_string(), "run recordings without `--live`");
    }
    let all = match opened.len() - infos.len() {
        0 => "all recordings",
        _ => "the other recordings",
    };
    check_rates(venue, &infos, all, report);
    check_lengths(venue, path, &infos, all, report);
    if let Some(remark) = starts_apart(venue, &infos) {
        report.advise(TIME, remark);
    }
    check_creation_times(&infos, report);
    check_timecodes(venue, opened, report);
}

/// `all` is the collective name of the recordings of `infos`.
fn check_rates(venue: &Venue, infos: &[(String, SourceInfo)], all: &str, report: &mut ReportLines) {
    let odd = odd_rates(infos);
    for rate in &odd {
        report.fail(TIME, rate.problem(), rate.remedy());
    }
    for held in held_keypoints(infos, venue.rate_hz) {
        report.warn(TIME, held.problem(), held.remedy());
    }
    if let Some(leaping) = leaping_keypoints(infos) {
        report.warn(TIME, leaping.problem(), LeapingKeypoints::REMEDY);
    }
    let Some(usual_hz) = usual_rate_hz(infos) else {
        return;
    };
    if are_apart(usual_hz, venue.rate_hz) {
        report.warn(
            TIME,
            format!(
                "the recordings have {usual_hz:.3} frames per second, the venue's `rate_hz` is {}: times have an offset of {:.1} s after an hour",
                venue.rate_hz,
                3600.0 * (usual_hz / venue.rate_hz - 1.0).abs()
            ),
            format!("rate_hz = {usual_hz:.6}"),
        );
    } else if odd.is_empty() {
        report.ok(
            TIME,
            format!("{all} with a known rate have {usual_hz:.3} frames per second"),
        );
    }
}

fn check_lengths(
    venue: &Venue,
    path: &Path,
    infos: &[(String, SourceInfo)],
    all: &str,
    report: &mut ReportLines,
) {
    if infos.is_empty() {
        return;
    }
    let ticks = match common_ticks(infos, None) {
        Ok(ticks) => ticks,
        Err(SourceError::Endless) => {
            report.ok(TIME, "all sources are live");
            return;
        }
        Err(SourceError::Lengths {
            a,
            b,
            shared: Some(shared),
        }) => {
            report.warn(
                TIME,
                format!(
                    "the recordings differ in length: camera `{}` has ticks {}..{}, camera `{}` has {}..{}",
                    a.0, a.1.start, a.1.end, b.0, b.1.start, b.1.end
                ),
                format!(
                    "if they begin at the same moment: `farfield run {} --ticks {}..{}`; if they end at the same moment, cut their beginnings",
                    path.display(), shared.start, shared.end
                ),
            );
            shared
        }
        Err(error) => {
            report.fail(
                TIME,
                error.to_string(),
                "for videos and images check `first_tick` and `tick_from`, for keypoints the ticks of their lines",
            );
            return;
        }
    };
    if let Err(error) = check_given_ticks(venue, path, &ticks) {
        report.fail(
            TIME,
            error.to_string(),
            "give the person at a tick that the recordings have",
        );
    }
    let frames = ticks.end - ticks.start;
    if let Some(words) = too_short(frames, venue.rate_hz, &venue.given_persons) {
        report.warn(TIME, words, LONGER);
    }
    report.ok(
        TIME,
        format!(
            "{all} have ticks {}..{}: {frames} frames, {:.1} s",
            ticks.start,
            ticks.end,
            frames as f64 / venue.rate_hz
        ),
    );
}

fn check_creation_times(infos: &[(String, SourceInfo)], report: &mut ReportLines) {
    let created = infos.iter().filter_map(|(camera, info)| {
        Some((unix_s(info.labels.created.as_deref()?)?, camera.as_str()))
    });
    let mut created: Vec<(f64, &str)> = created.collect();
    created.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (Some(first), Some(last)) = (created.first(), created.last()) else {
        return;
    };
    let apart_s = last.0 - first.0;
    if apart_s > CREATED_APART_S {
        report.warn(
            TIME,
            format!(
                "by their files, the recording of camera `{}` was created {apart_s:.0} s after that of `{}`",
                last.1, first.1
            ),
            "unless they were cut to the same moment, cut them: frame 0 of all must show the same moment",
        );
    } else if created.len() > 1 {
        report.ok(
            TIME,
            format!(
                "{} recordings were created within {apart_s:.1} s of each other",
                created.len()
            ),
        );
    }
}

fn check_timecodes(venue: &Venue, opened: &[OpenedSource], report: &mut ReportLines) {
    let mut first: Option<(i64, i64, &str)> = None;
    for (camera, source) in venue.cameras.iter().zip(opened) {
        let Ok(info) = &source.info else { continue };
        let Some(text) = &info.labels.timecode else {
            continue;
        };
        let rate_hz = info.rate_hz.unwrap_or(venue.rate_hz);
        let Ok(timecode) = Timecode::parse(text, rate_hz) else {
            continue;
        };
        if camera.tick_from == TickFrom::Timecode {
            continue;
        }
        let (frames, name) = (timecode.frames(), camera.model.name());
        match first {
            None => {
                let ticks = info.ticks.as_ref();
                first = Some((frames, ticks.map_or(0, |it| it.end - it.start), name));
            }
            Some((earlier, length, other)) if length > 0 && frames - earlier == length => {
                report.warn(
                    TIME,
                    format!(
                        "by their timecodes, the recording of camera `{name}` continues where that of `{other}` ends: these are \
                         two parts of one recording"
                    ),
                    "join the parts of each camera: `ffmpeg -f concat -safe 0 -i LIST -c copy OUT`, where LIST has a line \
                     `file 'PART'` for each",
                );
                return;
            }
            Some((earlier, _, other)) if earlier != frames => {
                report.warn(
                    TIME,
                    format!(
                        "by their timecodes, the recording of camera `{name}` begins {} frames after that of `{other}`",
                        frames - earlier
                    ),
                    "if the timecodes were set together, write `tick_from = \"timecode\"` for every camera",
                );
                return;
            }
            Some(_) => {}
        }
    }
}

/// Unix time in seconds of `2026-05-01T18:00:00.5Z`; `None` for other forms, and for the epoch that programs without a
/// clock write.
fn unix_s(text: &str) -> Option<f64> {
    let (date, clock) = text.strip_suffix('Z')?.split_once('T')?;
    let mut date = date.split('-');
    let mut number = || date.next()?.parse::<u16>().ok();
    let (year, month, day) = (number()?, number()?, number()?);
    let month = Month::try_from(u8::try_from(month).ok()?).ok()?;
    let date = Date::from_calendar_date(i32::from(year), month, u8::try_from(day).ok()?).ok()?;
    let mut parts = clock.split(':');
    let (hour, minute) = (parts.next()?.parse().ok()?, parts.next()?.parse().ok()?);
    let second: f64 = parts.next()?.parse().ok()?;
    if year < 2000 || !(0.0..61.0).contains(&second) {
        return None;
    }
    let at = PrimitiveDateTime::new(date, Time::from_hms(hour, minute, 0).ok()?);
    Some(at.assume_utc().unix_timestamp() as f64 + second)
}

#[cfg(test)]
mod tests {
    use farfield_proto::tick::Tick;

    use super::*;

    #[test]
    fn only_valid_times_of_containers_are_read() {
        assert_eq!(
            unix_s("2026-05-01T18:00:00.500000Z").map(f64::to_bits),
            Some(1_777_658_400.5_f64.to_bits())
        );
        for text in [
            "",
            "yesterday",
            "2026-13-01T00:00:00Z",
            "1904-01-01T00:00:00Z",
            "2026-05-01T18:00Z",
            "2026-05-01",
        ] {
            assert_eq!(unix_s(text), None, "{text}");
        }
    }

    #[test]
    fn recordings_created_at_different_times_are_reported() {
        let info = |created: &str| {
            let mut info = SourceInfo::default();
            info.labels.created = Some(created.to_owned());
            info
        };
        let infos = [
            ("a".to_owned(), info("2026-05-01T18:00:00Z")),
            ("b".to_owned(), info("2026-05-01T18:00:12Z")),
        ];
        let mut report = ReportLines::default();
        check_creation_times(&infos, &mut report);
        let text = &report.lines()[0].text;
        assert!(text.contains("`b` was created 12 s after"), "{text}");
    }
    #[test]
    fn parts_of_one_recording_are_distinguished_from_late_starts() {
        let report_text = |timecode: &str| {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("venue.sample.toml");
            let venue = farfield_node::files::load_venue(&path).unwrap();
            let opened = |timecode: &str| {
                let mut info = SourceInfo {
                    ticks: Some(Tick(0)..Tick(60)),
                    rate_hz: Some(30.0),
                    ..SourceInfo::default()
                };
                info.labels.timecode = Some(timecode.to_owned());
                OpenedSource {
                    info: Ok(info),
                    first: None,
                    content: None,
                    brightest: None,
                }
            };
            let mut report = ReportLines::default();
            let opened = [opened("01:00:00:00"), opened(timecode)];
            check_timecodes(&venue, &opened, &mut report);
            report.to_text()
        };
        assert!(report_text("01:00:02:00").contains("two parts"));
        assert!(report_text("01:00:01:00").contains("begins 30 frames after"));
        assert!(!report_text("01:00:00:00").contains("camera"));
    }
}
