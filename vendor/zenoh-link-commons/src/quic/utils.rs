//
// Copyright (c) 2025 ZettaScale Technology
//
// This program and the accompanying materials are made available under the
// terms of the Eclipse Public License 2.0 which is available at
// http://www.eclipse.org/legal/epl-2.0, or the Apache License, Version 2.0
// which is available at https://www.apache.org/licenses/LICENSE-2.0.
//
// SPDX-License-Identifier: EPL-2.0 OR Apache-2.0
//
// Contributors:
//   ZettaScale Zenoh Team, <zenoh@zettascale.tech>
//
use std::{
    fmt::{self, Debug},
    fs::File,
    io::{self, BufReader, Cursor},
    net::SocketAddr,
    sync::Arc,
    time::Duration,
};

use quinn::{crypto::rustls::HandshakeData, TransportConfig};
use rustls::{
    crypto::CryptoProvider,
    pki_types::{CertificateDer, PrivateKeyDer, TrustAnchor},
    server::WebPkiClientVerifier,
    version::TLS13,
    ClientConfig, RootCertStore, ServerConfig,
};
use secrecy::ExposeSecret;
use time::OffsetDateTime;
use webpki::anchor_from_trusted_cert;
use x509_parser::prelude::{FromDer, X509Certificate};
use zenoh_config::Config as ZenohConfig;
use zenoh_protocol::core::{
    endpoint::{Address, Config},
    parameters,
};
use zenoh_result::{bail, zerror, ZError, ZResult};

use crate::{
    quic::{
        congestion::SteadyWindowConfig,
        plaintext::{SkipServerVerification, SELF_SIGNED_CERT},
        unicast::MultiStreamConfig,
    },
    tls::{config::*, WebPkiVerifierAnyServerName},
    ConfigurationInspector, LinkAuthId,
};

// ALPN protocols
/// Protocol used by zenoh <= 1.8.0
pub const PROTOCOL_LEGACY: &[u8] = b"hq-29";
/// Zenoh single stream
pub const PROTOCOL_SINGLE_STREAM: &[u8] = b"zenoh";
/// Zenoh mixed reliability (single stream)
pub const PROTOCOL_MIXED_REL: &[u8] = b"zenoh-mr";
/// Zenoh multi stream (no mixed reliability)
pub const PROTOCOL_MULTI_STREAM: &[u8] = b"zenoh-ms";
/// Zenoh multi stream mixed reliability
pub const PROTOCOL_MULTI_STREAM_MIXED_REL: &[u8] = b"zenoh-ms-mr";

// QUIC MTU config
pub const QUIC_INITIAL_MTU: &str = "initial_mtu";
pub const QUIC_MTU_DISCOVERY_INTERVAL: &str = "mtu_discovery_interval_secs";

// QUIC segmentation offload config
/// Enables or disables UDP generic segmentation offload (GSO) for the link: `true` (default) or `false`.
///
/// When disabled, each QUIC datagram is passed to the OS in its own system call.
pub const QUIC_SEGMENTATION_OFFLOAD: &str = "segmentation_offload";

// QUIC best-effort config (Farfield's addition, see FARFIELD.md)
/// Bytes that may be in flight whatever was lost. Not set: the congestion controller alone decides.
pub const QUIC_MIN_WINDOW: &str = "min_window";
/// Most bytes of unreliable datagrams that wait to be sent; the oldest are dropped for newer ones.
pub const QUIC_DATAGRAM_BUFFER: &str = "datagram_buffer";

#[derive(Default, Clone, Copy, Debug)]
pub struct TlsConfigurator;

