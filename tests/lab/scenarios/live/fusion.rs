//! Fusion stops and starts again.

use std::collections::BTreeMap;
use std::net::{TcpListener, TcpStream};
use std::process::Command;
use std::thread;
use std::time::Duration;

use farfield_lab::live_venue::NodeProcess;
use farfield_proto::message::PersonPose;

use super::stage::{LiveStage, PEOPLE, RATE_HZ};
use crate::farfield::{command, farfield};
use crate::recording::replayed;

/// Longest time from the first patches until all tracks are back, seconds.
const BACK_WITHIN_S: f64 = 2.0;
/// Far above what a loaded machine takes to finish the files of a run.
const PATIENCE: Duration = Duration::from_mins(1);

/// Ends fusion by `end` and starts it again with its results in `name`. Waits until all people are tracked, and returns
/// the time from the first poses until then, seconds by ticks.
fn restart(stage: &mut LiveStage, name: &str, end: impl FnOnce(NodeProcess)) -> f64 {
    restart_with(stage, name, end, &[])
}

/// [`restart`] with more arguments for the new fusion.
fn restart_with(
    stage: &mut LiveStage,
    name: &str,
    end: impl FnOnce(NodeProcess),
    more: &[&str],
) -> f64 {
    let last = stage.seen().newest.as_ref().unwrap().session;
    end(stage.live.fusion.take().unwrap());
    let out = stage.out(name);
    stage.live.start_fusion(&out, more).unwrap();
    stage.wait("all people are tracked again", |seen| {
        let again = seen.newest.as_ref().is_some_and(|set| set.session != last);
        again && seen.tracked() == PEOPLE
    });
    let session = stage.seen().newest.as_ref().unwrap().session;
    let seen = stage.seen();
    let mut again = seen.arrivals.iter().filter(|a| a.session == session);
    let tracked = again.clone().find(|a| a.tracked == PEOPLE).unwrap();
    (tracked.tick - again.next().unwrap().tick) as f64 / RATE_HZ
}

/// For each person, whether it walks on the left side of the stage now: one always walks on each side.
fn sides(stage: &LiveStage) -> BTreeMap<u32, bool> {
    let seen = stage.seen();
    let persons = &seen.newest.as_ref().unwrap().persons;
    let side = |pose: &PersonPose| (pose.person.0, pose.joints_m[0][1] > 0.0);
    persons.iter().map(side).collect()
}

/// Ends fusion like a power cut.
fn kill(fusion: NodeProcess) {
    fusion.kill().unwrap();
}

/// Ends fusion like `systemctl restart`.
fn terminate(mut fusion: NodeProcess) {
    let pid = fusion.pid().to_string();
    let sent = Command::new("kill").args(["-TERM", &pid]).status();
    assert!(sent.unwrap().success());
    let status = fusion.wait(PATIENCE).unwrap().expect("fusion ends");
    assert_eq!(status.code(), Some(130), "{}", fusion.output());
}

#[test]
fn a_restarted_fusion_has_its_tracks_back_within_two_seconds() {
    let mut stage = LiveStage::open();
    let first_s = restart(&mut stage, "second", kill);
    stage.run_for(1.0);
    // Connections that edges open to find another fusion stay open; a second restart must not add more.
    let before = stage.resources();
    let second_s = restart(&mut stage, "third", kill);
    println!("tracks were back {first_s:.2} and {second_s:.2} s after the first poses, by ticks");
    assert!(first_s.max(second_s) <= BACK_WITHIN_S);
    stage.run_for(1.0);
    before.assert_flat(&stage.resources());
}

#[test]
fn edges_work_on_for_the_next_fusion_after_a_stop() {
    // Symptom to prevent: fusion reported the end of the run to its edges whenever it ended, and they left for good.
    let mut stage = LiveStage::prepare(&[], "");
    stage.live.fusion_by_hand();
    stage.start();
    let back_s = restart(&mut stage, "second", terminate);
    println!("tracks were back {back_s:.2} s after the first poses, by ticks");
    assert!(back_s <= BACK_WITHIN_S);
    stage.run_for(1.0);
    let at_work = stage.live.edges.iter().flatten();
    assert_eq!(at_work.filter_map(NodeProcess::vitals).count(), 4);
}

#[test]
fn people_keep_their_ids_over_restarts_and_the_replay_is_identical() {
    let mut stage = LiveStage::prepare(&[], "");
    stage.live.fusion_by_hand();
    stage.start();
    stage.run_for(3.0);
    let before = sides(&stage);
    assert_eq!(before.len(), PEOPLE);
    let recording = stage.folder.path().join("second.mcap");
    let path = recording.to_str().unwrap().to_owned();
    restart_with(&mut stage, "second", kill, &["--record", &path]);
    stage.run_for(1.0);
    assert_eq!(sides(&stage), before, "{}", stage.live.output());
    restart(&mut stage, "third", terminate);
    stage.run_for(1.0);
    assert_eq!(sides(&stage), before, "{}", stage.live.output());
    let output = replayed(&recording, &stage.folder.path().join("again"), &[]);
    let (same, different) = (
        &output["replay"]["same_ticks"],
        &output["replay"]["different_ticks"],
    );
    println!("two restarts kept both ids; replayed: {same} ticks the same, {different} different");
    assert_eq!(*different, 0, "{output}");
    assert!(same.as_u64().unwrap() > 30, "{output}");
}

