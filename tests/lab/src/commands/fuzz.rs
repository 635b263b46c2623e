//! Inputs of the fuzz targets. `lab fuzz-seeds` writes complete inputs of binary formats, which a fuzzer would take long to
//! find; run it again when a format changes. `lab fuzz-corpus` copies the corpus between its archive, which is under version
//! control, and the folder of the fuzzers.

use std::collections::BTreeMap;
use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
use farfield_edge::ring::record::{Label, put_record, records, segment_head};
use farfield_fusion::recording::reader::Recording;
use farfield_fusion::recording::writer::{Head, PassedMessage, RecordingWriter};
use farfield_fusion::recording::{CALIBRATION_FILE, VENUE_FILE};
use farfield_node::process::NodeError;
use farfield_proto::bounding_box::{BoundingBox, BoxRate};
use farfield_proto::grid::CellGrid;
use farfield_proto::id::{CameraIndex, PersonId, SessionId, ViewpointIndex};
use farfield_proto::message::decision::{Decision, UsedSet};
use farfield_proto::message::fill::{FillRequest, Filled, SetKind, StoredSet};
use farfield_proto::message::handout::{
    Chunk, FileKind, FileList, HandoutRequest, ListSignature, SharedFile, SignedList,
};
use farfield_proto::message::health::NodeHealth;
use farfield_proto::message::identity_event::{
    Change, DropReason, IdentityEvent, IdentityEventSet, Likeness,
};
use farfield_proto::message::live::{BoxEcho, LiveBoxes, LiveStatus, PatchTiming};
use farfield_proto::message::naming::{BodyLikeness, Finding, Naming, NamingSet};
use farfield_proto::message::thumbnail::Thumbnail;
use farfield_proto::message::{
    BoxSet, CameraBox, KeypointPeak, Order, PatchSet, PersonBoxes, PersonPatch, PersonPose,
    PersonState, PoseSet, Sighting, SightingSet, Status,
};
use farfield_proto::patch::{CompressionLevel, Decoder, EncodedMaps, Encoder, Maps};
use farfield_proto::tick::Tick;
use farfield_proto::wire::{self, Message};

use crate::corpus;

const SESSION: SessionId = SessionId(1 << 63);
const TICK: Tick = Tick(300);
const VIEWPOINT: ViewpointIndex = ViewpointIndex(0);

/// Arguments of `lab fuzz-seeds`.
#[derive(Debug, clap::Args)]
pub(super) struct FuzzSeedsArgs {
    /// The folder of all corpora: `fuzz/corpus` of a checkout.
    #[arg(value_name = "DIR")]
    corpus: PathBuf,
}

/// Writes the seeds of every target.
///
/// # Errors
/// Names the file that cannot be written, and a seed that does not read back.
pub(super) fn write_seeds(args: &FuzzSeedsArgs) -> Result<(), NodeError> {
    write_all(&args.corpus).map_err(NodeError::Failed)
}

fn write_all(corpus: &Path) -> anyhow::Result<()> {
    for (name, encoded) in patches()? {
        // The layout that `arbitrary` reads for (u16, u16, u8, &[u8]).
        let mut seed = encoded.width.to_le_bytes().to_vec();
        seed.extend(encoded.height.to_le_bytes());
        seed.push(encoded.keypoints);
        seed.extend(&encoded.bytes);
        write(corpus, "patch_decode", &name, &seed)?;
    }
    let messages = messages()?;
    // The first byte is the kind, as the target counts them.
    for (kind, (name, bytes)) in (0u8..).zip(&messages) {
        write(corpus, "wire_decode", name, &[&[kind], &bytes[..]].concat())?;
    }
    let recording = recording(&messages)?;
    write(corpus, "recording_file", "whole", &recording)?;
    let torn = &recording[..recording.len() * 3 / 4];
    ensure!(Recording::open(Cursor::new(torn)).is_ok(), "torn too early");
    write(corpus, "recording_file", "torn", torn)?;
    write(
        corpus,
        "ring_segment",
        "three_records",
        &segment(&messages)?,
    )
}

fn write(corpus: &Path, target: &str, name: &str, seed: &[u8]) -> anyhow::Result<()> {
    let folder = corpus.join(target);
    fs::create_dir_all(&folder)?;
    let path = folder.join(name);
    fs::write(&path, seed).with_context(|| format!("writing {}", path.display()))
}

