//! Where a node listens or connects, and by what it proves who it is: what its operator asked for, else what
//! the venue file says.

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
    /// Everybody else: it connects to fusion.
    Connect,
}

/// What an operator said of a node's link.
#[derive(Debug, Clone, Copy)]
pub struct Asked<'a> {
    /// Which end of the link the node is.
    pub side: LinkEnd,
    /// The name of the node, which its certificate bears.
    pub node: &'a str,
    /// The endpoints that were named; none: the venue file's.
    pub endpoints: &'a [String],
    /// The folder of its keys that was named, else the venue file's.
    pub certificates: Option<&'a Path>,
    /// Whether it may speak to other machines without TLS, whatever the venue file says.
    pub allow_plaintext: bool,
}

/// How a node reaches the others, checked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reach {
    /// Where it listens or connects.
    pub endpoints: Vec<String>,
    /// By what it proves who it is; `None` without TLS.
    pub identity: Option<Identity>,
    /// Until when the certificate of [`Self::identity`] holds.
    pub validity: Option<Validity>,
}

impl Reach {
    /// Whether nobody else can read what goes over the link: it is encrypted, or stays on this machine.
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

    fn of(self, endpoints: &Endpoints) -> &[String] {
        match self {
            Self::Listen => &endpoints.listen,
            Self::Connect => &endpoints.connect,
        }
    }
}

impl Asked<'_> {
    /// What was asked for, completed from `venue`.
    ///
    /// # Errors
    /// [`NodeError::Refused`] when an endpoint is none or may not be used without keys, or a file of the keys cannot
    /// be read, and as [`keys::check`].
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
            .map(|identity| keys::check(identity, (&venue.name, self.node), clock::unix_s()))
            .transpose()?;
        let exposure = Exposure {
            has_keys: identity.is_some(),
            allow_plaintext: self.allow_plaintext || venue.security.allow_plaintext,
        };
        let known = self.side.of(&venue.endpoints);
        let endpoints = exposure.choose(self.endpoints.to_vec(), known);
        Ok(Reach {
            endpoints: endpoints.map_err(NodeError::refused)?,
            identity,
            validity,
        })
    }
}
