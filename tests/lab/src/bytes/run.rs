//! Runs every codec in one scene or recording, over the same frames.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::Context as _;
use farfield_edge::pipeline::StandIn;
use farfield_fusion::body::skeleton::Joint;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::PoseSet;
use farfield_proto::order_statistics::value_after;
use farfield_score::lines::{LinesRole, PoseLines};
use farfield_score::matches_at;
use farfield_score::plot::{Layer, Plot, PlotAxis};
use farfield_score::points::{PointSet, ScoredBody};
use farfield_sim::scene::Scene;
use farfield_sim::simulated::in_memory::Input;
use nalgebra::Vector3;
use serde::Serialize;

use super::codec::{Codec, Rival, SentBytes};
use crate::in_process::InProcess;
use crate::suite::people::People;
use crate::suite::run::{SceneRun, SceneRunPlan, Traffic};

/// One packing of one codec in one scene or recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PackingRow {
    /// Its name.
    pub name: String,
    /// Whether it is our codec.
    pub ours: bool,
    /// Mean bytes of the maps of a person in a view at a tick.
    pub map_bytes: f64,
    /// The same with the rest of the message, divided by the persons in it; for our codec only.
    pub message_bytes: Option<f64>,
    /// The same with Zenoh; then TLS; then TCP and IP.
    pub framed_bytes: Option<[f64; 3]>,
    /// Errors of the poses.
    pub errors: Errors,
    /// Mean error above that with whole maps, millimetres.
    pub worse_mm: f64,
}

/// All codecs in one scene or recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Curve {
    /// The scene or recording.
    pub place: String,
    /// `maps`, `pixels` or `keypoints`.
    pub input: &'static str,
    /// Persons, views and ticks sent.
    pub patches: u64,
    /// Every packing.
    pub rows: Vec<PackingRow>,
}

/// One codec's run: errors and traffic.
struct CodecOutcome {
    codec: Codec,
    errors: Errors,
    traffic: Traffic,
    sent: SentBytes,
}

/// A factory of stand-ins (`None` for our codec), and their counter.
type StandIns = (
    Option<Arc<dyn Fn() -> Box<dyn StandIn>>>,
    Arc<Mutex<SentBytes>>,
);

fn stand_ins(codec: Codec) -> StandIns {
    let sent = Arc::new(Mutex::new(SentBytes::default()));
    if codec.level().is_some() {
        return (None, sent);
    }
    let counted = Arc::clone(&sent);
    let make = move || Box::new(Rival::new(codec, Arc::clone(&counted))) as Box<dyn StandIn>;
    (Some(Arc::new(make)), sent)
}

fn taken(sent: &Mutex<SentBytes>) -> SentBytes {
    sent.lock().unwrap_or_else(PoisonError::into_inner).clone()
}

impl Curve {
    /// Runs `scene` with every codec. Errors are those of the 12 limb joints of live poses, from the tick at which all runs have
    /// found the person.
    ///
    /// # Errors
    /// See [`SceneRun::make`].
    pub fn of_scene(
        name: &str,
        scene: &Arc<Scene>,
        input: &Input,
        codecs: &[Codec],
    ) -> anyhow::Result<Self> {
        let mut runs = Vec::new();
        for &codec in codecs {
            let (stand_in, sent) = stand_ins(codec);
            let mut plan = SceneRunPlan {
                stand_in,
                ..SceneRunPlan::default()
            };
            plan.parameters.link.quality = codec.level();
            let run = SceneRun::make(scene, input, plan)?;
            runs.push((codec, run, taken(&sent)));
        }
        let mut first_ticks = std::collections::BTreeMap::new();
        for (actor, tick) in runs.iter().flat_map(|(_, run, _)| run.first_ticks()) {
            let later = first_ticks.entry(actor).or_insert(tick);
            *later = tick.max(*later);
        }
        let outcomes = runs.into_iter().map(|(codec, run, sent)| CodecOutcome {
            codec,
            errors: Errors::measure(&run.causal, &run.truth_since(&first_ticks)),
            traffic: run.traffic,
            sent,
        });
        let input = match input {
            Input::Maps => "maps",
            Input::Pixels { .. } => "pixels",
        };
        Ok(Self::new(name, input, &outcomes.collect::<Vec<_>>()))
    }

