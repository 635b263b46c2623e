//! What is clicked in pictures, by two pages and by hand at once.

use super::*;

const COMMENTED: &str =
    "# by hand\n[places]\ndoor = [1.0, 2.0, 0.0]\n[camera.south]\ndoor = [3.1255, 4.0]\n";

fn desk(out: &Path) -> Desk {
    let text = std::fs::read_to_string(out).ok();
    let found = Found {
        clicked: ClickedFile::parse(text.as_deref().unwrap_or_default(), out).unwrap(),
        text,
        court: None,
    };
    of_north(out, found)
}

/// A desk that shows the picture of one camera.
fn of_north(out: &Path, found: Found) -> Desk {
    let north = MarkedPicture {
        name: "north".to_owned(),
        file: "north.png".to_owned(),
        size_px: [40, 30],
        png: Vec::new(),
        lens: None,
    };
    Desk::new(out.to_owned(), found, vec![north]).unwrap()
}

/// Puts one more place into what the desk holds, as a page that knows `revision` would.
fn adds(desk: &Desk, revision: u64, name: &str) -> Taken {
    let mut clicked = desk.held().clicked.clone();
    clicked.places.insert(name.to_owned(), [0.0; 3]);
    let clicked = serde_json::to_value(clicked).unwrap();
    let change = serde_json::json!({"revision": revision, "clicked": clicked});
    desk.take(change.to_string().as_bytes())
}

fn text(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap()
}

#[test]
fn more_decimals_in_a_camera_that_is_not_shown_do_not_lock_the_page() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("clicked.toml");
    std::fs::write(&out, COMMENTED).unwrap();
    let desk = desk(&out);
    assert!(matches!(adds(&desk, 0, "post"), Taken::Written(_)));
    assert!(text(&out).contains("post"));
}

#[test]
fn an_older_document_takes_no_clicks_from_cameras_that_are_not_shown() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("clicked.toml");
    let desk = desk(&out);
    assert!(matches!(adds(&desk, 0, "a"), Taken::Written(_)));
    let older = desk.held().clicked.clone();
    // Another page that shows the south, and a name that it gives.
    let both = text(&out) + "b = [1.0, 2.0, 3.0]\n[camera.south]\na = [3.0, 4.0]\nb = [5.0, 6.0]\n";
    std::fs::write(&out, ClickedFile::parse(&both, &out).unwrap().text()).unwrap();
    assert!(matches!(adds(&desk, 1, "c"), Taken::Behind(_)));
    // Ctrl Z.
    let older = serde_json::json!({"revision": 2, "clicked": older});
    let Taken::Written(state) = desk.take(older.to_string().as_bytes()) else {
        panic!("expected that it is written");
    };
    let written = ClickedFile::parse(&text(&out), &out).unwrap();
    assert_eq!(written.camera["south"]["b"], [[5.0, 6.0]], "{state}");
    assert_eq!(format!("{:?}", written.places["b"]), "[1.0, 2.0, 3.0]");
    assert!(state.contains("south"), "{state}");
    assert!(!folder.path().join("clicked.before.toml").exists());
}

#[test]
fn what_is_written_elsewhere_while_a_change_is_weighed_is_not_written_over() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("clicked.toml");
    let desk = desk(&out);
    assert!(matches!(adds(&desk, 0, "a"), Taken::Written(_)));
    let mut held = desk.held();
    let change = ClickedChange {
        revision: 1,
        clicked: held.clicked.clone(),
    };
    let Ok((clicked, fits)) = desk.weighed(&mut held, &change) else {
        panic!("expected that nothing is in the way");
    };
    std::fs::write(&out, COMMENTED).unwrap();
    let put = desk.put(&mut held, clicked, fits);
    assert!(matches!(put, Err(Taken::Behind(_))), "{put:?}");
    assert_eq!(text(&out), COMMENTED);
}

#[test]
fn a_file_that_leaves_the_court_to_the_command_is_taken_up_with_it() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("clicked.toml");
    std::fs::write(&out, COMMENTED).unwrap();
    let mut clicked = ClickedFile::parse(COMMENTED, &out).unwrap();
    clicked.court = Some("futsal".to_owned());
    let found = Found {
        court: clicked.court().unwrap(),
        clicked,
        text: Some(COMMENTED.to_owned()),
    };
    let desk = of_north(&out, found);
    std::fs::write(&out, format!("{COMMENTED}# and looked at\n")).unwrap();
    let Taken::Behind(state) = adds(&desk, 0, "a") else {
        panic!("expected what is in the file now");
    };
    assert!(state.contains("futsal"), "{state}");
    assert!(matches!(adds(&desk, 1, "a"), Taken::Written(_)));
    assert!(text(&out).contains("court = \"futsal\""));
}

#[test]
fn every_file_with_comments_is_kept_as_it_was_and_none_of_ours() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let out = at("clicked.toml");
    std::fs::write(&out, COMMENTED).unwrap();
    let first = desk(&out);
    for (revision, name) in [(0, "a"), (1, "b")] {
        assert!(matches!(adds(&first, revision, name), Taken::Written(_)));
    }
    assert_eq!(text(&at("clicked.before.toml")), COMMENTED);
    assert!(!at("clicked.before.2.toml").exists());
    // Ours, and a comment in it.
    let edited = text(&out) + "# the left door\n";
    std::fs::write(&out, &edited).unwrap();
    assert!(matches!(adds(&desk(&out), 0, "c"), Taken::Written(_)));
    assert_eq!(text(&at("clicked.before.toml")), COMMENTED);
    assert_eq!(text(&at("clicked.before.2.toml")), edited);
    assert!(matches!(adds(&desk(&out), 0, "d"), Taken::Written(_)));
    assert!(!at("clicked.before.3.toml").exists());
}

#[test]
fn a_file_that_is_edited_while_the_page_is_open_is_taken_up_and_not_written_over() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("clicked.toml");
    let desk = desk(&out);
    assert!(matches!(adds(&desk, 0, "a"), Taken::Written(_)));
    std::fs::write(&out, COMMENTED).unwrap();
    let Taken::Behind(state) = adds(&desk, 1, "b") else {
        panic!("expected what is in the file now");
    };
    assert!(
        state.contains("\"revision\":2") && state.contains("door"),
        "{state}"
    );
    assert_eq!(text(&out), COMMENTED);
    assert!(matches!(adds(&desk, 2, "b"), Taken::Written(_)));
    assert_eq!(text(&folder.path().join("clicked.before.toml")), COMMENTED);
    for broken in [
        "places = 3",
        "court = \"futsal\"",
        "[camera.north]\nnobody = [1, 2]",
    ] {
        std::fs::write(&out, broken).unwrap();
        let Taken::Failed(told) = adds(&desk, 3, "c") else {
            panic!("{broken}: expected to be told");
        };
        assert!(told.contains("was changed elsewhere"), "{told}");
        assert_eq!(text(&out), broken);
    }
    std::fs::remove_file(&out).unwrap();
    assert!(matches!(adds(&desk, 3, "c"), Taken::Written(_)));
}
