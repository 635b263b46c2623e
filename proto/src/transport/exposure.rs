//! The endpoints that a node may use: without TLS only those of this machine.

use core::net::IpAddr;

use crate::transport::endpoint::{host, scheme};

/// Whether a node has keys, and whether its operator allows plaintext.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Exposure {
    /// Whether the node has a certificate and a key.
    pub has_keys: bool,
    /// Whether the operator allows connections to other machines without TLS.
    pub allow_plaintext: bool,
}

/// Why a node refuses an endpoint.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ExposureError {
    /// Others could read and write the data.
    #[error(
        "endpoint {0} is not encrypted and reaches beyond this machine: make keys with `farfield certs` and use quic/ or tls/, or allow it with `--allow-plaintext` (in the venue file: `[security] allow_plaintext = true`) if everyone in that network may read and send along"
    )]
    Plaintext(String),
    /// TLS without keys.
    #[error(
        "endpoint {0} is encrypted, but the venue file names no keys: make them with `farfield certs` and set `[security] certificates`"
    )]
    NoKeys(String),
    /// Without TLS a peer has no name for access control.
    #[error(
        "endpoint {0} is not encrypted, but this venue has certificates (`[security] certificates`), and no node without one is admitted: use quic/ or tls/"
    )]
    NotEncrypted(String),
}

impl Exposure {
    /// The default endpoint, on this machine.
    pub fn default_endpoint(self) -> &'static str {
        if self.has_keys {
            "quic/127.0.0.1:7447"
        } else {
            "tcp/127.0.0.1:7447"
        }
    }

    /// The requested endpoints, else those of the venue file, else this machine alone.
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

    /// Refuses the first of `endpoints` that is not allowed.
    ///
    /// # Errors
    /// [`ExposureError`] with the endpoint and the remedy.
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

/// Whether an endpoint is on this machine alone. A name other than `localhost` may mean any
/// machine.
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

    const DEFAULT_EXPOSURE: Exposure = Exposure {
        has_keys: false,
        allow_plaintext: false,
    };

    #[test]
    fn without_tls_other_machines_need_the_operators_permission() {
        for near in [
            "tcp/127.0.0.1:1",
            "tcp/[::1]:1",
            "udp/localhost:1",
            "tcp/127.9.9.9:0",
        ] {
            check(near, DEFAULT_EXPOSURE).unwrap();
        }
        let allowed = Exposure {
            allow_plaintext: true,
            ..DEFAULT_EXPOSURE
        };
        for far in [
            "tcp/0.0.0.0:1",
            "tcp/[::]:1",
            "udp/10.0.0.1:1",
            "tcp/fusion.lan:1",
        ] {
            let error = check(far, DEFAULT_EXPOSURE).unwrap_err();
            assert_eq!(error, ExposureError::Plaintext(far.to_owned()));
            assert!(error.to_string().contains("--allow-plaintext"), "{error}");
            check(far, allowed).unwrap();
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
            check("quic/127.0.0.1:1", DEFAULT_EXPOSURE),
            Err(ExposureError::NoKeys(_))
        ));
        check(keys.default_endpoint(), keys).unwrap();
        check(DEFAULT_EXPOSURE.default_endpoint(), DEFAULT_EXPOSURE).unwrap();
    }
}
