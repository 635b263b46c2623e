//! Real faults, one after the other, and the report on each. Faults that need a process of their own (another ONNX
//! Runtime, a full disk) are scenarios.

use std::ffi::OsString;
use std::net::{TcpListener, UdpSocket};
use std::os::unix::fs::PermissionsExt as _;

use farfield_proto::message::health::SystemClock;

use self::keys::keys_report;
use super::disk::{check_disk, judge_rate, judge_room};
use super::inference::judge_people;
use super::machine::{MachineFacts, check_machine};
use super::*;
use crate::report_lines::Verdict::{self, Failed, Warning};
use crate::status::NodeInShort;

mod keys;

const NOW_S: i64 = 1_790_000_000;

/// A venue in `folder` with `more` in its file.
fn venue(folder: &Path, more: &str) -> Venue {
    let calibration = include_str!("../../calibration.sample.toml");
    std::fs::write(folder.join("calibration.toml"), calibration).unwrap();
    let text = format!(
        "name = \"hall\"\nrate_hz = 60.0\ncalibration = \"calibration.toml\"\n{more}\n\
         [[viewpoint]]\nname = \"sw\"\n[[viewpoint.camera]]\nname = \"sw\"\n\
         source = {{ kind = \"keypoints\", path = \"sw.jsonl\" }}\n"
    );
    let path = folder.join("venue.toml");
    std::fs::write(&path, text).unwrap();
    load_venue(&path).unwrap()
}

/// Writes a program that prints `output` and ends with `code`.
fn program(folder: &Path, name: &str, output: &str, code: i32) {
    let path = folder.join(name);
    std::fs::write(&path, format!("#!/bin/sh\necho '{output}'\nexit {code}\n")).unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
}

/// Writes a program that hangs.
fn hanging_program(folder: &Path, name: &str) {
    let path = folder.join(name);
    std::fs::write(&path, "#!/bin/sh\nexec /bin/sleep 60\n").unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
}

/// The report on the programs in `folder`.
fn programs_in(folder: &Path) -> ReportLines {
    let mut report = ReportLines::default();
    programs::check_programs(folder.as_os_str(), ProgramNeed::Video, &mut report);
    report
}

fn clock_report(clock: SystemClock, now_s: i64) -> ReportLines {
    let mut report = ReportLines::default();
    machine::check_clock(&clock, now_s, None, &mut report);
    report
}

/// The report on the ports of a venue whose fusion listens at `endpoint`.
fn ports_report(endpoint: &str, more: &str) -> ReportLines {
    ports_report_while(VenueRuns::No, endpoint, more)
}

fn ports_report_while(runs: VenueRuns, endpoint: &str, more: &str) -> ReportLines {
    let folder = tempfile::tempdir().unwrap();
    let text = format!("[fusion]\nlisten = [\"{endpoint}\"]\n{more}");
    let mut report = ReportLines::default();
    let venue = venue(folder.path(), &text);
    ports::check_ports(Some(&venue), runs, &mut report);
    report
}

fn disk_report(folder: &Path) -> ReportLines {
    let mut report = ReportLines::default();
    check_disk(folder, DiskNeed::for_venue(None), &mut report);
    report
}

fn judged(judge: impl FnOnce(&mut ReportLines)) -> ReportLines {
    let mut report = ReportLines::default();
    judge(&mut report);
    report
}

fn machine_report(facts: MachineFacts) -> ReportLines {
    judged(|report| check_machine(&facts, report))
}

const SYNCHRONISED: SystemClock = SystemClock {
    synchronised: true,
    max_error_us: Some(800),
    ahead_us: 0,
};
const FINE: MachineFacts = MachineFacts {
    cores: 8,
    free_bytes: Some(8 << 30),
    is_wide: true,
};

/// A fault, the report on it, and the expected line: verdict, part of the text, part of the remedy.
type Case<'a> = (&'a str, ReportLines, (Verdict, &'a str, &'a str));

