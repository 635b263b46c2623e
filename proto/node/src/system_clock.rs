//! What the system says of its clock: whether NTP or PTP keeps it right, and how wrong it may be.

use farfield_proto::message::health::SystemClock;

/// Asks the kernel, as chrony, ntpd, systemd-timesyncd and phc2sys have left word there. A system that cannot be asked has
/// a clock that nothing keeps right. [`SystemClock::ahead_us`] is left at 0.
#[cfg(target_os = "linux")]
pub fn read() -> SystemClock {
    // SAFETY: all fields of `timex` are integers, for which zero is a value.
    #[expect(
        unsafe_code,
        reason = "the kernel is asked by a structure of integers, zeroed as its manual wants it"
    )]
    let mut asked: libc::timex = unsafe { std::mem::zeroed() };
    // SAFETY: the pointer is to a live structure; with `modes` 0 the kernel only fills it in.
    #[expect(
        unsafe_code,
        reason = "no safe wrapper of adjtimex(2) is kept by anybody"
    )]
    let state = unsafe { libc::adjtimex(&raw mut asked) };
    let synchronised =
        state >= 0 && state != libc::TIME_ERROR && asked.status & libc::STA_UNSYNC == 0;
    SystemClock {
        synchronised,
        max_error_us: u32::try_from(asked.maxerror).ok().filter(|_| synchronised),
        ahead_us: 0,
    }
}

/// A system that cannot be asked has a clock that nothing keeps right.
#[cfg(not(target_os = "linux"))]
pub fn read() -> SystemClock {
    SystemClock::default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_that_nothing_sets_has_no_bound() {
        let clock = read();
        assert!(clock.synchronised || clock.max_error_us.is_none());
        assert_eq!(clock.ahead_us, 0);
    }
}
