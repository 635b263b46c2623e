//! Processor and memory.

use crate::report_lines::{ReportLines, Verdict};

const MACHINE: &str = "machine";
/// An edge with a large network takes so much, bytes.
const ENOUGH_BYTES: u64 = 1 << 30;
/// Less, and no network loads.
const LEAST_BYTES: u64 = 200 << 20;

/// What a machine has.
#[derive(Debug, Clone, Copy)]
pub(super) struct MachineFacts {
    /// Cores that this process may use.
    pub(super) cores: usize,
    /// Memory that programs can still get, bytes; `None` where the system does not say.
    pub(super) free_bytes: Option<u64>,
    /// Whether the processor multiplies eight numbers at once (AVX2 and FMA; on ARM always).
    pub(super) is_wide: bool,
}

/// What this machine has.
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

/// Adds what `facts` say.
pub(super) fn look_at_machine(facts: &MachineFacts, report: &mut ReportLines) {
    let cores = format!("{} cores", facts.cores);
    if facts.is_wide {
        report.ok(MACHINE, cores);
    } else {
        report.warn(
            MACHINE,
            format!("{cores}, without AVX2 and FMA: inference takes several times as long"),
            "use a processor made since 2014; in a virtual machine, pass the host's processor on",
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
            "end other programs (`ps aux --sort=-rss | head`); an edge with a large network takes 1 GB"
        }
    };
    let text = format!("{:.1} GB of memory are free", free_bytes as f64 / 1e9);
    report.push(MACHINE, verdict, text, remedy);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn free_memory_is_what_the_kernel_says_is_available() {
        let meminfo = "MemTotal:       49449924 kB\nMemFree:  1 kB\nMemAvailable:   2048 kB\n";
        assert_eq!(free_bytes(meminfo), Some(2 << 20));
        assert_eq!(free_bytes("nothing"), None);
    }
}
