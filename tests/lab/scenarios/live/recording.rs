//! Files of a live run when the disk is full, hangs, or fusion is killed.

use std::fs::File;

use farfield_fusion::recording::reader::Recording;
use farfield_lab::live_venue::SeenVenue;
use farfield_lab::small_disk::SmallDisk;

use super::stage::{LiveStage, PEOPLE, RATE_HZ};

#[test]
fn a_recording_waits_for_space_while_capture_continues() {
    let mut stage = LiveStage::prepare(&[], "");
    let disk = match SmallDisk::mount(&stage.folder.path().join("disk")) {
        Ok(disk) => disk,
        Err(reason) => {
            println!("SKIPPED a full disk: cannot mount a small one: {reason}");
            return;
        }
    };
    let record = disk.path().join("run.mcap");
    let out = stage.out("first");
    let path = record.to_str().unwrap();
    stage.start_with(&out, &["--record", path]);
    let fusion = || stage.live.fusion.as_ref().unwrap();
    stage.wait("the recording waits", |_| {
        fusion().output().contains("the disk is full")
    });
    let output = fusion().output();
    assert!(output.contains("run.mcap"), "{output}");
    let is_shown = |seen: &SeenVenue| {
        let notices = seen
            .statuses
            .get("fusion")
            .map(|status| &status.health.notices);
        notices.is_some_and(|notices| notices.iter().any(|text| text.contains("the disk is full")))
    };
    stage.wait("the status shows it", is_shown);
    let before = stage.resources();
    stage.run_for(3.0);
    before.assert_flat(&stage.resources());
    disk.grow().unwrap();
    stage.wait("the recording goes on", |_| {
        fusion().output().contains("there is room again")
    });
    stage.wait("the status shows it no more", |seen| !is_shown(seen));
    stage.finish("first");
    let recording = Recording::open(File::open(&record).unwrap()).unwrap();
    let part = &recording.sessions()[0];
    println!(
        "{} sets can be read, of ticks {} to {}",
        part.sets, part.ticks[0], part.ticks[1]
    );
    assert!(part.sets > 0 && recording.end().whole);
}

#[test]
fn a_disk_that_hangs_delays_no_live_pose() {
    // Symptom to prevent: fusion's core wrote the poses itself and made none while the disk hung.
    let mut stage = LiveStage::prepare(&[], "");
    let disk = match SmallDisk::mount_freezable(&stage.folder.path().join("disk")) {
        Ok(disk) => disk,
        Err(reason) => {
            println!("SKIPPED a disk that hangs: cannot mount one: {reason}");
            return;
        }
    };
    let out = disk.path().join("out");
    let record = disk.path().join("run.mcap");
    stage.start_with(&out, &["--record", record.to_str().unwrap()]);
    let mut frozen = disk.freeze(8).unwrap();
    let from = stage.seen().poses;
    std::thread::sleep(std::time::Duration::from_secs(4));
    let meanwhile = stage.seen().poses - from;
    assert!(frozen.try_wait().unwrap().is_none(), "it hung meanwhile");
    println!("{meanwhile} poses in 4 s while the disk hung, at {RATE_HZ} Hz");
    assert!(meanwhile as f64 > 3.0 * RATE_HZ, "{meanwhile}");
    let notices = |seen: &SeenVenue| seen.statuses["fusion"].health.notices.join("\n");
    stage.wait("the status shows it", |seen| {
        notices(seen).contains("the disk has not answered")
    });
    assert!(frozen.wait().unwrap().success());
    for words in ["the disk has not answered", "the disk answers again"] {
        stage.wait(words, |_| {
            let output = stage.live.fusion.as_ref().unwrap().output();
            // Once for the results and once for the recording.
            output.matches(words).count() == 2
        });
    }
    stage.wait("the status shows it no more", |seen| {
        notices(seen).is_empty()
    });
    stage.finish("first");
    let summary = std::fs::read_to_string(out.join("summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
    assert_eq!(
        summary["timing"]["poses"],
        serde_json::Value::Null,
        "nothing is missing"
    );
    assert_eq!(summary["timing"]["recording"]["lost"], 0);
}

#[test]
fn the_next_fusion_finishes_the_files_of_a_killed_one() {
    let mut stage = LiveStage::prepare(&[], "");
    stage.live.fusion_by_hand();
    let venue = stage.live.venue().name.clone();
    let [first, second] = [1, 2].map(|n| stage.out(&format!("{venue}-{n}")));
    stage.start_with(&first, &[]);
    // Lines are written to the disk once a second.
    stage.run_for(2.0);
    stage.live.fusion.take().unwrap().kill().unwrap();
    assert!(first.join("run.lock").exists() && first.join("poses.jsonl.tmp").exists());
    stage.live.start_fusion(&second, &[]).unwrap();
    // Its output arrives with a delay.
    stage.wait(
        "the files of the killed fusion are finished and reported",
        |_| {
            let output = stage.live.fusion.as_ref().unwrap().output();
            !first.join("run.lock").exists() && output.contains("were completed")
        },
    );
    let lines = std::fs::read_to_string(first.join("poses.jsonl")).unwrap();
    assert!(lines.lines().count() > PEOPLE * RATE_HZ as usize);
    for line in lines.lines() {
        serde_json::from_str::<serde_json::Value>(line).unwrap();
    }
    for entry in first.read_dir().unwrap() {
        let path = entry.unwrap().path();
        assert!(path.extension().is_none_or(|e| e != "tmp"), "{path:?}");
    }
}
