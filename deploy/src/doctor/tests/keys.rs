//! Keys that nobody would admit, made for real.

use farfield_proto::transport::{GENERATIONS_FILE, common_name};

use super::*;

const DAY_S: i64 = 86_400;

/// Keys of fusion in a folder, which hold from one day to another, counted from [`NOW_S`].
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

/// Writes a key of fusion's, for its owner alone.
fn write_key(folder: &Path, text: &str) {
    let path = folder.join("fusion.key");
    std::fs::write(&path, text).unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o600)).unwrap();
}

/// Puts `file` of keys that were made for themselves in the place of that of `keys`.
fn take_from_others(keys: &Path, file: &str) {
    let others = tempfile::tempdir().unwrap();
    make_keys(others.path(), -1, 100);
    std::fs::copy(others.path().join(file), keys.join(file)).unwrap();
}

/// What is said of keys that hold from one day to another, after `harm` was done to them.
pub(super) fn keys_said(days: [i64; 2], harm: impl FnOnce(&Path)) -> ReportLines {
    keys_said_of("hall", days, harm)
}

/// The same where the venue has this name.
fn keys_said_of(name: &str, days: [i64; 2], harm: impl FnOnce(&Path)) -> ReportLines {
    let folder = tempfile::tempdir().unwrap();
    let keys = folder.path().join("certs");
    std::fs::create_dir(&keys).unwrap();
    make_keys(&keys, days[0], days[1]);
    harm(&keys);
    let venue = Venue {
        name: name.to_owned(),
        ..venue(folder.path(), "[security]\ncertificates = \"certs\"")
    };
    let mut report = ReportLines::default();
    look_at_keys(
        &venue,
        &folder.path().join("venue.toml"),
        NOW_S,
        &mut report,
    );
    report
}

#[test]
fn keys_that_do_not_hold_or_are_not_safe_are_found() {
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
            keys_said([-100, -3], |_| {}),
            (Failed, "has ended 3 days ago", renew),
        ),
        (
            "not begun",
            keys_said([2, 100], |_| {}),
            (Failed, "begins in 2.0 days", "clock"),
        ),
        (
            "ends soon",
            keys_said([-100, 9], |_| {}),
            (Warning, "ends in 9 days", renew),
        ),
        (
            "others may read it",
            keys_said(fine, open_to_all),
            (Failed, "found mode 0644", "chmod 600"),
        ),
        (
            "ends soon, and others may read it",
            keys_said([-100, 9], open_to_all),
            (Failed, "found mode 0644", "chmod 600"),
        ),
        (
            "an older generation",
            keys_said(fine, generations("[generation]\nfusion = 2\n")),
            (Failed, "2 is the newest of fusion", "copy the newest"),
        ),
        (
            "no number of a generation",
            keys_said(fine, generations("[generation]\nfusion = -2\n")),
            (Failed, "generations.toml:2", "copy generations.toml"),
        ),
        (
            "gone",
            keys_said(fine, without_key),
            (Failed, "fusion.key", renew),
        ),
        (
            "no authority",
            keys_said(fine, no_authority),
            (Failed, "ca.pem", "copy ca.pem"),
        ),
        (
            "no keys at all",
            keys_said(fine, without_all),
            (Failed, "no such folder", "farfield certs"),
        ),
        (
            "another venue's",
            keys_said(fine, rename),
            (Failed, "no keys of any node", "farfield certs"),
        ),
    ]);
}

#[test]
fn keys_that_nobody_would_admit_are_found() {
    let fine = [-1, 100];
    check(vec![
        (
            "another authority's",
            keys_said(fine, |keys| take_from_others(keys, "ca.pem")),
            (
                Failed,
                "fusion.pem: found a certificate that is not signed by",
                "copy ca.pem",
            ),
        ),
        (
            "another certificate's",
            keys_said(fine, |keys| take_from_others(keys, "fusion.key")),
            (
                Failed,
                "fusion.key: found the private key of another certificate",
                "copy ca.pem",
            ),
        ),
        (
            "no key at all",
            keys_said(fine, |keys| write_key(keys, "junk")),
            (Failed, "found no private key", "copy ca.pem"),
        ),
        (
            "another venue's with the names of ours",
            keys_said_of("hall2", fine, |_| {}),
            (
                Failed,
                "found the certificate of `hall/fusion/1`",
                "copy ca.pem",
            ),
        ),
    ]);
}
