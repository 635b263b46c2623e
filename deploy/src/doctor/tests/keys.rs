//! Real keys that the nodes would refuse.

use farfield_proto::transport::{GENERATIONS_FILE, common_name};

use super::*;

const DAY_S: i64 = 86_400;

/// Creates keys of fusion in a folder, valid between two days counted from [`NOW_S`].
fn make_keys(folder: &Path, from_days: i64, until_days: i64) {
    let params = |node: &str, [from, until]: [i64; 2]| {
        let at =
            |days: i64| time::OffsetDateTime::from_unix_timestamp(NOW_S + days * DAY_S).unwrap();
        let mut params = rcgen::CertificateParams::new(vec!["hall".to_owned()]).unwrap();
        (params.not_before, params.not_after) = (at(from), at(until));
        params
            .distinguished_name
            .push(rcgen::DnType::CommonName, common_name("hall", node, 1));
        params
    };
    let mut of_authority = params("ca", [-100, 4000]);
    of_authority.is_ca = rcgen::IsCa::Ca(rcgen::BasicConstraints::Constrained(0));
    let key = rcgen::KeyPair::generate().unwrap();
    let authority = rcgen::CertifiedIssuer::self_signed(of_authority, key).unwrap();
    std::fs::write(folder.join("ca.pem"), authority.pem()).unwrap();
    let key = rcgen::KeyPair::generate().unwrap();
    let certificate = params("fusion", [from_days, until_days]).signed_by(&key, &authority);
    std::fs::write(folder.join("fusion.pem"), certificate.unwrap().pem()).unwrap();
    write_key(folder, &key.serialize_pem());
}

/// Writes a private key of fusion, readable only by its owner.
fn write_key(folder: &Path, text: &str) {
    let path = folder.join("fusion.key");
    std::fs::write(&path, text).unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o600)).unwrap();
}

/// Replaces `file` in `keys` by that of other, independent keys.
fn replace_by_other(keys: &Path, file: &str) {
    let others = tempfile::tempdir().unwrap();
    make_keys(others.path(), -1, 100);
    std::fs::copy(others.path().join(file), keys.join(file)).unwrap();
}

/// The report on keys valid between two days, after `damage` was done to them.
pub(super) fn keys_report(days: [i64; 2], damage: impl FnOnce(&Path)) -> ReportLines {
    keys_report_of("hall", days, damage)
}

/// The same for a venue of this name.
fn keys_report_of(name: &str, days: [i64; 2], damage: impl FnOnce(&Path)) -> ReportLines {
    let folder = tempfile::tempdir().unwrap();
    let keys = folder.path().join("certs");
    std::fs::create_dir(&keys).unwrap();
    make_keys(&keys, days[0], days[1]);
    damage(&keys);
    let venue = Venue {
        name: name.to_owned(),
        ..venue(folder.path(), "[security]\ncertificates = \"certs\"")
    };
    let mut report = ReportLines::default();
    check_keys(
        &venue,
        &folder.path().join("venue.toml"),
        NOW_S,
        &mut report,
    );
    report
}

#[test]
fn invalid_or_unsafe_keys_are_found() {
    let fine = [-1, 100];
    let open_to_all = |keys: &Path| {
        let mode = std::fs::Permissions::from_mode(0o644);
        std::fs::set_permissions(keys.join("fusion.key"), mode).unwrap();
    };
    let rename = |keys: &Path| {
        for name in ["fusion.pem", "fusion.key"] {
            std::fs::rename(keys.join(name), keys.join(format!("other-{name}"))).unwrap();
        }
    };
    let without_key = |keys: &Path| std::fs::remove_file(keys.join("fusion.key")).unwrap();
    let generations = |text: &'static str| {
        move |keys: &Path| std::fs::write(keys.join(GENERATIONS_FILE), text).unwrap()
    };
    let no_authority = |keys: &Path| std::fs::write(keys.join("ca.pem"), "hello").unwrap();
    let without_all = |keys: &Path| std::fs::remove_dir_all(keys).unwrap();
    let renew = "--renew fusion";
    check(vec![
        (
            "over",
            keys_report([-100, -3], |_| {}),
            (Failed, "has ended 3 days ago", renew),
        ),
        (
            "not begun",
            keys_report([2, 100], |_| {}),
            (Failed, "in 2.0 days", "clock"),
        ),
        (
            "ends soon",
            keys_report([-100, 9], |_| {}),
            (Warning, "ends in 9 days", renew),
        ),
        (
            "others may read it",
            keys_report(fine, open_to_all),
            (Failed, "found mode 0644", "chmod 600"),
        ),
        (
            "ends soon, and others may read it",
            keys_report([-100, 9], open_to_all),
            (Failed, "found mode 0644", "chmod 600"),
        ),
        (
            "an older generation",
            keys_report(fine, generations("[generation]\nfusion = 2\n")),
            (Failed, "2 is the newest of fusion", "copy the newest"),
        ),
        (
            "no number of a generation",
            keys_report(fine, generations("[generation]\nfusion = -2\n")),
            (Failed, "generations.toml:2", "copy generations.toml"),
        ),
        (
            "gone",
            keys_report(fine, without_key),
            (Failed, "fusion.key", renew),
        ),
        (
            "no authority",
            keys_report(fine, no_authority),
            (Failed, "ca.pem", "copy ca.pem"),
        ),
        (
            "no keys at all",
            keys_report(fine, without_all),
            (Failed, "does not exist", "farfield certs"),
        ),
        (
            "another venue's",
            keys_report(fine, rename),
            (Failed, "no keys of any node", "farfield certs"),
        ),
    ]);
}

#[test]
fn keys_that_nodes_would_refuse_are_found() {
    let fine = [-1, 100];
    check(vec![
        (
            "another authority's",
            keys_report(fine, |keys| replace_by_other(keys, "ca.pem")),
            (
                Failed,
                "fusion.pem: found a certificate that is not signed by",
                "copy ca.pem",
            ),
        ),
        (
            "another certificate's",
            keys_report(fine, |keys| replace_by_other(keys, "fusion.key")),
            (
                Failed,
                "fusion.key: found the private key of another certificate",
                "copy ca.pem",
            ),
        ),
        (
            "no key at all",
            keys_report(fine, |keys| write_key(keys, "junk")),
            (Failed, "found no private key", "copy ca.pem"),
        ),
        (
            "another venue's with the names of ours",
            keys_report_of("hall2", fine, |_| {}),
            (
                Failed,
                "found the certificate of `hall/fusion/1`",
                "copy ca.pem",
            ),
        ),
    ]);
}