impl ConfigurationInspector<ZenohConfig> for TlsConfigurator {
    fn inspect_config(&self, config: &ZenohConfig) -> ZResult<String> {
        let mut ps: Vec<(&str, &str)> = vec![];

        let c = config.transport().link().tls();

        match (c.root_ca_certificate(), c.root_ca_certificate_base64()) {
            (Some(_), Some(_)) => {
                bail!("Only one between 'root_ca_certificate' and 'root_ca_certificate_base64' can be present!")
            }
            (Some(ca_certificate), None) => {
                ps.push((TLS_ROOT_CA_CERTIFICATE_FILE, ca_certificate));
            }
            (None, Some(ca_certificate)) => {
                ps.push((
                    TLS_ROOT_CA_CERTIFICATE_BASE64,
                    ca_certificate.expose_secret(),
                ));
            }
            _ => {}
        }

        match (c.listen_private_key(), c.listen_private_key_base64()) {
            (Some(_), Some(_)) => {
                bail!("Only one between 'listen_private_key' and 'listen_private_key_base64' can be present!")
            }
            (Some(server_private_key), None) => {
                ps.push((TLS_LISTEN_PRIVATE_KEY_FILE, server_private_key));
            }
            (None, Some(server_private_key)) => {
                ps.push((
                    TLS_LISTEN_PRIVATE_KEY_BASE64,
                    server_private_key.expose_secret(),
                ));
            }
            _ => {}
        }

        match (c.listen_certificate(), c.listen_certificate_base64()) {
            (Some(_), Some(_)) => {
                bail!("Only one between 'listen_certificate' and 'listen_certificate_base64' can be present!")
            }
            (Some(server_certificate), None) => {
                ps.push((TLS_LISTEN_CERTIFICATE_FILE, server_certificate));
            }
            (None, Some(server_certificate)) => {
                ps.push((
                    TLS_LISTEN_CERTIFICATE_BASE64,
                    server_certificate.expose_secret(),
                ));
            }
            _ => {}
        }

        match c.enable_mtls().unwrap_or(TLS_ENABLE_MTLS_DEFAULT) {
            true => ps.push((TLS_ENABLE_MTLS, "true")),
            false => ps.push((TLS_ENABLE_MTLS, "false")),
        }

        match (c.connect_private_key(), c.connect_private_key_base64()) {
            (Some(_), Some(_)) => {
                bail!("Only one between 'connect_private_key' and 'connect_private_key_base64' can be present!")
            }
            (Some(client_private_key), None) => {
                ps.push((TLS_CONNECT_PRIVATE_KEY_FILE, client_private_key));
            }
            (None, Some(client_private_key)) => {
                ps.push((
                    TLS_CONNECT_PRIVATE_KEY_BASE64,
                    client_private_key.expose_secret(),
                ));
            }
            _ => {}
        }

        match (c.connect_certificate(), c.connect_certificate_base64()) {
            (Some(_), Some(_)) => {
                bail!("Only one between 'connect_certificate' and 'connect_certificate_base64' can be present!")
            }
            (Some(client_certificate), None) => {
                ps.push((TLS_CONNECT_CERTIFICATE_FILE, client_certificate));
            }
            (None, Some(client_certificate)) => {
                ps.push((
                    TLS_CONNECT_CERTIFICATE_BASE64,
                    client_certificate.expose_secret(),
                ));
            }
            _ => {}
        }

        match c
            .verify_name_on_connect()
            .unwrap_or(TLS_VERIFY_NAME_ON_CONNECT_DEFAULT)
        {
            true => ps.push((TLS_VERIFY_NAME_ON_CONNECT, "true")),
            false => ps.push((TLS_VERIFY_NAME_ON_CONNECT, "false")),
        };

        match c
            .close_link_on_expiration()
            .unwrap_or(TLS_CLOSE_LINK_ON_EXPIRATION_DEFAULT)
        {
            true => ps.push((TLS_CLOSE_LINK_ON_EXPIRATION, "true")),
            false => ps.push((TLS_CLOSE_LINK_ON_EXPIRATION, "false")),
        }

        Ok(parameters::from_iter(ps.drain(..)))
    }
}

pub struct TlsServerConfig {
    pub server_config: ServerConfig,
    pub tls_close_link_on_expiration: bool,
}

impl Debug for TlsServerConfig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("TlsServerConfig")
            .field("server_config", &"..")
            .field(
                "tls_close_link_on_expiration",
                &self.tls_close_link_on_expiration,
            )
            .finish()
    }
}

