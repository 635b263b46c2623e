//! Tests of resampling.

use farfield_proto::message::PersonState;

use super::*;
use crate::fixture::{RUN_HZ, sample_at};

fn clock(rate_hz: f64, end: i64) -> Clock {
    Clock {
        run_hz: RUN_HZ,
        rate_hz,
        zero: 0,
        first: 0,
        end,
    }
}

/// Frames of a person who is present at `ticks`.
fn frames(
    clock: Clock,
    gaps: Gaps,
    ticks: impl Iterator<Item = i64>,
    at: impl Fn(f64) -> Sample,
) -> Vec<Frame> {
    let mut frames = Vec::new();
    let mut keep = |frame| {
        frames.push(frame);
        Ok::<_, ()>(())
    };
    let mut resampler = Resampler::new(clock, gaps, 1.0, RestPose::TPose);
    for tick in ticks {
        resampler
            .push(tick, at(tick as f64 / RUN_HZ), &mut keep)
            .unwrap();
    }
    resampler.finish(&mut keep).unwrap();
    assert_eq!(frames.len() as u64, clock.n_frames());
    frames
}

fn pose(frame: &Frame) -> &Sample {
    &frame.pose.as_ref().unwrap().0
}

/// Largest distance between joints of two samples, metres.
fn apart_m(a: &Sample, b: &Sample) -> f64 {
    let (a, b) = (a.joints_m(RestPose::TPose), b.joints_m(RestPose::TPose));
    a.iter()
        .zip(&b)
        .map(|(a, b)| (a - b).norm())
        .fold(0.0, f64::max)
}

#[test]
fn at_the_original_rate_poses_are_unchanged() {
    for frame in frames(clock(RUN_HZ, 90), Gaps::Keep, 0..90, sample_at) {
        assert_eq!(pose(&frame), &sample_at(frame.time_s));
    }
}

#[test]
fn at_twice_the_rate_poses_are_interpolated() {
    let frames = frames(clock(2.0 * RUN_HZ, 60), Gaps::Keep, 0..60, sample_at);
    assert_eq!(frames.len(), 119);
    for frame in &frames {
        // A swing of 0.7 rad at 1 Hz between samples at 60 Hz: (2 pi)^2 0.7 / 8 / 60^2 rad, at one
        // metre.
        assert!(apart_m(pose(frame), &sample_at(frame.time_s)) < 2e-3);
    }
}

#[test]
fn at_half_the_rate_high_frequencies_are_removed() {
    let trembling = |t: f64| {
        let mut sample = sample_at(t);
        sample.motion.root_m.z += 0.05 * libm::cos(2.0 * PI * 25.0 * t);
        sample
    };
    let frames = frames(clock(RUN_HZ / 2.0, 240), Gaps::Keep, 0..240, trembling);
    assert_eq!(frames.len(), 120);
    // Where the filter is complete.
    for frame in &frames[6..114] {
        let apart_m = apart_m(pose(frame), &sample_at(frame.time_s));
        assert!(apart_m < 6e-3, "{apart_m}");
    }
}

#[test]
fn uniform_motion_is_not_shifted_at_the_ends() {
    let walking = |t: f64| {
        let mut sample = sample_at(0.0);
        sample.motion.root_m.x += 2.0 * t;
        sample
    };
    for frame in frames(clock(RUN_HZ / 3.0, 100), Gaps::Keep, 0..100, walking) {
        assert!(
            apart_m(pose(&frame), &walking(frame.time_s)) < 1e-3,
            "{}",
            frame.index
        );
    }
}

#[test]
fn gaps_are_kept_or_filled_as_requested() {
    let present = || (0..30).chain(40..60);
    let unfilled = frames(clock(RUN_HZ, 60), Gaps::Keep, present(), sample_at);
    let absent: Vec<u64> = unfilled
        .iter()
        .filter(|f| f.pose.is_none())
        .map(|f| f.index)
        .collect();
    assert_eq!(absent, (30..40).collect::<Vec<u64>>());
    let filled = frames(clock(RUN_HZ, 60), Gaps::Mark, present(), sample_at);
    for frame in &filled {
        let (sample, origin) = frame.pose.as_ref().unwrap();
        assert_eq!(*origin == Origin::Filled, (30..40).contains(&frame.index));
        assert!(apart_m(sample, &sample_at(frame.time_s)) < 0.1);
    }
}

#[test]
fn filled_poses_are_not_marked_as_measured() {
    let present = || (0..30).chain(40..60);
    for frame in frames(clock(2.0 * RUN_HZ, 60), Gaps::Fill, present(), sample_at) {
        let (sample, origin) = frame.pose.as_ref().unwrap();
        let is_measured = sample.sigma_m.is_some() && sample.views == 4;
        assert_eq!(is_measured, *origin == Origin::Seen, "{}", frame.index);
        assert_eq!(
            sample.state == PersonState::Coasting,
            *origin == Origin::Filled
        );
        assert_eq!(*origin == Origin::Filled, (59..80).contains(&frame.index));
    }
}

#[test]
fn longer_gaps_are_not_filled() {
    // From pose to pose, 60 ticks are one second.
    for (later, n_absent) in [(89, 0), (90, 60)] {
        let present = (0..30).chain(later..100);
        let filled = frames(clock(RUN_HZ, 100), Gaps::Fill, present, sample_at);
        let absent = filled.iter().filter(|frame| frame.pose.is_none());
        assert_eq!(absent.count(), n_absent);
    }
}

#[test]
fn at_a_lower_rate_filled_gaps_have_smooth_edges() {
    let walking = |t: f64| {
        let mut sample = sample_at(0.0);
        sample.motion.root_m.x += 2.0 * t;
        sample
    };
    let present = (0..40).chain(55..120);
    let filled = frames(clock(RUN_HZ / 3.0, 120), Gaps::Fill, present, walking);
    for frame in &filled {
        let apart_m = apart_m(pose(frame), &walking(frame.time_s));
        assert!(apart_m < 1e-3, "{} {apart_m}", frame.index);
    }
    assert!(
        filled
            .iter()
            .any(|f| matches!(&f.pose, Some((_, Origin::Filled))))
    );
}

#[test]
fn unobserved_angles_stay_unobserved_between_ticks() {
    let unobserved = |t: f64| Sample {
        unobserved: if t < 0.5 { 0b100 } else { 0 },
        ..sample_at(t)
    };
    for frame in frames(clock(2.0 * RUN_HZ, 60), Gaps::Keep, 0..60, unobserved) {
        assert_eq!(
            pose(&frame).is_unobserved(2),
            frame.index < 60,
            "{}",
            frame.index
        );
    }
}

#[test]
fn there_are_no_poses_before_the_first_and_after_the_last() {
    for gaps in [Gaps::Keep, Gaps::Fill] {
        let frames = frames(clock(RUN_HZ, 60), gaps, 10..50, sample_at);
        let present: Vec<u64> = frames
            .iter()
            .filter(|f| f.pose.is_some())
            .map(|f| f.index)
            .collect();
        assert_eq!(present, (10..50).collect::<Vec<u64>>());
    }
}

#[test]
fn time_starts_at_the_first_tick_of_the_run() {
    let clock = Clock {
        run_hz: 50.0,
        rate_hz: 25.0,
        zero: 100,
        first: 150,
        end: 160,
    };
    assert_eq!(clock.n_frames(), 5);
    assert!((clock.seconds(2) - 1.08).abs() < 1e-12);
    assert!((clock.position(2) - 154.0).abs() < 1e-12);
}