/// Two peaks, a smear and an empty map, at several compression levels.
fn patches() -> anyhow::Result<Vec<(String, EncodedMaps)>> {
    let mut maps = Maps::new(24, 32, 4);
    let peaks = [
        (0, 8.0, 9.5, 1.5),
        (1, 5.0, 20.0, 1.5),
        (1, 17.0, 12.0, 2.0),
        (2, 12.0, 16.0, 6.0),
    ];
    for (k, x, y, sigma) in peaks {
        for (at, cell) in maps.cells_mut(k).iter_mut().enumerate() {
            let (dx, dy) = ((at % 24) as f32 - x, (at / 24) as f32 - y);
            let value = 0.9 * (-(dx * dx + dy * dy) / (2.0 * sigma * sigma)).exp();
            *cell = (*cell).max(farfield_proto::patch::quantize(value));
        }
    }
    let mut encoder = Encoder::new();
    let mut all = vec![("lossless".to_owned(), encoder.encode_above(&maps, 0))];
    for level in CompressionLevel::all().step_by(4) {
        let name = format!("quality_{}", level.number());
        all.push((name, encoder.encode(&maps, level)));
    }
    for (name, encoded) in &all {
        let decoded = Decoder::new().decode(encoded, &mut Maps::default());
        decoded.with_context(|| name.clone())?;
    }
    Ok(all)
}

fn whole<M: Message>(name: &'static str, message: &M) -> anyhow::Result<(&'static str, Vec<u8>)> {
    let bytes = wire::encode(message);
    wire::decode::<M>(&bytes).context(name)?;
    Ok((name, bytes))
}

/// One message of each kind, in the order of the fuzz target.
fn messages() -> anyhow::Result<Vec<(&'static str, Vec<u8>)>> {
    let patches = patch_set()?;
    let used = UsedSet {
        viewpoint: VIEWPOINT,
        part: 0,
    };
    let decision = Decision {
        session: SESSION,
        first: Tick(290),
        tick: TICK,
        horizons_ticks: vec![1.5],
        patches: vec![used],
        sightings: Vec::new(),
    };
    let request = FillRequest {
        session: SESSION,
        from: TICK,
        to: Tick(400),
        max_bytes: 4096,
    };
    let filled = Filled {
        to: Tick(301),
        stored: vec![StoredSet {
            kind: SetKind::Patches,
            bytes: wire::encode(&patches),
        }],
    };
    let file = |kind, path: &str| SharedFile {
        kind,
        path: path.to_owned(),
        bytes: 70_000,
        blake3: [7; 32],
    };
    let list = FileList {
        venue: "hall".to_owned(),
        files: vec![
            file(FileKind::Venue, ""),
            file(FileKind::Calibration, "calibration.toml"),
        ],
    };
    let signed = SignedList {
        list: wire::encode(&list),
        signature: Some(ListSignature {
            certificate: vec![0x30; 40],
            ecdsa: vec![0x30; 70],
        }),
    };
    let chunk = Chunk {
        bytes: b"name = \"hall\"\n".to_vec(),
    };
    Ok(vec![
        whole("patches", &patches)?,
        whole("boxes", &box_set())?,
        whole("sightings", &sighting_set())?,
        whole("poses", &pose_set())?,
        whole("status", &status())?,
        whole("decision", &decision)?,
        whole("fill_request", &request)?,
        whole("filled", &filled)?,
        whole(
            "handout_request",
            &HandoutRequest::Chunk {
                file: 1,
                from: 65_536,
            },
        )?,
        whole("file_list", &list)?,
        whole("signed_list", &signed)?,
        whole("chunk", &chunk)?,
        whole("identity_events", &identity_events())?,
        whole("thumbnail", &thumbnail())?,
        whole("namings", &namings())?,
    ])
}

/// The head of an image of 320 x 180, and its end.
fn thumbnail() -> Thumbnail {
    let head = [
        0xff, 0xd8, 0xff, 0xe0, 0, 4, 1, 2, 0xff, 0xc0, 0, 11, 8, 0, 180, 1, 64, 1, 1, 0x11, 0,
    ];
    Thumbnail {
        session: SESSION,
        tick: TICK,
        viewpoint: VIEWPOINT,
        camera: CameraIndex(3),
        jpeg: [&head[..], &[0xff, 0xd9]].concat(),
    }
}

fn namings() -> NamingSet {
    let why = BodyLikeness {
        lengths_sigma: 0.75,
        log_ratio: 6.5,
        margin: Some(4.0),
    };
    let finding = Finding::Named {
        subject: "Žofia".to_owned(),
        why,
    };
    let person = PersonId(7);
    NamingSet {
        session: SESSION,
        tick: TICK,
        namings: vec![Naming { person, finding }],
    }
}

