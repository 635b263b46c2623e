//! The scale from known lengths: a wand that was carried through the field, distances between cameras.

use farfield_proto::order_statistics::upper_median;

/// A scale from several lengths.
#[derive(Debug, Clone, PartialEq)]
pub struct WandScale {
    /// Metres per unit of the cameras.
    pub scale: f64,
    /// Its relative standard deviation, from the differences of the lengths; `None` for one length.
    pub sigma_share: Option<f64>,
    /// Indices of lengths that contradict the others.
    pub outliers: Vec<usize>,
}

/// Relative error below which a length is never an outlier.
const LEAST_SHARE: f64 = 0.002;
/// Limit of an outlier in median absolute deviations (for a normal distribution: four standard deviations).
const DEVIATIONS: f64 = 5.9;
/// Least share of the lengths that must agree.
const LEAST_AGREEING: f64 = 0.6;
/// Relative error above which a length is always an outlier.
const MOST_SHARE: f64 = 0.05;

/// The scale on which most of `lengths` agree. Each is a pair: in units of the cameras, and in metres.
///
/// # Errors
/// A message: no length, an invalid length, or lengths that contradict each other.
pub fn wand_scale(lengths: &[(f64, f64)]) -> Result<WandScale, String> {
    let mut logs = Vec::new();
    for (found, known) in lengths {
        let is_length = |v: f64| v.is_finite() && v > 0.0;
        if !is_length(*found) || !is_length(*known) {
            return Err(format!("found a length of {known} m, expected more than 0"));
        }
        logs.push(libm::log(known / found));
    }
    let middle = upper_median(logs.clone()).ok_or("found no length, expected one or more")?;
    let off: Vec<f64> = logs.iter().map(|log| (log - middle).abs()).collect();
    let usual = upper_median(off.clone()).unwrap_or(0.0);
    let limit = (DEVIATIONS * usual).clamp(LEAST_SHARE, MOST_SHARE);
    let kept: Vec<f64> = logs
        .iter()
        .zip(&off)
        .filter(|(_, off)| **off <= limit)
        .map(|(log, _)| *log)
        .collect();
    let count = kept.len() as f64;
    if count < LEAST_AGREEING * lengths.len() as f64 {
        let least = logs.iter().copied().fold(f64::INFINITY, f64::min);
        let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        return Err(format!(
            "the known distances contradict each other by a factor of {:.2}: find and correct the wrong one",
            libm::exp(most - least)
        ));
    }
    let mean = kept.iter().sum::<f64>() / count;
    let squares: f64 = kept.iter().map(|log| (log - mean) * (log - mean)).sum();
    Ok(WandScale {
        scale: libm::exp(mean),
        sigma_share: (count > 1.0).then(|| (squares / (count - 1.0) / count).sqrt()),
        outliers: (0..off.len()).filter(|i| off[*i] > limit).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrong_length_among_many_is_an_outlier_and_not_used() {
        let mut lengths: Vec<(f64, f64)> = (0..12)
            .map(|i| (0.25 * (1.0 + 1e-3 * libm::sin(f64::from(i))), 1.0))
            .collect();
        lengths[5].0 = 0.31;
        let found = wand_scale(&lengths).unwrap();
        assert_eq!(found.outliers, [5]);
        assert!((found.scale - 4.0).abs() < 0.004, "{found:?}");
        let sigma = found.sigma_share.unwrap();
        assert!(sigma > 5e-5 && sigma < 5e-4, "{sigma}");
    }

    #[test]
    fn lengths_that_contradict_each_other_are_refused() {
        let error = wand_scale(&[(1.0, 1.0), (1.0, 1.3)]).unwrap_err();
        assert!(
            error.contains("contradict each other by a factor of 1.30"),
            "{error}"
        );
        assert!(
            wand_scale(&[]).is_err()
                && wand_scale(&[(1.0, 0.0)]).is_err()
                && wand_scale(&[(f64::NAN, 1.0)]).is_err()
        );
    }

    #[test]
    fn one_length_gives_a_scale_without_uncertainty() {
        let found = wand_scale(&[(2.0, 5.0)]).unwrap();
        assert!((found.scale - 2.5).abs() < 1e-12 && found.sigma_share.is_none());
    }
}
