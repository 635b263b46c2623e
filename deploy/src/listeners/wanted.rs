//! The streams of a run: those of its venue file and those of the command line.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};

use anyhow::bail;
use farfield_proto::toml_file::FileError;
use farfield_proto::transport::endpoint;
use farfield_proto::venue::{StreamField, Venue};
use farfield_streams::{StreamKind, StreamSpec};

use crate::report_lines::ReportLines;

const STREAMS: &str = "streams";

/// The streams of a run of `venue` with `given` on the command line. A given stream replaces all streams of its
/// protocol in the file.
///
/// # Errors
/// The first invalid stream of the file, with line and field; also one that `given` replaces.
pub(crate) fn streams(venue: &Venue, given: &[StreamSpec]) -> Result<Vec<StreamSpec>, FileError> {
    let mut wanted = Vec::new();
    for stream in &venue.streams {
        let spec = StreamSpec::of(&stream.to, stream.address.as_deref());
        let spec = spec.map_err(|error| {
            let field = if error.is_of_name() {
                StreamField::To
            } else {
                StreamField::Address
            };
            stream.error(field, error.to_string())
        })?;
        if wanted.contains(&spec) {
            let problem = format!("found a second stream {spec}, expected one");
            return Err(stream.error(StreamField::To, problem));
        }
        wanted.push(spec);
    }
    wanted.retain(|spec| !given.iter().any(|it| it.kind == spec.kind));
    wanted.extend(given);
    Ok(wanted)
}

/// Refuses the ROS 2 stream if fusion itself listens at the address of the ROS 2 router (`listens_at`: Zenoh
/// endpoints): messages would go to fusion's own session, and ROS 2 would get none.
///
/// # Errors
/// Names the address and the remedies.
pub(crate) fn check_ros2(specs: &[StreamSpec], listens_at: &[String]) -> anyhow::Result<()> {
    let is_by_tcp = |at: &&String| matches!(endpoint::scheme(at), "tcp" | "tls");
    let by_tcp = listens_at.iter().filter(is_by_tcp);
    for listening in by_tcp.flat_map(|at| addresses(at)) {
        if let Some(spec) = specs.iter().find(|it| it.takes_for_its_own(listening)) {
            bail!(
                "stream `ros2`: found fusion itself at {}, expected the router of ROS 2; let the router listen on another port and set it \
                 (ZENOH_CONFIG_OVERRIDE='listen/endpoints=[\"tcp/[::]:7449\"]' ros2 run rmw_zenoh_cpp rmw_zenohd, --stream ros2={}:7449), \
                 or let fusion listen on another endpoint (--listen)",
                spec.address,
                spec.address.ip()
            );
        }
    }
    Ok(())
}

/// The addresses of an endpoint whose host is an IP address or `localhost`, which can mean IPv4 or IPv6.
fn addresses(endpoint: &str) -> Vec<SocketAddr> {
    let Some(port) = endpoint::port(endpoint) else {
        return Vec::new();
    };
    let ips: Vec<IpAddr> = match endpoint::host(endpoint) {
        "localhost" => vec![Ipv4Addr::LOCALHOST.into(), Ipv6Addr::LOCALHOST.into()],
        host => host.parse::<IpAddr>().into_iter().collect(),
    };
    ips.into_iter()
        .map(|ip| SocketAddr::new(ip, port))
        .collect()
}