impl TlsServerConfig {
    pub async fn new(config: &Config<'_>, secure: bool) -> ZResult<Self> {
        let tls_close_link_on_expiration: bool = match config.get(TLS_CLOSE_LINK_ON_EXPIRATION) {
            Some(s) => s
                .parse()
                .map_err(|_| zerror!("Unknown close on expiration argument: {}", s))?,
            None => TLS_CLOSE_LINK_ON_EXPIRATION_DEFAULT,
        };

        // Install ring based rustls CryptoProvider.
        rustls::crypto::ring::default_provider()
            // This can be called successfully at most once in any process execution.
            // Call this early in your process to configure which provider is used for the provider.
            // The configuration should happen before any use of ClientConfig::builder() or ServerConfig::builder().
            .install_default()
            // Ignore the error here, because `rustls::crypto::ring::default_provider().install_default()` will inevitably be executed multiple times
            // when there are multiple quic links, and all but the first execution will fail.
            .ok();

        let sc = if secure {
            Self::new_secure_tls(config).await?
        } else {
            Self::new_unsecure_tls()?
        };

        Ok(Self {
            server_config: sc,
            tls_close_link_on_expiration,
        })
    }

    async fn new_secure_tls(config: &Config<'_>) -> ZResult<ServerConfig> {
        let tls_server_client_auth: bool = match config.get(TLS_ENABLE_MTLS) {
            Some(s) => s
                .parse()
                .map_err(|_| zerror!("Unknown enable mTLS argument: {}", s))?,
            None => TLS_ENABLE_MTLS_DEFAULT,
        };
        let tls_server_private_key = TlsServerConfig::load_tls_private_key(config).await?;
        let tls_server_certificate = TlsServerConfig::load_tls_certificate(config).await?;

        let certs: Vec<CertificateDer> =
            rustls_pemfile::certs(&mut Cursor::new(&tls_server_certificate))
                .collect::<Result<_, _>>()
                .map_err(|err| zerror!("Error processing server certificate: {err}."))?;

        let mut keys: Vec<PrivateKeyDer> =
            rustls_pemfile::rsa_private_keys(&mut Cursor::new(&tls_server_private_key))
                .map(|x| x.map(PrivateKeyDer::from))
                .collect::<Result<_, _>>()
                .map_err(|err| zerror!("Error processing server key: {err}."))?;

        if keys.is_empty() {
            keys = rustls_pemfile::pkcs8_private_keys(&mut Cursor::new(&tls_server_private_key))
                .map(|x| x.map(PrivateKeyDer::from))
                .collect::<Result<_, _>>()
                .map_err(|err| zerror!("Error processing server key: {err}."))?;
        }

        if keys.is_empty() {
            keys = rustls_pemfile::ec_private_keys(&mut Cursor::new(&tls_server_private_key))
                .map(|x| x.map(PrivateKeyDer::from))
                .collect::<Result<_, _>>()
                .map_err(|err| zerror!("Error processing server key: {err}."))?;
        }

        if keys.is_empty() {
            bail!("No private key found for TLS server.");
        }

        let sc = if tls_server_client_auth {
            let root_cert_store = load_trust_anchors(config)?.map_or_else(
                || Err(zerror!("Missing root certificates while mTLS is enabled.")),
                Ok,
            )?;
            let client_auth = WebPkiClientVerifier::builder(root_cert_store.into()).build()?;
            ServerConfig::builder_with_protocol_versions(&[&TLS13])
                .with_client_cert_verifier(client_auth)
                .with_single_cert(certs, keys.remove(0))
                .map_err(|e| zerror!(e))?
        } else {
            ServerConfig::builder()
                .with_no_client_auth()
                .with_single_cert(certs, keys.remove(0))
                .map_err(|e| zerror!(e))?
        };
        Ok(sc)
    }

    fn new_unsecure_tls() -> ZResult<ServerConfig> {
        // Does not support client authentication, and uses self-signed certificate
        let (key, certs) = {
            let cert = (*SELF_SIGNED_CERT)
                .as_ref()
                .map_err(|e| zerror!("Failed to generate static self-signed certificate: {e}"))?;
            (
                Into::<rustls::pki_types::PrivateKeyDer>::into(
                    rustls::pki_types::PrivatePkcs8KeyDer::from(cert.signing_key.serialize_der()),
                ),
                vec![CertificateDer::from(cert.cert.clone())],
            )
        };
        ServerConfig::builder()
            .with_no_client_auth()
            .with_single_cert(certs, key)
            .map_err(|e| zerror!(e).into())
    }

