//! The validity of a node's certificate. Links close when it ends, so the node warns in time.

use std::net::{Ipv4Addr, Ipv6Addr};
use std::path::Path;

use anyhow::anyhow;
use farfield_proto::toml_file::FileError;
use farfield_proto::transport::{GENERATIONS_FILE, Identity, generation_of};
use x509_parser::certificate::X509Certificate;
use x509_parser::extensions::GeneralName;
use x509_parser::pem::parse_x509_pem;

use crate::process::{NodeError, say};

/// A node warns from this many days before the end of its certificate.
const WARNING_DAYS: i64 = 30;
const DAY_S: i64 = 86_400;

/// The validity period of a certificate, Unix time in seconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Validity {
    /// The first second.
    pub from_s: i64,
    /// The last second.
    pub until_s: i64,
}

impl Validity {
    /// The validity of the certificate in the PEM file at `path`.
    ///
    /// # Errors
    /// [`FileError`] when the file cannot be read or contains no certificate.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        CertificateFile::read(path).map(|certificate| certificate.validity)
    }
}

/// The used fields of a node's certificate.
#[derive(Debug)]
struct CertificateFile {
    validity: Validity,
    /// Common name; empty if the certificate has none.
    common_name: String,
    public_key: Vec<u8>,
    /// Names and addresses.
    hosts: Vec<String>,
}

impl CertificateFile {
    fn read(path: &Path) -> Result<Self, FileError> {
        let failed = |problem: String| FileError::new(path, problem);
        let text = std::fs::read(path)
            .map_err(|error| failed(format!("cannot read the certificate: {error}")))?;
        let (_, pem) = parse_x509_pem(&text)
            .map_err(|error| failed(format!("found no certificate in PEM: {error}")))?;
        let certificate = pem
            .parse_x509()
            .map_err(|error| failed(format!("found no X.509 certificate: {error}")))?;
        let validity = certificate.validity();
        let mut names = certificate.subject().iter_common_name();
        let name = names.find_map(|name| name.as_str().ok());
        Ok(Self {
            validity: Validity {
                from_s: validity.not_before.timestamp(),
                until_s: validity.not_after.timestamp(),
            },
            common_name: name.unwrap_or_default().to_owned(),
            public_key: certificate.public_key().subject_public_key.data.to_vec(),
            hosts: hosts_of(&certificate),
        })
    }

    /// As [`check_generation`], with this file.
    fn check_generation(&self, identity: &Identity) -> Result<(), FileError> {
        let Some((node, generation)) = generation_of(&self.common_name) else {
            return Ok(());
        };
        let newest = identity.generations.of(node);
        if generation >= newest {
            return Ok(());
        }
        Err(FileError::new(
            &identity.certificate,
            format!(
                "found the certificate `{}`, of generation {generation}, and {GENERATIONS_FILE} in the same folder says that {newest} is the newest of {node}: other nodes refuse an older one; copy {node}.pem and {node}.key of that generation here",
                self.common_name
            ),
        ))
    }
}

/// The host names and addresses among a certificate's alternative names.
fn hosts_of(certificate: &X509Certificate<'_>) -> Vec<String> {
    let names = certificate.subject_alternative_name().ok().flatten();
    let names = names.iter().flat_map(|names| &names.value.general_names);
    let host = |name: &GeneralName<'_>| match name {
        GeneralName::DNSName(name) => Some((*name).to_owned()),
        GeneralName::IPAddress(address) => match *address {
            [a, b, c, d] => Some(Ipv4Addr::new(*a, *b, *c, *d).to_string()),
            _ => <[u8; 16]>::try_from(*address)
                .ok()
                .map(|address| Ipv6Addr::from(address).to_string()),
        },
        _ => None,
    };
    names.filter_map(host).collect()
}

/// The common name in the certificate at `path`; empty if it has none.
///
/// # Errors
/// [`FileError`] when the file cannot be read or contains no certificate.
pub fn common_name_in(path: &Path) -> Result<String, FileError> {
    CertificateFile::read(path).map(|certificate| certificate.common_name)
}

/// The public key in the certificate at `path`, in the encoding of the certificate.
///
/// # Errors
/// [`FileError`] when the file cannot be read or contains no certificate.
pub fn public_key_in(path: &Path) -> Result<Vec<u8>, FileError> {
    CertificateFile::read(path).map(|certificate| certificate.public_key)
}

/// The names and addresses for which the certificate at `path` is valid.
///
/// # Errors
/// [`FileError`] when the file cannot be read or contains no certificate.
pub fn hosts_in(path: &Path) -> Result<Vec<String>, FileError> {
    CertificateFile::read(path).map(|certificate| certificate.hosts)
}

/// Refuses a certificate that is older than the newest generation known to `identity`: other nodes
/// refuse it.
///
/// # Errors
/// [`FileError`] with both generations, or when the certificate cannot be read.
pub fn check_generation(identity: &Identity) -> Result<(), FileError> {
    CertificateFile::read(&identity.certificate)?.check_generation(identity)
}

