//! Keys that `farfield certs` creates, and what it refuses.

use std::os::unix::fs::PermissionsExt as _;

use clap::Parser as _;
use farfield_node::certificate::hosts_in;

use super::*;
use crate::cli::{FarfieldCli, FarfieldCommand};

struct Scratch {
    folder: tempfile::TempDir,
}

impl Scratch {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let calibration = "[c]\nname = \"c\"\nsize = [640, 480]\nmatrix = [[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]]\n\
                           distortions = [0.0, 0.0, 0.0, 0.0, 0.0]\nrotation = [1.5707963, 0.0, 0.0]\ntranslation = [0.0, 1.0, 5.0]\n";
        let venue = "name = \"hall\"\nrate_hz = 30.0\ncalibration = \"c.toml\"\n[fusion]\nlisten = [\"quic/0.0.0.0:7447\"]\n\
                     connect = [\"quic/fusion.lan:7447\"]\n[[viewpoint]]\nname = \"ne\"\n[[viewpoint.camera]]\nname = \"c\"\n\
                     source = { kind = \"keypoints\", path = \"c.jsonl\" }\n";
        std::fs::write(folder.path().join("c.toml"), calibration).unwrap();
        std::fs::write(folder.path().join("venue.toml"), venue).unwrap();
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn run(&self, more: &[&str]) -> anyhow::Result<()> {
        let (venue, out) = (self.path("venue.toml"), self.path("certs"));
        let words = [
            "farfield",
            "certs",
            venue.to_str().unwrap(),
            "--out",
            out.to_str().unwrap(),
        ];
        match FarfieldCli::try_parse_from([&words, more].concat())
            .unwrap()
            .command
        {
            FarfieldCommand::Certs(args) => make(&args),
            other => panic!("{other:?}"),
        }
    }

    fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.path("certs").join(name)).unwrap()
    }
}

#[test]
fn every_node_gets_a_key_that_only_its_owner_can_read() {
    let scratch = Scratch::new();
    scratch.run(&["--node", "screen"]).unwrap();
    let mode = |path: PathBuf| std::fs::metadata(path).unwrap().permissions().mode() & 0o777;
    // The authority's key is in another folder.
    assert!(!scratch.path("certs").join("ca.key").exists());
    assert_eq!(mode(scratch.path("certs-authority")), 0o700);
    assert_eq!(mode(scratch.path("certs-authority").join("ca.key")), 0o600);
    for node in ["fusion", "ne", "screen"] {
        let key = scratch.path("certs").join(format!("{node}.key"));
        assert_eq!(mode(key), 0o600, "{node}.key");
        assert!(
            scratch
                .read(&format!("{node}.pem"))
                .starts_with("-----BEGIN CERTIFICATE-----")
        );
    }
    let readme = scratch.read("README.txt");
    assert!(
        readme.contains("fusion.lan") && !readme.contains("0.0.0.0"),
        "{readme}"
    );
}

