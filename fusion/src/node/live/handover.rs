//! What a live fusion leaves for the one after it: who is there, kept beside the results and renewed every second, so that
//! a fusion that fails or is restarted gives people their old ids.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use anyhow::Context as _;
use farfield_node::process::say;
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;
use serde::{Deserialize, Serialize};

use super::start::LiveStart;
use crate::export::unfinished::write_whole_again;
use crate::identity::known::KnownPeople;

/// Longest file that is read, bytes.
const MOST_BYTES: u64 = 1 << 20;

/// The file.
#[derive(Debug, Serialize, Deserialize)]
struct HandoverFile {
    /// Whose people: ids of another venue mean nothing.
    venue_hash: String,
    /// Unix time of tick 0, microseconds: ticks of another mean nothing.
    epoch_us: u64,
    /// When it was written.
    tick: Tick,
    people: KnownPeople,
}

/// Keeps the file up to date, on a thread of its own: a disk that hangs holds up nobody.
pub(super) struct Handover {
    venue_hash: String,
    epoch_us: u64,
    newest: SyncSender<HandoverFile>,
    thread: JoinHandle<()>,
}

/// Where the file is of a `venue` whose results lie in `out`: beside that folder, as every run has one of its own.
pub(super) fn place(venue: &Venue, out: &Path) -> PathBuf {
    let folder = out.parent().unwrap_or(Path::new("."));
    folder.join(format!("{}.people.json", venue.name))
}

/// Where names of its people are kept, in the same folder: fusion itself knows none.
pub(in crate::node) fn names_place(venue: &Venue, out: &Path) -> PathBuf {
    place(venue, out).with_file_name(format!("{}.names.json", venue.name))
}

/// Who was there shortly before a run that begins like `start`; nobody where the file at `path` is missing, old, of
/// other ticks or another venue file, or cannot be read, which is said.
pub(super) fn read(path: &Path, venue: &Venue, start: &LiveStart) -> Option<KnownPeople> {
    let file = match load(path) {
        Ok(file) => file?,
        Err(error) => {
            say(format_args!(
                "who was here before is not known: {error:#}; people get new ids"
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
        "{} people are known from {ago_s:.1} s ago ({}): whoever is recognised keeps the id",
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
        metadata.len() <= MOST_BYTES,
        "{} has {} bytes, at most {MOST_BYTES} are read",
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
    /// Begins to keep the file at `path`.
    ///
    /// # Errors
    /// When the system has no thread left.
    pub(super) fn start(path: PathBuf, venue: &Venue, epoch_us: u64) -> std::io::Result<Self> {
        // Whatever comes while one is written is newer a second later.
        let (newest, files) = sync_channel(1);
        let thread = std::thread::Builder::new().name("handover".to_owned());
        Ok(Self {
            venue_hash: venue.hashes.venue.clone(),
            epoch_us,
            newest,
            thread: thread.spawn(move || write_all(&path, &files))?,
        })
    }

    /// Keeps who is there at `tick`.
    pub(super) fn keep(&self, tick: Tick, people: KnownPeople) {
        let file = HandoverFile {
            venue_hash: self.venue_hash.clone(),
            epoch_us: self.epoch_us,
            tick,
            people,
        };
        drop(self.newest.try_send(file));
    }

    /// Waits until the last is written.
    pub(super) async fn finish(self) {
        drop(self.newest);
        let thread = self.thread;
        // A thread that panicked has said so; there is nothing to save.
        drop(tokio::task::spawn_blocking(move || thread.join()).await);
    }
}

fn write_all(path: &Path, files: &Receiver<HandoverFile>) {
    let mut is_told = false;
    while let Ok(file) = files.recv() {
        let written = write(path, &file);
        if let (Err(error), false) = (&written, is_told) {
            say(format_args!(
                "who is here is not kept for a restart: {error:#}"
            ));
        }
        is_told = written.is_err();
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
    use crate::body::skeleton::Proportions;
    use crate::identity::known::KnownPerson;
    use crate::live::membership::Membership;
    use crate::live::tick_time::TickTime;

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
            // Of numbers that JSON gives back bit for bit.
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
    async fn who_was_there_is_known_to_the_next_for_as_long_as_people_are_remembered() {
        let folder = tempfile::tempdir().unwrap();
        let venue = venue();
        let path = place(&venue, &folder.path().join("run-1"));
        let known = |epoch_us, first| read(&path, &venue, &start(epoch_us, first));
        assert_eq!(known(EPOCH_US, 130), None, "there is no file");
        fs::write(path.with_extension("json.tmp"), "{\"half").unwrap();
        let handover = Handover::start(path.clone(), &venue, EPOCH_US).unwrap();
        handover.keep(Tick(100), people());
        handover.finish().await;
        assert_eq!(known(EPOCH_US, 130), Some(people()));
        let return_s = venue.parameters.births.return_s;
        let late = 100 + (return_s * venue.rate_hz) as i64 + 1;
        assert_eq!(known(EPOCH_US, late), None);
        assert_eq!(known(EPOCH_US, 99), None, "the clock was set back");
        assert_eq!(known(EPOCH_US + 1, 130), None, "they play something else");
        fs::write(&path, "{}").unwrap();
        assert_eq!(known(EPOCH_US, 130), None);
    }
}
