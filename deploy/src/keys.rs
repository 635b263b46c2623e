//! The keys of a venue, looked at by the rules of the nodes: whether they are there, hold now, are the newest, are of this venue
//! and its authority, fit each other, and are their owner's alone.

use std::fs;
use std::path::Path;
use std::time::Duration;

use farfield_node::certificate::{
    Validity, check_generation, common_name_in, ending_notice, public_key_in,
};
use farfield_node::files::{check_secret, load_generations};
use farfield_proto::transport::{
    FUSION, GENERATIONS_FILE, Generations, Identity, RECORDER, generation_of,
};
use farfield_proto::venue::Venue;
use rcgen::KeyPair;
use rustls_pki_types::pem::PemObject as _;
use rustls_pki_types::{CertificateDer, UnixTime};
use webpki::{ALL_VERIFICATION_ALGS, EndEntityCert, KeyUsage, anchor_from_trusted_cert};

use crate::report_lines::{ReportLines, Verdict};

/// The group of these lines.
const KEYS: &str = "keys";

/// Looks at the keys that the file of `venue`, at `path`, names, at `now_s` (Unix time in seconds). A folder may hold
/// those of one node alone.
pub(crate) fn look_at_keys(venue: &Venue, path: &Path, now_s: i64, report: &mut ReportLines) {
    let Some(folder) = &venue.security.certificates else {
        return;
    };
    let make = format!(
        "farfield certs {} --out {}",
        path.display(),
        folder.display()
    );
    if !folder.is_dir() {
        let text = format!("{}: there is no such folder", folder.display());
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
            "{}: there are no keys of any node of this venue",
            folder.display()
        );
        report.fail(KEYS, text, make);
        return;
    }
    look_at_authority(folder, now_s, report);
    let generations = load_generations(folder).unwrap_or_else(|error| {
        let remedy = format!("copy {GENERATIONS_FILE} from where `farfield certs` has made it");
        report.fail(KEYS, error.to_string(), remedy);
        Generations::default()
    });
    for node in here {
        let identity = Identity {
            generations: generations.clone(),
            ..Identity::in_folder(folder, node)
        };
        let renew = format!("{make} --renew {node}");
        look_at_node(&identity, (&venue.name, node), now_s, &renew, report);
    }
}

fn look_at_authority(folder: &Path, now_s: i64, report: &mut ReportLines) {
    let path = folder.join("ca.pem");
    let (verdict, text) = match Validity::read(&path) {
        Err(error) => (Verdict::Failed, error.to_string()),
        Ok(it) if now_s > it.until_s || now_s < it.from_s => (
            Verdict::Failed,
            format!("{}: the authority does not hold now", path.display()),
        ),
        Ok(_) => return,
    };
    report.push(
        KEYS,
        verdict,
        text,
        "copy ca.pem from where `farfield certs` has made it, or make new keys in another folder",
    );
}

fn look_at_node(
    identity: &Identity,
    (venue, node): (&str, &str),
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
            "{}: it begins in {:.1} days by the clock of this machine",
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
    if let Some(notice) = ending_notice(node, validity.until_s, now_s) {
        let verdict = if now_s > validity.until_s {
            Verdict::Failed
        } else {
            Verdict::Warning
        };
        let notice = notice.split(": ").next().unwrap_or_default();
        report.push(KEYS, verdict, notice, renew);
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
        report.fail(KEYS, text, "start the node as the owner of its key");
        return;
    }
    if let Some(misfit) = misfit(identity, (venue, node), now_s) {
        let remedy =
            format!("copy ca.pem, {node}.pem and {node}.key of this venue here, or: {renew}");
        report.fail(KEYS, misfit, remedy);
        return;
    }
    let days = (validity.until_s - now_s) / 86_400;
    let text = format!("the certificate of {node} holds for {days} days");
    report.ok(KEYS, text);
}

/// Of which node of `venue`, and of which generation, a certificate of this common name is; `None`: of none.
pub(crate) fn node_of<'a>(venue: &str, common_name: &'a str) -> Option<(&'a str, u32)> {
    let rest = common_name.strip_prefix(venue)?;
    generation_of(common_name).filter(|_| rest.starts_with('/'))
}

/// Why nobody would admit who has these keys; `None`: nothing speaks against it. Files that cannot be read are told before.
fn misfit(identity: &Identity, (venue, node): (&str, &str), now_s: i64) -> Option<String> {
    let certificate = &identity.certificate;
    let shown = certificate.display();
    let name = common_name_in(certificate).ok()?;
    if node_of(venue, &name).is_none_or(|(of, _)| of != node) {
        return Some(format!(
            "{shown}: found the certificate of `{name}`, expected that of {node} of venue {venue}"
        ));
    }
    if is_signed(identity, now_s) == Some(false) {
        let authority = identity.authority.display();
        return Some(format!(
            "{shown}: it is not signed by the authority of {authority}"
        ));
    }
    let text = fs::read_to_string(&identity.key).ok()?;
    let key = identity.key.display();
    match KeyPair::from_pem(&text) {
        Ok(pair) => {
            let is_its_own = pair.public_key_raw() == public_key_in(certificate).ok()?;
            (!is_its_own).then(|| format!("{key}: it is not the key of {shown}"))
        }
        // Keys of other programs may have other forms.
        Err(_) if text.contains("-----BEGIN ") => None,
        Err(_) => Some(format!("{key}: found no private key in PEM")),
    }
}

/// Whether the certificate is one of the authority beside it; `None` where one of them cannot be read.
fn is_signed(identity: &Identity, now_s: i64) -> Option<bool> {
    let authority = CertificateDer::from_pem_file(&identity.authority).ok()?;
    let anchors = [anchor_from_trusted_cert(&authority).ok()?];
    let own = CertificateDer::from_pem_file(&identity.certificate).ok()?;
    let own = EndEntityCert::try_from(&own).ok()?;
    let now = UnixTime::since_unix_epoch(Duration::from_secs(now_s.unsigned_abs()));
    // Edges connect with it, and so does fusion to its own.
    let usage = KeyUsage::client_auth();
    let verified =
        own.verify_for_usage(ALL_VERIFICATION_ALGS, &anchors, &[], now, usage, None, None);
    Some(verified.is_ok())
}
