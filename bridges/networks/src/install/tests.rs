//! Installation from a file and by programs that stand for npm and pip.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;

use super::*;
use crate::convert::HeatMaps;
use crate::fixture::{SMALL_MAPS, small};
use crate::known::{Client, Conversion, Licence, PackageFile, Task, Upstream};

const CARD: &str = "kind = \"heatmap\"\nfile = \"small.onnx\"\nbox_margin = 1.25\n\
    input = { name = \"image\", width = 8, height = 8, channels = \"rgb\" }\n\
    normalize = { scale = 0.00392156862745098, mean = [0.0, 0.0, 0.0], std = [1.0, 1.0, 1.0] }\n\
    output = { name = \"heatmaps\", width = 4, height = 4, keypoints = [\"nose\", \"neck\"] }\n\
    cell_to_input = { scale = 2.0, offset = 0.0 }\n";

const PACKAGE: Package = Package {
    client: Client::Npm,
    name: "@of/small",
    version: "1.2.3",
    megabytes: 1,
};
const OTHER: Package = Package {
    client: Client::Pip,
    name: "small",
    ..PACKAGE
};

/// The row of the test's network.
fn row() -> KnownNetwork {
    KnownNetwork {
        name: "small",
        task: Task::Keypoints,
        about: "a test",
        packages: &[PACKAGE, OTHER],
        files: vec![PackageFile {
            name: "small.tflite",
            sha256: hexadecimal(digest(&SHA256, &small().file()).as_ref()).leak(),
        }]
        .leak(),
        licence: Licence {
            id: "MIT",
            text: "all of it",
        },
        upstream: None,
        conversion: Conversion::TfliteHeatMaps(HeatMaps {
            shape: SMALL_MAPS,
            n_keypoints: 2,
        }),
        card: CARD,
    }
}

/// A folder with the file of the network, and a store in it.
fn given() -> (tempfile::TempDir, PathBuf, Store) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("small.tflite");
    fs::write(&file, small().file()).unwrap();
    let store = Store::in_folder(folder.path().join("store"));
    (folder, file, store)
}

/// A folder of programs, each a shell script.
fn programs(folder: &Path, scripts: &[(&str, &str)]) -> Origin {
    let programs = folder.join("programs");
    fs::create_dir(&programs).unwrap();
    for (name, script) in scripts {
        let path = programs.join(name);
        fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    }
    Origin::Packages {
        search_path: Some(programs.into()),
    }
}

fn refusal(origin: &Origin, store: &Store) -> String {
    install(&row(), origin, store, |_| {})
        .unwrap_err()
        .to_string()
}

#[test]
fn a_given_file_becomes_a_network_with_card_and_licence() {
    let (_folder, file, store) = given();
    assert_eq!(store.installed().unwrap(), []);
    let origin = Origin::File(file);
    for _ in ["new", "again"] {
        let installed = install(&row(), &origin, &store, |_| {}).unwrap();
        assert_eq!(installed.task, Ok(Task::Keypoints));
        assert_eq!(store.installed().unwrap(), [installed]);
    }
    let folder = store.folder().join("small");
    let licence = fs::read_to_string(folder.join("LICENCE.txt")).unwrap();
    assert!(licence.contains("@of/small 1.2.3 (npm)") && licence.ends_with("all of it"));
    assert_eq!(fs::read_to_string(folder.join("small.toml")).unwrap(), CARD);
    let names = store.folder().read_dir().unwrap();
    assert_eq!(names.count(), 1, "no temporary folder is left");
}

#[test]
fn a_network_of_others_keeps_its_source_and_the_licence_of_its_package() {
    let (_folder, file, store) = given();
    let network = KnownNetwork {
        upstream: Some(Upstream {
            authors: "others",
            published: "a network, their page",
            package_licence: Licence {
                id: "ISC",
                text: "the package's",
            },
        }),
        ..row()
    };
    install(&network, &Origin::File(file), &store, |_| {}).unwrap();
    let text = |name: &str| fs::read_to_string(store.folder().join("small").join(name)).unwrap();
    assert_eq!(text("LICENCE-OF-PACKAGE.txt"), "the package's");
    let licence = text("LICENCE.txt");
    for part in [
        "by others, published under this licence as a network, their page",
        "under the licence ISC: LICENCE-OF-PACKAGE.txt",
    ] {
        assert!(licence.contains(part), "{licence}");
    }
}

#[test]
fn a_changed_file_is_not_used() {
    let (_folder, file, store) = given();
    let mut bytes = small().file();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(&file, &bytes).unwrap();
    let refused = refusal(&Origin::File(file), &store);
    let found = hexadecimal(digest(&SHA256, &bytes).as_ref());
    for part in [
        &found,
        row().files[0].sha256,
        "the file is not used",
        "@of/small 1.2.3 (npm)",
    ] {
        assert!(refused.contains(part), "{refused}");
    }
    assert!(!store.folder().exists());
}

#[test]
fn a_missing_file_is_refused_with_the_expected_package() {
    let (folder, _, store) = given();
    let refused = refusal(&Origin::File(folder.path().join("none.tgz")), &store);
    assert!(
        refused.contains("none.tgz: found no such file, expected small.tflite"),
        "{refused}"
    );
    assert!(
        refused.contains("@of/small 1.2.3 (npm) or small 1.2.3 (pip)"),
        "{refused}"
    );
}

#[test]
fn without_a_client_the_other_ways_are_named() {
    let (folder, _, store) = given();
    let refused = refusal(&programs(folder.path(), &[]), &store);
    for part in [
        "npm, pip",
        "`npm pack @of/small@1.2.3`",
        "small==1.2.3",
        "small --from FILE",
    ] {
        assert!(refused.contains(part), "{refused}");
    }
}

#[test]
fn the_next_package_is_tried_if_a_client_fails() {
    let (folder, file, store) = given();
    let copy = format!("/bin/cp {} small.whl", file.display());
    let npm = "echo npm error code E403 >&2; exit 1";
    let origin = programs(folder.path(), &[("npm", npm), ("pip", &copy)]);
    let mut lines = Vec::new();
    install(&row(), &origin, &store, |line| lines.push(line.to_owned())).unwrap();
    assert_eq!(
        lines,
        [
            "downloading @of/small 1.2.3 with npm (1 MB)",
            "downloading small 1.2.3 with pip (1 MB)",
            "converting small.tflite to ONNX"
        ]
    );
}

#[test]
fn failed_downloads_are_reported_with_the_messages_of_the_clients() {
    let (folder, _, store) = given();
    let npm = "echo npm error code E403 >&2; exit 1";
    let origin = programs(folder.path(), &[("npm", npm), ("pip3", "exit 0")]);
    let error = install(&row(), &origin, &store, |_| {}).unwrap_err();
    assert!(!error.is_of_input());
    let refused = error.to_string();
    for part in [
        "npm error code E403",
        "wrote 0 files",
        "proxy",
        "--from FILE",
    ] {
        assert!(refused.contains(part), "{refused}");
    }
}