/// The arguments of a command line.
fn parsed(words: &[&str]) -> CertsArgs {
    let words = [&["farfield", "certs", "venue.toml"], words].concat();
    match FarfieldCli::try_parse_from(words).unwrap().command {
        FarfieldCommand::Certs(args) => args,
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_authority_folder_is_a_sibling_even_of_dot() {
    let here = std::fs::canonicalize(".").unwrap();
    let mut sibling = here.file_name().unwrap().to_owned();
    sibling.push("-authority");
    for out in [".", "./.", "src/.."] {
        let found = folder_of_authority(&parsed(&["--out", out]));
        assert_eq!(found, here.with_file_name(&sibling), "{out}");
    }
    let named = folder_of_authority(&parsed(&["--out", "keys/."]));
    assert_eq!(named, Path::new("keys-authority"));
    let given = folder_of_authority(&parsed(&["--out", ".", "--authority", "safe"]));
    assert_eq!(given, Path::new("safe"));
}

#[test]
fn keys_are_not_overwritten() {
    let scratch = Scratch::new();
    scratch.run(&[]).unwrap();
    let before = scratch.read("ne.key");
    let error = scratch.run(&[]).unwrap_err();
    assert!(format!("{error:#}").contains("ca.pem"), "{error:#}");
    assert_eq!(scratch.read("ne.key"), before);
}

#[test]
fn one_key_is_renewed_with_a_separate_authority() {
    let scratch = Scratch::new();
    let apart = scratch.path("apart");
    let apart = apart.to_str().unwrap();
    scratch
        .run(&["--authority", apart, "--node", "screen"])
        .unwrap();
    assert!(!scratch.path("certs").join("ca.key").exists());
    let before = [scratch.read("ne.key"), scratch.read("fusion.key")];
    let generations = || {
        let path = scratch.path("certs").join(GENERATIONS_FILE);
        let known = Generations::parse(&scratch.read(GENERATIONS_FILE), &path).unwrap();
        ["fusion", "ne", "recorder", "screen"].map(|node| known.of(node))
    };
    assert_eq!(generations(), [1, 1, 1, 1]);
    assert!(scratch.run(&["--renew", "ne"]).is_err(), "without the key");
    scratch
        .run(&[
            "--renew",
            "ne",
            "--renew",
            "screen",
            "--renew",
            "ne",
            "--authority",
            apart,
        ])
        .unwrap();
    assert_ne!(scratch.read("ne.key"), before[0]);
    assert_eq!(scratch.read("fusion.key"), before[1]);
    assert_eq!(generations(), [1, 2, 1, 2]);
    let error = scratch
        .run(&["--renew", "nowhere", "--authority", apart])
        .unwrap_err();
    assert!(error.to_string().contains("nowhere"), "{error}");
}

#[test]
fn invalid_names_and_hosts_are_refused() {
    let scratch = Scratch::new();
    for wrong in [
        ["--node", "ne"],
        ["--node", "fusion"],
        ["--node", "a/b"],
        ["--host", "a:1"],
        ["--host", ""],
    ] {
        assert!(scratch.run(&wrong).is_err(), "{wrong:?}");
    }
    assert!(!scratch.path("certs").exists());
}

#[test]
fn a_renewal_with_wrong_authority_venue_or_options_is_refused() {
    let (scratch, other) = (Scratch::new(), Scratch::new());
    scratch.run(&["--host", "fusion-host"]).unwrap();
    other.run(&[]).unwrap();
    let before = scratch.read("ne.key");
    let foreign = other.path("certs-authority");
    let error = scratch
        .run(&["--renew", "ne", "--authority", foreign.to_str().unwrap()])
        .unwrap_err();
    assert!(error.to_string().contains("ca.key"), "{error}");
    for ignored in [["--node", "tv"], ["--host", "elsewhere"]] {
        let options = [&["--renew", "ne"][..], &ignored].concat();
        assert!(scratch.run(&options).is_err(), "{options:?}");
    }
    let venue = scratch.path("venue.toml");
    let text = std::fs::read_to_string(&venue).unwrap();
    std::fs::write(&venue, text.replace("\"hall\"", "\"hall2\"")).unwrap();
    let error = scratch.run(&["--renew", "ne"]).unwrap_err();
    assert!(error.to_string().contains("`hall2 authority`"), "{error}");
    std::fs::write(&venue, text).unwrap();
    assert_eq!(scratch.read("ne.key"), before);
    // The host names of fusion stay.
    scratch.run(&["--renew", "fusion"]).unwrap();
    let hosts = hosts_in(&scratch.path("certs").join("fusion.pem")).unwrap();
    for host in ["fusion-host", "fusion.lan", "127.0.0.1", "::1"] {
        assert!(hosts.iter().any(|it| it == host), "{host}: {hosts:?}");
    }
}

#[test]
fn keys_of_an_earlier_release_are_renewed_in_place() {
    let scratch = Scratch::new();
    scratch.run(&[]).unwrap();
    let (keys, apart) = (scratch.path("certs"), scratch.path("certs-authority"));
    std::fs::rename(apart.join("ca.key"), keys.join("ca.key")).unwrap();
    std::fs::remove_file(keys.join(GENERATIONS_FILE)).unwrap();
    let authority = Authority::read(&scratch.read("ca.pem"), &scratch.read("ca.key")).unwrap();
    for bearer in [
        Bearer::fusion(Vec::new()),
        Bearer::edge("ne"),
        Bearer::recorder(),
    ] {
        let pair = authority.issue("hall", &bearer, 0, 825).unwrap();
        let path = keys.join(format!("{}.pem", bearer.node));
        std::fs::write(path, pair.certificate).unwrap();
    }
    scratch.run(&["--renew", "ne"]).unwrap();
    let text = scratch.read(GENERATIONS_FILE);
    assert!(text.ends_with("[generation]\n\"ne\" = 1\n"), "{text}");
}

#[test]
fn a_renewal_is_refused_if_the_generations_are_lost_or_outdated() {
    // Symptom to prevent: generation 1 was issued and accepted again, with the stolen keys.
    let scratch = Scratch::new();
    scratch.run(&[]).unwrap();
    let (keys, path) = (
        scratch.path("certs"),
        scratch.path("certs").join(GENERATIONS_FILE),
    );
    let first = scratch.read(GENERATIONS_FILE);
    scratch.run(&["--renew", "ne"]).unwrap();
    let (second, key) = (scratch.read(GENERATIONS_FILE), scratch.read("ne.key"));
    let refused = |node: &str| format!("{:#}", scratch.run(&["--renew", node]).unwrap_err());
    std::fs::remove_file(&path).unwrap();
    for node in ["ne", "fusion"] {
        let error = refused(node);
        assert!(error.contains("generations.toml: found no"), "{error}");
    }
    std::fs::write(&path, first).unwrap();
    let error = refused("fusion");
    for word in ["found 1", "of ne", "expected 2", "ne.pem"] {
        assert!(error.contains(word), "{word}: {error}");
    }
    assert_eq!(scratch.read("ne.key"), key);
    // Also refused without any certificate.
    std::fs::remove_file(&path).unwrap();
    for node in ["fusion", "ne", "recorder"] {
        std::fs::remove_file(keys.join(format!("{node}.pem"))).unwrap();
    }
    assert!(refused("ne").contains(GENERATIONS_FILE));
    std::fs::write(&path, second).unwrap();
    scratch.run(&["--renew", "ne"]).unwrap();
    assert!(scratch.read(GENERATIONS_FILE).contains("\"ne\" = 3\n"));
}