/// The warning at `now_s` about `node`'s certificate, which ends at `until_s`; `None` while the end
/// is far away.
pub fn ending_notice(node: &str, until_s: i64, now_s: i64) -> Option<String> {
    let days = until_s.saturating_sub(now_s).div_euclid(DAY_S);
    (days < WARNING_DAYS).then(|| {
        let when = match days {
            ..=-1 => format!("has ended {} days ago", -days),
            0 => "ends today".to_owned(),
            _ => format!("ends in {days} days"),
        };
        format!(
            "the certificate of {node} {when}, and links with it are closed then: `farfield certs VENUE --out DIR --renew {node}` makes a new one"
        )
    })
}

/// Reads the validity of `identity`, which belongs to `node`, and prints a warning if it ends soon.
///
/// # Errors
/// [`NodeError::Refused`] when the certificate has ended, is older than the newest of its node, or
/// is invalid. [`NodeError::Failed`] when its validity has not begun: then this machine's clock is
/// probably wrong, and a later start may succeed.
pub(crate) fn check(identity: &Identity, node: &str, now_s: i64) -> Result<Validity, NodeError> {
    let path = &identity.certificate;
    let certificate = CertificateFile::read(path).map_err(NodeError::refused)?;
    let generation = certificate.check_generation(identity);
    generation.map_err(NodeError::refused)?;
    let validity = certificate.validity;
    if now_s < validity.from_s {
        return Err(NodeError::failed(anyhow!(
            "{}: the certificate begins in {:.1} days by the clock of this machine, which is probably wrong: set the clock, by NTP or PTP",
            path.display(),
            (validity.from_s - now_s) as f64 / DAY_S as f64
        )));
    }
    let notice = ending_notice(node, validity.until_s, now_s);
    if now_s > validity.until_s {
        let notice = notice.unwrap_or_default();
        return Err(NodeError::refused(FileError::new(path, notice)));
    }
    if let Some(notice) = notice {
        say(format_args!("{notice}"));
    }
    Ok(validity)
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use farfield_proto::transport::{Generations, common_name};

    use super::*;

    const NOW_S: i64 = 1_790_000_000;

    /// A certificate that is valid between two days relative to [`NOW_S`].
    fn identity(folder: &Path, from_days: i64, until_days: i64) -> Identity {
        let at =
            |days: i64| time::OffsetDateTime::from_unix_timestamp(NOW_S + days * DAY_S).unwrap();
        let mut params = rcgen::CertificateParams::new(vec!["hall".to_owned()]).unwrap();
        (params.not_before, params.not_after) = (at(from_days), at(until_days));
        let name = common_name("hall", "ne", 2);
        params
            .distinguished_name
            .push(rcgen::DnType::CommonName, name);
        let key = rcgen::KeyPair::generate().unwrap();
        let certificate = params.self_signed(&key).unwrap();
        let path = folder.join("ne.pem");
        std::fs::write(&path, certificate.pem()).unwrap();
        Identity {
            authority: PathBuf::new(),
            certificate: path,
            key: PathBuf::new(),
            generations: Generations::default(),
        }
    }

    #[test]
    fn a_node_warns_before_its_certificate_ends_and_refuses_it_afterwards() {
        let folder = tempfile::tempdir().unwrap();
        let identity = |until| identity(folder.path(), -100, until);
        let validity = check(&identity(31), "ne", NOW_S).unwrap();
        assert_eq!(validity.until_s, NOW_S + 31 * DAY_S);
        assert_eq!(ending_notice("ne", validity.until_s, NOW_S), None);
        let notice = ending_notice("ne", validity.until_s, NOW_S + 2 * DAY_S).unwrap();
        assert!(
            notice.contains("ne ends in 29 days") && notice.contains("--renew ne"),
            "{notice}"
        );
        let refused = check(&identity(-3), "ne", NOW_S).unwrap_err();
        assert!(matches!(refused, NodeError::Refused(_)));
        assert!(
            refused.to_string().contains("has ended 3 days ago"),
            "{refused}"
        );
    }

    #[test]
    fn a_future_certificate_is_a_failure_that_names_the_clock() {
        let folder = tempfile::tempdir().unwrap();
        let error = check(&identity(folder.path(), 2, 100), "ne", NOW_S).unwrap_err();
        assert!(matches!(error, NodeError::Failed(_)));
    }

    #[test]
    fn a_certificate_of_an_older_generation_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let mut identity = identity(folder.path(), -1, 100);
        for _ in 0..2 {
            identity.generations.renew("ne");
            check(&identity, "ne", NOW_S).unwrap();
        }
        identity.generations.renew("ne");
        let refused = check(&identity, "ne", NOW_S).unwrap_err();
        assert!(matches!(refused, NodeError::Refused(_)));
        let refused = refused.to_string();
        for word in ["ne.pem", "`hall/ne/2`", "generation 2", "3 is the newest"] {
            assert!(refused.contains(word), "{word}: {refused}");
        }
    }

    #[test]
    fn an_invalid_certificate_is_refused_with_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ne.pem");
        std::fs::write(&path, "hello").unwrap();
        let error = CertificateFile::read(&path).unwrap_err().to_string();
        assert!(error.contains("ne.pem") && error.contains("PEM"), "{error}");
    }
}
