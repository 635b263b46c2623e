//! The scores as a person reads them.

use std::fmt;

use super::{ActorScore, Scores};

impl fmt::Display for Scores {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:>5}  {:>6} {:>5}  {:>8}  {:>7}  {:>6} {:>6} {:>6}  {:>6} {:>6}  {:>8}  {:>6}",
            "actor",
            "frames",
            "gaps",
            "MPJPE mm",
            "SR@150",
            "PCP",
            "PCP",
            "PCP",
            "PCK50",
            "PCK100",
            "jitter",
            "slide"
        )?;
        writeln!(
            f,
            "{:>5}  {:>6} {:>5}  {:>8}  {:>7}  {:>6} {:>6} {:>6}  {:>6} {:>6}  {:>8}  {:>6}",
            "", "", "", "", "%", "both", "mean", "mid", "%", "%", "m/s^3", "mm/s"
        )?;
        for (actor, score) in &self.actors {
            row(
                f,
                &actor.to_string(),
                [score.frames as f64, score.gaps as f64],
                &figures(score),
            )?;
        }
        let mean = &self.mean;
        let of_mean = [
            mean.mpjpe_mm,
            Some(mean.success_150),
            Some(mean.pcp_both_ends),
            Some(mean.pcp_mean_end),
            Some(mean.pcp_midpoint),
            Some(mean.pck_50),
            Some(mean.pck_100),
            mean.jitter_m_s3,
            mean.foot_slide_mm_s,
        ];
        row(f, "mean", [mean.frames, mean.gaps], &of_mean)?;
        let id = &self.identity;
        let births = if self.truth_partial {
            "false births not counted (the truth is partial)".to_owned()
        } else {
            format!("false births {}", id.false_births)
        };
        write!(
            f,
            "identity: switches {}, fragmentations {}, {births}, IDF1 {:.1} %, MOTA {:.1} %",
            id.switches, id.fragmentations, id.idf1, id.mota
        )?;
        if self.rate_hz.is_none() {
            write!(
                f,
                "\nno rate is known, so jitter and foot slide are left out"
            )?;
        }
        Ok(())
    }
}

fn figures(score: &ActorScore) -> [Option<f64>; 9] {
    [
        score.mpjpe_mm,
        Some(score.success_150),
        Some(score.pcp_both_ends),
        Some(score.pcp_mean_end),
        Some(score.pcp_midpoint),
        Some(score.pck_50),
        Some(score.pck_100),
        score.jitter_m_s3,
        score.foot_slide_mm_s,
    ]
}

fn row(
    f: &mut fmt::Formatter<'_>,
    name: &str,
    [frames, gaps]: [f64; 2],
    figures: &[Option<f64>; 9],
) -> fmt::Result {
    let [
        mpjpe,
        success,
        both,
        mean_end,
        middle,
        pck_50,
        pck_100,
        jitter,
        slide,
    ] = figures.map(|v| v.map_or_else(|| "-".to_owned(), |v| format!("{v:.1}")));
    // Counts of one actor are whole, their mean over actors is not.
    let [frames, gaps] = [frames, gaps].map(|n| {
        let digits = usize::from(n.fract() != 0.0);
        format!("{n:.digits$}")
    });
    writeln!(
        f,
        "{name:>5}  {frames:>6} {gaps:>5}  {mpjpe:>8}  {success:>7}  {both:>6} {mean_end:>6} {middle:>6}  \
         {pck_50:>6} {pck_100:>6}  {jitter:>8}  {slide:>6}"
    )
}
