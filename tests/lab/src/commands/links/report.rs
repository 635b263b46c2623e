//! The table of a study of links.

use std::fmt;

use serde::Serialize;

/// All lines of the table.
#[derive(Debug, Serialize)]
pub(super) struct LinkReport {
    /// Length of a run, seconds.
    pub(super) seconds: u32,
    /// Seconds at its start that are not scored.
    pub(super) settle: u32,
    pub(super) rows: Vec<LinkRow>,
}

/// One run.
#[derive(Debug, Serialize)]
pub(in crate::commands) struct LinkRow {
    /// Round trip and loss each way.
    pub(in crate::commands) link: String,
    pub(in crate::commands) mpjpe_mm: Option<f64>,
    /// Persons and ticks without a pose near the truth, and all of them.
    pub(in crate::commands) gaps: u64,
    pub(in crate::commands) frames: u64,
    pub(in crate::commands) id_switches: u64,
    /// From the capture to the arrival of the pose at an observer.
    pub(in crate::commands) delay_p50_ms: Option<f64>,
    pub(in crate::commands) delay_p99_ms: Option<f64>,
    /// The highest compression level of any edge at the end, 0 lossless to 6.
    pub(in crate::commands) quality: Option<u8>,
    /// The slowest edge works on every n-th tick.
    pub(in crate::commands) every_nth_tick: Option<u16>,
    /// Most bytes offered to a link in one second, and the mean.
    pub(in crate::commands) peak_bytes_s: u64,
    pub(in crate::commands) mean_bytes_s: u64,
    /// For a shared link: largest difference of an edge's rate from the mean, as a share of the mean.
    pub(in crate::commands) rates_apart: Option<f64>,
    /// For a shared link: each edge.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(in crate::commands) edges: Vec<EdgeShare>,
    /// Datagrams for which an edge's queue had no room.
    pub(in crate::commands) dropped: u64,
    /// Longest and mean wait in an edge's queue.
    pub(in crate::commands) longest_wait_ms: f64,
    pub(in crate::commands) mean_wait_ms: f64,
}

/// One edge's share of a shared link, and its state at the end.
#[derive(Debug, Serialize)]
pub(in crate::commands) struct EdgeShare {
    /// Bytes that arrived, with headers.
    pub(in crate::commands) bytes_s: u64,
    /// Compression level.
    pub(in crate::commands) quality: u8,
    /// Limit of persons per tick; `None`: all.
    pub(in crate::commands) persons_per_tick: Option<u16>,
    /// It works on every n-th tick.
    pub(in crate::commands) every_nth_tick: u16,
}

impl fmt::Display for EdgeShare {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (kb_s, quality) = (self.bytes_s as f64 / 1e3, self.quality);
        write!(f, "{kb_s:.1} kB/s, quality {quality}")?;
        if let Some(persons) = self.persons_per_tick {
            write!(f, ", {persons} persons a tick")?;
        }
        match self.every_nth_tick {
            0 | 1 => Ok(()),
            nth => write!(f, ", every {nth} ticks"),
        }
    }
}

impl LinkReport {
    pub(super) fn new(seconds: u32, settle: u32) -> Self {
        Self {
            seconds,
            settle,
            rows: Vec::new(),
        }
    }
}

const HEAD: &str = "link           MPJPE    gaps  switches  capture to pose ms  quality  every  kB/s of a link   \
                    queue ms           dropped  edges apart\n                  mm       %            P50      P99         \
                          nth    mean    peak      mean     max                    %";

impl fmt::Display for LinkReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{} s a line, the first {} s not scored; bytes as the relays counted them, with headers\n\n{HEAD}",
            self.seconds, self.settle
        )?;
        self.rows.iter().try_for_each(|row| writeln!(f, "{row}"))
    }
}

impl fmt::Display for LinkRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let number = |value: Option<f64>| value.map_or("-".to_owned(), |v| format!("{v:.1}"));
        let whole = |value: Option<u16>| value.map_or("-".to_owned(), |v| v.to_string());
        write!(
            f,
            "{:13} {:>6} {:>7.2} {:>9} {:>8} {:>8} {:>8} {:>6} {:>7.1} {:>7.1} {:>9.1} {:>7.1} {:>9} {:>12}",
            self.link,
            number(self.mpjpe_mm),
            100.0 * self.gaps as f64 / self.frames.max(1) as f64,
            self.id_switches,
            number(self.delay_p50_ms),
            number(self.delay_p99_ms),
            whole(self.quality.map(u16::from)),
            whole(self.every_nth_tick),
            self.mean_bytes_s as f64 / 1e3,
            self.peak_bytes_s as f64 / 1e3,
            self.mean_wait_ms,
            self.longest_wait_ms,
            self.dropped,
            number(self.rates_apart.map(|apart| 100.0 * apart))
        )?;
        let mut edges = self.edges.iter();
        edges.try_for_each(|edge| write!(f, "\n    an edge: {edge}"))
    }
}
