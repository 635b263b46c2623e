//! Conditions of a live run, such as a late edge or a wrong clock: each is printed when it begins and when it ends, and shown
//! in fusion's status as long as it lasts.

use std::collections::BTreeSet;

/// A condition that a watch has found.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct Condition {
    /// Identifies it from one second to the next.
    key: String,
    /// Printed when it begins.
    begins: Option<String>,
    /// Its notice in fusion's status.
    notice: Option<String>,
    /// Printed when it ends, with all others that end in these words. Without it, the condition is printed once in a run.
    ends: Option<String>,
}

impl Condition {
    /// A condition that is neither printed nor shown.
    pub(super) fn of(key: impl Into<String>) -> Self {
        Self {
            key: key.into(),
            ..Self::default()
        }
    }

    /// Printed as `text` when it begins.
    pub(super) fn begins(self, text: impl Into<String>) -> Self {
        Self {
            begins: Some(text.into()),
            ..self
        }
    }

    /// Shown as `text` in fusion's status.
    pub(super) fn notice(self, text: impl Into<String>) -> Self {
        Self {
            notice: Some(text.into()),
            ..self
        }
    }

    /// Printed and shown in the same words.
    pub(super) fn words(self, text: impl Into<String>) -> Self {
        let text = text.into();
        self.begins(text.clone()).notice(text)
    }

    /// Its end is printed as `text`.
    pub(super) fn ends(self, text: impl Into<String>) -> Self {
        Self {
            ends: Some(text.into()),
            ..self
        }
    }
}

/// The conditions that last.
#[derive(Debug, Default)]
pub(super) struct Conditions {
    lasting: Vec<Condition>,
    /// Keys of those that are printed once in a run.
    printed: BTreeSet<String>,
}

impl Conditions {
    /// Replaces the conditions by those of `now`. Returns the lines to print.
    pub(super) fn update(&mut self, now: Vec<Condition>) -> Vec<String> {
        let before = std::mem::replace(&mut self.lasting, now);
        let mut lines = Vec::new();
        for condition in &self.lasting {
            let is_new = before.iter().all(|old| old.key != condition.key);
            let is_once = condition.ends.is_none();
            if is_new && (!is_once || self.printed.insert(condition.key.clone())) {
                lines.extend(condition.begins.clone());
            }
        }
        for ended in before.into_iter().filter_map(|old| old.ends) {
            let lasts = |it: &Condition| it.ends.as_ref() == Some(&ended);
            if !self.lasting.iter().any(lasts) && !lines.contains(&ended) {
                lines.push(ended);
            }
        }
        lines
    }

    /// The notices for fusion's status.
    pub(super) fn notices(&self) -> impl Iterator<Item = &String> {
        self.lasting.iter().filter_map(|it| it.notice.as_ref())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn late(edge: &str) -> Condition {
        Condition::of(format!("late {edge}"))
            .words(format!("{edge} is late"))
            .ends("no edge is late")
    }

    #[test]
    fn a_condition_is_printed_at_its_beginning_and_its_end() {
        let mut conditions = Conditions::default();
        assert_eq!(conditions.update(vec![late("ne")]), ["ne is late"]);
        assert!(conditions.update(vec![late("ne")]).is_empty());
        assert_eq!(conditions.notices().collect::<Vec<_>>(), ["ne is late"]);
        assert_eq!(conditions.update(Vec::new()), ["no edge is late"]);
        assert_eq!(conditions.update(vec![late("ne")]), ["ne is late"]);
    }

    #[test]
    fn conditions_that_end_in_the_same_words_end_together() {
        let mut conditions = Conditions::default();
        conditions.update(vec![late("ne"), late("sw")]);
        assert!(conditions.update(vec![late("sw")]).is_empty());
        conditions.update(vec![late("ne"), late("sw")]);
        assert_eq!(conditions.update(Vec::new()), ["no edge is late"]);
    }

    #[test]
    fn a_condition_without_an_end_is_printed_once_in_a_run() {
        let mut conditions = Conditions::default();
        let expires = || vec![Condition::of("certificate").begins("it expires soon")];
        assert_eq!(conditions.update(expires()), ["it expires soon"]);
        assert!(conditions.update(Vec::new()).is_empty());
        assert!(conditions.update(expires()).is_empty());
        assert_eq!(conditions.notices().count(), 0);
    }
}