/// Checks that the report of each case has the expected line.
fn check(cases: Vec<Case<'_>>) {
    let mut faults = Vec::new();
    for (what, report, (verdict, text, remedy)) in cases {
        let is_found = report.lines().iter().any(|line| {
            line.verdict == verdict && line.text.contains(text) && line.remedy.contains(remedy)
        });
        if !is_found {
            faults.push(format!("{what}: {:#?}", report.lines()));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn programs_that_are_missing_old_or_broken_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| {
        let path = folder.path().join(name);
        std::fs::create_dir(&path).unwrap();
        path
    };
    let (none, one, old, broken) = (at("none"), at("one"), at("old"), at("broken"));
    let hanging = at("hanging");
    hanging_program(&hanging, "ffmpeg");
    let of_hanging = programs_in(&hanging);
    program(&one, "ffmpeg", "ffmpeg version 6.0 Copyright", 0);
    for name in ["ffmpeg", "ffprobe"] {
        program(
            &old,
            name,
            &format!("{name} version 4.2.7-0ubuntu0.1 Copyright"),
            0,
        );
        program(&broken, name, "", 127);
    }
    let remedy = "apt install ffmpeg";
    check(vec![
        (
            "no ffmpeg",
            programs_in(&none),
            (Failed, "`ffmpeg` cannot be started", remedy),
        ),
        (
            "no ffprobe",
            programs_in(&one),
            (Failed, "`ffprobe` cannot be started", remedy),
        ),
        (
            "an old ffmpeg",
            programs_in(&old),
            (Failed, "ffmpeg 4.2.7-0ubuntu0.1, expected 5.1", remedy),
        ),
        (
            "a broken ffmpeg",
            programs_in(&broken),
            (Failed, "no version", remedy),
        ),
        (
            "an ffmpeg that hangs",
            of_hanging,
            (
                Failed,
                "`ffmpeg -version` gave no answer within 1 s",
                remedy,
            ),
        ),
    ]);
}

#[test]
fn disks_that_cannot_be_written_are_full_or_slow_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    std::fs::write(&file, "").unwrap();
    let need = DiskNeed::for_venue(None);
    let room = |free: u64| judged(|it| judge_room("d", free, need, it));
    let slow = judged(|it| judge_rate("d", 2e6, need, it));
    check(vec![
        (
            "not writable",
            disk_report(Path::new("/proc/sys")),
            (Failed, "/proc/sys", "--out DIR"),
        ),
        (
            "a file, no folder",
            disk_report(&file),
            (Failed, "file", "--out DIR"),
        ),
        (
            "a full disk",
            room(40 << 20),
            (Failed, "are free", "delete recordings"),
        ),
        (
            "little space",
            room(3 << 30),
            (Warning, "hours", "delete recordings"),
        ),
        ("a slow disk", slow, (Warning, "2 MB/s", "faster disk")),
    ]);
}

#[test]
fn clocks_that_are_wrong_or_not_synchronised_are_found() {
    let free = SystemClock {
        synchronised: false,
        ..SYNCHRONISED
    };
    let rough = SystemClock {
        max_error_us: Some(900_000),
        ..SYNCHRONISED
    };
    let remedy = "timedatectl set-ntp true";
    check(vec![
        (
            "not synchronised",
            clock_report(free, NOW_S),
            (Warning, "not synchronised", remedy),
        ),
        (
            "far from its server",
            clock_report(rough, NOW_S),
            (Warning, "may be off by 900 ms", "chronyc makestep"),
        ),
        (
            "in 1970",
            clock_report(SYNCHRONISED, 1000),
            (Failed, "before the release", remedy),
        ),
    ]);
}

#[test]
fn endpoints_where_fusion_cannot_listen_are_found() {
    let tcp = TcpListener::bind("127.0.0.1:0").unwrap();
    let udp = UdpSocket::bind("127.0.0.1:0").unwrap();
    let tcp_endpoint = format!("tcp/{}", tcp.local_addr().unwrap());
    let udp_endpoint = format!("udp/{}", udp.local_addr().unwrap());
    let by_us = format!("(process {})", std::process::id());
    let open = "[security]\nallow_plaintext = true";
    let keys = "[security]\ncertificates = \"certs\"";
    let unknown_host = "quic/no-such-host.invalid:7447";
    let remedy = "[fusion] listen";
    check(vec![
        (
            "a port that is taken",
            ports_report(&tcp_endpoint, ""),
            (Failed, &by_us, "kill"),
        ),
        (
            "taken, of datagrams",
            ports_report(&udp_endpoint, ""),
            (Failed, "is taken by", "another port"),
        ),
        (
            "another machine's",
            ports_report("tcp/192.0.2.1:7447", open),
            (Warning, "not an address of this", remedy),
        ),
        (
            "an unknown host",
            ports_report(unknown_host, keys),
            (Failed, "does not exist", remedy),
        ),
        (
            "plain text",
            ports_report("tcp/0.0.0.0:7447", ""),
            (Failed, "not encrypted", "farfield certs"),
        ),
    ]);
}

#[test]
fn the_port_of_a_running_venue_is_no_fault() {
    let tcp = TcpListener::bind("127.0.0.1:0").unwrap();
    let endpoint = format!("tcp/{}", tcp.local_addr().unwrap());
    let report = ports_report_while(VenueRuns::Now, &endpoint, "");
    let lines: Vec<_> = report.lines().iter().collect();
    assert_eq!(lines.len(), 1, "{lines:#?}");
    assert_eq!(lines[0].verdict, Verdict::Ok, "{lines:#?}");
    assert!(lines[0].text.contains(&endpoint));
}

#[test]
fn machines_that_are_too_small_are_found() {
    let small = MachineFacts {
        free_bytes: Some(100 << 20),
        ..FINE
    };
    let old = MachineFacts {
        is_wide: false,
        ..FINE
    };
    check(vec![
        (
            "little memory",
            machine_report(small),
            (Failed, "0.1 GB of memory", "end other programs"),
        ),
        (
            "an old processor",
            machine_report(old),
            (Warning, "without AVX2", "processor"),
        ),
    ]);
}

#[test]
fn a_machine_without_faults_gives_no_false_alarm() {
    let folder = tempfile::tempdir().unwrap();
    let path: OsString = folder.path().into();
    for name in ["ffmpeg", "ffprobe"] {
        program(
            folder.path(),
            name,
            &format!("{name} version 5.1.9-0+deb12u1 Copyright"),
            0,
        );
    }
    let reports = [
        programs_in(Path::new(&path)),
        clock_report(SYNCHRONISED, NOW_S),
        ports_report("tcp/127.0.0.1:0", ""),
        keys_report([-1, 100], |_| {}),
        machine_report(FINE),
        judged(|it| judge_room("d", 500 << 30, DiskNeed::for_venue(None), it)),
        judged(|it| judge_rate("d", 100e6, DiskNeed::for_venue(None), it)),
    ];
    for report in reports {
        assert_eq!(report.verdict(), Verdict::Ok, "{:#?}", report.lines());
        assert!(!report.lines().is_empty());
    }
}

#[test]
fn a_venue_without_videos_does_not_need_ffmpeg() {
    let folder = tempfile::tempdir().unwrap();
    let mut report = ReportLines::default();
    let need = program_need(Some(&venue(folder.path(), "")));
    programs::check_programs(folder.path().as_os_str(), need, &mut report);
    assert_eq!(report.verdict(), Verdict::Warning);
}

#[test]
fn the_disk_check_leaves_no_files() {
    let folder = tempfile::tempdir().unwrap();
    let report = disk_report(&folder.path().join("not/there/yet"));
    assert_ne!(report.verdict(), Verdict::Failed, "{:#?}", report.lines());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn nodes_of_other_versions_and_faulty_nodes_are_reported() {
    let node = |name: &str, version: &str, trouble: Option<&str>| NodeInShort {
        name: name.to_owned(),
        version: version.to_owned(),
        trouble: trouble.map(str::to_owned),
    };
    let here = env!("CARGO_PKG_VERSION");
    let mut report = ReportLines::default();
    nodes::judge_nodes(
        "hall",
        &[
            node("fusion", here, None),
            node("north", "0.0.9", None),
            node("south", "", Some("not connected")),
        ],
        &mut report,
    );
    let texts: Vec<&str> = report
        .lines()
        .iter()
        .map(|line| line.text.as_str())
        .collect();
    let expected = [
        format!("nodes of venue hall that run farfield {here}, as this machine: fusion"),
        format!("north runs farfield 0.0.9, this machine {here}"),
        "south: not connected".to_owned(),
    ];
    assert_eq!(texts, expected);
    assert_eq!(report.count(Warning), 2);
}

#[test]
fn a_machine_that_is_too_slow_for_one_person_of_a_live_camera_fails() {
    let folder = tempfile::tempdir().unwrap();
    let recorded = venue(folder.path(), "");
    let mut live = venue(folder.path(), "");
    live.cameras[0].source = Source::V4l {
        device: "/dev/video0".into(),
        settings: farfield_proto::venue::DeviceSettings::default(),
    };
    // Edges plan with three quarters of the measured rate.
    for (venue, crops_per_s, expected) in [
        (&live, 79.0, Failed),
        (&live, 81.0, Verdict::Ok),
        (&recorded, 79.0, Verdict::Ok),
    ] {
        let mut report = ReportLines::default();
        judge_people(venue, crops_per_s, &mut report);
        let lines = report.lines();
        assert_eq!(report.verdict(), expected, "{crops_per_s}: {lines:?}");
    }
}