    pub(crate) async fn load_tls_private_key(config: &Config<'_>) -> ZResult<Vec<u8>> {
        load_tls_key(
            config,
            TLS_LISTEN_PRIVATE_KEY_RAW,
            TLS_LISTEN_PRIVATE_KEY_FILE,
            TLS_LISTEN_PRIVATE_KEY_BASE64,
        )
        .await
    }

    async fn load_tls_certificate(config: &Config<'_>) -> ZResult<Vec<u8>> {
        load_tls_certificate(
            config,
            TLS_LISTEN_CERTIFICATE_RAW,
            TLS_LISTEN_CERTIFICATE_FILE,
            TLS_LISTEN_CERTIFICATE_BASE64,
        )
        .await
    }
}

pub struct TlsClientConfig {
    pub client_config: ClientConfig,
    pub tls_close_link_on_expiration: bool,
}

impl Debug for TlsClientConfig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("TlsClientConfig")
            .field("client_config", &"..")
            .field(
                "tls_close_link_on_expiration",
                &self.tls_close_link_on_expiration,
            )
            .finish()
    }
}

impl TlsClientConfig {
    pub async fn new(config: &Config<'_>, secure: bool) -> ZResult<Self> {
        let tls_close_link_on_expiration: bool = match config.get(TLS_CLOSE_LINK_ON_EXPIRATION) {
            Some(s) => s
                .parse()
                .map_err(|_| zerror!("Unknown close on expiration argument: {}", s))?,
            None => TLS_CLOSE_LINK_ON_EXPIRATION_DEFAULT,
        };

        // Install ring based rustls CryptoProvider.
        rustls::crypto::ring::default_provider()
            // This can be called successfully at most once in any process execution.
            // Call this early in your process to configure which provider is used for the provider.
            // The configuration should happen before any use of ClientConfig::builder() or ServerConfig::builder().
            .install_default()
            // Ignore the error here, because `rustls::crypto::ring::default_provider().install_default()` will inevitably be executed multiple times
            // when there are multiple quic links, and all but the first execution will fail.
            .ok();

        let cc = if secure {
            Self::new_secure_tls(config).await?
        } else {
            Self::new_unsecure_tls()?
        };

        Ok(TlsClientConfig {
            client_config: cc,
            tls_close_link_on_expiration,
        })
    }