    /// Runs the recording of a `venue` with a `truth` with every codec. Errors are those of the 14 points of the Shelf, of the
    /// final poses.
    ///
    /// # Errors
    /// A file is missing or wrong, or a run fails.
    pub fn of_recording(
        name: &str,
        venue: &Path,
        truth: &Path,
        codecs: &[Codec],
    ) -> anyhow::Result<Self> {
        let file = File::open(truth).with_context(|| format!("opening {}", truth.display()))?;
        let points = PointSet::Shelf14;
        let truth = PoseLines::read(BufReader::new(file), truth, LinesRole::Truth, points, None)?;
        let mut outcomes = Vec::new();
        for &codec in codecs {
            let (stand_in, sent) = stand_ins(codec);
            let mut nodes = InProcess::open(venue)?;
            if let Some(stand_in) = &stand_in {
                nodes.set_stand_in(&**stand_in);
            }
            if let Some(level) = codec.level() {
                nodes.set_compression_level(level);
            }
            let (mut people, mut traffic) = (People::new(), Traffic::default());
            while let Some(trace) = nodes.step()? {
                traffic.add(&trace.edges);
                for poses in &trace.finished {
                    add(&mut people, poses, nodes.keypoints());
                }
            }
            for poses in &nodes.finish() {
                add(&mut people, poses, nodes.keypoints());
            }
            let poses = PoseLines::from_people(points, people);
            outcomes.push(CodecOutcome {
                codec,
                errors: Errors::measure(&poses, &truth),
                traffic,
                sent: taken(&sent),
            });
        }
        Ok(Self::new(name, "keypoints", &outcomes))
    }

    /// Mean over curves with the same rows; the worst error is the worst of all.
    pub fn mean_of(curves: &[Self]) -> Option<Self> {
        let n = curves.len() as f64;
        let mut mean = curves.first()?.clone();
        mean.place = format!("mean of {}", curves.len());
        mean.patches = curves.iter().map(|c| c.patches).sum();
        for (i, row) in mean.rows.iter_mut().enumerate() {
            let rows = || curves.iter().filter_map(|curve| curve.rows.get(i));
            let mean_value =
                |value: &dyn Fn(&PackingRow) -> f64| rows().map(value).sum::<f64>() / n;
            row.map_bytes = mean_value(&|r| r.map_bytes);
            row.message_bytes = row
                .message_bytes
                .map(|_| mean_value(&|r| r.message_bytes.unwrap_or(0.0)));
            row.framed_bytes = row.framed_bytes.map(|_| {
                [0, 1, 2].map(|k| mean_value(&|r| r.framed_bytes.map_or(0.0, |framed| framed[k])))
            });
            row.worse_mm = mean_value(&|r| r.worse_mm);
            row.errors = Errors {
                mpjpe_mm: mean_value(&|r| r.errors.mpjpe_mm),
                p99_mm: mean_value(&|r| r.errors.p99_mm),
                worst_mm: rows().map(|r| r.errors.worst_mm).fold(0.0, f64::max),
                gaps: rows().map(|r| r.errors.gaps).sum(),
                switches: rows().map(|r| r.errors.switches).sum(),
            };
        }
        Some(mean)
    }

    fn new(place: &str, input: &'static str, outcomes: &[CodecOutcome]) -> Self {
        let whole = outcomes.iter().find(|o| o.codec == Codec::Whole);
        let whole_mm = whole.map_or(0.0, |o| o.errors.mpjpe_mm);
        let rows = outcomes.iter().flat_map(|outcome| outcome.rows(whole_mm));
        Self {
            place: place.to_owned(),
            input,
            patches: outcomes.first().map_or(0, |o| o.traffic.patches),
            rows: rows.collect(),
        }
    }
}