fn identity_events() -> IdentityEventSet {
    let why = Likeness {
        distance_m: 0.5,
        absence_s: 3.0,
        lengths_sigma: 1.25,
        log_ratio: 4.0,
        margin: Some(5.5),
    };
    let event = |change| IdentityEvent {
        person: PersonId(7),
        wire_id: PersonId(9),
        change,
    };
    let old = PersonId(3);
    let reason = DropReason::OneView { missing_s: 5.0 };
    IdentityEventSet {
        session: SESSION,
        tick: TICK,
        events: vec![
            event(Change::Recognise { old, why }),
            event(Change::Drop { reason }),
        ],
    }
}

fn patch_set() -> anyhow::Result<PatchSet> {
    let (_, maps) = patches()?.pop().context("there are patches")?;
    let crop = CellGrid {
        origin_px: [10.0, 20.5],
        step_px: [4.0, 0.25],
        width: 24,
        height: 32,
    };
    let patch = PersonPatch {
        person: PersonId(7),
        camera: CameraIndex(3),
        box_tick: Tick(299),
        capture_offset_us: -120,
        crops: vec![crop],
        crop_of_keypoint: vec![0; 4],
        maps,
    };
    Ok(PatchSet {
        session: SESSION,
        tick: TICK,
        viewpoint: VIEWPOINT,
        part: 0,
        parts: 1,
        sighting_parts: 1,
        timing: Some(PatchTiming {
            sent_after_us: 9_000,
            clock_correction_us: -20_000,
            echo: Some(BoxEcho {
                sequence: 299,
                held_us: 4_000,
            }),
        }),
        persons: vec![patch],
    })
}

fn box_set() -> BoxSet {
    let camera = CameraBox {
        camera: CameraIndex(3),
        bounding_box: BoundingBox {
            center_px: [100.0, 200.0],
            size_px: [50.0, 90.0],
            rotation_rad: 0.5,
        },
        rate: BoxRate {
            center_px: [1.0, -1.0],
            size_px: [0.0, 0.5],
            rotation_rad: 0.0,
        },
        torso_px: [100.0, 210.0],
        neck_px: [101.0, 170.0],
    };
    BoxSet {
        session: SESSION,
        tick: TICK,
        viewpoint: VIEWPOINT,
        part: 0,
        parts: 1,
        order: Order::Track,
        live: Some(LiveBoxes {
            sequence: 300,
            epoch_us: 1_700_000_000_000_000,
            clock_correction_us: Some(-20_000),
            heard: None,
            every_nth_tick: 2,
        }),
        detection_cameras: vec![CameraIndex(0), CameraIndex(3)],
        persons: vec![PersonBoxes {
            person: PersonId(7),
            cameras: vec![camera],
        }],
    }
}

fn sighting_set() -> SightingSet {
    let peak = KeypointPeak {
        position_px: [1.5, -2.0],
        score: 0.75,
    };
    let in_full = Sighting {
        camera: CameraIndex(0),
        score: 1.0,
        keypoints: vec![Some(peak), None],
    };
    SightingSet {
        session: SESSION,
        tick: TICK,
        viewpoint: VIEWPOINT,
        part: 0,
        parts: 1,
        sightings: vec![in_full.clone().snapped(), in_full],
    }
}

fn pose_set() -> PoseSet {
    PoseSet {
        session: SESSION,
        tick: TICK,
        persons: vec![PersonPose {
            person: PersonId(7),
            state: PersonState::Tracked,
            joints_m: vec![[0.0, 0.5, 1.0]],
            keypoints_m: vec![[1.0, -0.5, 2.0]],
            sigma_m: vec![0.015_625],
            angles: vec![0.25],
            unobserved: 1 << 39,
            views: 4,
        }],
    }
}

fn status() -> Status {
    Status {
        node: "north".to_owned(),
        process: 129,
        viewpoint: Some(VIEWPOINT),
        release: String::new(),
        ready: true,
        venue_hash: "ab".to_owned(),
        calibration_hash: "cd".to_owned(),
        network_hash: String::new(),
        backend: String::new(),
        ticks: Some([TICK, Tick(400)]),
        tick: Some(TICK),
        unreadable: 0,
        failure: None,
        stages: Vec::new(),
        live: Some(LiveStatus {
            every_nth_tick: 1,
            ..LiveStatus::default()
        }),
        health: NodeHealth::default(),
        agreement: Vec::new(),
    }
}

