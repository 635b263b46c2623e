//! What fusion hands out to its edges when they ask: venue, calibration and networks.

mod sign;

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, ensure};
use farfield_proto::key::Keys;
use farfield_proto::message::handout::{
    CHUNK_BYTES, Chunk, FileKind, FileList, HandoutRequest, SharedFile, SignedList,
};
use farfield_proto::model_card::ModelCard;
use farfield_proto::transport::Identity;
use farfield_proto::venue::Venue;
use farfield_proto::wire;
use tokio_util::sync::CancellationToken;
use tracing::debug;
use zenoh::handlers::RingChannel;
use zenoh::query::Query;
use zenoh::{Session, Wait as _};

/// Questions that wait; of more, the oldest are dropped, and asked again.
const QUEUE: usize = 16;

/// The files of a venue, listed and signed once; their bytes are read when they are asked for.
#[derive(Debug, Default)]
pub(super) struct Handout {
    /// The encoded [`SignedList`].
    list: Vec<u8>,
    files: Vec<PathBuf>,
    /// How the fingerprint of an edge's networks begins, where fusion holds the networks, too.
    models: Option<String>,
}

impl Handout {
    /// Lists the files of the venue at `venue_path`. Networks that are not on this machine are left out.
    ///
    /// # Errors
    /// When a file cannot be read, or venue file or calibration are not those that were loaded any more.
    pub(super) fn load(
        venue_path: &Path,
        venue: &Venue,
        identity: Option<&Identity>,
    ) -> anyhow::Result<Self> {
        let folder = venue_path.parent().unwrap_or(Path::new(""));
        let mut files = vec![
            (FileKind::Venue, venue_path.to_owned()),
            (FileKind::Calibration, venue.calibration_path.clone()),
        ];
        let mut models = Vec::new();
        for (card, kinds) in [
            (&venue.network, [FileKind::NetworkCard, FileKind::Network]),
            (
                &venue.detector,
                [FileKind::DetectorCard, FileKind::Detector],
            ),
        ] {
            if let Some((card, model)) = card.as_deref().and_then(with_model) {
                models.push(model_hash(&card, &model)?);
                files.extend([(kinds[0], card), (kinds[1], model)]);
            }
        }
        let n_networks = [&venue.network, &venue.detector];
        let n_networks = n_networks.into_iter().flatten().count();
        let shared = files.iter().map(|(kind, path)| share(*kind, path, folder));
        let list = FileList {
            venue: venue.name.clone(),
            files: shared.collect::<Result<_, _>>()?,
        };
        check_unchanged(venue, &list.files)?;
        let list = wire::encode_for_anyone(&list);
        let signature = identity
            .map(|identity| sign::sign(&list, identity))
            .transpose()?;
        Ok(Self {
            list: wire::encode_for_anyone(&SignedList { list, signature }),
            files: files.into_iter().map(|(_, path)| path).collect(),
            models: (n_networks > 0 && models.len() == n_networks).then(|| models.join("+")),
        })
    }

    /// How the fingerprint of an edge's networks must begin; `None` where fusion does not hold them all.
    pub(super) fn models(&self) -> Option<&str> {
        self.models.as_deref()
    }

    fn answer(&self, question: &[u8]) -> anyhow::Result<Vec<u8>> {
        match wire::decode(question)? {
            HandoutRequest::List => Ok(self.list.clone()),
            HandoutRequest::Chunk { file, from } => {
                let path = self.files.get(usize::from(file));
                let path = path.context("no such file in the list")?;
                let bytes =
                    read_at(path, from).with_context(|| format!("reading {}", path.display()))?;
                Ok(wire::encode_for_anyone(&Chunk { bytes }))
            }
        }
    }
}

/// Files may have been edited since they were loaded: an edge must not get others than fusion works with.
fn check_unchanged(venue: &Venue, files: &[SharedFile]) -> anyhow::Result<()> {
    for file in files {
        let loaded = match file.kind {
            FileKind::Venue => &venue.hashes.venue,
            FileKind::Calibration => &venue.hashes.calibration,
            _ => continue,
        };
        let found = blake3::Hash::from_bytes(file.blake3).to_hex();
        ensure!(
            found.starts_with(loaded.as_str()),
            "the {} was changed while fusion started: start it again",
            file.kind.name()
        );
    }
    Ok(())
}