    async fn new_secure_tls(config: &Config<'_>) -> ZResult<ClientConfig> {
        let tls_client_server_auth: bool = match config.get(TLS_ENABLE_MTLS) {
            Some(s) => s
                .parse()
                .map_err(|_| zerror!("Unknown enable mTLS argument: {}", s))?,
            None => TLS_ENABLE_MTLS_DEFAULT,
        };

        let tls_server_name_verification: bool = match config.get(TLS_VERIFY_NAME_ON_CONNECT) {
            Some(s) => s
                .parse()
                .map_err(|_| zerror!("Unknown server name verification argument: {}", s))?,
            None => TLS_VERIFY_NAME_ON_CONNECT_DEFAULT,
        };
        if !tls_server_name_verification {
            tracing::warn!("Skipping name verification of QUIC server");
        }

        // Allows mixed user-generated CA and webPKI CA
        tracing::debug!("Loading default Web PKI certificates.");
        let mut root_cert_store = RootCertStore {
            roots: webpki_roots::TLS_SERVER_ROOTS.to_vec(),
        };

        if let Some(custom_root_cert) = load_trust_anchors(config)? {
            tracing::debug!("Loading user-generated certificates.");
            root_cert_store.extend(custom_root_cert.roots);
        }

        let cc = if tls_client_server_auth {
            tracing::debug!("Loading client authentication key and certificate...");
            let tls_client_private_key = TlsClientConfig::load_tls_private_key(config).await?;
            let tls_client_certificate = TlsClientConfig::load_tls_certificate(config).await?;

            let certs: Vec<CertificateDer> =
                rustls_pemfile::certs(&mut Cursor::new(&tls_client_certificate))
                    .collect::<Result<_, _>>()
                    .map_err(|err| zerror!("Error processing client certificate: {err}."))?;

            let mut keys: Vec<PrivateKeyDer> =
                rustls_pemfile::rsa_private_keys(&mut Cursor::new(&tls_client_private_key))
                    .map(|x| x.map(PrivateKeyDer::from))
                    .collect::<Result<_, _>>()
                    .map_err(|err| zerror!("Error processing client key: {err}."))?;

            if keys.is_empty() {
                keys =
                    rustls_pemfile::pkcs8_private_keys(&mut Cursor::new(&tls_client_private_key))
                        .map(|x| x.map(PrivateKeyDer::from))
                        .collect::<Result<_, _>>()
                        .map_err(|err| zerror!("Error processing client key: {err}."))?;
            }

            if keys.is_empty() {
                keys = rustls_pemfile::ec_private_keys(&mut Cursor::new(&tls_client_private_key))
                    .map(|x| x.map(PrivateKeyDer::from))
                    .collect::<Result<_, _>>()
                    .map_err(|err| zerror!("Error processing client key: {err}."))?;
            }

            if keys.is_empty() {
                bail!("No private key found for TLS client.");
            }

            let builder = ClientConfig::builder_with_protocol_versions(&[&TLS13]);

            if tls_server_name_verification {
                builder
                    .with_root_certificates(root_cert_store)
                    .with_client_auth_cert(certs, keys.remove(0))
            } else {
                builder
                    .dangerous()
                    .with_custom_certificate_verifier(Arc::new(WebPkiVerifierAnyServerName::new(
                        root_cert_store,
                    )))
                    .with_client_auth_cert(certs, keys.remove(0))
            }
            .map_err(|e| zerror!("Bad certificate/key: {}", e))?
        } else {
            let builder = ClientConfig::builder();
            if tls_server_name_verification {
                builder
                    .with_root_certificates(root_cert_store)
                    .with_no_client_auth()
            } else {
                builder
                    .dangerous()
                    .with_custom_certificate_verifier(Arc::new(WebPkiVerifierAnyServerName::new(
                        root_cert_store,
                    )))
                    .with_no_client_auth()
            }
        };
        Ok(cc)
    }

    fn new_unsecure_tls() -> ZResult<ClientConfig> {
        let provider = CryptoProvider::get_default().expect("default cypto provider should be set");
        // No server verification, trusts any certificate
        Ok(ClientConfig::builder_with_provider(provider.clone())
            .with_protocol_versions(&[&TLS13])?
            .dangerous()
            .with_custom_certificate_verifier(SkipServerVerification::new(provider.clone()))
            .with_no_client_auth())
    }

    async fn load_tls_private_key(config: &Config<'_>) -> ZResult<Vec<u8>> {
        load_tls_key(
            config,
            TLS_CONNECT_PRIVATE_KEY_RAW,
            TLS_CONNECT_PRIVATE_KEY_FILE,
            TLS_CONNECT_PRIVATE_KEY_BASE64,
        )
        .await
    }

    async fn load_tls_certificate(config: &Config<'_>) -> ZResult<Vec<u8>> {
        load_tls_certificate(
            config,
            TLS_CONNECT_CERTIFICATE_RAW,
            TLS_CONNECT_CERTIFICATE_FILE,
            TLS_CONNECT_CERTIFICATE_BASE64,
        )
        .await
    }
}

fn process_pem(pem: &mut dyn io::BufRead) -> ZResult<Vec<TrustAnchor<'static>>> {
    let certs: Vec<CertificateDer> = rustls_pemfile::certs(pem)
        .map(|result| result.map_err(|err| zerror!("Error processing PEM certificates: {err}.")))
        .collect::<Result<Vec<CertificateDer>, ZError>>()?;

    let trust_anchors: Vec<TrustAnchor> = certs
        .into_iter()
        .map(|cert| {
            anchor_from_trusted_cert(&cert)
                .map_err(|err| zerror!("Error processing trust anchor: {err}."))
                .map(|trust_anchor| trust_anchor.to_owned())
        })
        .collect::<Result<Vec<TrustAnchor>, ZError>>()?;

    Ok(trust_anchors)
}

