//! Checks that the keys of a node belong to its venue, to the authority in the same folder, and to
//! each other. With wrong keys a node would wait for ever, because other nodes close the connection
//! without a reason.

use std::path::Path;
use std::time::Duration;

use anyhow::anyhow;
use farfield_proto::toml_file::FileError;
use farfield_proto::transport::{FUSION, Identity, READER, generation_of};
use rustls::crypto::ring::default_provider;
use rustls::sign::CertifiedKey;
use rustls_pki_types::pem::{self, PemObject as _};
use rustls_pki_types::{CertificateDer, PrivateKeyDer, TrustAnchor, UnixTime};
use webpki::{ALL_VERIFICATION_ALGS, EndEntityCert, KeyUsage, anchor_from_trusted_cert};

use crate::certificate::{self, Validity, common_name_in};
use crate::process::NodeError;

/// Checks the keys with which a node of this venue and name starts at `now_s` (Unix time in
/// seconds). Returns their validity, and warns if it ends soon.
///
/// # Errors
/// [`NodeError::Refused`] when the keys have ended, are outdated, belong to another node, or are
/// invalid. [`NodeError::Failed`] when their validity has not begun: then this machine's clock is
/// probably wrong, and a later start may succeed.
pub fn check(
    identity: &Identity,
    venue: &str,
    node: &str,
    now_s: i64,
) -> Result<Validity, NodeError> {
    let validity = certificate::check(identity, node, now_s)?;
    check_own(identity, venue, node, now_s).map_err(|misfit| {
        NodeError::refused(anyhow!(
            "{misfit}; copy ca.pem, {node}.pem and {node}.key of venue {venue} there from the folder that `farfield certs` has written"
        ))
    })?;
    Ok(validity)
}

/// Refuses keys with which other nodes would not admit the node of this venue and name, at `now_s`
/// (Unix time in seconds). The caller adds the remedy.
///
/// # Errors
/// [`FileError`] with the certificate if it belongs to another node or authority, with the key if
/// it is invalid or does not match the certificate, and as [`check_authority`].
pub fn check_own(
    identity: &Identity,
    venue: &str,
    node: &str,
    now_s: i64,
) -> Result<(), FileError> {
    check_name(identity, venue, node)?;
    let chain = certificates_in(&identity.certificate, &format!("that of {node}"))?;
    check_key(identity, &chain)?;
    check_signature(identity, node, &chain, now_s)
}

/// Refuses a file that does not contain certificates of authorities.
///
/// # Errors
/// [`FileError`] when the file cannot be read or has other content.
pub fn check_authority(path: &Path) -> Result<(), FileError> {
    anchors(&authorities_in(path)?, path).map(drop)
}

/// The node of `venue` and the generation in a certificate's common name; `None` for other names.
pub fn node_of<'a>(venue: &str, common_name: &'a str) -> Option<(&'a str, u32)> {
    let rest = common_name.strip_prefix(venue)?;
    generation_of(common_name).filter(|_| rest.starts_with('/'))
}

fn check_name(identity: &Identity, venue: &str, node: &str) -> Result<(), FileError> {
    let path = &identity.certificate;
    let name = common_name_in(path)?;
    // Readers of releases without generations share one name.
    let is_own = node_of(venue, &name).is_some_and(|of| of.0 == node || of == (READER, 0));
    if is_own {
        return Ok(());
    }
    Err(FileError::new(
        path,
        format!(
            "found the certificate of `{name}`, expected that of {node} of venue {venue}: no other certificate is admitted as {node}"
        ),
    ))
}

