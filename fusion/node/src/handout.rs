//! Serves the venue's files to the edges: venue, calibration and networks, with fusion's signature.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, anyhow, ensure};
use farfield_node::networks::{RECEIVED, card_in, is_installed_name};
use farfield_proto::key::Keys;
use farfield_proto::message::handout::{
    CHUNK_BYTES, Chunk, FileKind, FileList, HandoutRequest, ListSignature, SIGNED_AHEAD,
    SharedFile, SignedList,
};
use farfield_proto::model_card::ModelCard;
use farfield_proto::transport::Identity;
use farfield_proto::venue::{Venue, VenueFile};
use farfield_proto::wire;
use ring::rand::SystemRandom;
use ring::signature::{ECDSA_P256_SHA256_ASN1_SIGNING, EcdsaKeyPair};
use rustls_pki_types::pem::PemObject as _;
use rustls_pki_types::{CertificateDer, PrivatePkcs8KeyDer};
use tokio_util::sync::CancellationToken;
use tracing::debug;
use zenoh::handlers::RingChannel;
use zenoh::query::Query;
use zenoh::{Session, Wait as _};

/// Queued requests; if there are more, the oldest are dropped, and the edges repeat them.
const QUEUE: usize = 16;

/// The files of a venue, listed and signed once. Their bytes are read on request.
#[derive(Debug, Default)]
pub(super) struct Handout {
    /// The encoded [`SignedList`].
    list: Vec<u8>,
    files: Vec<PathBuf>,
    /// Prefix of the fingerprint of an edge's networks, if fusion has the networks too.
    models: Option<String>,
}

impl Handout {
    /// Lists the files of the venue at `venue_path`. Networks that are not on this machine are omitted.
    ///
    /// # Errors
    /// A file cannot be read, or the venue file or calibration has changed since it was loaded.
    pub(super) fn load(
        venue_path: &Path,
        venue: &Venue,
        identity: Option<&Identity>,
    ) -> anyhow::Result<Self> {
        let folder = venue_path.parent().unwrap_or(Path::new(""));
        let text = std::fs::read_to_string(venue_path)
            .with_context(|| format!("reading {}", venue_path.display()))?;
        // If it was changed to something else, that is reported below.
        let named = VenueFile::parse(&text, venue_path).ok();
        let named = named.as_ref();
        let mut files = vec![
            (FileKind::Venue, venue_path.to_owned()),
            (FileKind::Calibration, venue.calibration_path.clone()),
        ];
        let mut models = Vec::new();
        let mut installed = None;
        for (card, name, kinds) in [
            (
                &venue.network,
                named.and_then(VenueFile::network),
                [FileKind::NetworkCard, FileKind::Network],
            ),
            (
                &venue.detector,
                named.and_then(VenueFile::detector),
                [FileKind::DetectorCard, FileKind::Detector],
            ),
        ] {
            if let Some((card, model)) = card.as_deref().and_then(with_model) {
                models.push(model_hash(&card, &model)?);
                installed = name.and_then(|name| store_of(&card, name)).or(installed);
                files.extend([(kinds[0], card), (kinds[1], model)]);
            }
        }
        let n_networks = [&venue.network, &venue.detector];
        let n_networks = n_networks.into_iter().flatten().count();
        let folders = Folders {
            venue: folder,
            installed,
        };
        let shared = files
            .iter()
            .map(|(kind, path)| share(*kind, path, &folders));
        let list = FileList {
            venue: venue.name.clone(),
            files: shared.collect::<Result<_, _>>()?,
        };
        check_unchanged(venue, &list.files)?;
        let list = wire::encode_for_anyone(&list);
        let signature = identity.map(|identity| sign(&list, identity)).transpose()?;
        Ok(Self {
            list: wire::encode_for_anyone(&SignedList { list, signature }),
            files: files.into_iter().map(|(_, path)| path).collect(),
            models: (n_networks > 0 && models.len() == n_networks).then(|| models.join("+")),
        })
    }

    /// The prefix of the fingerprint of an edge's networks; `None` if fusion does not have them all.
    pub(super) fn models(&self) -> Option<&str> {
        self.models.as_deref()
    }

