//! Smooth functions of time between evenly spaced samples.

/// `N` values at evenly spaced times from 0 on, interpolated by Catmull-Rom cubics: once
/// continuously differentiable, and constant before the first and after the last sample.
#[derive(Debug, Clone, Default)]
pub(super) struct Table<const N: usize> {
    step_s: f64,
    samples: Vec<[f64; N]>,
}

impl<const N: usize> Table<N> {
    /// One sample every `step_s`; without samples the function is zero.
    pub(super) fn new(step_s: f64, samples: Vec<[f64; N]>) -> Self {
        Self { step_s, samples }
    }

    pub(super) fn at(&self, time_s: f64) -> [f64; N] {
        let Some(last) = self.samples.len().checked_sub(1) else {
            return [0.0; N];
        };
        let place = (time_s / self.step_s).clamp(0.0, last as f64);
        let index = (place as usize).min(last.saturating_sub(1));
        let u = place - index as f64;
        let sample = |offset: usize| self.samples[(index + offset).saturating_sub(1).min(last)];
        let (a, b, c, d) = (sample(0), sample(1), sample(2), sample(3));
        std::array::from_fn(|i| {
            let (into, out) = ((c[i] - a[i]) / 2.0, (d[i] - b[i]) / 2.0);
            let rise = c[i] - b[i];
            let bend = u * (into + out - 2.0 * rise) + (3.0 * rise - 2.0 * into - out);
            b[i] + u * (into + u * bend)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_interpolates_samples_and_preserves_lines() {
        let table = Table::new(0.5, (0..5).map(|i| [f64::from(i), 2.0]).collect());
        for (time_s, value) in [
            (0.0, 0.0),
            (0.5, 1.0),
            (0.8, 1.6),
            (2.0, 4.0),
            (9.0, 4.0),
            (-1.0, 0.0),
        ] {
            let [a, b] = table.at(time_s);
            assert!(
                (a - value).abs() < 1e-12 && (b - 2.0).abs() < 1e-12,
                "{time_s}: {a}"
            );
        }
    }

    #[test]
    fn an_empty_table_is_zero() {
        assert!(Table::<1>::default().at(1.0)[0].abs() < 1e-12);
    }
}
