//! Scores as a text table.

use std::fmt;

use super::lines::TruthExtent;
use super::{ActorScore, MeanScore, Scores};

/// The columns after the actor's: name, unit, width.
const COLUMNS: [(&str, &str, usize); 15] = [
    ("frames", "", 6),
    ("gaps", "", 5),
    ("out", "", 4),
    ("MPJPE", "mm", 6),
    ("sites", "mm", 6),
    ("SR@150", "%", 7),
    ("PCP", "both", 6),
    ("PCP", "mean", 6),
    ("PCP", "mid", 6),
    ("PCK50", "%", 6),
    ("PCK100", "%", 6),
    ("ids", "", 4),
    ("jitter", "m/s^3", 7),
    ("slide", "mm/s", 6),
    ("ankle", "mm/s", 6),
];

/// The figures of a row, in the order of the columns.
pub type TableRow = [Option<f64>; COLUMNS.len()];

impl fmt::Display for Scores {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}\n", self.sentence())?;
        writeln!(f, "{}", head(5))?;
        for (actor, score) in &self.actors {
            writeln!(f, "{}", line(5, &actor.to_string(), &score.row()))?;
        }
        writeln!(f, "{}", line(5, "mean", &self.mean.row()))?;
        write!(f, "{}\n{}", self.identity_line(), self.lives)?;
        if let Some(calibration) = &self.calibration {
            write!(f, "\n{calibration}")?;
        }
        if let Some(hole) = &self.first_hole {
            write!(
                f,
                "\nthe truth has person {} at ticks {} and {} and not in between: this counts as absence (use --truth partial if it was annotated in part)",
                hole.person, hole.after, hole.until
            )?;
        }
        if self.rate_hz.is_none() {
            write!(
                f,
                "\njitter and foot slide are left out: the rate is unknown"
            )?;
        }
        Ok(())
    }
}

impl Scores {
    /// A summary in one sentence.
    pub fn sentence(&self) -> String {
        let frames: u64 = self.actors.values().map(|actor| actor.frames).sum();
        let gaps: u64 = self.actors.values().map(|actor| actor.gaps).sum();
        let people = match self.actors.len() {
            1 => "1 person".to_owned(),
            n => format!("{n} people"),
        };
        let off = self.mean.mpjpe_mm.map_or_else(
            || "no pose is near the truth".to_owned(),
            |mm| format!("joints are {mm:.0} mm off on average"),
        );
        let switches = match self.identity.switches {
            0 => "no person changed ids".to_owned(),
            n => format!("ids changed {n} times"),
        };
        format!("{people}, {frames} true poses: {off}, {gaps} poses are missing, {switches}")
    }

    /// The figures of identity in one line.
    pub fn identity_line(&self) -> String {
        let id = &self.identity;
        let births = match self.truth {
            TruthExtent::Partial => "false births not counted (the truth is partial)".to_owned(),
            TruthExtent::Whole => format!("false births {}", id.false_births),
        };
        format!(
            "identity: switches {}, fragmentations {}, {births}, IDF1 {:.1} %, MOTA {:.1} %",
            id.switches, id.fragmentations, id.idf1, id.mota
        )
    }
}

/// Several scores against the same truth in one table: for each actor, and for the mean, one row per score under its name. The
/// first score determines the actors.
pub fn side_by_side(name_width: usize, named: &[(&str, &Scores)]) -> String {
    let mut lines = vec![head(name_width)];
    let mut group = |actor: &str, row_of: &dyn Fn(&Scores) -> Option<TableRow>| {
        for (index, (name, scores)) in named.iter().enumerate() {
            let actor = if index == 0 { actor } else { "" };
            let name = format!("{actor:<4} {name:>width$}", width = name_width - 5);
            lines.extend(row_of(scores).map(|row| line(name_width, &name, &row)));
        }
    };
    let actors = named.first().into_iter().flat_map(|(_, s)| s.actors.keys());
    for actor in actors {
        group(&actor.to_string(), &|scores| {
            scores.actors.get(actor).map(ActorScore::row)
        });
    }
    group("mean", &|scores| Some(scores.mean.row()));
    lines.join("\n")
}

/// The two header lines of a table whose row names have `name_width` characters.
pub fn head(name_width: usize) -> String {
    let [heads, units] = [0, 1].map(|which| {
        let cells = COLUMNS.map(|(head, unit, width)| {
            let text = if which == 0 { head } else { unit };
            format!(" {text:>width$}")
        });
        cells.concat()
    });
    format!("{:>name_width$}{heads}\n{:>name_width$}{units}", "", "")
}

/// One line of the table.
pub fn line(name_width: usize, name: &str, row: &TableRow) -> String {
    let cells = row.iter().zip(COLUMNS).map(|(value, (_, unit, width))| {
        // Counts of one actor are whole numbers; their means are not.
        let digits = usize::from(!unit.is_empty() || value.is_some_and(|v| v.fract() != 0.0));
        value.map_or_else(
            || format!(" {:>width$}", "-"),
            |value| format!(" {value:>width$.digits$}"),
        )
    });
    format!("{name:>name_width$}{}", cells.collect::<String>())
}

macro_rules! row {
    ($score:expr) => {
        [
            Some($score.frames as f64),
            Some($score.gaps as f64),
            Some($score.outliers as f64),
            $score.mpjpe_mm,
            $score.mpjpe_sites_mm,
            $score.success_150,
            $score.pcp_both_ends,
            $score.pcp_mean_end,
            $score.pcp_midpoint,
            $score.pck_50,
            $score.pck_100,
            Some($score.id_switches as f64),
            $score.jitter_m_s3,
            $score.foot_slide_mm_s,
            $score.ankle_slide_mm_s,
        ]
    };
}

impl ActorScore {
    /// The figures in the order of the table's columns.
    pub fn row(&self) -> TableRow {
        row!(self)
    }
}

impl MeanScore {
    /// The figures in the order of the table's columns.
    pub fn row(&self) -> TableRow {
        row!(self)
    }
}