    fn answer(&self, request: &[u8]) -> anyhow::Result<Vec<u8>> {
        match wire::decode(request)? {
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

/// Ensures that edges get the same files that fusion uses: they may have been edited since they were loaded.
fn check_unchanged(venue: &Venue, files: &[SharedFile]) -> anyhow::Result<()> {
    for file in files {
        let loaded = match file.kind {
            FileKind::Venue => &venue.hashes.venue,
            FileKind::Calibration => &venue.hashes.calibration,
            _ => continue,
        };
        let actual = blake3::Hash::from_bytes(file.blake3).to_hex();
        ensure!(
            actual.starts_with(loaded.as_str()),
            "the {} was changed while fusion started: start it again",
            file.kind.name()
        );
    }
    Ok(())
}

/// The card at `card` and its model, if both are on this machine.
fn with_model(card: &Path) -> Option<(PathBuf, PathBuf)> {
    let text = std::fs::read_to_string(card).ok()?;
    let model = match ModelCard::parse(&text, card).ok()? {
        ModelCard::Heatmap(card) => card.file,
        ModelCard::Detector(card) => card.file,
    };
    model.is_file().then(|| (card.to_owned(), model))
}

/// The fingerprint of a network, as an edge computes it: the model file, then the card.
fn model_hash(card: &Path, model: &Path) -> anyhow::Result<String> {
    let mut hasher = blake3::Hasher::new();
    for path in [model, card] {
        copy_into(&mut hasher, path)?;
    }
    Ok(hasher.finalize().to_hex()[..16].to_owned())
}

/// The folders of the shared files.
struct Folders<'a> {
    venue: &'a Path,
    /// The folder of installed networks, if the venue file names one.
    installed: Option<PathBuf>,
}

impl Folders<'_> {
    /// The place of a file on an edge: in the folder of its venue file, if possible.
    fn place(&self, path: &Path) -> PathBuf {
        let installed = self.installed.as_ref();
        let installed = installed.and_then(|folder| path.strip_prefix(folder).ok());
        match installed {
            Some(place) => Path::new(RECEIVED).join(place),
            None => path.strip_prefix(self.venue).unwrap_or(path).to_owned(),
        }
    }
}

/// The folder of installed networks with the network `name`, if `card` is that network's card.
fn store_of(card: &Path, name: &str) -> Option<PathBuf> {
    let folder = card.ancestors().nth(2)?;
    let is_it = is_installed_name(name) && card_in(folder, name) == card;
    is_it.then(|| folder.to_owned())
}

fn share(kind: FileKind, path: &Path, folders: &Folders<'_>) -> anyhow::Result<SharedFile> {
    let mut hasher = blake3::Hasher::new();
    let bytes = copy_into(&mut hasher, path)?;
    let place = match kind {
        FileKind::Venue => PathBuf::new(),
        _ => folders.place(path),
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

/// Signs the list of files with the key of fusion's certificate, which the venue's authority has signed.
///
/// # Errors
/// The certificate or key cannot be read, or the key is no ECDSA P-256 key as made by `farfield certs`. No error contains
/// anything of the key.
fn sign(list: &[u8], identity: &Identity) -> anyhow::Result<ListSignature> {
    let certificate = CertificateDer::from_pem_file(&identity.certificate)
        .map_err(|error| anyhow!("reading {}: {error}", identity.certificate.display()))?;
    let path = identity.key.display();
    let der = PrivatePkcs8KeyDer::from_pem_file(&identity.key)
        .map_err(|error| anyhow!("reading {path}: {error}"))?;
    let random = SystemRandom::new();
    let algorithm = &ECDSA_P256_SHA256_ASN1_SIGNING;
    let pair = EcdsaKeyPair::from_pkcs8(algorithm, der.secret_pkcs8_der(), &random)
        .map_err(|_| anyhow!("{path} is not an ECDSA P-256 key as made by `farfield certs`"))?;
    let signature = pair
        .sign(&random, &[SIGNED_AHEAD, list].concat())
        .ok()
        .context("signing the list of the venue's files")?;
    Ok(ListSignature {
        certificate: certificate.as_ref().to_vec(),
        ecdsa: signature.as_ref().to_vec(),
    })
}

/// Task: answers requests for the files of `venue`.
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
    let requests = match declared {
        Ok(requests) => requests,
        Err(error) => {
            debug!(%error, "the venue's files are not served");
            return;
        }
    };
    loop {
        let request = tokio::select! {
            request = requests.recv_async() => request,
            () = leave.cancelled() => return,
        };
        let Ok(request) = request else { return };
        reply(&handout, request).await;
    }
}

/// Answers on a blocking thread: reading waits for the disk, replying for a full link.
async fn reply(handout: &Arc<Handout>, query: Query) {
    let handout = Arc::clone(handout);
    let answer = move || {
        let request = query.payload().map(|bytes| bytes.to_bytes().into_owned());
        match handout.answer(&request.unwrap_or_default()) {
            Ok(bytes) => {
                // At the priority of the request, below everything that a tick needs.
                query.reply(query.key_expr().clone(), bytes).wait()
            }
            Err(error) => query.reply_err(format!("{error:#}")).wait(),
        }
    };
    match tokio::task::spawn_blocking(answer).await {
        Ok(Ok(())) => {}
        Ok(Err(error)) => debug!(%error, "a file request was not answered"),
        Err(error) => debug!(%error, "a file request ended early"),
    }
}

#[cfg(test)]
mod tests {
    use farfield_node::files::load_venue;

    use super::*;

    const CALIBRATION: &str = "[c]\nname = \"c\"\nsize = [640, 480]\nmatrix = [[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]]\n\
                               distortions = [0.0, 0.0, 0.0, 0.0, 0.0]\nrotation = [1.5707963, 0.0, 0.0]\ntranslation = [0.0, 1.0, 5.0]\n";
    const VENUE: &str = "name = \"hall\"\nrate_hz = 30.0\ncalibration = \"sub/c.toml\"\n[[viewpoint]]\nname = \"a\"\n[[viewpoint.camera]]\n\
                         name = \"c\"\nsource = { kind = \"keypoints\", path = \"c.jsonl\" }\n";

    fn request<M: wire::Message>(handout: &Handout, request: &HandoutRequest) -> M {
        wire::decode(&handout.answer(&wire::encode(request)).unwrap()).unwrap()
    }

    #[test]
    fn the_files_of_a_venue_are_listed_and_read_in_chunks() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("venue.toml");
        let long = format!("{CALIBRATION}# {}\n", "x".repeat(CHUNK_BYTES as usize));
        std::fs::create_dir(folder.path().join("sub")).unwrap();
        std::fs::write(folder.path().join("sub/c.toml"), &long).unwrap();
        std::fs::write(&path, VENUE).unwrap();
        let venue = load_venue(&path).unwrap();
        let handout = Handout::load(&path, &venue, None).unwrap();
        assert_eq!(handout.models(), None);
        let signed: SignedList = request(&handout, &HandoutRequest::List);
        assert_eq!(signed.signature, None);
        let list: FileList = wire::decode(&signed.list).unwrap();
        let places: Vec<&str> = list.files.iter().map(|file| file.path.as_str()).collect();
        assert_eq!(places, ["", "sub/c.toml"]);
        assert_eq!(list.files[1].bytes, long.len() as u64);

        let mut read = Vec::new();
        loop {
            let from = read.len() as u64;
            let chunk: Chunk = request(&handout, &HandoutRequest::Chunk { file: 1, from });
            if chunk.bytes.is_empty() {
                break;
            }
            read.extend(chunk.bytes);
        }
        assert_eq!(read, long.as_bytes());
        assert_eq!(*blake3::hash(&read).as_bytes(), list.files[1].blake3);
    }

    #[test]
    fn an_installed_network_gets_a_place_in_the_venues_folder() {
        let card = Path::new("/store/net/net.toml");
        let installed = store_of(card, "net");
        assert_eq!(store_of(card, "net.toml"), None);
        for venue in ["", "/venue"] {
            let folders = Folders {
                venue: Path::new(venue),
                installed: installed.clone(),
            };
            let place = folders.place(Path::new("/store/net/net.onnx"));
            assert_eq!(place, Path::new("networks/net/net.onnx"));
            let other = Path::new(venue).join("sub/c.toml");
            assert_eq!(folders.place(&other), Path::new("sub/c.toml"));
        }
    }

    #[test]
    fn an_invalid_request_is_refused() {
        let handout = Handout::default();
        assert!(handout.answer(&[]).is_err());
        assert!(handout.answer(&[0xff; 40]).is_err());
        let request = HandoutRequest::Chunk { file: 3, from: 0 };
        assert!(handout.answer(&wire::encode(&request)).is_err());
    }

    #[test]
    fn a_file_that_changed_since_loading_is_not_served() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("venue.toml");
        std::fs::create_dir(folder.path().join("sub")).unwrap();
        let calibration = folder.path().join("sub/c.toml");
        for (changed, what) in [(&path, "venue file"), (&calibration, "calibration")] {
            std::fs::write(&path, VENUE).unwrap();
            std::fs::write(&calibration, CALIBRATION).unwrap();
            let venue = load_venue(&path).unwrap();
            Handout::load(&path, &venue, None).unwrap();
            let text = std::fs::read_to_string(changed).unwrap();
            std::fs::write(changed, text + "# edited\n").unwrap();
            let refused = Handout::load(&path, &venue, None).unwrap_err().to_string();
            assert!(refused.contains(what), "{refused}");
        }
    }
}
