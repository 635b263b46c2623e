//! Whether a camera fits equally well at all times: one that was knocked, or whose clock jumped, fits before or after.

use farfield_proto::order_statistics::upper_median;

/// Windows of equally many sights that a camera's are cut into, and how many a window needs.
const WINDOWS: usize = 20;
const LEAST_SIGHTS: usize = 5;
/// Neighbouring windows that are bad together, and the share of the usual that is bad.
const LEAST_RUN: usize = 2;
const BAD_SHARE: f64 = 0.5;

/// Where in `used` (whether each sight fits, in the order of time) the first run of windows begins that fit less than half
/// as well as the usual one, or where it ends if it begins with the first; a share of all sights, 0 to 1. Windows are 20, or 10 where sights are few.
pub(crate) fn knocked_at(used: &[bool]) -> Option<f64> {
    let windows = if used.len() >= WINDOWS * 2 * LEAST_SIGHTS {
        WINDOWS
    } else {
        WINDOWS / 2
    };
    if used.len() < windows * LEAST_SIGHTS {
        return None;
    }
    let shares = (0..windows).filter_map(|k| {
        let own = used.get(k * used.len() / windows..(k + 1) * used.len() / windows)?;
        let fitting = own.iter().filter(|fits| **fits).count();
        Some(fitting as f64 / own.len().max(1) as f64)
    });
    let shares: Vec<f64> = shares.collect();
    let bar = BAD_SHARE * upper_median(shares.clone())?;
    let mut runs = shares.windows(LEAST_RUN);
    let start = runs.position(|run| run.iter().all(|share| *share < bar))?;
    let change = if start > 0 {
        start
    } else {
        shares.iter().take_while(|share| **share < bar).count()
    };
    Some(change as f64 / windows as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tenth does not fit, and nothing from `from` on to `to`.
    fn used(count: usize, from: f64, to: f64) -> Vec<bool> {
        let each = (0..count).map(|i| {
            let at = i as f64 / count as f64;
            i % 10 != 3 && !(from..to).contains(&at)
        });
        each.collect()
    }

    #[test]
    fn a_part_that_does_not_fit_is_found_where_it_begins_or_ends() {
        for (count, from, to, change) in [
            (400, 0.85, 1.0, 0.85),
            (400, 0.5, 0.6, 0.5),
            (400, 0.0, 0.2, 0.2),
            (60, 0.6, 1.0, 0.6),
        ] {
            let at = knocked_at(&used(count, from, to)).unwrap();
            assert!((at - change).abs() < 0.06, "{at} {change}");
        }
    }

    #[test]
    fn outliers_that_come_evenly_and_too_few_sights_are_no_knock() {
        assert_eq!(knocked_at(&used(400, 2.0, 2.0)), None);
        assert_eq!(knocked_at(&used(30, 0.5, 1.0)), None);
        assert_eq!(knocked_at(&[]), None);
    }
}
