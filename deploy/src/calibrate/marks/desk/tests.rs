//! Clicks by two pages and edits by hand at the same time.

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
    north_desk(out, found)
}

/// A desk that shows the image of one camera.
fn north_desk(out: &Path, found: Found) -> Desk {
    let north = MarkedPicture {
        name: "north".to_owned(),
        file: "north.png".to_owned(),
        size_px: [40, 30],
        png: Vec::new(),
        lens: None,
    };
    Desk::new(out.to_owned(), found, vec![north]).unwrap()
}

/// Adds a position, as a page with `revision` would.
fn adds(desk: &Desk, revision: u64, name: &str) -> Taken {
    let mut clicked = desk.lock().clicked.clone();
    clicked.places.insert(name.to_owned(), [0.0; 3]);
    let clicked = serde_json::to_value(clicked).unwrap();
    let change = serde_json::json!({"revision": revision, "clicked": clicked});
    desk.take(change.to_string().as_bytes())
}

fn text(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap()
}

#[test]
fn more_decimals_in_a_hidden_camera_do_not_block_the_page() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("clicked.toml");
    std::fs::write(&out, COMMENTED).unwrap();
    let desk = desk(&out);
    assert!(matches!(adds(&desk, 0, "post"), Taken::Written(_)));
    assert!(text(&out).contains("post"));
}

#[test]
fn an_older_document_does_not_remove_clicks_of_hidden_cameras() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("clicked.toml");
    let desk = desk(&out);
    assert!(matches!(adds(&desk, 0, "a"), Taken::Written(_)));
    let older = desk.lock().clicked.clone();
    // Another page shows the south camera, and adds a name.
    let both = text(&out) + "b = [1.0, 2.0, 3.0]\n[camera.south]\na = [3.0, 4.0]\nb = [5.0, 6.0]\n";
    std::fs::write(&out, ClickedFile::parse(&both, &out).unwrap().text()).unwrap();
    assert!(matches!(adds(&desk, 1, "c"), Taken::Behind(_)));
    // Undo (Ctrl Z).
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
fn a_change_by_another_program_during_a_fit_is_not_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("clicked.toml");
    let desk = desk(&out);
    assert!(matches!(adds(&desk, 0, "a"), Taken::Written(_)));
    let mut state = desk.lock();
    let change = ClickedChange {
        revision: 1,
        clicked: state.clicked.clone(),
    };
    let Ok((clicked, fits)) = desk.fitted(&mut state, &change) else {
        panic!("expected a valid change");
    };
    std::fs::write(&out, COMMENTED).unwrap();
    let stored = desk.store(&mut state, clicked, fits);
    assert!(matches!(stored, Err(Taken::Behind(_))), "{stored:?}");
    assert_eq!(text(&out), COMMENTED);
}

#[test]
fn a_changed_file_without_a_court_is_reloaded_with_the_court_option() {
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
    let desk = north_desk(&out, found);
    std::fs::write(&out, format!("{COMMENTED}# and checked\n")).unwrap();
    let Taken::Behind(state) = adds(&desk, 0, "a") else {
        panic!("expected the new content of the file");
    };
    assert!(state.contains("futsal"), "{state}");
    assert!(matches!(adds(&desk, 1, "a"), Taken::Written(_)));
    assert!(text(&out).contains("court = \"futsal\""));
}

#[test]
fn only_files_with_comments_are_backed_up() {
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
    // A file written by the desk, with an added comment.
    let edited = text(&out) + "# the left door\n";
    std::fs::write(&out, &edited).unwrap();
    assert!(matches!(adds(&desk(&out), 0, "c"), Taken::Written(_)));
    assert_eq!(text(&at("clicked.before.toml")), COMMENTED);
    assert_eq!(text(&at("clicked.before.2.toml")), edited);
    assert!(matches!(adds(&desk(&out), 0, "d"), Taken::Written(_)));
    assert!(!at("clicked.before.3.toml").exists());
}

#[test]
fn a_file_edited_while_the_page_is_open_is_reloaded() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("clicked.toml");
    let desk = desk(&out);
    assert!(matches!(adds(&desk, 0, "a"), Taken::Written(_)));
    std::fs::write(&out, COMMENTED).unwrap();
    let Taken::Behind(state) = adds(&desk, 1, "b") else {
        panic!("expected the new content of the file");
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
        "[camera.north]\nunknown = [1, 2]",
    ] {
        std::fs::write(&out, broken).unwrap();
        let Taken::Failed(error) = adds(&desk, 3, "c") else {
            panic!("{broken}: expected an error");
        };
        assert!(error.contains("clicked.toml"), "{error}");
        assert_eq!(text(&out), broken);
    }
    std::fs::remove_file(&out).unwrap();
    assert!(matches!(adds(&desk, 3, "c"), Taken::Written(_)));
}
