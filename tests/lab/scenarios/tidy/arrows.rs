//! Dependencies between the packages.

use std::collections::{BTreeMap, BTreeSet};

use super::{check, root, workspace};

/// Allowed dependencies of each package in the workspace, in any table of its manifest. Edge and fusion are independent of
/// each other, and no product package depends on the laboratory. All names except `farfield` begin with `farfield-`.
const MAY_DEPEND_ON: [(&str, &[&str]); 16] = [
    ("proto", &[]),
    ("node", &["proto"]),
    ("calibration", &["proto"]),
    ("edge", &["proto", "node"]),
    ("fusion", &["proto"]),
    ("fusion-node", &["proto", "node", "fusion"]),
    ("export", &["proto", "fusion"]),
    ("streams", &["proto", "fusion", "export"]),
    ("import", &["proto", "calibration"]),
    ("networks", &["proto", "node"]),
    ("page", &["proto"]),
    ("sim", &["proto", "edge", "fusion"]),
    ("score", &["proto", "fusion"]),
    (
        "farfield",
        &[
            "proto",
            "node",
            "calibration",
            "edge",
            "fusion",
            "fusion-node",
            "export",
            "streams",
            "import",
            "networks",
            "page",
            "sim",
            "score",
        ],
    ),
    (
        "lab",
        &[
            "proto",
            "node",
            "calibration",
            "edge",
            "fusion",
            "fusion-node",
            "export",
            "import",
            "page",
            "streams",
            "sim",
            "score",
            "farfield",
        ],
    ),
    (
        "fuzz",
        &[
            "proto",
            "calibration",
            "edge",
            "fusion",
            "export",
            "import",
            "page",
            "streams",
            "sim",
            "score",
        ],
    ),
];

/// A package's name in the table.
fn short(name: &str) -> &str {
    name.strip_prefix("farfield-").unwrap_or(name)
}

/// Packages that `farfield` does not contain at any depth: the laboratory, and one crate that only the laboratory needs. It
/// stands for the others, which mostly come with it.
const NOT_IN_FARFIELD: [&str; 2] = ["farfield-lab", "zstd"];

#[test]
fn packages_depend_only_on_allowed_packages() {
    let allowed = BTreeMap::from(MAY_DEPEND_ON);
    let mut faults = Vec::new();
    for package in &workspace().packages {
        let name = &package.name;
        let Some(allowed) = allowed.get(short(name)) else {
            faults.push(format!("{name}: not in the table of this test"));
            continue;
        };
        for other in &package.dependencies {
            let ours = other.name == "farfield" || other.name.starts_with("farfield-");
            if ours && !allowed.contains(&short(&other.name)) {
                let table = other.kind.as_deref().unwrap_or("plain");
                let other = &other.name;
                faults.push(format!("{name} must not depend on {other} ({table} table)"));
            }
        }
    }
    check(&faults);
}

#[test]
fn every_package_of_the_table_exists() {
    let packages = workspace().packages.iter();
    let names: BTreeSet<&str> = packages.map(|it| short(&it.name)).collect();
    let gone = |(name, _): (&str, _)| (!names.contains(name)).then(|| format!("{name} is gone"));
    check(
        &MAY_DEPEND_ON
            .into_iter()
            .filter_map(gone)
            .collect::<Vec<_>>(),
    );
}

#[test]
fn the_operators_command_is_built_without_the_laboratory() {
    #[derive(serde::Deserialize)]
    struct Lock {
        package: Vec<Locked>,
    }
    #[derive(serde::Deserialize)]
    struct Locked {
        name: String,
        #[serde(default)]
        dependencies: Vec<String>,
    }
    let lock: Lock = toml::from_str(&workspace().texts["Cargo.lock"]).unwrap();
    let mut known = BTreeMap::from([("farfield".to_owned(), "farfield".to_owned())]);
    let mut open = vec!["farfield".to_owned()];
    while let Some(name) = open.pop() {
        for package in lock.package.iter().filter(|it| it.name == name) {
            for other in &package.dependencies {
                // `name` or `name version`.
                let other = other.split(' ').next().unwrap_or_default().to_owned();
                if !known.contains_key(&other) {
                    known.insert(other.clone(), format!("{} > {other}", known[&name]));
                    open.push(other);
                }
            }
        }
    }
    assert!(known.len() > 50, "the lock file was read");
    let fault = |name: &str| known.get(name).map(|way| format!("{name} is in: {way}"));
    check(
        &NOT_IN_FARFIELD
            .into_iter()
            .filter_map(fault)
            .collect::<Vec<_>>(),
    );
}

#[test]
fn every_manifest_belongs_to_a_known_package() {
    let packages = workspace().packages.iter();
    let manifests: BTreeSet<&str> = packages.map(|it| it.manifest_path.as_str()).collect();
    let root = root().canonicalize().unwrap();
    let unread = |path: &&String| {
        path.ends_with("/Cargo.toml") && !manifests.contains(root.join(path).to_str().unwrap())
    };
    let faults = workspace().texts.keys().filter(unread);
    check(
        &faults
            .map(|path| format!("{path} belongs to no known package"))
            .collect::<Vec<_>>(),
    );
}
