//! HTTPS with the venue's keys, by the cryptography that the rest of the program has.

use std::sync::Arc;

use rustls_pki_types::pem::PemObject as _;
use rustls_pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::ServerConfig;
use tokio_rustls::rustls::crypto::ring;

/// A certificate chain and its private key, PEM.
pub struct Keys {
    /// The certificate, then those that signed it.
    pub certificate_pem: Vec<u8>,
    /// The key.
    pub key_pem: Vec<u8>,
}

impl std::fmt::Debug for Keys {
    /// Not the key.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Keys(..)")
    }
}

/// Why keys cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum KeysError {
    /// The certificate is none.
    #[error("the page's certificate cannot be read: {0}")]
    Certificate(String),
    /// There is no certificate.
    #[error("the page's certificate: expected PEM with at least one CERTIFICATE, found none")]
    NoCertificate,
    /// The key is none.
    #[error("the page's private key cannot be read: {0}")]
    Key(String),
    /// The two do not fit.
    #[error("the page's certificate and key cannot be used: {0}")]
    Refused(String),
}

impl Keys {
    /// What makes connections secret with these keys.
    pub(super) fn acceptor(&self) -> Result<TlsAcceptor, KeysError> {
        let chain: Result<Vec<_>, _> =
            CertificateDer::pem_slice_iter(&self.certificate_pem).collect();
        let chain = chain.map_err(|error| KeysError::Certificate(error.to_string()))?;
        if chain.is_empty() {
            return Err(KeysError::NoCertificate);
        }
        let key = PrivateKeyDer::from_pem_slice(&self.key_pem)
            .map_err(|error| KeysError::Key(error.to_string()))?;
        let refused = |error: tokio_rustls::rustls::Error| KeysError::Refused(error.to_string());
        let mut config = ServerConfig::builder_with_provider(Arc::new(ring::default_provider()))
            .with_safe_default_protocol_versions()
            .map_err(refused)?
            .with_no_client_auth()
            .with_single_cert(chain, key)
            .map_err(refused)?;
        config.alpn_protocols = vec![b"http/1.1".to_vec()];
        Ok(TlsAcceptor::from(Arc::new(config)))
    }
}
