//! What was found in samples that do not change once they are kept: those that are judged again need not be looked at again.

use std::sync::Arc;

/// What was found in some samples.
#[derive(Debug)]
pub(in crate::camera_agreement) struct Found<S, F>(Vec<(Arc<S>, F)>);

impl<S, F> Default for Found<S, F> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<S, F> Found<S, F> {
    /// Takes out what was found in `sample`.
    pub(in crate::camera_agreement) fn take(&mut self, sample: &Arc<S>) -> Option<F> {
        let at = self.0.iter().position(|(of, _)| Arc::ptr_eq(of, sample))?;
        Some(self.0.swap_remove(at).1)
    }
}

impl<S, F> FromIterator<(Arc<S>, F)> for Found<S, F> {
    fn from_iter<I: IntoIterator<Item = (Arc<S>, F)>>(all: I) -> Self {
        Self(all.into_iter().collect())
    }
}
