//! What fusion hands out: the list, its signature, the chunks.

use farfield_node::files::load_venue;

use super::*;

const CALIBRATION: &str = "[c]\nname = \"c\"\nsize = [640, 480]\nmatrix = [[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]]\n\
                           distortions = [0.0, 0.0, 0.0, 0.0, 0.0]\nrotation = [1.5707963, 0.0, 0.0]\ntranslation = [0.0, 1.0, 5.0]\n";
const VENUE: &str = "name = \"hall\"\nrate_hz = 30.0\ncalibration = \"sub/c.toml\"\n[[viewpoint]]\nname = \"a\"\n[[viewpoint.camera]]\n\
                     name = \"c\"\nsource = { kind = \"keypoints\", path = \"c.jsonl\" }\n";

fn ask<M: wire::Message>(handout: &Handout, question: &HandoutRequest) -> M {
    wire::decode(&handout.answer(&wire::encode(question)).unwrap()).unwrap()
}

#[test]
fn the_files_of_a_venue_are_listed_and_read_in_chunks() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("venue.toml");
    let long = format!("{CALIBRATION}# {}\n", "x".repeat(CHUNK_BYTES as usize));
    std::fs::create_dir(folder.path().join("sub")).unwrap();
    std::fs::write(folder.path().join("sub/c.toml"), &long).unwrap();
    std::fs::write(&path, VENUE).unwrap();
    let venue = load_venue(&path).unwrap();
    let handout = Handout::load(&path, &venue, None).unwrap();
    assert_eq!(handout.models(), None);
    let signed: SignedList = ask(&handout, &HandoutRequest::List);
    assert_eq!(signed.signature, None);
    let list: FileList = wire::decode(&signed.list).unwrap();
    let places: Vec<&str> = list.files.iter().map(|file| file.path.as_str()).collect();
    assert_eq!(places, ["", "sub/c.toml"]);
    assert_eq!(list.files[1].bytes, long.len() as u64);

    let mut read = Vec::new();
    loop {
        let from = read.len() as u64;
        let chunk: Chunk = ask(&handout, &HandoutRequest::Chunk { file: 1, from });
        if chunk.bytes.is_empty() {
            break;
        }
        read.extend(chunk.bytes);
    }
    assert_eq!(read, long.as_bytes());
    assert_eq!(*blake3::hash(&read).as_bytes(), list.files[1].blake3);
}

#[test]
fn a_question_that_makes_no_sense_is_refused() {
    let handout = Handout::default();
    assert!(handout.answer(&[]).is_err());
    assert!(handout.answer(&[0xff; 40]).is_err());
    let question = HandoutRequest::Chunk { file: 3, from: 0 };
    assert!(handout.answer(&wire::encode(&question)).is_err());
}

#[test]
fn a_file_that_was_changed_since_it_was_loaded_is_not_handed_out() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("venue.toml");
    std::fs::create_dir(folder.path().join("sub")).unwrap();
    let calibration = folder.path().join("sub/c.toml");
    for (changed, what) in [(&path, "venue file"), (&calibration, "calibration")] {
        std::fs::write(&path, VENUE).unwrap();
        std::fs::write(&calibration, CALIBRATION).unwrap();
        let venue = load_venue(&path).unwrap();
        Handout::load(&path, &venue, None).unwrap();
        let text = std::fs::read_to_string(changed).unwrap();
        std::fs::write(changed, text + "# edited\n").unwrap();
        let refused = Handout::load(&path, &venue, None).unwrap_err().to_string();
        assert!(refused.contains(what), "{refused}");
    }
}
