//! When an edit is made.

use farfield_node::clock;
use time::OffsetDateTime;

/// Now, in UTC, as RFC 3339 has it.
pub(crate) fn now() -> String {
    rfc3339(clock::unix_time().as_secs())
}

fn rfc3339(unix_s: u64) -> String {
    let at = i64::try_from(unix_s)
        .ok()
        .and_then(|at| OffsetDateTime::from_unix_timestamp(at).ok());
    let at = at.unwrap_or(OffsetDateTime::UNIX_EPOCH);
    format!(
        "{:04}-{:02}-{:02}T{:02}:{:02}:{:02}Z",
        at.year(),
        u8::from(at.month()),
        at.day(),
        at.hour(),
        at.minute(),
        at.second()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_those_of_the_calendar() {
        // `date -u -d @N`.
        assert_eq!(rfc3339(951_827_696), "2000-02-29T12:34:56Z");
        assert_eq!(rfc3339(0), "1970-01-01T00:00:00Z");
    }
}