async fn load_tls_key(
    config: &Config<'_>,
    tls_private_key_raw_config_key: &str,
    tls_private_key_file_config_key: &str,
    tls_private_key_base64_config_key: &str,
) -> ZResult<Vec<u8>> {
    if let Some(value) = config.get(tls_private_key_raw_config_key) {
        return Ok(value.as_bytes().to_vec());
    }

    if let Some(b64_key) = config.get(tls_private_key_base64_config_key) {
        return base64_decode(b64_key);
    }

    if let Some(value) = config.get(tls_private_key_file_config_key) {
        return Ok(tokio::fs::read(value)
            .await
            .map_err(|e| zerror!("Invalid TLS private key file: {}", e))?)
        .and_then(|result| {
            if result.is_empty() {
                Err(zerror!("Empty TLS key.").into())
            } else {
                Ok(result)
            }
        });
    }
    Err(zerror!("Missing TLS private key.").into())
}

async fn load_tls_certificate(
    config: &Config<'_>,
    tls_certificate_raw_config_key: &str,
    tls_certificate_file_config_key: &str,
    tls_certificate_base64_config_key: &str,
) -> ZResult<Vec<u8>> {
    if let Some(value) = config.get(tls_certificate_raw_config_key) {
        return Ok(value.as_bytes().to_vec());
    }

    if let Some(b64_certificate) = config.get(tls_certificate_base64_config_key) {
        return base64_decode(b64_certificate);
    }

    if let Some(value) = config.get(tls_certificate_file_config_key) {
        return Ok(tokio::fs::read(value)
            .await
            .map_err(|e| zerror!("Invalid TLS certificate file: {}", e))?);
    }
    Err(zerror!("Missing tls certificates.").into())
}

fn load_trust_anchors(config: &Config<'_>) -> ZResult<Option<RootCertStore>> {
    let mut root_cert_store = RootCertStore::empty();
    if let Some(value) = config.get(TLS_ROOT_CA_CERTIFICATE_RAW) {
        let mut pem = BufReader::new(value.as_bytes());
        let trust_anchors = process_pem(&mut pem)?;
        root_cert_store.extend(trust_anchors);
        return Ok(Some(root_cert_store));
    }

    if let Some(b64_certificate) = config.get(TLS_ROOT_CA_CERTIFICATE_BASE64) {
        let certificate_pem = base64_decode(b64_certificate)?;
        let mut pem = BufReader::new(certificate_pem.as_slice());
        let trust_anchors = process_pem(&mut pem)?;
        root_cert_store.extend(trust_anchors);
        return Ok(Some(root_cert_store));
    }

    if let Some(filename) = config.get(TLS_ROOT_CA_CERTIFICATE_FILE) {
        let mut pem = BufReader::new(File::open(filename)?);
        let trust_anchors = process_pem(&mut pem)?;
        root_cert_store.extend(trust_anchors);
        return Ok(Some(root_cert_store));
    }
    Ok(None)
}

pub async fn get_quic_addr(address: &Address<'_>) -> ZResult<SocketAddr> {
    match tokio::net::lookup_host(address.as_str()).await?.next() {
        Some(addr) => Ok(addr),
        None => bail!("Couldn't resolve QUIC locator address: {}", address),
    }
}

pub fn get_quic_host<'a>(address: &Address<'a>) -> ZResult<&'a str> {
    Ok(address
        .as_str()
        .rsplit_once(':')
        .ok_or_else(|| zerror!("Invalid QUIC address"))?
        .0)
}

pub fn base64_decode(data: &str) -> ZResult<Vec<u8>> {
    use base64::{engine::general_purpose, Engine};
    Ok(general_purpose::STANDARD
        .decode(data)
        .map_err(|e| zerror!("Unable to perform base64 decoding: {e:?}"))?)
}

