//! Farfield's addition to this crate: see FARFIELD.md.

use std::{net::SocketAddr, sync::Arc};

use quinn::EndpointConfig;
use quinn_proto::HashedConnectionIdGenerator;
use ring::hmac::{sign, Key, HMAC_SHA256};

/// Where Linux has a random number that is the same until the machine is started again.
const BOOT_ID: &str = "/proc/sys/kernel/random/boot_id";

/// Settings of a listener at `address` that knows connections by keys which are the same when it is started again.
///
/// Packets of a connection of its last life are then answered by a stateless reset (RFC 9000, 10.3), which whoever sent them
/// can tell from a forged one; with keys that are new at every start they are dropped without a word, and the other side
/// waits until its connection is idle for too long.
///
/// The keys are of this machine, this private key and this address alone: another listener that had them would tell an
/// eavesdropper how to end a connection that lives (RFC 9000, 21.11). Where the machine has no number of its own they
/// are new at every start.
pub(crate) fn listener_config(private_key: &[u8], address: &SocketAddr) -> EndpointConfig {
    let Some(boot_id) = std::fs::read(BOOT_ID).ok().filter(|id| !id.is_empty()) else {
        return EndpointConfig::default();
    };
    let root = Key::new(HMAC_SHA256, &[private_key, &boot_id].concat());
    let of_ids = sign(&root, format!("connection ids {address}").as_bytes());
    let id_key = of_ids
        .as_ref()
        .iter()
        .take(8)
        .fold(0, |key, byte| key << 8 | u64::from(*byte));
    let of_resets = sign(&root, format!("stateless resets {address}").as_bytes());
    let mut config = EndpointConfig::new(Arc::new(Key::new(HMAC_SHA256, of_resets.as_ref())));
    config.cid_generator(move || Box::new(HashedConnectionIdGenerator::from_key(id_key)));
    config
}