impl CodecOutcome {
    fn rows(&self, whole_mm: f64) -> Vec<PackingRow> {
        let traffic = &self.traffic;
        let a_patch = |bytes: u64| bytes as f64 / traffic.patches.max(1) as f64;
        let is_ours = self.codec.level().is_some();
        let sums = if is_ours {
            vec![traffic.map_bytes]
        } else {
            self.sent.bytes.clone()
        };
        let more = [ZENOH_BYTES, TLS_BYTES, TCP_IP_BYTES];
        let framed = || {
            let mut sum = traffic.message_bytes;
            more.map(|bytes| {
                sum += bytes * traffic.messages;
                a_patch(sum)
            })
        };
        let named = self.codec.packings().into_iter().zip(sums);
        named
            .map(|(name, sum)| PackingRow {
                name,
                ours: is_ours,
                map_bytes: a_patch(sum),
                message_bytes: is_ours.then(|| a_patch(traffic.message_bytes)),
                framed_bytes: is_ours.then(framed),
                errors: self.errors,
                worse_mm: self.errors.mpjpe_mm - whole_mm,
            })
            .collect()
    }
}

/// Adds the poses of a tick with the points of the Shelf's truth.
fn add(people: &mut People, poses: &PoseSet, keypoints: &KeypointSet) {
    let to_f64 = |p: &[f32; 3]| Vector3::from(p.map(f64::from));
    for pose in &poses.persons {
        let point = |name: &str| pose.keypoints_m.get(keypoints.index_of(name)?).map(to_f64);
        let joint = |name: &str| {
            let joint = Joint::from_name(name)?;
            pose.joints_m.get(joint.index()).map(to_f64)
        };
        let body = ScoredBody::gather(PointSet::Shelf14, point, joint);
        let at_tick = people.entry(poses.tick).or_default();
        at_tick.insert(pose.person.0, body);
    }
}

impl std::fmt::Display for Curve {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(
            f,
            "[{}] {}, {} persons x views x ticks; bytes of each",
            self.place, self.input, self.patches
        )?;
        write!(
            f,
            "{:>26} {:>9} {:>8} {:>7} {:>7} {:>7} {:>8} {:>7} {:>8} {:>8} {:>5} {:>4}",
            "",
            "maps",
            "message",
            "+Zenoh",
            "+TLS",
            "+TCP/IP",
            "MPJPE mm",
            "worse",
            "p99 mm",
            "worst mm",
            "gaps",
            "ids"
        )?;
        for row in &self.rows {
            let some =
                |bytes: Option<f64>| bytes.map_or_else(|| "-".to_owned(), |b| format!("{b:.1}"));
            let framed = [0, 1, 2].map(|i| some(row.framed_bytes.map(|framed| framed[i])));
            let [zenoh, tls, tcp] = framed;
            let e = &row.errors;
            write!(
                f,
                "\n{:>26} {:>9.1} {:>8} {zenoh:>7} {tls:>7} {tcp:>7} {:>8.2} {:>+7.2} {:>8.1} {:>8.1} {:>5} {:>4}",
                row.name,
                row.map_bytes,
                some(row.message_bytes),
                e.mpjpe_mm,
                row.worse_mm,
                e.p99_mm,
                e.worst_mm,
                e.gaps,
                e.switches
            )?;
        }
        Ok(())
    }
}

/// Errors of single points over a run, millimetres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Default)]
pub struct Errors {
    /// Mean over all points, people and ticks.
    pub mpjpe_mm: f64,
    /// 99th percentile.
    pub p99_mm: f64,
    /// The largest.
    pub worst_mm: f64,
    /// Truths without a pose.
    pub gaps: u64,
    /// Times that the id of a person's pose changed.
    pub switches: u64,
}