pub fn get_cert_common_name(conn: &quinn::Connection) -> ZResult<QuicAuthId> {
    let mut auth_id = QuicAuthId { auth_value: None };
    if let Some(pi) = conn.peer_identity() {
        let serv_certs = pi
            .downcast::<Vec<rustls_pki_types::CertificateDer>>()
            .unwrap();
        if let Some(item) = serv_certs.iter().next() {
            let (_, cert) = X509Certificate::from_der(item.as_ref()).unwrap();
            let subject_name = cert
                .subject
                .iter_common_name()
                .next()
                .and_then(|cn| cn.as_str().ok());
            auth_id = QuicAuthId {
                auth_value: subject_name.map(|cn| cn.to_string()),
            };
        }
    }
    Ok(auth_id)
}

/// Returns the minimum value of the `not_after` field in the remote certificate chain.
/// Returns `None` if the remote certificate chain is empty
pub fn get_cert_chain_expiration(conn: &quinn::Connection) -> ZResult<Option<OffsetDateTime>> {
    let mut link_expiration: Option<OffsetDateTime> = None;
    if let Some(pi) = conn.peer_identity() {
        if let Ok(remote_certs) = pi.downcast::<Vec<rustls_pki_types::CertificateDer>>() {
            for cert in *remote_certs {
                let (_, cert) = X509Certificate::from_der(cert.as_ref())?;
                let cert_expiration = cert.validity().not_after.to_datetime();
                link_expiration = link_expiration
                    .map(|current_min| current_min.min(cert_expiration))
                    .or(Some(cert_expiration));
            }
        }
    }
    Ok(link_expiration)
}

#[derive(Clone)]
pub struct QuicAuthId {
    auth_value: Option<String>,
}

impl Debug for QuicAuthId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "Common Name: {}",
            self.auth_value.as_deref().unwrap_or("None")
        )
    }
}

impl From<QuicAuthId> for LinkAuthId {
    fn from(value: QuicAuthId) -> Self {
        LinkAuthId::Quic(value.auth_value.clone())
    }
}

pub(crate) struct QuicMtuConfig {
    initial_mtu: Option<u16>,
    mtu_discovery_interval_secs: Option<u64>,
}

impl QuicMtuConfig {
    fn apply_to_transport(&self, quic_transport_conf: &mut TransportConfig) {
        if let Some(initial_mtu) = self.initial_mtu {
            quic_transport_conf.initial_mtu(initial_mtu);
        }

        if let Some(mtu_discovery_interval) =
            self.mtu_discovery_interval_secs.map(Duration::from_secs)
        {
            let mut mtu_discovery_config = quinn::MtuDiscoveryConfig::default();
            mtu_discovery_config.interval(mtu_discovery_interval);
            quic_transport_conf.mtu_discovery_config(Some(mtu_discovery_config));
        }
    }
}

impl TryFrom<&Config<'_>> for QuicMtuConfig {
    type Error = zenoh_result::Error;

    fn try_from(config: &Config) -> ZResult<Self> {
        let mut initial_mtu = None;
        if let Some(v) = config.get(QUIC_INITIAL_MTU) {
            initial_mtu = Some(v.parse::<u16>().map_err(|err| {
                zerror!("could not parse QUIC endpoint's {QUIC_INITIAL_MTU} value `{v}`: {err}")
            })?);
        }

        let mut mtu_discovery_interval_secs = None;
        if let Some(interval_secs) = config.get(QUIC_MTU_DISCOVERY_INTERVAL) {
            mtu_discovery_interval_secs = Some(interval_secs
            .parse::<u64>()
            .map_err(|err| {
                zerror!(
                    "could not parse QUIC endpoint's {QUIC_MTU_DISCOVERY_INTERVAL} value `{interval_secs}`: {err}"
                )
            })?);
        }

        Ok(Self {
            initial_mtu,
            mtu_discovery_interval_secs,
        })
    }
}

pub(crate) struct QuicSegmentationOffloadConfig {
    enabled: Option<bool>,
}

impl TryFrom<&Config<'_>> for QuicSegmentationOffloadConfig {
    type Error = zenoh_result::Error;

    fn try_from(config: &Config) -> ZResult<Self> {
        let mut enabled = None;
        if let Some(v) = config.get(QUIC_SEGMENTATION_OFFLOAD) {
            enabled = Some(v.parse::<bool>().map_err(|err| {
                zerror!(
                    "could not parse QUIC endpoint's {QUIC_SEGMENTATION_OFFLOAD} value `{v}`: {err}"
                )
            })?);
        }
        Ok(Self { enabled })
    }
}

