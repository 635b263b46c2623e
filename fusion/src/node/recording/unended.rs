//! What is said of a recording that has no end.

use std::path::Path;

use crate::node::output::claim::is_written_to;

/// Why the recording at `path` has no end, of which so many bytes can be read of so many that it has. Outside of the folder of a
/// run nobody knows whether somebody writes to it.
pub fn without_end(path: &Path, [read, all]: [u64; 2]) -> String {
    let folder = path.parent().filter(|it| !it.as_os_str().is_empty());
    if is_written_to(folder.unwrap_or(Path::new("."))) {
        format!("its run goes on, and the recording with it: its first {read} bytes are read")
    } else if read < all {
        format!("the recording was cut off: {read} of its {all} bytes can be read")
    } else {
        format!(
            "the recording has no end: it is still being written, or who wrote it was killed; all of its {all} bytes can be read"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::node::output::claim::FolderClaim;

    #[test]
    fn only_of_what_cannot_be_read_is_said_that_it_was_cut_off() {
        let folder = tempfile::tempdir().unwrap();
        let recording = folder.path().join("out/hall.mcap");
        let told = |read| without_end(&recording, [read, 900]);
        assert_eq!(
            told(640),
            "the recording was cut off: 640 of its 900 bytes can be read"
        );
        assert!(told(900).contains("it is still being written, or who wrote it was killed"));
        let claim = FolderClaim::take(recording.parent(), "hall").unwrap();
        for read in [640, 900] {
            let told = told(read);
            assert!(told.starts_with("its run goes on"), "{told}");
        }
        drop(claim);
    }
}
