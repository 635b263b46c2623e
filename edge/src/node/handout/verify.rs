//! Verification of a list of files: it must be signed with a certificate that the venue's authority
//! issued for a fusion node.

use anyhow::{Context as _, anyhow};
use farfield_proto::message::handout::{SIGNED_AHEAD, SignedList};
use farfield_proto::transport::Identity;
use rustls_pki_types::pem::PemObject as _;
use rustls_pki_types::{CertificateDer, UnixTime};
use webpki::{ALL_VERIFICATION_ALGS, EndEntityCert, KeyUsage, anchor_from_trusted_cert};

/// The list, if the signature is valid.
///
/// # Errors
/// If the signature is missing or does not match the list, or the certificate is not one of a
/// fusion node of this venue's authority.
pub(super) fn verify<'a>(signed: &'a SignedList, identity: &Identity) -> anyhow::Result<&'a [u8]> {
    let authority = CertificateDer::from_pem_file(&identity.authority)
        .map_err(|error| anyhow!("reading {}: {error}", identity.authority.display()))?;
    verify_at(signed, &authority, UnixTime::now())
}

fn verify_at<'a>(
    signed: &'a SignedList,
    authority: &CertificateDer<'_>,
    now: UnixTime,
) -> anyhow::Result<&'a [u8]> {
    let signature = signed
        .signature
        .as_ref()
        .context("fusion's list of files is not signed, but this edge has keys")?;
    let anchor = anchor_from_trusted_cert(authority).context("ca.pem")?;
    let der = CertificateDer::from(signature.certificate.as_slice());
    let certificate = EndEntityCert::try_from(&der).context("the certificate of the signature")?;
    certificate
        .verify_for_usage(
            ALL_VERIFICATION_ALGS,
            &[anchor],
            &[],
            now,
            // Only a certificate of fusion has this usage.
            KeyUsage::server_auth(),
            None,
            None,
        )
        .map_err(|error| anyhow!("the list of files is not signed by fusion: {error}"))?;
    certificate
        .verify_signature(
            webpki::ring::ECDSA_P256_SHA256,
            &[SIGNED_AHEAD, &signed.list].concat(),
            &signature.ecdsa,
        )
        .map_err(|error| anyhow!("the signature of fusion's list of files is invalid: {error}"))?;
    Ok(&signed.list)
}

#[cfg(test)]
mod tests {
    use farfield_proto::message::handout::ListSignature;
    use rcgen::{
        BasicConstraints, CertificateParams, CertifiedIssuer, ExtendedKeyUsagePurpose, IsCa,
        KeyPair, SigningKey as _,
    };

    use super::*;

    fn authority() -> CertifiedIssuer<'static, KeyPair> {
        let mut params = CertificateParams::default();
        params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        CertifiedIssuer::self_signed(params, KeyPair::generate().unwrap()).unwrap()
    }

    fn signed(
        authority: &CertifiedIssuer<'static, KeyPair>,
        usage: ExtendedKeyUsagePurpose,
        list: &[u8],
    ) -> SignedList {
        let mut params = CertificateParams::default();
        params.extended_key_usages = vec![usage];
        let key = KeyPair::generate().unwrap();
        let certificate = params.signed_by(&key, authority).unwrap();
        SignedList {
            list: list.to_vec(),
            signature: Some(ListSignature {
                certificate: certificate.der().to_vec(),
                ecdsa: key.sign(&[SIGNED_AHEAD, list].concat()).unwrap(),
            }),
        }
    }

    #[test]
    fn only_a_signature_of_fusion_under_this_list_is_valid() {
        let (ours, other) = (authority(), authority());
        let server = || ExtendedKeyUsagePurpose::ServerAuth;
        let now = UnixTime::now();
        let good = signed(&ours, server(), b"files");
        assert_eq!(verify_at(&good, ours.der(), now).unwrap(), b"files");

        let mut changed = good.clone();
        changed.list = b"other files".to_vec();
        let mut unsigned = good.clone();
        unsigned.signature = None;
        for wrong in [
            changed,
            unsigned,
            signed(&other, server(), b"files"),
            signed(&ours, ExtendedKeyUsagePurpose::ClientAuth, b"files"),
        ] {
            assert!(verify_at(&wrong, ours.der(), now).is_err());
        }
    }
}
