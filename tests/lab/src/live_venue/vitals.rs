//! Resources of a running process: memory, threads and file handles, from the kernel.

use std::fs;

/// Resources of a process at one moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Vitals {
    /// Memory in use, bytes (resident set).
    pub memory_bytes: u64,
    /// Threads.
    pub threads: u32,
    /// Open files and sockets.
    pub handles: u32,
    /// Processor time since its start, milliseconds, over all threads.
    pub cpu_ms: u64,
}

impl Vitals {
    /// Of process `pid`; `None` if it has ended.
    pub fn of(pid: u32) -> Option<Self> {
        let status = fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
        let field = |name: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(name))?;
            line.split_whitespace().next()?.parse::<u64>().ok()
        };
        let handles = fs::read_dir(format!("/proc/{pid}/fd")).ok()?.count();
        let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
        // The name, in brackets, may contain any character; user and system time are the 12th and 13th after it.
        let mut after_name = stat.rsplit_once(") ")?.1.split(' ').skip(11);
        let mut clock_ticks = || after_name.next()?.parse::<u64>().ok();
        // Linux counts in hundredths of a second on every architecture.
        let cpu_ms = (clock_ticks()? + clock_ticks()?) * 10;
        Some(Self {
            memory_bytes: field("VmRSS:")? * 1024,
            threads: u32::try_from(field("Threads:")?).ok()?,
            handles: u32::try_from(handles).ok()?,
            cpu_ms,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_handle_more_and_a_thread_more_are_counted() {
        let pid = std::process::id();
        let before = Vitals::of(pid).unwrap();
        assert!(before.memory_bytes > 100_000);
        let files: Vec<fs::File> = (0..50)
            .map(|_| fs::File::open("/proc/self/status").unwrap())
            .collect();
        let (end, wait) = std::sync::mpsc::channel::<()>();
        let thread = std::thread::spawn(move || wait.recv().is_err());
        let with = Vitals::of(pid).unwrap();
        drop((files, end));
        thread.join().unwrap();
        // Other tests of this process start and end.
        assert!(with.handles >= before.handles + 30, "{before:?} {with:?}");
        assert!(with.threads >= 2);
        assert_eq!(Vitals::of(u32::MAX), None);
    }
}
