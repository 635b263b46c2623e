//! Pose files on full or hanging disks. Making such disks needs root.

use std::fs;
use std::path::PathBuf;
use std::process::{Child, Command};

use farfield_fusion::export::fixture;
use farfield_fusion::export::summary::Summary;
use farfield_proto::message::PersonState::Tracked;
use farfield_proto::tick::Tick;

use super::super::summary_file::SummaryFile;
use super::*;
use crate::live::tests::venue;

/// Far more than a loaded machine delays one thread, and far less than the disk hangs here.
const AT_ONCE: Duration = Duration::from_millis(500);
const PEOPLE: [(u32, farfield_proto::message::PersonState); 2] = [(1, Tracked), (2, Tracked)];
const TICKS: i64 = 1500;

/// A mounted disk, unmounted on drop.
struct Disk {
    at: PathBuf,
    _folder: tempfile::TempDir,
}

impl Disk {
    /// A disk of one MiB, mostly filled by another file.
    ///
    /// # Errors
    /// The disk cannot be mounted.
    fn small() -> Result<Self, String> {
        let disk = Self::mount(|_| vec!["-t", "tmpfs", "-o", "size=1m", "tmpfs"])?;
        fs::write(disk.ballast(), vec![1; 700 << 10]).unwrap();
        Ok(disk)
    }

    /// A disk that can be made to hang.
    ///
    /// # Errors
    /// The disk cannot be mounted.
    fn freezable() -> Result<Self, String> {
        Self::mount(|image| {
            fs::File::create(image).unwrap().set_len(16 << 20).unwrap();
            drop(run(Command::new("mkfs.ext4").arg("-q").arg(image)));
            vec!["-o", "loop", image]
        })
    }

    fn mount(options: impl Fn(&'static str) -> Vec<&'static str>) -> Result<Self, String> {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path().join("disk");
        fs::create_dir(&at).unwrap();
        let image = folder.path().join("image").display().to_string();
        let mut mount = Command::new("mount");
        run(mount.args(options(image.leak())).arg(&at))?;
        Ok(Self {
            at,
            _folder: folder,
        })
    }

    fn ballast(&self) -> PathBuf {
        self.at.join("ballast")
    }

    /// Freezes the disk for this time. Another process unfreezes it, even if the test fails.
    fn freeze(&self, seconds: u32) -> Child {
        let script = format!("fsfreeze -f \"$0\" && sleep {seconds}; fsfreeze -u \"$0\"");
        let mut freeze = Command::new("sh");
        let child = freeze.args(["-c", &script]).arg(&self.at).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(300));
        child
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        drop(run(Command::new("umount").arg("-l").arg(&self.at)));
    }
}

fn run(command: &mut Command) -> Result<(), String> {
    let output = command.output().map_err(|error| error.to_string())?;
    if output.status.success() {
        Ok(())
    } else {
        Err(String::from_utf8_lossy(&output.stderr).trim().to_owned())
    }
}

/// The disk, or a line that the test is skipped.
fn or_skip(disk: Result<Disk, String>) -> Option<Disk> {
    disk.map_err(|reason| println!("SKIPPED: no disk of our own: {reason}"))
        .ok()
}

fn start(disk: &Disk, mode: RunMode) -> ExportThread {
    let keypoints = KeypointSet::coco17();
    ExportThread::start(&disk.at, &venue(), &keypoints, mode).unwrap()
}

/// Hands over these ticks; returns the longest time for one.
fn hand_over(
    exporter: &mut ExportThread,
    ticks: std::ops::Range<i64>,
    pause: Duration,
) -> Duration {
    let took = ticks.map(|tick| {
        std::thread::sleep(pause);
        let start = clock::now();
        exporter.write(vec![fixture::poses(tick, &PEOPLE)], Vec::new());
        clock::now().duration_since(start)
    });
    took.max().unwrap_or_default()
}

/// The number of ticks in `poses.jsonl` with all people. Checks that each line is complete, and that every other file has the
/// number of rows in its header.
fn whole_ticks(disk: &Disk) -> u64 {
    let read = |name: &str| fs::read_to_string(disk.at.join(name)).unwrap();
    let lines = read("poses.jsonl");
    assert!(lines.ends_with('\n'));
    let ticks: Vec<Tick> = lines
        .lines()
        .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap())
        .map(|pose| Tick(pose["tick"].as_i64().unwrap()))
        .collect();
    let whole = ticks.chunks(PEOPLE.len());
    let expected = (0..).map(Tick);
    assert!(
        whole
            .clone()
            .zip(expected)
            .all(|(lines, tick)| lines[0] == tick)
    );
    for (person, _) in PEOPLE {
        let trc = read(&format!("poses_{person}.trc"));
        let header = trc.lines().nth(2).unwrap().split('\t').nth(2).unwrap();
        assert_eq!(header, (trc.lines().count() - 5).to_string());
        let mot = read(&format!("angles_{person}.mot"));
        let header = mot.lines().find_map(|line| line.strip_prefix("nRows="));
        let rows = mot.lines().skip_while(|line| *line != "endheader").count() - 2;
        assert_eq!(header.unwrap(), rows.to_string());
        assert!(trc.ends_with('\n') && mot.ends_with('\n'));
    }
    let names = fs::read_dir(&disk.at).unwrap();
    let mut names = names.map(|entry| entry.unwrap().file_name());
    assert!(names.all(|name| !name.to_string_lossy().ends_with(".tmp")));
    whole.filter(|ticks| ticks.len() == PEOPLE.len()).count() as u64
}

