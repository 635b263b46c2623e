//! `--from-fusion`: before the start, an edge fetches the parts of the venue file, the calibration
//! and the networks that differ from fusion's.

mod ask;
mod history;
mod names;
mod place;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, ensure};
use farfield_node::files::{load_identity, load_venue};
use farfield_node::process::{Managed, NodeError, say, stop_on_signal};
use farfield_node::{clock, keys, runtime, session};
use farfield_proto::message::handout::{FileKind, FileList, SharedFile};
use farfield_proto::transport::{EdgeTransport, Exposure, Identity};
use farfield_proto::wire;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use super::attempts::{self, remind};
use super::config::EdgeArgs;
use ask::{Fusion, verify};
use history::HandoutHistory;
use names::VenueFileNames;
use place::Part;

/// Folder of the keys without a venue file, relative to the folder of the future venue file.
const CERTIFICATES: &str = "certs";

/// How an edge reaches fusion before it has a reliable venue file.
struct FirstContact {
    venue: String,
    connect: Vec<String>,
    identity: Option<Identity>,
}

/// Fetches the files that differ; `false` if the node was stopped before.
///
/// # Errors
/// If fusion's address or the venue's name is unknown, a signature or a hash is wrong, or the files
/// are older than earlier ones. Also if a file would be outside the venue's folder or cannot be
/// written.
pub(super) fn fetch(args: &EdgeArgs) -> Result<bool, NodeError> {
    let contact = first_contact(args)?;
    runtime::block_on(1, async {
        let (tasks, stop) = (TaskTracker::new(), CancellationToken::new());
        let managed = if args.managed {
            Managed::Yes
        } else {
            Managed::No
        };
        stop_on_signal(&tasks, &stop, managed)
            .context("listening for signals")
            .map_err(NodeError::Failed)?;
        let fetched = stop.run_until_cancelled(fetch_by(args, &contact)).await;
        stop.cancel();
        fetched.transpose().map(|fetched| fetched.is_some())
    })
}

fn first_contact(args: &EdgeArgs) -> Result<FirstContact, NodeError> {
    // An unreadable venue file counts as missing: fusion's replaces it.
    let known = load_venue(&args.venue).ok();
    let named = known.as_ref().map(|venue| venue.name.clone());
    let venue = args.venue_name.clone().or(named).ok_or_else(|| {
        NodeError::Refused(anyhow!(
            "{} cannot be read yet: set the venue to ask fusion for with --venue-name NAME",
            args.venue.display()
        ))
    })?;
    let default_keys = folder(&args.venue).join(CERTIFICATES);
    let keys = args
        .certificates
        .clone()
        .or_else(|| {
            known
                .as_ref()
                .and_then(|venue| venue.security.certificates.clone())
        })
        .or_else(|| default_keys.is_dir().then_some(default_keys));
    let identity = keys.map(|keys| load_identity(&keys, &args.viewpoint));
    let identity = identity.transpose().map_err(NodeError::refused)?;
    if let Some(identity) = &identity {
        // Fusion would not answer an invalid certificate.
        keys::check(identity, &venue, &args.viewpoint, clock::unix_s())?;
    }
    let exposure = Exposure {
        has_keys: identity.is_some(),
        allow_plaintext: args.allow_plaintext
            || known
                .as_ref()
                .is_some_and(|venue| venue.security.allow_plaintext),
    };
    let endpoints = known.map(|venue| venue.endpoints.connect);
    let connect = exposure.choose(args.connect.clone(), &endpoints.unwrap_or_default());
    let connect = connect.map_err(NodeError::refused)?;
    Ok(FirstContact {
        venue,
        connect,
        identity,
    })
}

fn folder(venue: &Path) -> PathBuf {
    venue.parent().unwrap_or(Path::new("")).to_owned()
}

async fn fetch_by(args: &EdgeArgs, contact: &FirstContact) -> Result<(), NodeError> {
    let transport = EdgeTransport {
        venue: &contact.venue,
        connect: &contact.connect,
        identity: contact.identity.as_ref(),
    };
    let endpoints = contact.connect.join(", ");
    if !args.managed {
        say(format_args!(
            "{}: asking fusion at {endpoints} for the files of venue {}",
            args.viewpoint, contact.venue
        ));
    }
    let waiting = |why: Option<String>| {
        let why = why.map_or(String::new(), |why| format!(" ({why})"));
        let line = format!("{}: waiting for fusion at {endpoints}{why}", args.viewpoint);
        (!args.managed).then_some(line)
    };
    let session = tokio::select! {
        session = session::connect(&transport) => session.map_err(NodeError::Failed)?,
        never = remind(|| waiting(attempts::last_failure().map(str::to_owned))) => match never {},
    };
    let fusion = Fusion::new(session, &contact.venue);
    let signed = tokio::select! {
        list = fusion.list() => list.context("fusion's list of files").map_err(NodeError::Failed)?,
        never = remind(|| waiting(fusion.failure())) => match never {},
    };
    let list = match &contact.identity {
        Some(identity) => verify(&signed, identity).map_err(NodeError::Refused)?,
        None => &signed.list,
    };
    let list: FileList = wire::decode(list)
        .context("fusion's list of files")
        .map_err(NodeError::Failed)?;
    if list.venue != contact.venue {
        return Err(NodeError::Refused(anyhow!(
            "fusion hands out the files of venue {}, not of {}",
            list.venue,
            contact.venue
        )));
    }
    let mut history = HandoutHistory::read(&args.venue).map_err(NodeError::refused)?;
    if !args.accept_older {
        // The right fusion may return: the node may be restarted.
        let checked = history.check(&list, clock::unix_s());
        checked.map_err(NodeError::Failed)?;
    }
    let taken = tokio::select! {
        taken = take(args, contact, &fusion, &list) => taken,
        never = remind(|| waiting(Some(fusion.failure()?))) => match never {},
    };
    fusion.close().await;
    taken?;
    if let Err(error) = history.note(&list, clock::unix_s()) {
        // On a read-only disk the files already exist.
        say(format_args!(
            "{}: older files of fusion would not be detected: {error:#}",
            args.viewpoint
        ));
    }
    Ok(())
}

