//! Where the fusion of a run listens. Live where `farfield status` looks for it, as long as nobody else is there, and there edges
//! of the venue find it, too, that somebody has started by hand; in lock-step, where many runs go side by side and nobody joins
//! them, at any port of this machine.

use std::path::Path;

use farfield_proto::transport::endpoint::{port, scheme};
use farfield_proto::transport::{Exposure, is_loopback};
use farfield_proto::venue::Venue;
use farfield_streams::StreamSpec;

use crate::listeners::wanted::check_ros2;

/// Where fusion listens.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ListenPlace {
    /// Where others look for it; `None` where it is not to be there.
    known: Option<String>,
    /// A free port of this machine.
    any: &'static str,
}

impl ListenPlace {
    /// Of a run of `venue` in lock-step: at any port.
    pub(super) fn anywhere(venue: &Venue) -> Self {
        let any = match venue.security.certificates {
            Some(_) => "quic/127.0.0.1:0",
            None => "tcp/127.0.0.1:0",
        };
        Self { known: None, any }
    }

    /// Of a live run of `venue`, with `streams` beside it: where others look for it, if that may be.
    pub(super) fn where_looked_for(venue: &Venue, streams: &[StreamSpec]) -> Self {
        let exposure = Exposure {
            has_keys: venue.security.certificates.is_some(),
            allow_plaintext: venue.security.allow_plaintext,
        };
        let looked_at = exposure.choose(Vec::new(), &venue.endpoints.connect);
        // A run keeps to this machine. An edge of the venue that waits here for a fusion takes part all the same, and the
        // run's own of that viewpoint is refused as its second (docs/live.md says what to do).
        let is_to_be_had = |it: &String| {
            is_loopback(it)
                && port(it).is_some_and(|port| port != 0)
                && check_ros2(streams, std::slice::from_ref(it)).is_ok()
        };
        let known = looked_at.unwrap_or_default().into_iter().find(is_to_be_had);
        Self {
            known,
            ..Self::anywhere(venue)
        }
    }

    /// The words of fusion's command line that say so.
    pub(super) fn words(&self) -> Vec<String> {
        let words = match &self.known {
            Some(known) => vec!["--listen", known.as_str(), "--listen-else", self.any],
            None => vec!["--listen", self.any],
        };
        words.into_iter().map(str::to_owned).collect()
    }

    /// What the operator is told once fusion listens at `endpoint`: how to look at the nodes of the venue in the file `venue`.
    pub(super) fn told(&self, venue: &Path, endpoint: &str) -> String {
        let venue = venue.display();
        let is_known =
            |known: &&String| (scheme(known), port(known)) == (scheme(endpoint), port(endpoint));
        let at = self.known.as_ref().filter(is_known);
        let status = if at.is_some() {
            format!("`farfield status {venue}`")
        } else {
            format!("`farfield status {venue} --connect {endpoint}`")
        };
        let why = match &self.known {
            Some(known) if at.is_none() => format!(" ({known} is taken)"),
            _ => String::new(),
        };
        format!("fusion listens on {endpoint}{why}: {status} shows its nodes")
    }
}

#[cfg(test)]
mod tests {
    use farfield_node::files::parse_venue;

    use super::*;

    fn venue(connect: &str) -> Venue {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("venue.sample.toml");
        let text = std::fs::read_to_string(&path).unwrap();
        let mut venue = parse_venue(&text, &path).unwrap();
        venue.endpoints.connect = connect.split_whitespace().map(str::to_owned).collect();
        venue.security.certificates = None;
        venue
    }

    fn live(connect: &str, streams: &[&str]) -> ListenPlace {
        let streams: Vec<StreamSpec> = streams.iter().map(|it| it.parse().unwrap()).collect();
        ListenPlace::where_looked_for(&venue(connect), &streams)
    }

    fn known(connect: &str, streams: &[&str]) -> Option<String> {
        live(connect, streams).known
    }

    #[test]
    fn a_live_run_is_where_status_looks_for_it_and_one_in_lock_step_anywhere() {
        assert_eq!(
            live("", &[]).words().join(" "),
            "--listen tcp/127.0.0.1:7447 --listen-else tcp/127.0.0.1:0"
        );
        let in_lock_step = ListenPlace::anywhere(&venue(""));
        assert_eq!(in_lock_step.words().join(" "), "--listen tcp/127.0.0.1:0");
    }

    #[test]
    fn what_the_venue_file_says_counts_where_it_stays_on_this_machine() {
        assert_eq!(
            known("tcp/127.0.0.1:9000", &[]).as_deref(),
            Some("tcp/127.0.0.1:9000")
        );
        // That is an endpoint of other machines, or one that says no port.
        assert_eq!(known("quic/10.0.0.1:7447 tcp/127.0.0.1:0", &[]), None);
    }

    #[test]
    fn the_place_of_the_router_of_ros_2_is_left_to_it() {
        assert_eq!(known("", &["ros2"]), None);
        assert_eq!(known("tcp/localhost:7447", &["ros2"]), None);
        assert!(known("tcp/localhost:7447", &[]).is_some());
        assert!(known("", &["qtm"]).is_some());
    }

    #[test]
    fn the_operator_is_told_how_to_look_at_the_nodes() {
        let told = |connect, endpoint| live(connect, &[]).told(Path::new("hall.toml"), endpoint);
        assert_eq!(
            told("", "tcp/127.0.0.1:7447"),
            "fusion listens on tcp/127.0.0.1:7447: `farfield status hall.toml` shows its nodes"
        );
        assert_eq!(
            told("", "tcp/127.0.0.1:41000"),
            "fusion listens on tcp/127.0.0.1:41000 (tcp/127.0.0.1:7447 is taken): `farfield status hall.toml --connect \
             tcp/127.0.0.1:41000` shows its nodes"
        );
        assert_eq!(
            told("tcp/127.0.0.1:0", "tcp/127.0.0.1:41000"),
            "fusion listens on tcp/127.0.0.1:41000: `farfield status hall.toml --connect tcp/127.0.0.1:41000` shows its nodes"
        );
    }
}
