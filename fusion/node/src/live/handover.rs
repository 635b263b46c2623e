//! Handover of a live fusion to the next: the present people, in a file next to the results that is renewed every second. A
//! restarted fusion gives recognised people their old ids.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use anyhow::Context as _;
use farfield_fusion::export::unfinished::write_whole_again;
use farfield_fusion::identity::known::KnownPeople;
use farfield_node::process::say;
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;
use serde::{Deserialize, Serialize};

use super::start::LiveStart;

/// Most bytes of the file.
const MAX_BYTES: u64 = 1 << 20;

#[derive(Debug, Serialize, Deserialize)]
struct HandoverFile {
    /// The fingerprint of the venue: its ids mean nothing in another.
    venue_hash: String,
    /// Unix time of tick 0, microseconds: ticks mean nothing with another.
    epoch_us: u64,
    /// The tick of the file.
    tick: Tick,
    people: KnownPeople,
}

/// Keeps the file up to date, on its own thread so that a hanging disk delays nothing.
pub(super) struct Handover {
    venue_hash: String,
    epoch_us: u64,
    newest: SyncSender<HandoverFile>,
    thread: JoinHandle<()>,
}

/// The path of the file for a `venue` with results in `out`: next to that folder, because each run has its own.
pub(super) fn place(venue: &Venue, out: &Path) -> PathBuf {
    let folder = out.parent().unwrap_or(Path::new("."));
    folder.join(format!("{}.people.json", venue.name))
}

/// The path of the file with the names of its people, in the same folder. Fusion itself knows no names.
pub(crate) fn names_place(venue: &Venue, out: &Path) -> PathBuf {
    place(venue, out).with_file_name(format!("{}.names.json", venue.name))
}

/// The people present shortly before a run that begins like `start`. `None` if the file at `path` is missing, old, of other
/// ticks or another venue file, or cannot be read, which is reported.
pub(super) fn read(path: &Path, venue: &Venue, start: &LiveStart) -> Option<KnownPeople> {
    let file = match load(path) {
        Ok(file) => file?,
        Err(error) => {
            say(format_args!(
                "the people of the previous run are unknown: {error:#}; all people get new ids"
            ));
            return None;
        }
    };
    let ago_s = (start.first - file.tick) as f64 / venue.rate_hz;
    let is_recent = (0.0..=venue.parameters.births.return_s).contains(&ago_s);
    let is_ours = file.venue_hash == venue.hashes.venue && file.epoch_us == start.time.epoch_us();
    if !is_recent || !is_ours || file.people.people.is_empty() {
        return None;
    }
    say(format_args!(
        "{} people are known from {ago_s:.1} s ago ({}): those who are recognised keep their ids",
        file.people.people.len(),
        path.display()
    ));
    Some(file.people)
}

fn load(path: &Path) -> anyhow::Result<Option<HandoverFile>> {
    let reading = || format!("reading {}", path.display());
    let Ok(metadata) = fs::metadata(path) else {
        return Ok(None);
    };
    anyhow::ensure!(
        metadata.len() <= MAX_BYTES,
        "{} has {} bytes, expected at most {MAX_BYTES}",
        path.display(),
        metadata.len()
    );
    let text = fs::read_to_string(path).with_context(reading)?;
    let file: HandoverFile = serde_json::from_str(&text).with_context(reading)?;
    let people = file.people.checked().map_err(anyhow::Error::msg);
    let people = people.with_context(reading)?;
    Ok(Some(HandoverFile { people, ..file }))
}

impl Handover {
    /// Starts the thread for the file at `path`.
    ///
    /// # Errors
    /// The system cannot start a thread.
    pub(super) fn start(path: PathBuf, venue: &Venue, epoch_us: u64) -> std::io::Result<Self> {
        // Data that arrive during a write are dropped: newer ones follow a second later.
        let (newest, files) = sync_channel(1);
        let thread = std::thread::Builder::new().name("handover".to_owned());
        Ok(Self {
            venue_hash: venue.hashes.venue.clone(),
            epoch_us,
            newest,
            thread: thread.spawn(move || write_all(&path, &files))?,
        })
    }

    /// Queues the people present at `tick`.
    pub(super) fn save(&self, tick: Tick, people: KnownPeople) {
        let file = HandoverFile {
            venue_hash: self.venue_hash.clone(),
            epoch_us: self.epoch_us,
            tick,
            people,
        };
        drop(self.newest.try_send(file));
    }

    /// Waits until the last file is written.
    pub(super) async fn finish(self) {
        drop(self.newest);
        let thread = self.thread;
        // A thread that panicked has reported it; there is nothing to save.
        drop(tokio::task::spawn_blocking(move || thread.join()).await);
    }
}

fn write_all(path: &Path, files: &Receiver<HandoverFile>) {
    let mut is_reported = false;
    while let Ok(file) = files.recv() {
        let written = write(path, &file);
        if let (Err(error), false) = (&written, is_reported) {
            say(format_args!(
                "the present people are not saved for a restart: {error:#}"
            ));
        }
        is_reported = written.is_err();
    }
}

fn write(path: &Path, file: &HandoverFile) -> anyhow::Result<()> {
    let json = serde_json::to_vec(file).context("writing people as JSON")?;
    write_whole_again(path, &json).with_context(|| format!("writing {}", path.display()))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::super::tests::venue;
    use super::*;
    use farfield_fusion::body::skeleton::Proportions;
    use farfield_fusion::identity::known::KnownPerson;
    use farfield_fusion::live::membership::Membership;
    use farfield_fusion::live::tick_time::TickTime;

    const EPOCH_US: u64 = 1_700_000_000_000_000;

    fn people() -> KnownPeople {
        let person = KnownPerson {
            id: 4,
            wire_id: None,
            seen: Tick(99),
            gone: None,
            place_m: [0.1, 0.2, 0.9],
            velocity_m_s: None,
            to_left: None,
            // Numbers that JSON preserves bit for bit.
            lengths_m: vec![0.25; Proportions::from_stature(1.7).lengths_m().count()],
            lived_s: 3.0,
        };
        KnownPeople {
            next_id: 5,
            people: vec![person],
        }
    }

    fn start(epoch_us: u64, first: i64) -> LiveStart {
        let venue = venue();
        LiveStart {
            time: TickTime::new(epoch_us, venue.rate_hz),
            first: Tick(first),
            members: Membership::new(&venue),
            present: BTreeSet::new(),
        }
    }

    #[tokio::test]
    async fn the_next_fusion_knows_recent_people() {
        let folder = tempfile::tempdir().unwrap();
        let venue = venue();
        let path = place(&venue, &folder.path().join("run-1"));
        let known = |epoch_us, first| read(&path, &venue, &start(epoch_us, first));
        assert_eq!(known(EPOCH_US, 130), None, "there is no file");
        fs::write(path.with_extension("json.tmp"), "{\"half").unwrap();
        let handover = Handover::start(path.clone(), &venue, EPOCH_US).unwrap();
        handover.save(Tick(100), people());
        handover.finish().await;
        assert_eq!(known(EPOCH_US, 130), Some(people()));
        let return_s = venue.parameters.births.return_s;
        let late = 100 + (return_s * venue.rate_hz) as i64 + 1;
        assert_eq!(known(EPOCH_US, late), None);
        assert_eq!(known(EPOCH_US, 99), None, "the clock was set back");
        assert_eq!(
            known(EPOCH_US + 1, 130),
            None,
            "other recordings are played"
        );
        fs::write(&path, "{}").unwrap();
        assert_eq!(known(EPOCH_US, 130), None);
    }
}
