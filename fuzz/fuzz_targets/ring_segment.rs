//! Segments of an edge's ring of any content: the whole records up to the first torn one, never a panic.
#![no_main]

use farfield_edge::ring::record::{put_record, record_at, records, segment_head, segment_number};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let (found, end) = records(bytes);
    assert!(end <= bytes.len());
    let mut again = segment_head(segment_number(bytes).unwrap_or(0)).to_vec();
    for record in &found {
        assert_eq!(record_at(bytes, record.at), Some(*record));
        put_record(record.label, record.message, &mut again);
    }
    let (same, _) = records(&again);
    assert_eq!(same.len(), found.len());
    assert!(same.iter().zip(&found).all(|(a, b)| (a.label, a.message) == (b.label, b.message)));
});
