//! A venue that runs live on this machine with edges behind relays: for scenarios, studies and soaks.
//!
//! Fusion listens on the loopback. Every edge reaches it through a [`UdpRelay`] of its own. Where the system allows it, the
//! edge has a network namespace of its own, so that a datagram lost in the relay is lost. Every node is the given program,
//! started as an operator would start it. Each can be killed and started again.

mod node;
mod player;
mod pose_log;
mod watch;

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::Context as _;
use farfield_proto::venue::Venue;

use crate::namespaces::Namespaces;
use crate::relay::UdpRelay;

pub use self::node::{NodeProcess, Vitals};
pub use self::player::{Played, Player, write_played_venue};
pub use self::pose_log::{PoseLog, RepeatingTruth};
pub use self::watch::{PoseArrival, SeenVenue, VenueWatch};

/// A venue, its relays and its running nodes.
#[derive(Debug)]
pub struct LiveVenue {
    /// Fusion, while it runs.
    pub fusion: Option<NodeProcess>,
    /// The edges by viewpoint, while they run.
    pub edges: Vec<Option<NodeProcess>>,
    /// The link of every edge, or the shared one ([`Self::share_one_link`]).
    pub relays: Vec<UdpRelay>,
    program: PathBuf,
    venue_path: PathBuf,
    venue: Venue,
    /// UDP for the edges, TCP for observers.
    ports: [u16; 2],
    namespaces: Option<Namespaces>,
    is_fusion_managed: bool,
    /// The core of fusion; `None`: all.
    fusion_core: Option<usize>,
    /// Environment variables of fusion.
    fusion_environment: Vec<(String, String)>,
}

impl LiveVenue {
    /// The venue at `venue_path` with relays and without nodes. `program` is the operator's command. Edges get namespaces of their
    /// own if `namespaces` has enough of them.
    ///
    /// # Errors
    /// The venue file is refused, or there are no free ports.
    pub fn prepare(
        program: &Path,
        venue_path: &Path,
        namespaces: Option<Namespaces>,
    ) -> anyhow::Result<Self> {
        let venue = farfield_node::files::load_venue(venue_path)?;
        let ports = free_ports().context("looking for free ports")?;
        let server = SocketAddr::from((Ipv4Addr::LOCALHOST, ports[0]));
        let n = venue.viewpoints.len();
        let relay = |i: usize| {
            let listen = namespaces
                .as_ref()
                .map_or(Ipv4Addr::LOCALHOST, |n| n.get(i).gateway());
            UdpRelay::start(SocketAddr::new(IpAddr::V4(listen), 0), server, i as u64)
        };
        let relays: io::Result<Vec<UdpRelay>> = (0..n).map(relay).collect();
        Ok(Self {
            fusion: None,
            edges: (0..n).map(|_| None).collect(),
            relays: relays.context("starting the relays")?,
            program: program.to_owned(),
            venue_path: venue_path.to_owned(),
            venue,
            ports,
            namespaces,
            is_fusion_managed: true,
            fusion_core: None,
            fusion_environment: Vec::new(),
        })
    }

    /// Makes all edges share one relay, as behind one radio bridge. Call it before the edges start.
    ///
    /// # Errors
    /// There is no free port.
    pub fn share_one_link(&mut self) -> io::Result<()> {
        let server = SocketAddr::from((Ipv4Addr::LOCALHOST, self.ports[0]));
        // Edges in namespaces reach it at different addresses of this machine.
        let any = SocketAddr::from((Ipv4Addr::UNSPECIFIED, 0));
        self.relays = vec![UdpRelay::start(any, server, 0)?];
        Ok(())
    }

    /// Address of the relay for the edge of viewpoint `i`.
    fn relay_address(&self, i: usize) -> SocketAddr {
        match &self.relays[..] {
            [shared] if self.edges.len() > 1 => {
                let here = self.namespaces.as_ref();
                let ip = here.map_or(Ipv4Addr::LOCALHOST, |n| n.get(i).gateway());
                SocketAddr::from((ip, shared.address().port()))
            }
            relays => relays[i].address(),
        }
    }

    /// The venue.
    pub fn venue(&self) -> &Venue {
        &self.venue
    }

