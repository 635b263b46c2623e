//! Completes the files that a killed run left in its folder.
//!
//! Complete files, and files that do not belong to a run, are not changed: repeating it is
//! harmless.

use std::io;
use std::path::{Path, PathBuf};

use super::refusal::WriteError;
use super::unfinished::{SUFFIX, sync_folder_of};
use super::whole::{Kind, make_whole};

/// Name of the folder of smoothed poses in that of a run.
pub const SMOOTH: &str = "smooth";

/// Completes the files of a run in `folder` and in its folder of smoothed poses; returns the files
/// that got their names.
///
/// # Errors
/// [`WriteError::Io`] of the first file that could not be completed, after all others.
pub fn salvage(folder: &Path) -> Result<Vec<PathBuf>, WriteError> {
    let mut named = Vec::new();
    let mut failed = None;
    let smooth = folder.join(SMOOTH);
    for folder in [folder.to_owned(), smooth.clone()] {
        // The target of a link does not belong to this run, unless the folder itself was given as
        // one.
        let is_link = folder == smooth && folder.is_symlink();
        let left = if is_link {
            Err(io::Error::other(
                "found a symbolic link, expected a folder: it is left as it is; remove it",
            ))
        } else {
            unfinished_in(&folder)
        };
        let left = match left {
            Ok(left) => left,
            Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
            Err(source) => {
                failed.get_or_insert(WriteError::Io {
                    path: folder,
                    source,
                });
                continue;
            }
        };
        for (path, kind) in left {
            match make_whole(&path, kind) {
                Ok(whole) => named.extend(whole.map(|whole| whole.path)),
                Err(source) => drop(failed.get_or_insert(WriteError::Io { path, source })),
            }
        }
        // Not every file system can sync a folder; the files are complete all the same.
        drop(sync_folder_of(&folder.join("poses.jsonl")));
    }
    match failed {
        Some(error) => Err(error),
        None => Ok(named),
    }
}

