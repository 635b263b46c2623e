//! Description of the stream: short XML for discovery, and full XML with the channels.

use std::fmt::Write as _;

use farfield_fusion::body::skeleton::Joint;

use super::PLACES;
use super::sample::N_CHANNELS;

/// Identification of a stream.
#[derive(Debug, Clone, PartialEq)]
pub struct Info {
    /// Name of the venue.
    pub venue: String,
    /// Samples per second, not counting skipped ones.
    pub rate_hz: f64,
    /// Unique id of this outlet, new at every start. In lower case, since inlets compare it so.
    pub uid: String,
    /// Name of the machine.
    pub hostname: String,
    /// Creation time of the outlet, seconds of its clock.
    pub created_at_s: f64,
    /// The TCP port of samples.
    pub data_port: u16,
    /// The UDP port of the clock.
    pub service_port: u16,
}

impl Info {
    /// Its fields, in order, for queries of inlets.
    pub fn fields(&self) -> [(&'static str, String); 17] {
        let (venue, hostname) = (&self.venue, &self.hostname);
        [
            ("name", format!("farfield-{venue}")),
            ("type", "MoCap".to_owned()),
            ("channel_count", N_CHANNELS.to_string()),
            ("channel_format", "float32".to_owned()),
            // Constant over restarts, so that inlets resume.
            ("source_id", format!("farfield-{venue}-{hostname}")),
            ("nominal_srate", format!("{:?}", self.rate_hz)),
            ("version", "1.10".to_owned()),
            ("created_at", format!("{:?}", self.created_at_s)),
            ("uid", self.uid.clone()),
            ("session_id", "default".to_owned()),
            ("hostname", hostname.clone()),
            // Inlets record the sender's address themselves.
            ("v4address", String::new()),
            ("v4data_port", self.data_port.to_string()),
            ("v4service_port", self.service_port.to_string()),
            ("v6address", String::new()),
            ("v6data_port", "0".to_owned()),
            ("v6service_port", "0".to_owned()),
        ]
    }

    /// For discovery.
    pub fn short_xml(&self) -> String {
        self.xml("<desc />")
    }

    /// With the description of the channels.
    pub fn full_xml(&self) -> String {
        self.xml(&desc())
    }

    fn xml(&self, desc: &str) -> String {
        let mut text = "<?xml version=\"1.0\"?>\n<info>\n".to_owned();
        for (name, value) in self.fields() {
            // Writing to a string cannot fail.
            writeln!(text, "\t<{name}>{}</{name}>", escaped(&value)).ok();
        }
        text.push('\t');
        text.push_str(desc);
        text.push_str("\n</info>\n");
        text
    }
}

/// Escapes text; control characters, which XML cannot represent, are dropped.
fn escaped(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '&' => safe.push_str("&amp;"),
            c if c.is_control() => {}
            c => safe.push(c),
        }
    }
    safe
}

/// The description: label, marker, object, type and unit of each channel, with XDF's names.
fn desc() -> String {
    let mut text = "<desc>\n\t\t<channels>\n".to_owned();
    let mut channel = |label: &str, [marker, object]: [&str; 2], kind: &str, unit: &str| {
        writeln!(
            text,
            "\t\t\t<channel><label>{label}</label><marker>{marker}</marker><object>{object}</object><type>{kind}</type><unit>{unit}</unit></channel>"
        )
        .ok();
    };
    channel("tick", ["", ""], "FrameNumber", "count");
    for place in 1..=PLACES {
        let object = format!("p{place}");
        channel(&format!("{object}_id"), ["", &object], "Id", "none");
        let seen = format!("{object}_seen");
        channel(&seen, ["", &object], "Confidence", "normalized");
        for joint in Joint::ALL {
            let marker = format!("{object}_{}", joint.name());
            for axis in ["X", "Y", "Z"] {
                let label = format!("{marker}_{}", axis.to_lowercase());
                let kind = format!("Position{axis}");
                channel(&label, [&marker, &object], &kind, "meters");
            }
        }
    }
    text.push_str(
        "\t\t</channels>\n\
         \t\t<synchronization><can_drop_samples>true</can_drop_samples></synchronization>\n\
         \t\t<acquisition><manufacturer>Farfield</manufacturer><model>Farfield</model></acquisition>\n\
         \t\t<setup><coordinates>right-handed, z up</coordinates></setup>\n\
         \t</desc>",
    );
    text
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in crate::lsl) fn info() -> Info {
        Info {
            venue: "a <b> & c".to_owned(),
            rate_hz: 60.0,
            uid: "01234567-89ab-cdef-0123-456789abcdef".to_owned(),
            hostname: "lab".to_owned(),
            created_at_s: 12.5,
            data_port: 16572,
            service_port: 16573,
        }
    }

    #[test]
    fn the_short_xml_describes_the_stream() {
        let xml = info().short_xml();
        assert!(xml.starts_with("<?xml version=\"1.0\"?>\n<info>\n\t<name>farfield-a &lt;b&gt; &amp; c</name>\n\t<type>MoCap</type>\n"));
        assert!(xml.contains("<channel_count>713</channel_count>"));
        assert!(xml.contains("<v4data_port>16572</v4data_port>"));
        assert!(xml.ends_with("\t<desc />\n</info>\n"));
    }

    #[test]
    fn every_channel_has_a_label_a_type_and_a_unit() {
        let xml = info().full_xml();
        assert_eq!(xml.matches("<channel>").count(), N_CHANNELS);
        assert_eq!(
            xml.matches("<type>PositionX</type><unit>meters</unit>")
                .count(),
            8 * 29
        );
        assert!(xml.contains(
            "<label>p8_left_knee_z</label><marker>p8_left_knee</marker><object>p8</object>"
        ));
        let labels: std::collections::BTreeSet<&str> = xml
            .split("<label>")
            .skip(1)
            .filter_map(|rest| rest.split('<').next())
            .collect();
        assert_eq!(labels.len(), N_CHANNELS);
    }
}
