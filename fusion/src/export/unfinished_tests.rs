//! Tests of incomplete files, and of their owners.

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
fn a_file_gets_its_name_when_it_is_complete() {
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
fn a_head_is_written_to_its_reserved_room() {
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
fn buffered_bytes_are_counted_separately() {
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
fn a_file_of_another_writer_is_not_changed() {
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
fn files_of_dead_processes_are_removed_and_others_are_not() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.txt");
    let long_ago = std::time::SystemTime::now() - 2 * LEFT_FOR;
    let here = place().unwrap();
    // Process numbers are smaller than the first one; this process is alive. The number of a writer
    // in a container is meaningless here.
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
fn temporary_names_of_concurrent_writers_are_random() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.txt");
    // Processes in two containers may both have number 1.
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
fn of_concurrent_writers_one_wins_and_no_file_remains() {
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
fn an_abandoned_file_is_deleted() {
    let folder = tempfile::tempdir().unwrap();
    let mut file = Unfinished::create(folder.path().join("a.txt")).unwrap();
    file.write_all(b"half").unwrap();
    drop(file);
    assert!(names(folder.path()).is_empty());
}