/// Reports the streams of a run of `venue`.
pub(crate) fn check_streams(venue: &Venue, report: &mut ReportLines) {
    let wanted = match streams(venue, &[]) {
        Ok(wanted) => wanted,
        Err(error) => {
            let names = StreamKind::ALL.map(|(name, _)| name).join(", ");
            let remedy = format!("to = one of {names}; address = \"IP\" or \"IP:PORT\"");
            report.fail(STREAMS, error.to_string(), remedy);
            return;
        }
    };
    for spec in wanted {
        let (name, address) = (spec.kind.name(), spec.address);
        let what = if spec.kind.is_server() {
            "clients connect to"
        } else {
            "sent to"
        };
        if spec.leaves_this_machine() {
            report.warn(
                STREAMS,
                format!("{name}: {what} {address}; it has no keys: everyone who can reach it sees where people are"),
                "without `address` it stays on this machine",
            );
        } else {
            report.ok(STREAMS, format!("{name}: {what} {address}"));
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::report_lines::Verdict;

    fn venue(streams: &str) -> Venue {
        let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("venue.sample.toml");
        let text = std::fs::read_to_string(&sample).unwrap();
        let (before, after) = text.split_once("[[stream]]").unwrap();
        let after = &after[after.find("\n\n").unwrap()..];
        farfield_node::files::parse_venue(&format!("{before}{streams}{after}"), &sample).unwrap()
    }

    fn read(specs: &[&str]) -> Vec<StreamSpec> {
        specs.iter().map(|it| it.parse().unwrap()).collect()
    }

    #[test]
    fn the_command_line_replaces_streams_of_the_same_protocol() {
        let venue = venue(
            "[[stream]]\nto = \"vmc\"\n[[stream]]\nto = \"vmc\"\naddress = \"10.0.0.9\"\n[[stream]]\nto = \"qtm\"",
        );
        let wanted = |given: &[&str]| streams(&venue, &read(given)).unwrap();
        assert_eq!(wanted(&[]), read(&["vmc", "vmc=10.0.0.9", "qtm"]));
        let given = ["vmc=10.0.0.1", "psn"];
        assert_eq!(wanted(&given), read(&["qtm", "vmc=10.0.0.1", "psn"]));
    }

    #[test]
    fn an_invalid_stream_is_refused_with_file_line_and_field() {
        for (text, expected) in [
            (
                "to = \"natnet\"",
                ".to`: stream `natnet`: found no stream of that name",
            ),
            (
                "to = \"vmc\"\naddress = \"10.0.0.9:65530\"",
                ".address`: stream `vmc`: found port 65530",
            ),
            (
                "to = \"vmc\"\n[[stream]]\nto = \"vmc\"\naddress = \"127.0.0.1:39539\"",
                "[1].to`: found a second stream vmc=127.0.0.1:39539",
            ),
        ] {
            let venue = venue(&format!("[[stream]]\n{text}"));
            let error = streams(&venue, &[]).unwrap_err().to_string();
            assert!(error.contains("venue.sample.toml:"), "{error}");
            assert!(error.contains(expected), "{error}");
            let mut report = ReportLines::default();
            check_streams(&venue, &mut report);
            assert_eq!(report.lines()[0].verdict, Verdict::Failed);
        }
    }

    #[test]
    fn streams_that_leave_this_machine_are_a_warning() {
        let venue =
            venue("[[stream]]\nto = \"vmc\"\n[[stream]]\nto = \"vmc\"\naddress = \"10.0.0.9\"");
        let mut report = ReportLines::default();
        check_streams(&venue, &mut report);
        let verdicts = report.lines().iter().map(|line| line.verdict);
        assert_eq!(
            verdicts.collect::<Vec<_>>(),
            [Verdict::Ok, Verdict::Warning]
        );
    }

    #[test]
    fn the_ros_2_stream_is_refused_where_fusion_listens() {
        let check = |specs: &[&str], at: &str| check_ros2(&read(specs), &[at.to_owned()]);
        let error = check(&["qtm", "ros2"], "tcp/127.0.0.1:7447").unwrap_err();
        let error = error.to_string();
        assert!(error.contains("--stream ros2=127.0.0.1:7449"), "{error}");
        assert!(check(&["ros2"], "tcp/0.0.0.0:7447?x=1").is_err());
        // UDP does not block that port.
        assert!(check(&["ros2"], "quic/0.0.0.0:7447").is_ok());
        assert!(check(&["ros2=127.0.0.1:7449"], "tcp/0.0.0.0:7447").is_ok());
    }
}
