//! Queries to fusion, repeated until answered: the round trip can be long, and fusion may not run
//! yet. The list of files must be signed with a certificate that the venue's authority issued for a
//! fusion node.

use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use farfield_node::session;
use farfield_proto::key::Keys;
use farfield_proto::message::handout::{
    Chunk, HandoutRequest, SIGNED_AHEAD, SharedFile, SignedList,
};
use farfield_proto::transport::Identity;
use farfield_proto::wire::{self, Message, WireError};
use rustls_pki_types::pem::PemObject as _;
use rustls_pki_types::{CertificateDer, UnixTime};
use tracing::debug;
use webpki::{ALL_VERIFICATION_ALGS, EndEntityCert, KeyUsage, anchor_from_trusted_cert};
use zenoh::Session;
use zenoh::qos::{CongestionControl, Priority};

use super::place::Part;

/// Longest wait for an answer: a chunk over a link of 64 kbit/s.
const PATIENCE: Duration = Duration::from_secs(15);
/// Pause before an unanswered query is repeated.
const RETRY_AFTER: Duration = Duration::from_millis(300);
/// Attempts per chunk before the file is given up.
const TRIES: u32 = 20;

/// The fusion node that provides the files.
pub(super) struct Fusion {
    session: Session,
    key: String,
    /// Why the last query failed.
    failure: Mutex<Option<String>>,
}

impl Fusion {
    pub(super) fn new(session: Session, venue: &str) -> Self {
        Self {
            session,
            key: Keys::new(venue).config(),
            failure: Mutex::default(),
        }
    }

    /// Fetches the list of files; waits for fusion without a limit.
    ///
    /// # Errors
    /// If fusion uses another wire version, because this cannot change.
    pub(super) async fn list(&self) -> anyhow::Result<SignedList> {
        loop {
            match self.ask(&HandoutRequest::List).await {
                Ok(list) => return Ok(list),
                Err(error) if is_final(&error) => return Err(error),
                Err(error) => debug!(%error, "no list of files"),
            }
            tokio::time::sleep(RETRY_AFTER).await;
        }
    }

    /// Why the last query failed; `None` if it succeeded.
    pub(super) fn failure(&self) -> Option<String> {
        let failure = self.failure.lock().unwrap_or_else(PoisonError::into_inner);
        failure.clone()
    }

    /// Fetches a file of the list, with the final path `target`.
    pub(super) async fn file(
        &self,
        index: u16,
        file: &SharedFile,
        target: &Path,
    ) -> anyhow::Result<Part> {
        let mut part = Part::create(target, file)?;
        let mut from = 0;
        while from < file.bytes {
            let chunk = self.chunk(index, from).await?;
            anyhow::ensure!(
                !chunk.is_empty(),
                "{} has become shorter on fusion's machine since fusion started: start fusion again",
                target.display()
            );
            from += chunk.len() as u64;
            anyhow::ensure!(
                from <= file.bytes,
                "{} has become longer on fusion's machine since fusion started: start fusion again",
                target.display()
            );
            part.write(&chunk)?;
        }
        part.check()?;
        Ok(part)
    }

    async fn chunk(&self, file: u16, from: u64) -> anyhow::Result<Vec<u8>> {
        let mut tries = 0;
        loop {
            match self.ask(&HandoutRequest::Chunk { file, from }).await {
                Ok(Chunk { bytes }) => return Ok(bytes),
                Err(error) if tries == TRIES || is_final(&error) => return Err(error),
                Err(error) => debug!(%error, "no chunk"),
            }
            tries += 1;
            tokio::time::sleep(RETRY_AFTER).await;
        }
    }

    async fn ask<M: Message>(&self, question: &HandoutRequest) -> anyhow::Result<M> {
        let answer = self.try_to_ask(question).await;
        let failure = answer.as_ref().err().map(|error| format!("{error:#}"));
        *self.failure.lock().unwrap_or_else(PoisonError::into_inner) = failure;
        answer
    }

    async fn try_to_ask<M: Message>(&self, question: &HandoutRequest) -> anyhow::Result<M> {
        let replies = self
            .session
            .get(self.key.as_str())
            .payload(wire::encode_for_anyone(question))
            .priority(Priority::DataLow)
            .congestion_control(CongestionControl::Block)
            .timeout(PATIENCE)
            .await;
        let replies = replies.map_err(|error| anyhow!("{error}"))?;
        let reply = replies.recv_async().await;
        let reply = reply.map_err(|_| anyhow!("fusion does not hand out files (yet)"))?;
        match reply.result() {
            Ok(sample) => Ok(wire::decode(&sample.payload().to_bytes())?),
            Err(refusal) => {
                let bytes = refusal.payload().to_bytes();
                Err(anyhow!(
                    "fusion answers: {}",
                    String::from_utf8_lossy(&bytes)
                ))
            }
        }
    }

    /// Closes the session.
    pub(super) async fn close(self) {
        session::close(&self.session).await;
    }
}

/// Whether a repetition cannot help.
fn is_final(error: &anyhow::Error) -> bool {
    let error = error.downcast_ref();
    matches!(error, Some(WireError::Version { .. }))
}

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
