//! Bytes that a link adds to a message, from the formats.
//!
//! Zenoh 1.x on a stream: two bytes of batch length, a frame of five (header, sequence number up to 2^28), a push of four
//! (header, number of a declared key, extension of its priority), a put of four (header, encoding, length of the payload).
//! TLS 1.3 adds five of header, sixteen of tag and one of type to a record. TCP over IPv4 with time stamps adds 52 per
//! segment, and a segment carries a message of the size that edges send.

/// Bytes that Zenoh adds to a message.
pub const ZENOH_BYTES: u64 = 15;
/// Bytes that TLS 1.3 adds to a record; each message is one record.
pub const TLS_BYTES: u64 = 22;
/// Bytes of the headers of TCP and IPv4 per segment.
pub const TCP_IP_BYTES: u64 = 52;
