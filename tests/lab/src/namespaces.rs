//! Network namespaces: nodes of one machine that reach each other only through a relay.
//!
//! Each namespace is one end of a virtual cable whose other end is outside. Programs in it reach only a relay that listens at
//! that end. Making namespaces needs root and the program `ip`.

use std::net::Ipv4Addr;
use std::process::Command;
use std::sync::atomic::{AtomicU32, Ordering};

/// Namespaces of one test or study; removed when dropped.
#[derive(Debug)]
pub struct Namespaces(Vec<Namespace>);

/// One namespace and the cable to it.
#[derive(Debug)]
pub struct Namespace {
    name: String,
    gateway: Ipv4Addr,
}

/// Number of namespaces that this process has made.
static MADE: AtomicU32 = AtomicU32::new(0);

impl Namespaces {
    /// Makes `n`, at most 63.
    ///
    /// # Errors
    /// The reason, for people and for tests that are skipped.
    pub fn make(n: usize) -> Result<Self, String> {
        remove_stale()?;
        // Dropped and removed if one of them fails.
        let mut made = Self(Vec::new());
        let block = free_block()?;
        for i in 0..n.min(63) {
            let number = MADE.fetch_add(1, Ordering::Relaxed);
            let name = format!("ff{}n{number}", std::process::id());
            let gateway = Ipv4Addr::new(198, 18, block, 4 * i as u8 + 1);
            made.0.push(Namespace { name, gateway });
            made.0[i].connect()?;
        }
        Ok(made)
    }

    /// The `i`-th.
    ///
    /// # Panics
    /// There are fewer.
    pub fn get(&self, i: usize) -> &Namespace {
        &self.0[i]
    }
}

impl Namespace {
    /// The address of the outer end of the cable, where a relay listens.
    pub fn gateway(&self) -> Ipv4Addr {
        self.gateway
    }

    /// A command that runs `program` inside. The process is the program itself, with its signals and exit codes.
    pub fn command(&self, program: impl AsRef<std::ffi::OsStr>) -> Command {
        let mut command = Command::new("ip");
        command.args(["netns", "exec", &self.name]).arg(program);
        command
    }

    fn connect(&self) -> Result<(), String> {
        let Self { name, gateway } = self;
        let [a, b, c, d] = gateway.octets();
        let inside = Ipv4Addr::new(a, b, c, d + 1);
        // Names of interfaces have at most 15 characters.
        let (here, there) = (format!("{name}h"), format!("{name}e"));
        ip(&["netns", "add", name])?;
        ip(&["link", "add", &here, "type", "veth", "peer", "name", &there])?;
        ip(&["link", "set", &there, "netns", name])?;
        ip(&["address", "add", &format!("{gateway}/30"), "dev", &here])?;
        ip(&["link", "set", &here, "up"])?;
        let address = format!("{inside}/30");
        ip(&["-n", name, "address", "add", &address, "dev", &there])?;
        ip(&["-n", name, "link", "set", "lo", "up"])?;
        ip(&["-n", name, "link", "set", &there, "up"])?;
        Ok(())
    }
}

impl Drop for Namespace {
    fn drop(&mut self) {
        remove(&self.name);
    }
}

/// Removes the namespaces of processes that were killed.
fn remove_stale() -> Result<(), String> {
    for line in ip(&["netns", "list"])?.lines() {
        let name = line.split(' ').next().unwrap_or_default();
        let maker = name
            .strip_prefix("ff")
            .and_then(|rest| rest.split_once('n'));
        let Some((pid, _)) = maker.filter(|(pid, _)| pid.parse::<u32>().is_ok()) else {
            continue;
        };
        if !std::path::Path::new("/proc").join(pid).exists() {
            remove(name);
        }
    }
    Ok(())
}

/// Removes a namespace, and its cable first: a namespace is gone with the last process in it, a cable at once.
fn remove(name: &str) {
    // Missing ones are no error.
    drop(ip(&["link", "delete", &format!("{name}h")]));
    drop(ip(&["netns", "delete", name]));
}

/// The third number of addresses 198.18.x.y (RFC 2544: for measurements) that is not used here.
fn free_block() -> Result<u8, String> {
    let used = ip(&["-4", "-o", "address", "show"])?;
    let wish = std::process::id().wrapping_mul(16) + MADE.load(Ordering::Relaxed);
    (0..=u8::MAX)
        .map(|i| i.wrapping_add(wish as u8))
        .find(|block| !used.contains(&format!(" 198.18.{block}.")))
        .ok_or_else(|| "all of 198.18.0.0/16 is in use".to_owned())
}

fn ip(args: &[&str]) -> Result<String, String> {
    let describe = |what: &str| format!("`ip {}`: {what}", args.join(" "));
    let output = Command::new("ip").args(args).output();
    let output = output.map_err(|error| describe(&error.to_string()))?;
    if !output.status.success() {
        return Err(describe(String::from_utf8_lossy(&output.stderr).trim()));
    }
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

#[cfg(test)]
mod tests {
    use std::net::UdpSocket;
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_namespace_reaches_only_its_end_of_the_cable() {
        let namespaces = match Namespaces::make(2) {
            Ok(namespaces) => namespaces,
            Err(reason) => {
                println!("skipped: no network namespaces: {reason}");
                return;
            }
        };
        let namespace = namespaces.get(0);
        let names = ["h", "e"].map(|end| format!("{}{end}", namespace.name));
        assert!(names.iter().all(|name| name.len() <= 15));
        let here = UdpSocket::bind((namespace.gateway(), 0)).unwrap();
        here.set_read_timeout(Some(Duration::from_secs(20)))
            .unwrap();
        let port = here.local_addr().unwrap().port();
        let send = |to: Ipv4Addr| {
            let script = format!("echo -n hello > /dev/udp/{to}/{port}");
            let mut bash = namespace.command("bash");
            bash.args(["-c", &script])
                .output()
                .unwrap()
                .status
                .success()
        };
        assert!(send(namespace.gateway()));
        let mut buffer = [0; 10];
        assert_eq!(here.recv(&mut buffer).unwrap(), 5);
        assert!(
            !send(namespaces.get(1).gateway()),
            "another cable is reached"
        );
        let name = namespace.name.clone();
        drop(namespaces);
        assert!(!ip(&["netns", "list"]).unwrap().contains(&name));
    }
}
