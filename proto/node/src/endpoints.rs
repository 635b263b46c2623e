//! The endpoints and the identity of a node: from the operator's options, else from the venue file.

use std::path::Path;

use anyhow::anyhow;
use farfield_proto::transport::endpoint::is_endpoint;
use farfield_proto::transport::{Exposure, Identity, is_loopback};
use farfield_proto::venue::{Endpoints, Venue};

use crate::certificate::Validity;
use crate::clock;
use crate::files::load_identity;
use crate::keys;
use crate::process::NodeError;

/// Which end of the link a node is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LinkEnd {
    /// Fusion: it listens.
    Listen,
    /// All other nodes: they connect to fusion.
    Connect,
}

/// The operator's options for the link of a node.
#[derive(Debug, Clone, Copy)]
pub struct LinkRequest<'a> {
    /// The end of the link.
    pub side: LinkEnd,
    /// The name of the node, as in its certificate.
    pub node: &'a str,
    /// The endpoints of the command line; empty: those of the venue file.
    pub endpoints: &'a [String],
    /// The folder of keys of the command line; `None`: that of the venue file.
    pub certificates: Option<&'a Path>,
    /// Whether the node may connect to other machines without TLS, regardless of the venue file.
    pub allow_plaintext: bool,
}

/// The checked endpoints and identity of a node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reach {
    /// The endpoints to listen at or to connect to.
    pub endpoints: Vec<String>,
    /// The certificate and key; `None` without TLS.
    pub identity: Option<Identity>,
    /// The validity of the certificate of [`Self::identity`].
    pub validity: Option<Validity>,
}

impl Reach {
    /// Whether the link is private: encrypted, or inside this machine.
    pub fn is_private(&self) -> bool {
        self.identity.is_some() || self.endpoints.iter().all(|it| is_loopback(it))
    }
}

impl LinkEnd {
    fn option(self) -> &'static str {
        match self {
            Self::Listen => "--listen",
            Self::Connect => "--connect",
        }
    }

    fn example(self) -> &'static str {
        match self {
            Self::Listen => "quic/0.0.0.0:7447",
            Self::Connect => "quic/10.0.0.1:7447",
        }
    }

    fn endpoints_in(self, endpoints: &Endpoints) -> &[String] {
        match self {
            Self::Listen => &endpoints.listen,
            Self::Connect => &endpoints.connect,
        }
    }
}

impl LinkRequest<'_> {
    /// The options, completed from `venue`.
    ///
    /// # Errors
    /// [`NodeError::Refused`] when an endpoint is invalid or not allowed without keys, when a key
    /// file cannot be read, and as [`keys::check`].
    pub fn in_venue(&self, venue: &Venue) -> Result<Reach, NodeError> {
        if let Some(wrong) = self.endpoints.iter().find(|text| !is_endpoint(text)) {
            let (option, example) = (self.side.option(), self.side.example());
            return Err(NodeError::refused(anyhow!(
                "`{option}`: found `{wrong}`, expected for example {example}"
            )));
        }
        let identity = self
            .certificates
            .or(venue.security.certificates.as_deref())
            .map(|keys| load_identity(keys, self.node))
            .transpose()
            .map_err(NodeError::refused)?;
        let validity = identity
            .as_ref()
            .map(|identity| keys::check(identity, &venue.name, self.node, clock::unix_s()))
            .transpose()?;
        let exposure = Exposure {
            has_keys: identity.is_some(),
            allow_plaintext: self.allow_plaintext || venue.security.allow_plaintext,
        };
        let known = self.side.endpoints_in(&venue.endpoints);
        let endpoints = exposure.choose(self.endpoints.to_vec(), known);
        Ok(Reach {
            endpoints: endpoints.map_err(NodeError::refused)?,
            identity,
            validity,
        })
    }
}
