//! Where the fusion of a run listens. In lock-step many runs work side by side, so it takes any free port of this
//! machine.
//! Live it listens at the endpoint of the venue if that is free. There `farfield status` and edges started by hand find
//! it.

use std::path::Path;

use farfield_proto::transport::endpoint::{port, scheme};
use farfield_proto::transport::{Exposure, is_loopback};
use farfield_proto::venue::Venue;
use farfield_streams::StreamSpec;

use crate::listeners::wanted::check_ros2;

/// Where fusion listens.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ListenPlace {
    /// The endpoint where other programs expect it; `None`: only the free port.
    known: Option<String>,
    /// A free port of this machine.
    any: &'static str,
}

impl ListenPlace {
    /// Lock-step: any free port.
    pub(super) fn anywhere(venue: &Venue) -> Self {
        let any = match venue.security.certificates {
            Some(_) => "quic/127.0.0.1:0",
            None => "tcp/127.0.0.1:0",
        };
        Self { known: None, any }
    }

    /// Live: the endpoint of the venue, if a run with these streams may use it.
    pub(super) fn at_venue_endpoint(venue: &Venue, streams: &[StreamSpec]) -> Self {
        let exposure = Exposure {
            has_keys: venue.security.certificates.is_some(),
            allow_plaintext: venue.security.allow_plaintext,
        };
        let endpoints = exposure.choose(Vec::new(), &venue.endpoints.connect);
        // A run stays on this machine. An edge started by hand that waits at this endpoint also takes part; fusion then
        // refuses the run's own edge of that viewpoint as a second one (see docs/live.md).
        let is_usable = |it: &String| {
            is_loopback(it)
                && port(it).is_some_and(|port| port != 0)
                && check_ros2(streams, std::slice::from_ref(it)).is_ok()
        };
        let known = endpoints.unwrap_or_default().into_iter().find(is_usable);
        Self {
            known,
            ..Self::anywhere(venue)
        }
    }

    /// The arguments for fusion's command line.
    pub(super) fn words(&self) -> Vec<String> {
        let words = match &self.known {
            Some(known) => vec!["--listen", known.as_str(), "--listen-else", self.any],
            None => vec!["--listen", self.any],
        };
        words.into_iter().map(str::to_owned).collect()
    }

    /// The line printed once fusion listens at `endpoint`: how to show the status of the nodes of the venue file
    /// `venue`.
    pub(super) fn message(&self, venue: &Path, endpoint: &str) -> String {
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
        ListenPlace::at_venue_endpoint(&venue(connect), &streams)
    }

    fn known(connect: &str, streams: &[&str]) -> Option<String> {
        live(connect, streams).known
    }

    #[test]
    fn live_uses_the_venue_endpoint_and_lock_step_any_port() {
        assert_eq!(
            live("", &[]).words().join(" "),
            "--listen tcp/127.0.0.1:7447 --listen-else tcp/127.0.0.1:0"
        );
        let in_lock_step = ListenPlace::anywhere(&venue(""));
        assert_eq!(in_lock_step.words().join(" "), "--listen tcp/127.0.0.1:0");
    }

    #[test]
    fn only_loopback_endpoints_of_the_venue_file_are_used() {
        assert_eq!(
            known("tcp/127.0.0.1:9000", &[]).as_deref(),
            Some("tcp/127.0.0.1:9000")
        );
        // The first belongs to another machine; the second has no port.
        assert_eq!(known("quic/10.0.0.1:7447 tcp/127.0.0.1:0", &[]), None);
    }

    #[test]
    fn the_port_of_the_ros_2_router_is_not_used() {
        assert_eq!(known("", &["ros2"]), None);
        assert_eq!(known("tcp/localhost:7447", &["ros2"]), None);
        assert!(known("tcp/localhost:7447", &[]).is_some());
        assert!(known("", &["qtm"]).is_some());
    }

    #[test]
    fn the_message_shows_how_to_query_the_status() {
        let message =
            |connect, endpoint| live(connect, &[]).message(Path::new("hall.toml"), endpoint);
        assert_eq!(
            message("", "tcp/127.0.0.1:7447"),
            "fusion listens on tcp/127.0.0.1:7447: `farfield status hall.toml` shows its nodes"
        );
        assert_eq!(
            message("", "tcp/127.0.0.1:41000"),
            "fusion listens on tcp/127.0.0.1:41000 (tcp/127.0.0.1:7447 is taken): `farfield status hall.toml --connect \
             tcp/127.0.0.1:41000` shows its nodes"
        );
        assert_eq!(
            message("tcp/127.0.0.1:0", "tcp/127.0.0.1:41000"),
            "fusion listens on tcp/127.0.0.1:41000: `farfield status hall.toml --connect tcp/127.0.0.1:41000` shows its nodes"
        );
    }
}