/// The card at `card` and its model, where both are on this machine.
fn with_model(card: &Path) -> Option<(PathBuf, PathBuf)> {
    let text = std::fs::read_to_string(card).ok()?;
    let model = match ModelCard::parse(&text, card).ok()? {
        ModelCard::Heatmap(card) => card.file,
        ModelCard::Detector(card) => card.file,
    };
    model.is_file().then(|| (card.to_owned(), model))
}

/// As an edge fingerprints a network: its file, then its card.
fn model_hash(card: &Path, model: &Path) -> anyhow::Result<String> {
    let mut hasher = blake3::Hasher::new();
    for path in [model, card] {
        copy_into(&mut hasher, path)?;
    }
    Ok(hasher.finalize().to_hex()[..16].to_owned())
}

fn share(kind: FileKind, path: &Path, folder: &Path) -> anyhow::Result<SharedFile> {
    let mut hasher = blake3::Hasher::new();
    let bytes = copy_into(&mut hasher, path)?;
    let place = match kind {
        FileKind::Venue => Path::new(""),
        _ => path.strip_prefix(folder).unwrap_or(path),
    };
    let place = place.to_str();
    Ok(SharedFile {
        kind,
        path: place
            .with_context(|| format!("{} is not UTF-8", path.display()))?
            .to_owned(),
        bytes,
        blake3: *hasher.finalize().as_bytes(),
    })
}

fn copy_into(hasher: &mut blake3::Hasher, path: &Path) -> anyhow::Result<u64> {
    let mut copied = 0;
    loop {
        let bytes = read_at(path, copied).with_context(|| format!("reading {}", path.display()))?;
        if bytes.is_empty() {
            return Ok(copied);
        }
        hasher.update(&bytes);
        copied += bytes.len() as u64;
    }
}

fn read_at(path: &Path, from: u64) -> io::Result<Vec<u8>> {
    let file = File::open(path)?;
    let mut bytes = vec![0; CHUNK_BYTES as usize];
    let mut filled = 0;
    while filled < bytes.len() {
        match file.read_at(&mut bytes[filled..], from.saturating_add(filled as u64))? {
            0 => break,
            n => filled += n,
        }
    }
    bytes.truncate(filled);
    Ok(bytes)
}

/// Task: answers edges that ask for the files of the venue called `venue`.
pub(super) async fn serve(
    session: Session,
    venue: String,
    handout: Arc<Handout>,
    leave: CancellationToken,
) {
    let key = Keys::new(&venue).config();
    let declared = session
        .declare_queryable(key)
        .with(RingChannel::new(QUEUE))
        .await;
    let questions = match declared {
        Ok(questions) => questions,
        Err(error) => {
            debug!(%error, "the files of the venue are not handed out");
            return;
        }
    };
    loop {
        let question = tokio::select! {
            question = questions.recv_async() => question,
            () = leave.cancelled() => return,
        };
        let Ok(question) = question else { return };
        reply(&handout, question).await;
    }
}

/// Reading waits for the disk, and replying for a link that is full: neither may hold up the runtime.
async fn reply(handout: &Arc<Handout>, query: Query) {
    let handout = Arc::clone(handout);
    let answer = move || {
        let question = query.payload().map(|bytes| bytes.to_bytes().into_owned());
        match handout.answer(&question.unwrap_or_default()) {
            Ok(bytes) => {
                // At the question's priority: behind everything that a tick needs.
                query.reply(query.key_expr().clone(), bytes).wait()
            }
            Err(error) => query.reply_err(format!("{error:#}")).wait(),
        }
    };
    match tokio::task::spawn_blocking(answer).await {
        Ok(Ok(())) => {}
        Ok(Err(error)) => debug!(%error, "a question for files was not answered"),
        Err(error) => debug!(%error, "a question for files ended early"),
    }
}

#[cfg(test)]
mod tests;