fn wait_until(mut done: impl FnMut() -> bool) {
    let patience = clock::now() + Duration::from_secs(40);
    while !done() {
        assert!(clock::now() < patience);
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn a_live_run_waits_for_a_full_disk_and_loses_nothing() {
    let Some(disk) = or_skip(Disk::small()) else {
        return;
    };
    let mut exporter = start(&disk, RunMode::Live);
    let longest = hand_over(&mut exporter, 0..TICKS, Duration::ZERO);
    wait_until(|| exporter.shared.disk.notice().is_some());
    let while_full = hand_over(&mut exporter, TICKS..TICKS + 60, Duration::ZERO);
    assert!(
        longest.max(while_full) < AT_ONCE,
        "{longest:?} {while_full:?}"
    );
    fs::remove_file(disk.ballast()).unwrap();
    run(Command::new("mount")
        .args(["-o", "remount,size=8m"])
        .arg(&disk.at))
    .unwrap();
    wait_until(|| exporter.shared.disk.notice().is_none());
    let exported = exporter.finish(Vec::new(), Vec::new()).unwrap();
    assert_eq!(exported.poses, None);
    assert_eq!(whole_ticks(&disk), TICKS as u64 + 60);
}

#[test]
fn a_full_disk_leaves_complete_files_and_a_correct_summary() {
    for mode in [RunMode::Live, RunMode::LockStep] {
        let Some(disk) = or_skip(Disk::small()) else {
            return;
        };
        let mut summary = SummaryFile::in_folder(&disk.at);
        summary.reserve().unwrap();
        let mut exporter = start(&disk, mode);
        hand_over(&mut exporter, 0..TICKS, Duration::ZERO);
        match mode {
            RunMode::Live => wait_until(|| exporter.shared.disk.notice().is_some()),
            RunMode::LockStep => wait_until(|| exporter.has_failed()),
        }
        // The rest of the disk is filled: completion must not need any.
        let mut last = fs::File::create(disk.at.join("last")).unwrap();
        drop(std::io::copy(&mut std::io::repeat(1), &mut last));
        let exported = exporter.finish(Vec::new(), Vec::new()).unwrap();
        let missing = exported.poses.unwrap();
        let failure = missing.failure.clone().unwrap();
        assert!(failure.contains("No space left"), "{failure}");
        let whole = whole_ticks_without(&disk, "summary.json.tmp");
        assert!(whole > 100, "{whole}");
        assert_eq!(whole + missing.unwritten_ticks, TICKS as u64);
        let mut expected = Summary::default();
        expected.timing.poses = Some(missing);
        summary.put(expected.clone()).unwrap();
        summary.finish(None).unwrap();
        let read = fs::read_to_string(disk.at.join("summary.json")).unwrap();
        assert_eq!(read, expected.to_json());
    }
}

/// [`whole_ticks`] while the summary is `unfinished`.
fn whole_ticks_without(disk: &Disk, unfinished: &str) -> u64 {
    let (from, to) = (disk.at.join(unfinished), disk.at.join("elsewhere"));
    fs::rename(&from, &to).unwrap();
    let whole = whole_ticks(disk);
    fs::rename(&to, &from).unwrap();
    whole
}

#[test]
fn a_live_run_is_not_delayed_by_a_hanging_disk() {
    // Symptom to prevent: the core wrote its files itself, and there were no poses while the disk hung.
    let Some(disk) = or_skip(Disk::freezable()) else {
        return;
    };
    let mut exporter = start(&disk, RunMode::Live);
    let tick = Duration::from_micros(16_667);
    hand_over(&mut exporter, 0..30, tick);
    let mut frozen = disk.freeze(3);
    let longest = hand_over(&mut exporter, 30..210, tick);
    println!("longest time to hand over a tick while the disk hung: {longest:?}");
    assert!(longest < AT_ONCE);
    assert!(frozen.wait().unwrap().success());
    let exported = exporter.finish(Vec::new(), Vec::new()).unwrap();
    assert_eq!(exported.poses, None);
    assert_eq!(whole_ticks(&disk), 210);
}

#[test]
fn a_run_without_a_tick_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let discard = |exporter: ExportThread| exporter.discard().unwrap();
    for give_up in [drop::<ExportThread>, discard] {
        let keypoints = KeypointSet::coco17();
        let mode = RunMode::LockStep;
        give_up(ExportThread::start(folder.path(), &venue(), &keypoints, mode).unwrap());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
