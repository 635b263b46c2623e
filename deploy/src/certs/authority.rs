//! The venue's authority (CA), the certificates that it signs, and the host names in fusion's certificate.

use std::collections::BTreeSet;
use std::net::IpAddr;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::Context as _;
use farfield_node::certificate::{common_name_in, hosts_in};
use farfield_node::keys::node_of;
use farfield_node::process::say;
use farfield_proto::transport::endpoint::host;
use farfield_proto::transport::{FUSION, RECORDER, common_name, reader};
use farfield_proto::venue::Venue;
use rcgen::{
    BasicConstraints, CertificateParams, DistinguishedName, DnType, ExtendedKeyUsagePurpose, IsCa,
    Issuer, KeyPair, KeyUsagePurpose,
};
use time::{Duration, OffsetDateTime};

/// Validity of the authority relative to that of the nodes.
const AUTHORITY_FACTOR: i64 = 5;
/// Certificates are valid from this time before now, as clocks of nodes may be behind.
const SLACK: Duration = Duration::days(1);

/// The common name of the authority of `venue`.
pub(super) fn name_of(venue: &str) -> String {
    format!("{venue} authority")
}

/// A node or person that gets a key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Bearer {
    /// Name, also of its files.
    pub(super) node: String,
    pub(super) role: NodeRole,
}

/// What a key is for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum NodeRole {
    /// Accepts connections at these names and addresses.
    Fusion(Vec<String>),
    /// Connects, and publishes under its name.
    Edge,
    /// Connects, and only receives: everything.
    Recorder,
    /// Connects, and only receives: poses and statuses.
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

/// Signs certificates.
pub(super) struct Authority {
    pub(super) venue: String,
    pub(super) days: u32,
    certificate: String,
    key: String,
    issuer: Issuer<'static, KeyPair>,
}

impl Authority {
    /// A new authority for `venue`; it issues certificates that are valid for `days`.
    pub(super) fn new(venue: &str, days: u32) -> anyhow::Result<Self> {
        let mut params = CertificateParams::default();
        params.distinguished_name = named(&name_of(venue));
        params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
        (params.not_before, params.not_after) = validity(AUTHORITY_FACTOR * i64::from(days))?;
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

    /// An existing authority.
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

    /// Its public key, as in its certificate.
    pub(super) fn public_key(&self) -> &[u8] {
        self.issuer.key().public_key_raw()
    }

    pub(super) fn certificate(&self) -> String {
        self.certificate.clone()
    }

    pub(super) fn key(&self) -> String {
        self.key.clone()
    }

    /// Issues a new key and certificate of this generation to `bearer` of `venue`. Only fusion's certificate is valid
    /// for a server: an edge's key cannot act as fusion.
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
        (params.not_before, params.not_after) = validity(i64::from(days))?;
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

/// The validity of a certificate that is created now.
fn validity(days: i64) -> anyhow::Result<(OffsetDateTime, OffsetDateTime)> {
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

/// Used by nodes on fusion's machine.
const LOOPBACK: [&str; 3] = ["localhost", "127.0.0.1", "::1"];

/// All names that edges may use for fusion: the hosts of the venue's endpoints, `more`, and the loopback.
///
/// # Errors
/// When one of `more` is neither a host name nor an address.
pub(super) fn hosts_of_fusion(venue: &Venue, more: &[String]) -> anyhow::Result<Vec<String>> {
    if let Some(wrong) = more.iter().find(|text| !is_host(text)) {
        anyhow::bail!("`--host`: found `{wrong}`, expected a name or an address, without a port");
    }
    let endpoints = venue
        .endpoints
        .connect
        .iter()
        .chain(&venue.endpoints.listen);
    let hosts: BTreeSet<&str> = LOOPBACK
        .into_iter()
        .chain(endpoints.map(|endpoint| host(endpoint)))
        .chain(more.iter().map(String::as_str))
        // 0.0.0.0 is only for listening.
        .filter(|host| !host.parse::<IpAddr>().is_ok_and(|a| a.is_unspecified()))
        .collect();
    Ok(hosts.into_iter().map(str::to_owned).collect())
}

/// `hosts`, and those of fusion's current certificate in the folder `keys`, which came from `--host`. Prints a note if
/// there is none.
pub(super) fn with_current_hosts(mut hosts: Vec<String>, keys: &Path, venue: &str) -> Vec<String> {
    let path = keys.join(format!("{FUSION}.pem"));
    let is_ours = |name: String| node_of(venue, &name).is_some_and(|(node, _)| node == FUSION);
    let found = (common_name_in(&path).map(is_ours), hosts_in(&path));
    let before = if let (Ok(true), Ok(before)) = found {
        before
    } else {
        say(format_args!(
            "{}: found no certificate of this venue's fusion: the new one is valid for {}; add more with --host",
            path.display(),
            hosts.join(", ")
        ));
        Vec::new()
    };
    // The same address can be written in several ways.
    let same = |a: &str, b: &str| match (a.parse::<IpAddr>(), b.parse::<IpAddr>()) {
        (Ok(a), Ok(b)) => a == b,
        _ => a == b,
    };
    for host in before.into_iter().filter(|host| is_host(host)) {
        if !hosts.iter().any(|known| same(known, &host)) {
            hosts.push(host);
        }
    }
    hosts
}

fn is_host(text: &str) -> bool {
    let is_name = |text: &str| {
        text.bytes()
            .all(|b| b.is_ascii_alphanumeric() || matches!(b, b'-' | b'.'))
    };
    !text.is_empty() && (text.parse::<IpAddr>().is_ok() || is_name(text))
}