/// A recording with a message of each kind that it contains.
fn recording(messages: &[(&str, Vec<u8>)]) -> anyhow::Result<Vec<u8>> {
    let facts = [("venue", "hall"), ("viewpoints", "north")];
    let file = |name: &str| (name.to_owned(), b"name = \"hall\"\n".to_vec());
    let head = Head {
        venue: "hall".to_owned(),
        viewpoints: vec!["north".to_owned()],
        rate_hz: 60.0,
        started_ns: 1,
        files: vec![file(VENUE_FILE), file(CALIBRATION_FILE)],
        facts: BTreeMap::from(facts.map(|(key, value)| (key.to_owned(), value.to_owned()))),
        json_poses: None,
    };
    let mut writer = RecordingWriter::create(Vec::new(), head)?;
    let topics = [
        "hall/patch/north",
        "hall/box/north",
        "hall/sighting/north",
        "hall/pose",
        "hall/status/north",
        "hall/decision",
    ];
    for (topic, (name, bytes)) in topics.into_iter().zip(messages) {
        let passed = PassedMessage {
            topic,
            bytes,
            log_ns: 1_000,
        };
        writer.write(&passed)?.with_context(|| (*name).to_owned())?;
        writer.flush()?;
    }
    let bytes = writer.finish()?;
    let read = Recording::open(Cursor::new(&bytes[..]))?;
    ensure!(
        read.end().whole && read.unreadable() == 0,
        "it is not whole"
    );
    Ok(bytes)
}

/// A segment of a ring with sets of two ticks.
fn segment(messages: &[(&str, Vec<u8>)]) -> anyhow::Result<Vec<u8>> {
    let mut bytes = segment_head(3).to_vec();
    for (tick, kind, at) in [
        (300, SetKind::Sightings, 2),
        (300, SetKind::Patches, 0),
        (301, SetKind::Patches, 0),
    ] {
        let label = Label {
            session: SESSION,
            tick: Tick(tick),
            kind,
        };
        let (_, message) = messages.get(at).context("there is one of each kind")?;
        put_record(label, message, &mut bytes);
    }
    ensure!(records(&bytes).0.len() == 3, "not all come back");
    Ok(bytes)
}

/// Arguments of `lab fuzz-corpus`.
#[derive(Debug, clap::Args)]
pub(super) struct CorpusArgs {
    #[command(subcommand)]
    direction: CorpusCommand,
    /// The folder of all corpora, as `cargo fuzz` uses it.
    #[arg(long, global = true, value_name = "DIR", default_value = "fuzz/corpus")]
    folder: PathBuf,
    /// The archive.
    #[arg(
        long,
        global = true,
        value_name = "FILE",
        default_value = "fuzz/corpus.tar"
    )]
    archive: PathBuf,
}

/// Direction of the copy.
#[derive(Clone, Copy, Debug, clap::Subcommand)]
enum CorpusCommand {
    /// Write the archive's inputs to the folder.
    Unpack,
    /// Write the folder's inputs with different behaviour to the archive.
    Pack,
}

/// Packs or unpacks.
///
/// # Errors
/// Names the file or folder that cannot be read or written.
pub(super) fn corpus(args: &CorpusArgs) -> Result<(), NodeError> {
    let done = match args.direction {
        CorpusCommand::Unpack => unpack(&args.archive, &args.folder),
        CorpusCommand::Pack => pack(&args.folder, &args.archive),
    };
    done.map_err(NodeError::Failed)
}

fn unpack(archive: &Path, folder: &Path) -> anyhow::Result<()> {
    let bytes = fs::read(archive).with_context(|| archive.display().to_string())?;
    let corpus = corpus::read(&bytes).with_context(|| archive.display().to_string())?;
    for ((target, name), bytes) in &corpus {
        let folder = folder.join(target);
        fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        let path = folder.join(name);
        fs::write(&path, bytes).with_context(|| path.display().to_string())?;
    }
    println!("{} inputs in {}", corpus.len(), folder.display());
    Ok(())
}

fn pack(folder: &Path, archive: &Path) -> anyhow::Result<()> {
    let all = corpus::read_folder(folder)?;
    let minimal = corpus::minimised(&all);
    let bytes = corpus::archive(&minimal)?;
    fs::write(archive, &bytes).with_context(|| archive.display().to_string())?;
    println!(
        "{} of {} inputs, {} bytes, in {}",
        minimal.len(),
        all.len(),
        bytes.len(),
        archive.display()
    );
    Ok(())
}
