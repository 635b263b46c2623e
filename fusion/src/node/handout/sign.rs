//! Fusion's signature under the list of files: with the key of its certificate, which the venue's
//! authority has signed.

use anyhow::{Context as _, anyhow};
use farfield_proto::message::handout::{ListSignature, SIGNED_AHEAD};
use farfield_proto::transport::Identity;
use ring::rand::SystemRandom;
use ring::signature::{ECDSA_P256_SHA256_ASN1_SIGNING, EcdsaKeyPair};
use rustls_pki_types::pem::PemObject as _;
use rustls_pki_types::{CertificateDer, PrivatePkcs8KeyDer};

/// Signs `list`.
///
/// # Errors
/// When certificate or key cannot be read, or the key is not one of ECDSA P-256, as `farfield certs`
/// makes them. No error says anything of the key.
pub(super) fn sign(list: &[u8], identity: &Identity) -> anyhow::Result<ListSignature> {
    let certificate = CertificateDer::from_pem_file(&identity.certificate)
        .map_err(|error| anyhow!("reading {}: {error}", identity.certificate.display()))?;
    let path = identity.key.display();
    let der = PrivatePkcs8KeyDer::from_pem_file(&identity.key)
        .map_err(|error| anyhow!("reading {path}: {error}"))?;
    let random = SystemRandom::new();
    let algorithm = &ECDSA_P256_SHA256_ASN1_SIGNING;
    let pair =
        EcdsaKeyPair::from_pkcs8(algorithm, der.secret_pkcs8_der(), &random).map_err(|_| {
            anyhow!("{path} is not a key of ECDSA P-256, as `farfield certs` makes them")
        })?;
    let signature = pair
        .sign(&random, &[SIGNED_AHEAD, list].concat())
        .ok()
        .context("signing the list of the venue's files")?;
    Ok(ListSignature {
        certificate: certificate.as_ref().to_vec(),
        ecdsa: signature.as_ref().to_vec(),
    })
}
