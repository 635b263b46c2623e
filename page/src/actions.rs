//! What pages may have done for them, by whoever runs the server: names of people, recordings.

pub use crate::protocol::request::Action;
pub use crate::protocol::text::ActionKind;

/// Who does what pages ask for. Called on a thread that may wait; one action at a time.
pub trait PageActions: Send + Sync {
    /// What can be done.
    fn kinds(&self) -> Vec<ActionKind>;

    /// Does it.
    ///
    /// # Errors
    /// Why not, in a sentence for the operator.
    fn act(&self, action: &Action) -> Result<(), String>;
}

impl Action {
    /// Its kind.
    pub fn kind(&self) -> ActionKind {
        match self {
            Self::NamePerson { .. } => ActionKind::NamePerson,
            Self::StartRecording | Self::StopRecording => ActionKind::Record,
        }
    }
}
