//! What is left of files that were begun, and whose.

use super::*;

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = entries
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

#[test]
fn a_file_has_its_name_only_when_it_is_whole() {
    let folder = tempfile::tempdir().unwrap();
    let mut file = Unfinished::create(folder.path().join("a.txt")).unwrap();
    file.write_all(b"one ").unwrap();
    assert_eq!(names(folder.path()), ["a.txt.tmp"]);
    file.rest().unwrap();
    file.write_all(b"two").unwrap();
    file.finish().unwrap();
    assert_eq!(names(folder.path()), ["a.txt"]);
    assert_eq!(
        fs::read_to_string(folder.path().join("a.txt")).unwrap(),
        "one two"
    );
}

#[test]
fn a_head_is_written_where_room_was_kept_for_it() {
    let folder = tempfile::tempdir().unwrap();
    let mut file = Unfinished::create(folder.path().join("a.txt")).unwrap();
    file.write_all(b"____ rows").unwrap();
    file.overwrite_head(b"head").unwrap();
    file.write_all(b" more").unwrap();
    file.overwrite_head(b"HEAD").unwrap();
    file.finish().unwrap();
    assert_eq!(names(folder.path()), ["a.txt"]);
    assert_eq!(
        fs::read_to_string(folder.path().join("a.txt")).unwrap(),
        "HEAD rows more"
    );
}

#[test]
fn what_the_system_has_is_told_from_what_is_buffered() {
    let folder = tempfile::tempdir().unwrap();
    let mut file = Unfinished::create(folder.path().join("a.txt")).unwrap();
    file.write_all(b"buffered").unwrap();
    assert_eq!((file.taken(), file.handed_over()), (8, 0));
    file.sync().unwrap();
    assert_eq!((file.taken(), file.handed_over()), (8, 8));
    file.write_all(b" and lost").unwrap();
    let left = file.leave();
    assert_eq!(fs::read_to_string(left).unwrap(), "buffered");
}

#[test]
fn a_file_that_someone_else_has_begun_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.txt");
    let mut first = Unfinished::create(&path).unwrap();
    first.write_all(b"first").unwrap();
    let refused = Unfinished::create(&path).unwrap_err();
    assert_eq!(refused.kind(), io::ErrorKind::AlreadyExists);
    first.finish().unwrap();
    assert_eq!(fs::read_to_string(&path).unwrap(), "first");
}

#[test]
fn what_one_who_was_killed_has_left_is_taken_away_and_what_others_write_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.txt");
    let long_ago = std::time::SystemTime::now() - 2 * LEFT_FOR;
    let here = place().unwrap();
    // Processes have smaller numbers than the first; this one is alive. A writer in a container has a number there that says
    // nothing here.
    let (gone, own, elsewhere) = (u32::MAX, std::process::id(), here ^ 1);
    let begun = [
        (gone, here, None, false),
        (own, here, Some(long_ago), true),
        (gone, elsewhere, None, true),
        (own, elsewhere, Some(long_ago), false),
    ];
    let mut left = vec!["a.txt".to_owned()];
    for (process, place, written, is_kept) in begun {
        let name = format!("a.txt.{process}-{place}-7.tmp");
        let file = File::create_new(folder.path().join(&name)).unwrap();
        if let Some(written) = written {
            file.set_modified(written).unwrap();
        }
        left.extend(is_kept.then_some(name));
    }
    write_whole_again(&path, b"whole").unwrap();
    left.sort();
    assert_eq!(names(folder.path()), left);
    assert_eq!(fs::read_to_string(&path).unwrap(), "whole");
}

#[test]
fn names_of_files_that_are_written_at_once_are_by_chance() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.txt");
    // Of two processes in two containers both may be number 1.
    let made: Vec<_> = (0..2).map(|_| create_own(&path).unwrap()).collect();
    let number = |own: &Path| {
        let name = own.to_str().unwrap();
        let (_, number) = name.rsplit_once('-').unwrap();
        number.trim_end_matches(SUFFIX).parse::<u64>().unwrap()
    };
    let [one, other] = [number(&made[0].1), number(&made[1].1)];
    assert!(one.abs_diff(other) > 1, "{one} {other}");
}

#[test]
fn of_several_who_write_one_file_at_once_one_counts_and_nothing_is_left() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.txt");
    std::thread::scope(|scope| {
        for writer in 0..8u8 {
            let path = &path;
            scope.spawn(move || {
                for _ in 0..20 {
                    write_whole_again(path, &[b'a' + writer; 4096]).unwrap();
                }
            });
        }
    });
    let whole = fs::read(&path).unwrap();
    assert_eq!(whole, vec![whole[0]; 4096]);
    assert_eq!(names(folder.path()), ["a.txt"]);
}

#[test]
fn a_file_that_was_given_up_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let mut file = Unfinished::create(folder.path().join("a.txt")).unwrap();
    file.write_all(b"half").unwrap();
    drop(file);
    assert!(names(folder.path()).is_empty());
}