/// Uses the same code as links do, so that both accept the same keys, whichever program made them.
fn check_key(identity: &Identity, chain: &[CertificateDer<'static>]) -> Result<(), FileError> {
    let certificate = identity.certificate.display();
    let failed = |problem: String| FileError::new(&identity.key, problem);
    let key = PrivateKeyDer::from_pem_file(&identity.key).map_err(|error| match error {
        pem::Error::Io(error) => failed(format!("cannot read the private key: {error}")),
        // The text of other errors may contain a line of the key.
        _ => failed(format!(
            "found no private key in PEM, expected that of {certificate}"
        )),
    })?;
    match CertifiedKey::from_der(chain.to_vec(), key, &default_provider()) {
        Ok(_) => Ok(()),
        Err(rustls::Error::InconsistentKeys(_)) => Err(failed(format!(
            "found the private key of another certificate, expected that of {certificate}"
        ))),
        Err(error) => Err(failed(format!(
            "found a private key that no link can use ({error}), expected that of {certificate}"
        ))),
    }
}

/// `chain`: the certificate, then those of intermediate authorities.
fn check_signature(
    identity: &Identity,
    node: &str,
    chain: &[CertificateDer<'static>],
    now_s: i64,
) -> Result<(), FileError> {
    let authorities = authorities_in(&identity.authority)?;
    let anchors = anchors(&authorities, &identity.authority)?;
    let failed = |error: webpki::Error| {
        let authority = identity.authority.display();
        let problem = match error {
            webpki::Error::UnknownIssuer
            | webpki::Error::InvalidSignatureForPublicKey
            | webpki::Error::CaUsedAsEndEntity => format!(
                "found a certificate that is not signed by the authority of {authority} ({error}), expected one that is"
            ),
            _ => format!(
                "found a certificate that no link can use ({error}), expected one of the authority of {authority}"
            ),
        };
        FileError::new(&identity.certificate, problem)
    };
    let Some((own, between)) = chain.split_first() else {
        return Err(failed(webpki::Error::UnknownIssuer));
    };
    let own = EndEntityCert::try_from(own).map_err(failed)?;
    let now = UnixTime::since_unix_epoch(Duration::from_secs(now_s.unsigned_abs()));
    // Fusion listens with it; all other nodes connect.
    let usage = if node == FUSION {
        KeyUsage::server_auth()
    } else {
        KeyUsage::client_auth()
    };
    let verified = own.verify_for_usage(
        ALL_VERIFICATION_ALGS,
        &anchors,
        between,
        now,
        usage,
        None,
        None,
    );
    verified.map(drop).map_err(failed)
}

/// The certificates of authorities at `path`.
fn authorities_in(path: &Path) -> Result<Vec<CertificateDer<'static>>, FileError> {
    certificates_in(path, "that of the venue's authority")
}

/// All certificates at `path`, at least one. `expected` describes the owner of the first.
fn certificates_in(path: &Path, expected: &str) -> Result<Vec<CertificateDer<'static>>, FileError> {
    let read = || -> Result<Vec<CertificateDer<'static>>, pem::Error> {
        let all = CertificateDer::pem_file_iter(path)?.collect::<Result<Vec<_>, _>>()?;
        if all.is_empty() {
            return Err(pem::Error::NoItemsFound);
        }
        Ok(all)
    };
    read().map_err(|error| {
        FileError::new(
            path,
            format!("found no certificate in PEM ({error}), expected {expected}"),
        )
    })
}

