//! Streams for other programs.

use super::{VENUE, parse};
use crate::venue::StreamField;

fn with_streams(text: &str) -> String {
    VENUE.replace("[tuning]", &format!("{text}\n[tuning]"))
}

#[test]
fn streams_are_text_with_their_lines() {
    let text = with_streams(
        "[[stream]]\nto = \"vmc\"\naddress = \"127.0.0.1:39539\"\n[[stream]]\nto = \"carrier-pigeon\"",
    );
    let venue = parse(&text).unwrap();
    let [vmc, other] = &venue.streams[..] else {
        panic!("{:?}", venue.streams)
    };
    assert_eq!(vmc.to, "vmc");
    assert_eq!(vmc.address.as_deref(), Some("127.0.0.1:39539"));
    // Unknown protocols are refused by the command that opens streams; an edge opens none.
    assert_eq!(
        (other.to.as_str(), &other.address),
        ("carrier-pigeon", &None)
    );
    let at = |field| other.error(field, "found it").to_string();
    assert_eq!(
        at(StreamField::To),
        "venues/hall.toml:37: `stream[1].to`: found it"
    );
    // For an absent field, the line of its table.
    assert_eq!(
        at(StreamField::Address),
        "venues/hall.toml:36: `stream[1].address`: found it"
    );
}

#[test]
fn impossible_streams_are_refused_with_line_and_field() {
    let refused = |text: &str| parse(&with_streams(text)).unwrap_err().to_string();
    for (text, expected) in [
        (
            "[[stream]]\nto = \"\"",
            "34: `stream[0].to`: found \"\", expected the name of a protocol",
        ),
        (
            "[[stream]]\nto = \"v m\"",
            "34: `stream[0].to`: found \"v m\"",
        ),
        (
            "[[stream]]\nto = \"qtm\"\naddress = \"\"",
            "35: `stream[0].address`: found \"\", expected an address",
        ),
        (
            "[[stream]]\nto = \"qtm\"\n[[stream]]\nto = \"qtm\"",
            "36: `stream[1].to`: found \"qtm\" a second time",
        ),
        (
            "[[stream]]\nname = \"qtm\"",
            "34: `stream[0].name`: unknown field `name`",
        ),
        (
            "[[stream]]\naddress = \"::1\"",
            "`stream[0].to`: the field is missing",
        ),
    ] {
        let message = refused(text);
        assert!(message.contains(expected), "{message}\n{expected}");
    }
    let many = (0..33).map(|i| format!("[[stream]]\nto = \"s{i}\"\n"));
    let many = many.collect::<Vec<_>>().concat();
    assert!(refused(&many).contains("`stream`: found 33, expected at most 32"));
}
