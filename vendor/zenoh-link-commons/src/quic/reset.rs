//! Farfield's addition to this crate: see FARFIELD.md.

use std::sync::Arc;

use quinn::EndpointConfig;
use quinn_proto::HashedConnectionIdGenerator;
use ring::hmac::{sign, Key, HMAC_SHA256};

/// Settings of a listener that knows connections by a secret that is the same after a restart.
///
/// Packets of a connection of its last life are then answered by a stateless reset (RFC 9000, 10.3), which whoever sent them
/// can tell from a forged one; with keys that are new at every start they are dropped without a word, and the other side
/// waits until its connection is idle for too long.
pub(crate) fn listener_config(secret: &[u8]) -> EndpointConfig {
    let root = Key::new(HMAC_SHA256, secret);
    let of_ids = sign(&root, b"connection ids");
    let id_key = of_ids
        .as_ref()
        .iter()
        .take(8)
        .fold(0, |key, byte| key << 8 | u64::from(*byte));
    let of_resets = sign(&root, b"stateless resets");
    let mut config = EndpointConfig::new(Arc::new(Key::new(HMAC_SHA256, of_resets.as_ref())));
    config.cid_generator(move || Box::new(HashedConnectionIdGenerator::from_key(id_key)));
    config
}
