//! Processor, memory and system clock.

use farfield_proto::message::health::SystemClock;
use farfield_proto::venue::{Parameters, Venue};

use crate::report_lines::{ReportLines, Verdict};

const MACHINE: &str = "machine";
/// Memory for an edge with a large network, bytes.
const ENOUGH_BYTES: u64 = 1 << 30;
/// With less memory, no network can be loaded.
const LEAST_BYTES: u64 = 200 << 20;

/// Facts on a machine.
#[derive(Debug, Clone, Copy)]
pub(super) struct MachineFacts {
    pub(super) cores: usize,
    /// Free memory, bytes; `None` if unknown.
    pub(super) free_bytes: Option<u64>,
    /// Whether the processor multiplies eight numbers at once (AVX2 and FMA; on ARM always true).
    pub(super) is_wide: bool,
}

/// Facts on this machine.
pub(super) fn facts() -> MachineFacts {
    let meminfo = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    MachineFacts {
        cores: std::thread::available_parallelism().map_or(1, std::num::NonZero::get),
        free_bytes: free_bytes(&meminfo),
        is_wide: is_wide(),
    }
}

#[cfg(target_arch = "x86_64")]
fn is_wide() -> bool {
    std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma")
}

#[cfg(not(target_arch = "x86_64"))]
fn is_wide() -> bool {
    true
}

/// `MemAvailable` of the kernel's `/proc/meminfo`.
fn free_bytes(meminfo: &str) -> Option<u64> {
    let line = meminfo
        .lines()
        .find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}

/// Checks processor and memory.
pub(super) fn check_machine(facts: &MachineFacts, report: &mut ReportLines) {
    let cores = format!("{} cores", facts.cores);
    if facts.is_wide {
        report.ok(MACHINE, cores);
    } else {
        report.warn(
            MACHINE,
            format!("{cores}, without AVX2 and FMA: inference takes several times as long"),
            "use a processor from 2014 or later; in a virtual machine, pass the host's processor through",
        );
    }
    let Some(free_bytes) = facts.free_bytes else {
        return;
    };
    let verdict = if free_bytes < LEAST_BYTES {
        Verdict::Failed
    } else if free_bytes < ENOUGH_BYTES {
        Verdict::Warning
    } else {
        Verdict::Ok
    };
    let remedy = match verdict {
        Verdict::Ok => "",
        _ => {
            "end other programs (`ps aux --sort=-rss | head`); an edge with a large network needs 1 GB"
        }
    };
    let text = format!("{:.1} GB of memory are free", free_bytes as f64 / 1e9);
    report.push(MACHINE, verdict, text, remedy);
}

const CLOCK: &str = "clock";
/// 2025-01-01, Unix time in seconds: this program is newer.
const YOUNGEST_S: i64 = 1_735_689_600;
const KEEP: &str = "timedatectl set-ntp true (or chrony, or PTP: docs/live.md)";

/// Checks the system clock, which shows `now_s` (Unix time in seconds).
pub(super) fn check_clock(
    clock: &SystemClock,
    now_s: i64,
    venue: Option<&Venue>,
    report: &mut ReportLines,
) {
    if now_s < YOUNGEST_S {
        report.fail(
            CLOCK,
            "the clock shows a time before the release of this program",
            KEEP,
        );
        return;
    }
    let parameters = venue.map_or_else(Parameters::default, |venue| venue.parameters.clone());
    let bound_ms = parameters.link.clock_bound_ms;
    let max_error_ms = clock.max_error_us.map(|us| f64::from(us) / 1000.0);
    match (clock.synchronised, max_error_ms) {
        (false, _) => report.warn(
            CLOCK,
            "the clock is not synchronised, as far as the system reports (a container may not know)",
            KEEP,
        ),
        (true, Some(error_ms)) if error_ms > bound_ms => report.warn(
            CLOCK,
            format!("the clock may be off by {error_ms:.0} ms; a live fusion refuses an edge that is surely off by {bound_ms:.0} ms"),
            "chronyc makestep (or use a nearer time server)",
        ),
        (true, Some(error_ms)) => {
            report.ok(CLOCK, format!("the clock is synchronised, to {error_ms:.1} ms at worst"));
        }
        (true, None) => report.ok(CLOCK, "the clock is synchronised"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn free_memory_is_mem_available_of_the_kernel() {
        let meminfo = "MemTotal:       49449924 kB\nMemFree:  1 kB\nMemAvailable:   2048 kB\n";
        assert_eq!(free_bytes(meminfo), Some(2 << 20));
        assert_eq!(free_bytes("nothing"), None);
    }
}