/// Fetches all files that differ, then moves them to their places, the venue file last.
async fn take(
    args: &EdgeArgs,
    contact: &FirstContact,
    fusion: &Fusion,
    list: &FileList,
) -> Result<(), NodeError> {
    let folder = folder(&args.venue);
    let mut keys = vec![folder.join(CERTIFICATES)];
    keys.extend(contact.identity.as_ref().and_then(|identity| {
        let folder = identity.authority.parent()?;
        Some(folder.to_owned())
    }));
    let mut names = VenueFileNames::new(&folder, keys);
    let mut files: Vec<(usize, &SharedFile)> = list.files.iter().enumerate().collect();
    files.sort_by_key(|(_, file)| names::order(file.kind));
    check_kinds(list).map_err(NodeError::Refused)?;
    let mut parts: Vec<(&SharedFile, Part)> = Vec::new();
    for (index, file) in files {
        let target = place::target(&args.venue, file).map_err(NodeError::Refused)?;
        let mut text_at = place::whole(&args.venue, file);
        if let Some(target) = target {
            names.check(file, &target).map_err(NodeError::Refused)?;
            let part = fusion.file(index as u16, file, &target).await;
            let part = part.map_err(NodeError::Failed)?;
            part.path().clone_into(&mut text_at);
            parts.push((file, part));
        }
        if names::names_others(file.kind) {
            let text = std::fs::read_to_string(&text_at);
            let text = text.with_context(|| format!("reading {}", text_at.display()));
            let learnt = text.and_then(|text| names.learn(file, &text));
            learnt.map_err(NodeError::Refused)?;
        }
    }
    parts.sort_by_key(|(file, _)| file.kind == FileKind::Venue);
    for (file, part) in parts {
        let target = part.finish().map_err(NodeError::Failed)?;
        if !args.managed {
            say(format_args!(
                "{}: the {} is fusion's now: {} ({} bytes)",
                args.viewpoint,
                file.kind.name(),
                target.display(),
                file.bytes
            ));
        }
    }
    Ok(())
}

/// Refuses a list with two files of one kind.
fn check_kinds(list: &FileList) -> anyhow::Result<()> {
    let mut seen = BTreeSet::new();
    for file in &list.files {
        let is_new = seen.insert(file.kind);
        ensure!(
            is_new,
            "fusion's list has two files of one kind: {}",
            file.kind.name()
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use clap::Parser as _;
    use farfield_proto::transport::{GENERATIONS_FILE, common_name};
    use rcgen::{CertificateParams, DnType, KeyPair, date_time_ymd};

    use super::*;

    #[derive(clap::Parser)]
    struct Cli {
        #[command(flatten)]
        args: EdgeArgs,
    }

    /// First contact of an edge without a venue file with fusion of `venue`. Its certificate is for
    /// the venue hall, of generation 1, valid until `year`; `newest` is the newest generation.
    fn contact(venue: &str, year: i32, newest: u32) -> Result<FirstContact, NodeError> {
        let folder = tempfile::tempdir().unwrap();
        let keys = folder.path().join(CERTIFICATES);
        std::fs::create_dir(&keys).unwrap();
        let mut params = CertificateParams::default();
        params.not_before = date_time_ymd(2020, 1, 1);
        params.not_after = date_time_ymd(year, 1, 1);
        params
            .distinguished_name
            .push(DnType::CommonName, common_name("hall", "ne", 1));
        let key = KeyPair::generate().unwrap();
        let certificate = params.self_signed(&key).unwrap().pem();
        let newest = format!("[generation]\nne = {newest}\n");
        for (name, text) in [
            ("ca.pem", &certificate),
            ("ne.pem", &certificate),
            ("ne.key", &key.serialize_pem()),
            (GENERATIONS_FILE, &newest),
        ] {
            let path = keys.join(name);
            std::fs::write(&path, text).unwrap();
            std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o600)).unwrap();
        }
        let file = folder.path().join("venue.toml");
        let words = format!(
            "--viewpoint ne --from-fusion --venue-name {venue} --connect quic/127.0.0.1:7447"
        );
        let words = ["edge", file.to_str().unwrap()]
            .into_iter()
            .chain(words.split(' '));
        first_contact(&Cli::parse_from(words).args)
    }

    #[test]
    fn an_edge_with_an_invalid_certificate_does_not_wait_for_fusion() {
        assert!(contact("hall", 4000, 1).is_ok());
        for (venue, year, newest, words) in [
            ("hall", 2021, 1, "has ended"),
            ("hall", 4000, 2, "2 is the newest of ne"),
            ("arena", 4000, 1, "expected that of ne of venue arena"),
        ] {
            let refused = contact(venue, year, newest).err().unwrap();
            assert!(matches!(refused, NodeError::Refused(_)), "{refused}");
            assert!(refused.to_string().contains(words), "{refused}");
        }
    }
}
