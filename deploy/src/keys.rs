//! Checks the keys of a venue by the rules of the nodes: they exist, are valid now, are the newest, belong to this
//! venue and its authority, match each other, and only their owner can read them.

use std::path::Path;

use farfield_node::certificate::{Validity, check_generation, ending_notice};
use farfield_node::files::{check_secret, load_generations};
use farfield_node::keys::{check_authority, check_own};
use farfield_proto::transport::{FUSION, GENERATIONS_FILE, Generations, Identity, RECORDER};
use farfield_proto::venue::Venue;

use crate::report_lines::{ReportLines, Verdict};

/// The group of these lines.
const KEYS: &str = "keys";

/// Checks the keys of `venue`, whose file is `path`, at `now_s` (Unix time in seconds). The folder may contain the keys
/// of one node only.
pub(crate) fn check_keys(venue: &Venue, path: &Path, now_s: i64, report: &mut ReportLines) {
    let Some(folder) = &venue.security.certificates else {
        return;
    };
    let make = format!(
        "farfield certs {} --out {}",
        path.display(),
        folder.display()
    );
    if !folder.is_dir() {
        let text = format!("{}: the folder does not exist", folder.display());
        report.fail(KEYS, text, make);
        return;
    }
    let viewpoints = venue.viewpoints.iter().map(|it| it.name.as_str());
    let nodes = || viewpoints.clone().chain([FUSION, RECORDER]);
    let is_here = |node: &&str| {
        let identity = Identity::in_folder(folder, node);
        identity.certificate.exists() || identity.key.exists()
    };
    let here: Vec<&str> = nodes().filter(is_here).collect();
    if here.is_empty() {
        let text = format!(
            "{}: found no keys of any node of this venue",
            folder.display()
        );
        report.fail(KEYS, text, make);
        return;
    }
    check_venue_authority(folder, now_s, report);
    let generations = load_generations(folder).unwrap_or_else(|error| {
        let remedy =
            format!("copy {GENERATIONS_FILE} from the folder in which `farfield certs` wrote it");
        report.fail(KEYS, error.to_string(), remedy);
        Generations::default()
    });
    for node in here {
        let identity = Identity {
            generations: generations.clone(),
            ..Identity::in_folder(folder, node)
        };
        let renew = format!("{make} --renew {node}");
        check_node(&identity, &venue.name, node, now_s, &renew, report);
    }
}

fn check_venue_authority(folder: &Path, now_s: i64, report: &mut ReportLines) {
    let path = folder.join("ca.pem");
    let read = check_authority(&path).and_then(|()| Validity::read(&path));
    let (verdict, text) = match read {
        Err(error) => (Verdict::Failed, error.to_string()),
        Ok(it) if now_s > it.until_s || now_s < it.from_s => (
            Verdict::Failed,
            format!(
                "{}: the certificate of the authority is not valid now",
                path.display()
            ),
        ),
        Ok(_) => return,
    };
    report.push(
        KEYS,
        verdict,
        text,
        "copy ca.pem from the folder in which `farfield certs` wrote it, or make new keys in another folder",
    );
}

fn check_node(
    identity: &Identity,
    venue: &str,
    node: &str,
    now_s: i64,
    renew: &str,
    report: &mut ReportLines,
) {
    let validity = match Validity::read(&identity.certificate) {
        Ok(validity) => validity,
        Err(error) => {
            report.fail(KEYS, error.to_string(), renew);
            return;
        }
    };
    if let Err(error) = check_generation(identity) {
        let remedy = format!("copy the newest {node}.pem and {node}.key here");
        report.fail(KEYS, error.to_string(), remedy);
        return;
    }
    if now_s < validity.from_s {
        let text = format!(
            "{}: valid only in {:.1} days by the clock of this machine",
            identity.certificate.display(),
            (validity.from_s - now_s) as f64 / 86_400.0
        );
        report.fail(
            KEYS,
            text,
            "set the clock of this machine (`timedatectl set-ntp true`)",
        );
        return;
    }
    let notice = ending_notice(node, validity.until_s, now_s);
    let has_ended = now_s > validity.until_s;
    if let Some(notice) = &notice {
        let verdict = if has_ended {
            Verdict::Failed
        } else {
            Verdict::Warning
        };
        let notice = notice.split(": ").next().unwrap_or_default();
        report.push(KEYS, verdict, notice, renew);
    }
    if has_ended {
        return;
    }
    let key = &identity.key;
    if let Err(error) = std::fs::metadata(key) {
        report.fail(KEYS, format!("{}: {error}", key.display()), renew);
        return;
    }
    if let Err(error) = check_secret(key) {
        let remedy = format!("chmod 600 {}", key.display());
        report.fail(KEYS, error.to_string(), remedy);
        return;
    }
    if let Err(error) = std::fs::File::open(key) {
        let text = format!("{}: {error}", key.display());
        report.fail(KEYS, text, "start the node as the user who owns its key");
        return;
    }
    let misfit = check_own(identity, venue, node, now_s).err();
    // An error of the authority is reported once, not for each node.
    if let Some(misfit) = misfit.filter(|it| it.path != identity.authority) {
        let remedy =
            format!("copy ca.pem, {node}.pem and {node}.key of this venue here, or: {renew}");
        report.fail(KEYS, misfit.to_string(), remedy);
        return;
    }
    if notice.is_some() {
        return;
    }
    let days = (validity.until_s - now_s) / 86_400;
    let text = format!("the certificate of {node} is valid for {days} days");
    report.ok(KEYS, text);
}