/// How unreliable datagrams are sent (Farfield's addition, see FARFIELD.md)
pub(crate) struct QuicBestEffortConfig {
    min_window: Option<u64>,
    datagram_buffer: Option<usize>,
}

impl TryFrom<&Config<'_>> for QuicBestEffortConfig {
    type Error = zenoh_result::Error;

    fn try_from(config: &Config) -> ZResult<Self> {
        let number = |name: &str| -> ZResult<Option<u32>> {
            let Some(v) = config.get(name) else {
                return Ok(None);
            };
            let number = v.parse::<u32>().map_err(|err| {
                zerror!("could not parse QUIC endpoint's {name} value `{v}`: {err}")
            })?;
            Ok(Some(number))
        };
        Ok(Self {
            min_window: number(QUIC_MIN_WINDOW)?.map(u64::from),
            datagram_buffer: number(QUIC_DATAGRAM_BUFFER)?.map(|bytes| bytes as usize),
        })
    }
}

/// Helper wrapper for configuring QUIC transport
pub(crate) struct QuicTransportConfigurator<'a>(pub(crate) &'a mut quinn::TransportConfig);

impl QuicTransportConfigurator<'_> {
    pub(crate) fn configure_max_concurrent_streams(
        self,
        multistream: Option<&MultiStreamConfig>,
    ) -> Self {
        if let Some(m) = multistream {
            m.set_nb_concurrent_streams(self.0);
        } else {
            self.0.max_concurrent_bidi_streams(0u8.into());
            self.0.max_concurrent_uni_streams(0u8.into());
        }
        self
    }

    pub(crate) fn configure_mtu(self, mtu_config: &QuicMtuConfig) -> Self {
        mtu_config.apply_to_transport(self.0);
        self
    }

    /// Farfield's addition, see FARFIELD.md.
    pub(crate) fn configure_best_effort(self, best_effort: &QuicBestEffortConfig) -> Self {
        if let Some(min_window) = best_effort.min_window {
            self.0
                .congestion_controller_factory(Arc::new(SteadyWindowConfig { min_window }));
        }
        if let Some(bytes) = best_effort.datagram_buffer {
            self.0.datagram_send_buffer_size(bytes);
        }
        self
    }

    pub(crate) fn configure_segmentation_offload(
        self,
        segmentation_offload_config: &QuicSegmentationOffloadConfig,
    ) -> Self {
        if let Some(enabled) = segmentation_offload_config.enabled {
            self.0.enable_segmentation_offload(enabled);
        }
        self
    }
}

pub(crate) fn get_negotiated_alpn(connection: &quinn::Connection) -> ZResult<Option<Vec<u8>>> {
    let handshake_data = connection
        .handshake_data()
        .ok_or_else(|| zerror!("No handshake data"))?;
    let handshake_data = handshake_data
        .downcast_ref::<HandshakeData>()
        .expect("HandshakeData should be only existing implementation");
    Ok(handshake_data.protocol.clone())
}

#[cfg(test)]
mod tests {
    use zenoh_protocol::core::EndPoint;

    use super::*;

    fn segmentation_offload(endpoint: &str) -> ZResult<Option<bool>> {
        let endpoint: EndPoint = endpoint.parse().unwrap();
        QuicSegmentationOffloadConfig::try_from(&endpoint.config()).map(|c| c.enabled)
    }

    #[test]
    fn segmentation_offload_config() {
        assert_eq!(segmentation_offload("quic/localhost:7447").unwrap(), None);
        assert_eq!(
            segmentation_offload("quic/localhost:7447#segmentation_offload=true").unwrap(),
            Some(true)
        );
        assert_eq!(
            segmentation_offload("quic/localhost:7447#segmentation_offload=false").unwrap(),
            Some(false)
        );
        assert!(segmentation_offload("quic/localhost:7447#segmentation_offload=0").is_err());
    }
}