/// The files of a run in `folder` that have no names yet, by path.
fn unfinished_in(folder: &Path) -> io::Result<Vec<(PathBuf, Kind)>> {
    let mut left = Vec::new();
    for entry in folder.read_dir()? {
        let path = entry?.path();
        let name = path.file_name().and_then(|name| name.to_str());
        let name = name.and_then(|name| name.strip_suffix(SUFFIX));
        if let Some(kind) = name.and_then(Kind::from_name) {
            left.push((path, kind));
        }
    }
    left.sort_by(|a, b| a.0.cmp(&b.0));
    Ok(left)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::fs;
    use std::sync::Arc;

    use farfield_proto::message::PersonState::Tracked;

    use super::super::disk_policy::GiveUp;
    use super::super::fixture;
    use super::super::pose_files::PoseFiles;
    use super::super::run_clock::RunEnd;
    use super::super::summary::Summary;
    use super::super::whole::WholeLines;
    use super::*;

    const RATE_HZ: f64 = 50.0;

    fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
        let entries = fs::read_dir(folder).unwrap().map(Result::unwrap);
        entries
            .map(|entry| {
                let name = entry.file_name().into_string().unwrap();
                (name, fs::read(entry.path()).unwrap())
            })
            .collect()
    }

    /// The complete files of a run with this many ticks of one person.
    fn run_of(n_ticks: i64) -> BTreeMap<String, Vec<u8>> {
        let folder = tempfile::tempdir().unwrap();
        let layout = fixture::layout();
        let disk = Arc::new(GiveUp);
        let mut files =
            PoseFiles::create(folder.path(), layout, RATE_HZ, RunEnd::Known, disk).unwrap();
        for tick in 0..n_ticks {
            files.write(&fixture::poses(tick, &[(1, Tracked)])).unwrap();
        }
        assert!(files.finish().failure.is_none());
        contents(folder.path())
    }

    #[test]
    fn a_lost_head_is_not_changed() {
        let folder = tempfile::tempdir().unwrap();
        let damaged = b"PathFileType\t4\t\xff\xfe\n2\n3\n4\n5\n1\t0.0\n";
        let endless = [b"Coordinates\n".to_vec(), vec![b'\n'; 2 << 20]].concat();
        for (name, bytes) in [
            ("poses_1.trc.tmp", &damaged[..]),
            ("angles_1.mot.tmp", &endless),
        ] {
            fs::write(folder.path().join(name), bytes).unwrap();
        }
        assert!(salvage(folder.path()).unwrap().is_empty());
        for (name, bytes) in [
            ("poses_1.trc.tmp", &damaged[..]),
            ("angles_1.mot.tmp", &endless),
        ] {
            assert_eq!(fs::read(folder.path().join(name)).unwrap(), bytes);
        }
    }

    #[test]
    fn a_cut_file_equals_that_of_a_shorter_run() {
        const TICKS: i64 = 3;
        let whole = run_of(TICKS);
        let shorter: Vec<_> = (0..TICKS).map(run_of).collect();
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in &whole {
            // As a killed run leaves it: the head has no count yet.
            let as_left = match Kind::from_name(name).unwrap() {
                Kind::Lines | Kind::Summary => text.clone(),
                kind => {
                    let lines = WholeLines::read(text.as_slice(), kind).unwrap();
                    assert_eq!(lines.n_rows, TICKS as u64);
                    let empty = kind.with_rows(&lines.head, 0).unwrap();
                    [empty.as_bytes(), &text[lines.head.len()..]].concat()
                }
            };
            for end in 0..=as_left.len() {
                let mut torn = as_left[..end].to_vec();
                // Zeros if the disk got the length of the file and not its bytes.
                torn.resize(end + end % 3, 0);
                fs::write(folder.path().join(name.clone() + SUFFIX), torn).unwrap();
                salvage(folder.path()).unwrap();
                let found = contents(folder.path());
                // A run without ticks has no person, and a file without lines is deleted.
                let runs = [&whole].into_iter().chain(shorter.iter().rev());
                let mut texts = runs.filter_map(|run| run.get(name));
                let expected = texts.find(|text| text.len() <= end && !text.is_empty());
                assert!(found.get(name) == expected, "{name} at {end}");
                assert_eq!(found.len(), usize::from(expected.is_some()));
                for name in found.keys() {
                    fs::remove_file(folder.path().join(name)).unwrap();
                }
            }
        }
    }

    #[test]
    fn targets_of_links_are_not_changed_and_the_link_is_reported() {
        use std::os::unix::fs::symlink;
        let (folder, outside) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let theirs = outside.path().join("poses.jsonl.tmp");
        fs::write(&theirs, "{}\n{\"ti").unwrap();
        fs::write(folder.path().join("poses_1-2.trc.tmp"), "").unwrap();
        symlink(&theirs, folder.path().join("poses.jsonl.tmp")).unwrap();
        let refused = salvage(folder.path()).unwrap_err().to_string();
        let words = ["poses.jsonl.tmp", "a symbolic link", "remove it"];
        assert!(words.iter().all(|word| refused.contains(word)), "{refused}");
        assert!(
            !folder.path().join("poses_1-2.trc.tmp").exists(),
            "others are made whole"
        );
        fs::remove_file(folder.path().join("poses.jsonl.tmp")).unwrap();
        symlink(outside.path(), folder.path().join(SMOOTH)).unwrap();
        let refused = salvage(folder.path()).unwrap_err().to_string();
        assert!(
            refused.contains("smooth: found a symbolic link"),
            "{refused}"
        );
        assert_eq!(fs::read_to_string(&theirs).unwrap(), "{}\n{\"ti");
    }

    #[test]
    fn only_files_of_a_run_are_changed() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        fs::create_dir(path(SMOOTH)).unwrap();
        let kept = [
            ("poses.jsonl", "whole\ntorn"),
            ("overlay_a_3.png.tmp", "half a picture"),
            // From an older farfield that wrote heads last.
            ("poses_1.trc.tmp", "1\t0.0\t2.0\n2\t0.1\t2.0\n3\n4\n5\n6\n"),
            ("angles_1.mot.tmp", "0.0\t2.0\n0.1\t2.0\n"),
        ];
        for (name, text) in kept {
            fs::write(path(name), text).unwrap();
        }
        fs::write(path("smooth/poses.jsonl.tmp"), "{}\n{\"ti").unwrap();
        let named = salvage(folder.path()).unwrap();
        assert_eq!(named, [path("smooth/poses.jsonl")]);
        assert_eq!(fs::read_to_string(&named[0]).unwrap(), "{}\n");
        for (name, text) in kept {
            assert_eq!(fs::read_to_string(path(name)).unwrap(), text);
        }
        assert!(salvage(folder.path()).unwrap().is_empty(), "once is enough");
    }

    #[test]
    fn a_written_summary_gets_its_name_and_reserved_room_is_deleted() {
        let folder = tempfile::tempdir().unwrap();
        let left = folder.path().join("summary.json.tmp");
        let room = " ".repeat(100);
        fs::write(&left, &room).unwrap();
        assert!(salvage(folder.path()).unwrap().is_empty());
        assert!(!left.exists());
        let text = Summary::default().to_json();
        fs::write(&left, text.clone() + &room).unwrap();
        let named = salvage(folder.path()).unwrap();
        assert_eq!(fs::read_to_string(&named[0]).unwrap(), text);
    }
}