#[test]
fn a_second_fusion_is_refused_or_waits_to_replace_the_first() {
    // Symptom to prevent: edges changed over to a second fusion on another host without a message.
    let free = TcpListener::bind("127.0.0.1:0").unwrap();
    let known = format!("tcp/{}", free.local_addr().unwrap());
    drop(free);
    let venue = format!("[fusion]\nconnect = [\"{known}\"]\n");
    let mut stage = LiveStage::prepare(&[], &venue);
    stage.live.fusion_by_hand();
    let out = stage.out("first");
    stage.start_with(&out, &["--listen", &known]);
    let ids = stage.ids();

    let path = stage.folder.path().join("venue.toml");
    let second = |more: &[&str]| {
        let (venue, out) = (path.to_str().unwrap(), stage.out("refused"));
        farfield(&[&["fusion", venue, "--out", out.to_str().unwrap()], more].concat())
    };
    let lock_step = second(&["--listen", "tcp/127.0.0.1:0"]);
    assert_eq!(lock_step.code, 2, "{}", lock_step.stderr);
    let same_place = second(&["--live", "--listen", &known]);
    assert_eq!(same_place.code, 1, "{}", same_place.stderr);
    for output in [&lock_step.stderr, &same_place.stderr] {
        assert!(
            output.contains("venue stage") && output.contains(&known),
            "{output}"
        );
    }

    let first = stage.live.fusion.take().unwrap();
    let out = stage.out("second");
    stage.live.start_fusion(&out, &[]).unwrap();
    let log = |stage: &LiveStage| stage.live.fusion.as_ref().unwrap().output();
    stage.wait("the second one waits", |_| {
        log(&stage).contains("waits until it has gone")
    });
    assert!(log(&stage).contains(&known), "{}", log(&stage));
    stage.run_for(1.0);
    assert_eq!(stage.ids(), ids, "the first works on");
    let session = stage.seen().newest.as_ref().unwrap().session;
    kill(first);
    stage.wait("the second takes its place", |seen| {
        let is_second = seen
            .newest
            .as_ref()
            .is_some_and(|set| set.session != session);
        is_second && seen.tracked() == PEOPLE
    });
    assert!(log(&stage).contains("takes its place"), "{}", log(&stage));
    for edge in stage.live.edges.iter().flatten() {
        assert!(
            edge.output().contains("follows another fusion now"),
            "{}",
            edge.output()
        );
    }
}

#[test]
fn one_of_two_fusions_started_together_waits_for_the_other() {
    // As after a power cut of the whole venue: neither listens while both search.
    let free = || TcpListener::bind("127.0.0.1:0").unwrap();
    let [one, other] = [free(), free()].map(|it| format!("tcp/{}", it.local_addr().unwrap()));
    let venue = format!("[fusion]\nconnect = [\"{one}\", \"{other}\"]\n");
    let stage = LiveStage::prepare(&[], &venue);
    // Each listens at one of the two places and searches at the other.
    let [first, second] = [&one, &other].map(|listen| {
        let mut command = command();
        command
            .arg("fusion")
            .arg(stage.folder.path().join("venue.toml"));
        command.args(["--live", "--allow-plaintext", "--listen", listen, "--out"]);
        command.arg(stage.out(&listen.replace(['/', ':'], "-")));
        NodeProcess::start(listen, command).unwrap()
    });
    let log = |fusion: &NodeProcess| fusion.output().contains("waits until it has gone");
    wait_until(|| log(&first) || log(&second));
    // By now both have searched long enough to find each other.
    thread::sleep(Duration::from_secs(3));
    let both = [log(&first), log(&second)];
    assert_ne!(both[0], both[1], "{}\n{}", first.output(), second.output());
    let (works, mut waiting) = if both[0] {
        (second, first)
    } else {
        (first, second)
    };
    kill(works);
    wait_until(|| waiting.output().contains("takes its place"));
    // It listens at its endpoint, searches once more, and works.
    let ended = waiting.wait(Duration::from_secs(4)).unwrap();
    assert_eq!(ended, None, "{}", waiting.output());
    TcpStream::connect(waiting.name().trim_start_matches("tcp/")).unwrap();
}

fn wait_until(condition: impl Fn() -> bool) {
    const PAUSE: Duration = Duration::from_millis(50);
    let condition = (0..PATIENCE.as_millis() / PAUSE.as_millis()).any(|_| {
        let condition = condition();
        if !condition {
            thread::sleep(PAUSE);
        }
        condition
    });
    assert!(condition, "not within {PATIENCE:?}");
}
