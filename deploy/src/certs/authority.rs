//! The venue's authority (CA), and the certificates that it signs.

use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::Context as _;
use farfield_proto::transport::{FUSION, RECORDER, common_name, reader};
use rcgen::{
    BasicConstraints, CertificateParams, DistinguishedName, DnType, ExtendedKeyUsagePurpose, IsCa,
    Issuer, KeyPair, KeyUsagePurpose,
};
use time::{Duration, OffsetDateTime};

/// How much longer the authority holds than what it signs.
const LIVES: i64 = 5;
/// Clocks of the nodes may be behind by so much.
const SLACK: Duration = Duration::days(1);

/// What the authority of `venue` is called.
pub(super) fn name_of(venue: &str) -> String {
    format!("{venue} authority")
}

/// Someone who gets a key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Bearer {
    /// Its name, which its files have.
    pub(super) node: String,
    /// What it does.
    pub(super) role: NodeRole,
}

/// What a node does.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum NodeRole {
    /// Is connected to, by these names and addresses.
    Fusion(Vec<String>),
    /// Connects, and publishes under its name.
    Edge,
    /// Connects, and only listens: to everything.
    Recorder,
    /// Connects, and only listens: to poses and statuses.
    Reader,
}

impl Bearer {
    pub(super) fn fusion(hosts: Vec<String>) -> Self {
        Self {
            node: FUSION.to_owned(),
            role: NodeRole::Fusion(hosts),
        }
    }

    pub(super) fn edge(viewpoint: &str) -> Self {
        Self {
            node: viewpoint.to_owned(),
            role: NodeRole::Edge,
        }
    }

    pub(super) fn recorder() -> Self {
        Self {
            node: RECORDER.to_owned(),
            role: NodeRole::Recorder,
        }
    }

    pub(super) fn reader(name: &str) -> Self {
        Self {
            node: name.to_owned(),
            role: NodeRole::Reader,
        }
    }
}

/// A certificate with its key, PEM.
pub(super) struct Pair {
    pub(super) certificate: String,
    pub(super) key: String,
}

/// What signs.
pub(super) struct Authority {
    pub(super) venue: String,
    pub(super) days: u32,
    certificate: String,
    key: String,
    issuer: Issuer<'static, KeyPair>,
}

impl Authority {
    /// A new one for `venue`, for certificates that hold for `days`.
    pub(super) fn new(venue: &str, days: u32) -> anyhow::Result<Self> {
        let mut params = CertificateParams::default();
        params.distinguished_name = named(&name_of(venue));
        params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
        (params.not_before, params.not_after) = holds(LIVES * i64::from(days))?;
        let key = KeyPair::generate().context("making the authority's key")?;
        let certificate = params
            .self_signed(&key)
            .context("signing the authority's certificate")?;
        Ok(Self {
            venue: venue.to_owned(),
            days,
            certificate: certificate.pem(),
            key: key.serialize_pem(),
            issuer: Issuer::new(params, key),
        })
    }

    /// One that was made before.
    pub(super) fn read(certificate: &str, key: &str) -> anyhow::Result<Self> {
        let pair = KeyPair::from_pem(key).context("ca.key is not a private key")?;
        let issuer = Issuer::from_ca_cert_pem(certificate, pair)
            .context("ca.pem is not the certificate of an authority")?;
        Ok(Self {
            venue: String::new(),
            days: 0,
            certificate: certificate.to_owned(),
            key: key.to_owned(),
            issuer,
        })
    }

    /// Its public key, as its certificate has it.
    pub(super) fn public_key(&self) -> &[u8] {
        self.issuer.key().public_key_raw()
    }

    pub(super) fn certificate(&self) -> String {
        self.certificate.clone()
    }

    pub(super) fn key(&self) -> String {
        self.key.clone()
    }

    /// A new key for `bearer` of `venue` and its certificate, of this generation. Only fusion's is good for being
    /// connected to: an edge's key makes no fusion node.
    pub(super) fn issue(
        &self,
        venue: &str,
        bearer: &Bearer,
        generation: u32,
        days: u32,
    ) -> anyhow::Result<Pair> {
        let (names, name, usages) = match &bearer.role {
            NodeRole::Fusion(hosts) => (
                hosts.clone(),
                bearer.node.clone(),
                vec![
                    ExtendedKeyUsagePurpose::ServerAuth,
                    ExtendedKeyUsagePurpose::ClientAuth,
                ],
            ),
            NodeRole::Edge | NodeRole::Recorder => (
                Vec::new(),
                bearer.node.clone(),
                vec![ExtendedKeyUsagePurpose::ClientAuth],
            ),
            NodeRole::Reader => (
                Vec::new(),
                reader(&bearer.node),
                vec![ExtendedKeyUsagePurpose::ClientAuth],
            ),
        };
        let mut params = CertificateParams::new(names)
            .with_context(|| format!("the hosts of {}", bearer.node))?;
        params.distinguished_name = named(&common_name(venue, &name, generation));
        params
            .distinguished_name
            .push(DnType::OrganizationalUnitName, bearer.node.as_str());
        params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        params.extended_key_usages = usages;
        params.use_authority_key_identifier_extension = true;
        (params.not_before, params.not_after) = holds(i64::from(days))?;
        let key = KeyPair::generate().with_context(|| format!("making {}'s key", bearer.node))?;
        let certificate = params
            .signed_by(&key, &self.issuer)
            .with_context(|| format!("signing {}'s certificate", bearer.node))?;
        Ok(Pair {
            certificate: certificate.pem(),
            key: key.serialize_pem(),
        })
    }
}

fn named(common_name: &str) -> DistinguishedName {
    let mut name = DistinguishedName::new();
    name.push(DnType::CommonName, common_name);
    name
}

/// From when to when a certificate holds that is made now.
fn holds(days: i64) -> anyhow::Result<(OffsetDateTime, OffsetDateTime)> {
    let since = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .context("the clock of this machine is before 1970")?;
    let now = OffsetDateTime::from_unix_timestamp(since.as_secs().cast_signed())
        .context("the clock of this machine is far off")?;
    let until = now.checked_add(Duration::days(days));
    Ok((
        now - SLACK,
        until.context("a validity beyond the year 9999")?,
    ))
}
