//! The state of the system's clock: whether NTP or PTP synchronises it, and its maximum error.

use farfield_proto::message::health::SystemClock;

/// Reads the state from the kernel, where chrony, ntpd, systemd-timesyncd and phc2sys store it. If
/// the kernel cannot be queried, the clock counts as not synchronised. [`SystemClock::ahead_us`] is
/// 0.
#[cfg(target_os = "linux")]
pub fn read() -> SystemClock {
    // SAFETY: all fields of `timex` are integers, for which zero is a value.
    #[expect(
        unsafe_code,
        reason = "the kernel's interface is a structure of integers, zeroed as its manual requires"
    )]
    let mut timex: libc::timex = unsafe { std::mem::zeroed() };
    // SAFETY: the pointer is to a live structure; with `modes` 0 the kernel only fills it in.
    #[expect(unsafe_code, reason = "no maintained crate wraps adjtimex(2) safely")]
    let state = unsafe { libc::adjtimex(&raw mut timex) };
    let synchronised =
        state >= 0 && state != libc::TIME_ERROR && timex.status & libc::STA_UNSYNC == 0;
    SystemClock {
        synchronised,
        max_error_us: u32::try_from(timex.maxerror).ok().filter(|_| synchronised),
        ahead_us: 0,
    }
}

/// A system without this interface counts as not synchronised.
#[cfg(not(target_os = "linux"))]
pub fn read() -> SystemClock {
    SystemClock::default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unsynchronised_clock_has_no_error_bound() {
        let clock = read();
        assert!(clock.synchronised || clock.max_error_us.is_none());
        assert_eq!(clock.ahead_us, 0);
    }
}
