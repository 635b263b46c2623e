//! Nets: what runs say and write today, so that a change of structure that changes it is seen.
//!
//! A row that gets better is changed in a commit of its own. `FARFIELD_NETS=show` prints rows and hashes in place of
//! comparing them.

mod poses;
mod verdicts;

pub(crate) use self::poses::hold_poses;
pub(crate) use self::verdicts::hold_verdicts;

/// Whether the nets shall be shown, to be written anew.
fn is_shown() -> bool {
    std::env::var_os("FARFIELD_NETS").is_some_and(|it| it == "show")
}