/// The trust anchors of `certificates`, which were read from `path`.
fn anchors<'a>(
    certificates: &'a [CertificateDer<'static>],
    path: &Path,
) -> Result<Vec<TrustAnchor<'a>>, FileError> {
    let anchor = |certificate: &'a CertificateDer<'static>| {
        anchor_from_trusted_cert(certificate).map_err(|error| {
            FileError::new(
                path,
                format!("found a certificate that cannot be read ({error}), expected that of the venue's authority"),
            )
        })
    };
    certificates.iter().map(anchor).collect()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use farfield_proto::transport::{common_name, reader};
    use rcgen::{BasicConstraints, CertificateParams, CertifiedIssuer, DnType, IsCa, KeyPair};
    use time::OffsetDateTime;

    use super::*;

    const NOW_S: i64 = 1_790_000_000;
    const DAY_S: i64 = 86_400;
    /// Venue and node of the tests.
    const NE: (&str, &str) = ("hall", "ne");

    /// Parameters of a certificate with this common name.
    fn params(common_name: &str) -> CertificateParams {
        let at = |days: i64| OffsetDateTime::from_unix_timestamp(NOW_S + days * DAY_S).unwrap();
        let mut params = CertificateParams::new(vec!["hall".to_owned()]).unwrap();
        (params.not_before, params.not_after) = (at(-1), at(100));
        params
            .distinguished_name
            .push(DnType::CommonName, common_name);
        params
    }

    /// Writes keys with this common name, signed by a new authority.
    fn make(identity: &Identity, common_name: &str) {
        let mut of_authority = params("hall authority");
        of_authority.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        let key = KeyPair::generate().unwrap();
        let authority = CertifiedIssuer::self_signed(of_authority, key).unwrap();
        let key = KeyPair::generate().unwrap();
        let certificate = params(common_name).signed_by(&key, &authority).unwrap();
        fs::write(&identity.authority, authority.pem()).unwrap();
        fs::write(&identity.certificate, certificate.pem()).unwrap();
        fs::write(&identity.key, key.serialize_pem()).unwrap();
    }

    /// The text of one file of other keys with the same name.
    fn of_others(file: impl FnOnce(&Identity) -> &Path) -> String {
        let folder = tempfile::tempdir().unwrap();
        let others = Identity::in_folder(folder.path(), NE.1);
        make(&others, &common_name(NE.0, NE.1, 2));
        fs::read_to_string(file(&others)).unwrap()
    }

    /// The error for the keys of ne after `change`.
    fn check_after(change: impl FnOnce(&Identity)) -> Result<(), String> {
        let folder = tempfile::tempdir().unwrap();
        let identity = Identity::in_folder(folder.path(), NE.1);
        make(&identity, &common_name(NE.0, NE.1, 2));
        change(&identity);
        match check(&identity, NE.0, NE.1, NOW_S) {
            Ok(_) => Ok(()),
            Err(error @ NodeError::Refused(_)) => Err(error.to_string()),
            Err(error) => panic!("{error}"),
        }
    }

    /// The error after the text of the key was replaced.
    fn check_with_key(text: &str) -> Result<(), String> {
        check_after(|keys| fs::write(&keys.key, text).unwrap())
    }

    #[test]
    fn matching_keys_of_the_node_and_venue_pass() {
        check_after(|_| {}).unwrap();
        // The name before generations were counted.
        check_after(|keys| make(keys, "hall/ne")).unwrap();
        // Links accept several authorities from one file.
        check_after(|keys| {
            let own = fs::read_to_string(&keys.authority).unwrap();
            let both = of_others(|it| &it.authority) + &own;
            fs::write(&keys.authority, both).unwrap();
        })
        .unwrap();
    }

    #[test]
    fn keys_of_another_venue_or_node_are_refused() {
        for other in ["arena/ne/2", "hall/nw/2", "hall2/ne/2", "other"] {
            let refused = check_after(|keys| make(keys, other)).unwrap_err();
            let found = format!("ne.pem: found the certificate of `{other}`");
            for words in [&found, "expected that of ne of venue hall"] {
                assert!(refused.contains(words), "{words}: {refused}");
            }
        }
    }

    #[test]
    fn mismatched_keys_are_refused() {
        let of_another_authority = |keys: &Identity| {
            fs::write(&keys.authority, of_others(|it| &it.authority)).unwrap();
        };
        let cases = [
            (
                check_after(of_another_authority),
                "ne.pem: found a certificate that is not signed by the authority of",
            ),
            (
                check_with_key(&of_others(|it| &it.key)),
                "ne.key: found the private key of another certificate",
            ),
        ];
        for (result, words) in cases {
            let refused = result.unwrap_err();
            assert!(refused.contains(words), "{words}: {refused}");
        }
    }

    #[test]
    fn invalid_key_files_are_refused_without_quoting_them() {
        // Regression: with an invalid key file an edge waited for ever.
        let no_key = "ne.key: found no private key in PEM";
        let useless = "-----BEGIN PRIVATE KEY-----\nc2VjcmV0\n-----END PRIVATE KEY-----\n";
        let own_line = "-----BEGIN secret\n";
        let cases = [
            (check_with_key("secret"), no_key),
            (check_with_key(""), no_key),
            (check_with_key(own_line), no_key),
            (check_with_key(&useless[..40]), no_key),
            (check_with_key(&of_others(|it| &it.certificate)), no_key),
            (
                check_with_key(useless),
                "ne.key: found a private key that no link can use",
            ),
            (
                check_after(|keys| fs::write(&keys.authority, "secret").unwrap()),
                "ca.pem: found no certificate in PEM",
            ),
        ];
        for (result, words) in cases {
            let refused = result.unwrap_err();
            let remedy = "copy ca.pem, ne.pem and ne.key of venue hall";
            for words in [words, "expected that of", remedy] {
                assert!(refused.contains(words), "{words}: {refused}");
            }
            assert!(
                !refused.contains("secret") && !refused.contains("c2Vj"),
                "{refused}"
            );
        }
    }

    #[test]
    fn a_reader_has_its_own_name_or_the_old_common_one() {
        let folder = tempfile::tempdir().unwrap();
        let identity = Identity::in_folder(folder.path(), "screen");
        for name in [
            common_name("hall", &reader("screen"), 1),
            common_name("hall", READER, 0),
        ] {
            make(&identity, &name);
            check_own(&identity, "hall", "screen", NOW_S).unwrap();
        }
        make(&identity, &common_name("hall", &reader("door"), 1));
        check_own(&identity, "hall", "screen", NOW_S).unwrap_err();
    }
}