    /// Whether edges have namespaces of their own.
    pub fn is_in_namespaces(&self) -> bool {
        self.namespaces.is_some()
    }

    /// Endpoint of fusion for nodes other than edges.
    pub fn endpoint(&self) -> String {
        format!("tcp/127.0.0.1:{}", self.ports[1])
    }

    /// Opens an observer.
    ///
    /// # Errors
    /// Zenoh fails.
    pub fn watch(&self) -> anyhow::Result<VenueWatch> {
        VenueWatch::open(&self.venue.name, &self.endpoint())
    }

    /// Starts fusion from now on as by hand or by systemd: it does not report, and has no parent that would end the edges with it.
    pub fn fusion_by_hand(&mut self) {
        self.is_fusion_managed = false;
    }

    /// Starts fusion from now on on this core only.
    pub fn fusion_on_core(&mut self, core: usize) {
        self.fusion_core = Some(core);
    }

    /// Starts fusion from now on with these environment variables.
    pub fn fusion_environment(&mut self, variables: Vec<(String, String)>) {
        self.fusion_environment = variables;
    }

    /// Starts fusion with its results in `out`, and `more` arguments.
    ///
    /// # Errors
    /// It cannot be started.
    pub fn start_fusion(&mut self, out: &Path, more: &[&str]) -> io::Result<()> {
        // The parent of a managed fusion node creates its folder.
        std::fs::create_dir_all(out)?;
        let mut command = match self.fusion_core {
            Some(core) => {
                let mut command = Command::new("taskset");
                command.args(["-c", &core.to_string()]).arg(&self.program);
                command
            }
            None => Command::new(&self.program),
        };
        command.arg("fusion").arg(&self.venue_path);
        // The namespaces of this machine are private.
        command.args(["--live", "--allow-plaintext", "--out"]);
        command.arg(out);
        if self.is_fusion_managed {
            command.arg("--managed");
        }
        let endpoints = [format!("udp/127.0.0.1:{}", self.ports[0]), self.endpoint()];
        for endpoint in &endpoints {
            command.args(["--listen", endpoint]);
        }
        command.args(more);
        command.envs(self.fusion_environment.iter().cloned());
        self.fusion = Some(NodeProcess::start("fusion", command)?);
        Ok(())
    }

    /// Starts the edge of viewpoint `i` with `more` arguments, on another venue file than fusion's if `venue_path` is given.
    ///
    /// # Errors
    /// It cannot be started.
    pub fn start_edge(
        &mut self,
        i: usize,
        venue_path: Option<&Path>,
        more: &[&str],
    ) -> io::Result<()> {
        let mut command = match &self.namespaces {
            Some(namespaces) => namespaces.get(i).command(&self.program),
            None => Command::new(&self.program),
        };
        let name = self.venue.viewpoints[i].name.clone();
        let endpoint = format!("udp/{}", self.relay_address(i));
        command
            .arg("edge")
            .arg(venue_path.unwrap_or(&self.venue_path))
            .args(["--managed", "--allow-plaintext", "--viewpoint", &name])
            .args(["--connect", &endpoint, "--ring"])
            .arg(self.venue_path.with_file_name("rings").join(&name))
            .args(more);
        self.edges[i] = Some(NodeProcess::start(&name, command)?);
        Ok(())
    }

    /// Starts every edge that does not run.
    ///
    /// # Errors
    /// One cannot be started.
    pub fn start_edges(&mut self) -> io::Result<()> {
        for i in 0..self.edges.len() {
            if self.edges[i].is_none() {
                self.start_edge(i, None, &[])?;
            }
        }
        Ok(())
    }

    /// The nodes that were started and not killed.
    pub fn nodes(&self) -> impl Iterator<Item = &NodeProcess> {
        self.fusion.iter().chain(self.edges.iter().flatten())
    }

    /// Standard error of every node, for messages about failed runs.
    pub fn output(&self) -> String {
        let output = |node: &NodeProcess| format!("--- {}\n{}", node.name(), node.output());
        self.nodes().map(output).collect()
    }
}

/// Free ports of the loopback, UDP and TCP.
fn free_ports() -> io::Result<[u16; 2]> {
    let udp = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
    let tcp = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
    Ok([udp.local_addr()?.port(), tcp.local_addr()?.port()])
}