impl Errors {
    /// Errors of `poses` relative to `truth`.
    pub fn measure(poses: &PoseLines, truth: &PoseLines) -> Self {
        let mut all = Vec::new();
        let (mut gaps, mut switches) = (0, 0);
        let mut ids: BTreeMap<u32, u32> = BTreeMap::new();
        for tick in truth.ticks() {
            let matches = matches_at(tick, poses, truth);
            let Some(people) = truth.people_at(tick) else {
                continue;
            };
            for (actor, body) in people {
                let id = matches.get(actor);
                let pose = id.and_then(|id| poses.people_at(tick)?.get(id));
                let (Some(id), Some(pose)) = (id, pose) else {
                    gaps += 1;
                    continue;
                };
                let before = ids.insert(*actor, *id);
                switches += u64::from(before.is_some_and(|before| before != *id));
                all.extend(distances_mm(body, pose));
            }
        }
        all.sort_by(f64::total_cmp);
        Self {
            mpjpe_mm: all.iter().sum::<f64>() / all.len().max(1) as f64,
            p99_mm: value_after(&all, 0.99).unwrap_or(0.0),
            worst_mm: all.last().copied().unwrap_or(0.0),
            gaps,
            switches,
        }
    }
}

fn distances_mm<'a>(truth: &'a ScoredBody, pose: &'a ScoredBody) -> impl Iterator<Item = f64> + 'a {
    let pairs = truth.points_m.iter().zip(&pose.points_m);
    pairs.filter_map(|(truth, pose)| Some(1000.0 * ((*truth)? - (*pose)?).norm()))
}

/// Bytes that Zenoh adds to a message.
pub const ZENOH_BYTES: u64 = 15;
/// Bytes that TLS 1.3 adds to a record; each message is one record.
pub const TLS_BYTES: u64 = 22;
/// Bytes of the headers of TCP and IPv4 per segment.
pub const TCP_IP_BYTES: u64 = 52;

/// Range of bytes in the plot.
const RANGE_BYTES: [f64; 2] = [20.0, 300_000.0];
/// Points with an error above this factor of the least do not set the scale.
const SHOWN: f64 = 2.5;
/// Colours of other codecs, after that of ours.
const OTHER_COLOURS: usize = 7;

/// The curve of one scene or recording as an SVG document.
pub fn svg(curve: &Curve) -> String {
    let errors = curve.rows.iter().map(|row| row.errors.mpjpe_mm);
    let least = errors.clone().fold(f64::INFINITY, f64::min);
    let most = errors
        .filter(|&mm| mm <= SHOWN * least)
        .fold(least, f64::max);
    let margin = (0.1 * (most - least)).max(0.5);
    let range_mm = [(least - margin).max(0.0), most + margin];
    let at = |row: &PackingRow| {
        let bytes = row.map_bytes.clamp(RANGE_BYTES[0], RANGE_BYTES[1]);
        (bytes, row.errors.mpjpe_mm.clamp(range_mm[0], range_mm[1]))
    };
    let ours = curve.rows.iter().filter(|row| row.ours).map(at).collect();
    let line = Layer {
        name: "ours".to_owned(),
        lines: vec![ours],
        ..Layer::default()
    };
    let points = curve.rows.iter().enumerate().map(|(i, row)| Layer {
        name: format!("{} {:.0} B", row.name, row.map_bytes),
        colour: if row.ours { 0 } else { 1 + i % OTHER_COLOURS },
        points: vec![at(row)],
        ..Layer::default()
    });
    let title = format!(
        "{}, {}: mean error over bytes per person, view and tick",
        curve.place, curve.input
    );
    let plot = Plot {
        title: &title,
        size_px: [1000, 560],
        x: PlotAxis {
            description: "bytes",
            range: RANGE_BYTES,
            is_logarithmic: true,
            label: |bytes| format!("{bytes:.0} B"),
        },
        y: PlotAxis {
            description: "mm",
            range: range_mm,
            is_logarithmic: false,
            label: |mm| format!("{mm:.1}"),
        },
        layers: std::iter::once(line).chain(points).collect(),
        note: "",
    };
    plot.svg()
}
