//! Which endpoints a node may use: without TLS only those of this machine.

use core::net::IpAddr;

use crate::transport::endpoint::{host, scheme};

/// Whether a node has keys, and what its operator allows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Exposure {
    /// Whether the node has a certificate and a key.
    pub has_keys: bool,
    /// Whether the operator has said that nodes may talk to other machines without TLS.
    pub allow_plaintext: bool,
}

/// Why a node does not use an endpoint.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ExposureError {
    /// Others could read and write along.
    #[error(
        "endpoint {0} is not encrypted and reaches beyond this machine: make keys with `farfield certs` and use quic/ or tls/, or say `--allow-plaintext` (in the venue file: `[security] allow_plaintext = true`) if everyone in that network may read and send along"
    )]
    Plaintext(String),
    /// TLS without keys.
    #[error(
        "endpoint {0} is encrypted, but the venue file names no keys: make them with `farfield certs` and set `[security] certificates`"
    )]
    NoKeys(String),
    /// Without TLS a peer has no name for access control.
    #[error(
        "endpoint {0} is not encrypted, but this venue has certificates (`[security] certificates`), and nobody without one is let in: use quic/ or tls/"
    )]
    NotEncrypted(String),
}

impl Exposure {
    /// The endpoint of a node without a configured one: on this machine.
    pub fn default_endpoint(self) -> &'static str {
        if self.has_keys {
            "quic/127.0.0.1:7447"
        } else {
            "tcp/127.0.0.1:7447"
        }
    }

    /// What was asked for, else what the venue file says, else this machine alone.
    ///
    /// # Errors
    /// As [`Exposure::check`].
    pub fn choose(
        self,
        asked: Vec<String>,
        venue: &[String],
    ) -> Result<Vec<String>, ExposureError> {
        let choices = [
            asked,
            venue.to_vec(),
            vec![self.default_endpoint().to_owned()],
        ];
        let chosen = choices.into_iter().find(|endpoints| !endpoints.is_empty());
        let chosen = chosen.unwrap_or_default();
        self.check(&chosen)?;
        Ok(chosen)
    }

    /// Refuses the first of `endpoints` that may not be used.
    ///
    /// # Errors
    /// [`ExposureError`] naming the endpoint and what to do.
    pub fn check(self, endpoints: &[String]) -> Result<(), ExposureError> {
        for endpoint in endpoints {
            let encrypted = matches!(scheme(endpoint), "quic" | "tls");
            match (self.has_keys, encrypted) {
                (true, false) => return Err(ExposureError::NotEncrypted(endpoint.clone())),
                (false, true) => return Err(ExposureError::NoKeys(endpoint.clone())),
                (false, false) if !self.allow_plaintext && !is_loopback(endpoint) => {
                    return Err(ExposureError::Plaintext(endpoint.clone()));
                }
                _ => {}
            }
        }
        Ok(())
    }
}

/// Whether an endpoint is for this machine alone. A name other than `localhost` may mean anything.
pub fn is_loopback(endpoint: &str) -> bool {
    let host = host(endpoint);
    host == "localhost"
        || host
            .parse::<IpAddr>()
            .is_ok_and(|address| address.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(endpoint: &str, exposure: Exposure) -> Result<(), ExposureError> {
        exposure.check(&[endpoint.to_owned()])
    }

    const NOTHING_SAID: Exposure = Exposure {
        has_keys: false,
        allow_plaintext: false,
    };

    #[test]
    fn without_tls_nothing_leaves_the_machine_unless_the_operator_says_so() {
        for near in [
            "tcp/127.0.0.1:1",
            "tcp/[::1]:1",
            "udp/localhost:1",
            "tcp/127.9.9.9:0",
        ] {
            check(near, NOTHING_SAID).unwrap();
        }
        let said = Exposure {
            allow_plaintext: true,
            ..NOTHING_SAID
        };
        for far in [
            "tcp/0.0.0.0:1",
            "tcp/[::]:1",
            "udp/10.0.0.1:1",
            "tcp/fusion.lan:1",
        ] {
            let error = check(far, NOTHING_SAID).unwrap_err();
            assert_eq!(error, ExposureError::Plaintext(far.to_owned()));
            assert!(error.to_string().contains("--allow-plaintext"), "{error}");
            check(far, said).unwrap();
        }
    }

    #[test]
    fn keys_and_encryption_go_together() {
        let keys = Exposure {
            has_keys: true,
            allow_plaintext: true,
        };
        check("quic/0.0.0.0:1", keys).unwrap();
        assert!(matches!(
            check("tcp/127.0.0.1:1", keys),
            Err(ExposureError::NotEncrypted(_))
        ));
        assert!(matches!(
            check("quic/127.0.0.1:1", NOTHING_SAID),
            Err(ExposureError::NoKeys(_))
        ));
        check(keys.default_endpoint(), keys).unwrap();
        check(NOTHING_SAID.default_endpoint(), NOTHING_SAID).unwrap();
    }
}
