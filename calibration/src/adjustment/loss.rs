//! How much a residual counts.

/// A robust loss rho of the squared residual s (in standard deviations, over both image axes), with cost 1/2 rho(s).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Loss {
    /// Least squares: rho = s.
    Squared,
    /// Cauchy: rho = c2 ln(1 + s / c2), with c in standard deviations.
    Cauchy(f64),
    /// Huber: s up to c2, then 2 c sqrt(s) - c2, with c in standard deviations.
    Huber(f64),
}

impl Loss {
    /// rho(s) and its derivative, which is the weight of the residual in the normal equations.
    pub fn value_and_weight(self, s: f64) -> (f64, f64) {
        match self {
            Self::Squared => (s, 1.0),
            Self::Cauchy(c) => {
                let ratio = s / (c * c);
                (c * c * libm::log1p(ratio), 1.0 / (1.0 + ratio))
            }
            Self::Huber(c) if s <= c * c => (s, 1.0),
            Self::Huber(c) => {
                let root = s.sqrt();
                (2.0 * c * root - c * c, c / root)
            }
        }
    }
}
