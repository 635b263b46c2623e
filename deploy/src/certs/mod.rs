//! `farfield certs`: the keys of a venue. No part of a private key is ever printed.

mod authority;
mod files;
mod generations;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, bail, ensure};
use clap::Args;
use farfield_node::certificate::{common_name_in, public_key_in};
use farfield_node::files::{AUTHORITY_KEY, load_venue};
use farfield_node::process::{NodeError, say};
use farfield_proto::key::is_key_chunk;
use farfield_proto::transport::{FUSION, GENERATIONS_FILE, Generations, READER, RECORDER};
use farfield_proto::venue::Venue;

use authority::{Authority, Bearer, NodeRole, Pair};
use files::{Folder, Old, write_together};

use crate::exchange::target::check_folder;

/// Arguments of `farfield certs`.
#[derive(Debug, Args)]
pub(crate) struct CertsArgs {
    /// The venue file.
    pub(crate) venue: PathBuf,
    /// Folder for the keys.
    ///
    /// The venue file contains it as `[security] certificates`.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Another name or address of fusion's machine.
    ///
    /// In addition to the hosts of the venue's endpoints.
    #[arg(long, value_name = "NAME|IP")]
    pub(crate) host: Vec<String>,
    /// Also create a key for a reader of poses.
    #[arg(long, value_name = "NAME")]
    pub(crate) node: Vec<String>,
    /// Replace the key of this node, or add a new one.
    #[arg(long, value_name = "NODE")]
    pub(crate) renew: Vec<String>,
    /// Folder of the authority's private key, `ca.key`.
    ///
    /// It belongs to no node. Default: that of `--out` with `-authority` appended.
    #[arg(long, value_name = "DIR")]
    pub(crate) authority: Option<PathBuf>,
    /// Validity of the certificates in days.
    ///
    /// For the nodes; the certificate of the authority is valid five times as long.
    #[arg(long, value_name = "N", default_value_t = 825, value_parser = clap::value_parser!(u32).range(1..=7300))]
    pub(crate) days: u32,
}

/// Creates or renews the keys.
///
/// # Errors
/// When the venue, a name or a host is wrong, a file already exists, or one cannot be written.
pub(crate) fn certs(args: &CertsArgs) -> Result<(), NodeError> {
    make(args).map_err(NodeError::Refused)
}

fn make(args: &CertsArgs) -> anyhow::Result<()> {
    let venue = load_venue(&args.venue)?;
    check_folder("--out", &args.out)?;
    check_folder("--authority", &folder_of_authority(args))?;
    let bearers = bearers(&venue, args)?;
    let folder = Folder::new(&args.out);
    let keys_of_authority = folder_of_authority(args);
    let mut generations = Generations::default();
    if args.renew.is_empty() {
        let authority = Authority::new(&venue.name, args.days)?;
        let readme = files::readme(&venue, &bearers);
        create(
            [&folder, &Folder::new(&keys_of_authority)],
            &authority,
            &bearers,
            &mut generations,
            &readme,
        )?;
    } else {
        let authority = read_authority(&args.out, &keys_of_authority, &venue.name)?;
        generations = generations::known(&args.out, &venue.name)?;
        let mut issue = |bearer: &Bearer| {
            let generation = generations.renew(&bearer.node);
            authority.issue(&venue.name, bearer, generation, args.days)
        };
        let pairs: Vec<Pair> = bearers.iter().map(&mut issue).collect::<Result<_, _>>()?;
        let newest = generations.to_toml(&venue.name);
        let renewed = bearers.iter().zip(&pairs);
        let mut files: Vec<_> = renewed
            .flat_map(|(bearer, pair)| folder.pair(&bearer.node, pair))
            .collect();
        files.push(folder.public(GENERATIONS_FILE, &newest));
        write_together(&files, Old::Replaced)?;
    }
    for bearer in &bearers {
        say(format_args!(
            "{}: {}, generation {}",
            bearer.node,
            args.out.join(format!("{}.pem", bearer.node)).display(),
            generations.of(&bearer.node)
        ));
    }
    if args.renew.is_empty() {
        let key = keys_of_authority.join(AUTHORITY_KEY);
        say(format_args!(
            "{} creates new keys for this venue: keep it away from the nodes; {} describes the files",
            key.display(),
            args.out.join("README.txt").display()
        ));
    } else {
        let is_fusion = bearers.iter().any(|bearer| bearer.node == FUSION);
        let machines = if is_fusion {
            "every machine"
        } else {
            "fusion's machine"
        };
        say(format_args!(
            "older keys of these nodes are refused as soon as {} is next to ca.pem on {machines} and that node was restarted",
            args.out.join(GENERATIONS_FILE).display()
        ));
        if bearers.iter().any(|it| it.role == NodeRole::Reader) {
            say(format_args!(
                "this includes the keys of all readers that were created by a release without generations: they share one name; renew them, too"
            ));
        }
    }
    Ok(())
}

/// The folder of the authority's key: separate from those of the nodes, unless an earlier release has put it there.
fn folder_of_authority(args: &CertsArgs) -> PathBuf {
    if let Some(folder) = &args.authority {
        return folder.clone();
    }
    let is_among_keys = !args.renew.is_empty() && args.out.join(AUTHORITY_KEY).is_file();
    // `.` has no name of its own.
    let out = match args.out.file_name() {
        Some(_) => args.out.clone(),
        None => std::fs::canonicalize(&args.out).unwrap_or_else(|_| args.out.clone()),
    };
    let name = out.file_name().filter(|_| !is_among_keys);
    name.map_or_else(
        || args.out.clone(),
        |name| {
            let mut name = name.to_owned();
            name.push("-authority");
            out.with_file_name(name)
        },
    )
}

/// The nodes that get a key now.
fn bearers(venue: &Venue, args: &CertsArgs) -> anyhow::Result<Vec<Bearer>> {
    let viewpoints: Vec<&str> = venue.viewpoints.iter().map(|v| v.name.as_str()).collect();
    let mut seen = BTreeSet::new();
    for name in &args.node {
        let is_taken = viewpoints.contains(&name.as_str())
            || [FUSION, READER, RECORDER, "ca"].contains(&name.as_str());
        ensure!(
            is_key_chunk(name) && !is_taken && seen.insert(name),
            "`--node`: found `{name}`, expected a name that no other node has, of up to 64 ASCII letters, digits, `-`, `_` or `.`"
        );
    }
    check_renewed_options(args)?;
    let mut hosts = authority::hosts_of_fusion(venue, &args.host)?;
    if args.renew.iter().any(|node| node == FUSION) {
        hosts = authority::with_current_hosts(hosts, &args.out, &venue.name);
    }
    let mut all = vec![Bearer::fusion(hosts)];
    all.extend(viewpoints.iter().map(|name| Bearer::edge(name)));
    all.push(Bearer::recorder());
    all.extend(args.node.iter().map(|name| Bearer::reader(name)));
    if args.renew.is_empty() {
        return Ok(all);
    }
    let mut renewed = Vec::new();
    let names: BTreeSet<&String> = args.renew.iter().collect();
    for name in names {
        let known = all.iter().find(|bearer| bearer.node == *name);
        let known = known
            .cloned()
            .or_else(|| is_reader(&args.out, name).then(|| Bearer::reader(name)));
        renewed.push(known.ok_or_else(|| {
            anyhow!(
                "`--renew`: found `{name}`, expected {FUSION}, a viewpoint ({}), or the name of a reader's certificate",
                viewpoints.join(", ")
            )
        })?);
    }
    Ok(renewed)
}

/// Refuses options for nodes that are not renewed.
fn check_renewed_options(args: &CertsArgs) -> anyhow::Result<()> {
    if args.renew.is_empty() {
        return Ok(());
    }
    let is_renewed = |name: &str| args.renew.iter().any(|node| node == name);
    if let Some(name) = args.node.iter().find(|name| !is_renewed(name)) {
        bail!("`--node {name}`: to add a key to existing ones use `--renew {name} --node {name}`");
    }
    ensure!(
        args.host.is_empty() || is_renewed(FUSION),
        "`--host`: it belongs to fusion's certificate: add `--renew {FUSION}`"
    );
    Ok(())
}

/// A certificate of neither fusion nor a viewpoint belongs to a reader.
fn is_reader(out: &Path, name: &str) -> bool {
    is_key_chunk(name) && name != "ca" && out.join(format!("{name}.pem")).is_file()
}

/// Creates all keys with their next generations, the authority's in the folder `apart`; or none.
fn create(
    [folder, apart]: [&Folder; 2],
    authority: &Authority,
    bearers: &[Bearer],
    generations: &mut Generations,
    readme: &str,
) -> anyhow::Result<()> {
    let names = [files::AUTHORITY, "README.txt", GENERATIONS_FILE];
    let mut names = names.map(str::to_owned).to_vec();
    for bearer in bearers {
        names.extend([
            format!("{}.pem", bearer.node),
            format!("{}.key", bearer.node),
        ]);
    }
    folder.check_free(&names)?;
    apart.check_free(&[AUTHORITY_KEY.to_owned()])?;
    folder.make()?;
    apart.make_secret()?;
    // All keys are generated before the first is written.
    let (certificate, key) = (authority.certificate(), authority.key());
    let pairs: Vec<Pair> = bearers
        .iter()
        .map(|bearer| {
            let generation = generations.renew(&bearer.node);
            authority.issue(&authority.venue, bearer, generation, authority.days)
        })
        .collect::<Result<_, _>>()?;
    let newest = generations.to_toml(&authority.venue);
    let mut all = vec![
        folder.public(files::AUTHORITY, &certificate),
        apart.secret(AUTHORITY_KEY, &key),
        folder.public("README.txt", readme),
        folder.public(GENERATIONS_FILE, &newest),
    ];
    for (bearer, pair) in bearers.iter().zip(&pairs) {
        all.extend(folder.pair(&bearer.node, pair));
    }
    write_together(&all, Old::None)
}

/// The authority whose certificate is in the folder `out`. It must belong to `venue` and match its private key, or
/// every key issued would be useless.
fn read_authority(out: &Path, keys_of_authority: &Path, venue: &str) -> anyhow::Result<Authority> {
    let path = out.join(files::AUTHORITY);
    let certificate = Folder::new(out).read(files::AUTHORITY)?;
    let (found, expected) = (common_name_in(&path)?, authority::name_of(venue));
    ensure!(
        found == expected,
        "{}: found the certificate of `{found}`, expected that of `{expected}`: set the folder of this venue's keys with --out; a renamed venue needs new keys in another folder",
        path.display()
    );
    let key = Folder::new(keys_of_authority)
        .read(AUTHORITY_KEY)
        .context("the authority's key is needed; set its folder with --authority DIR")?;
    let authority = Authority::read(&certificate, &key)?;
    ensure!(
        authority.public_key() == public_key_in(&path)?,
        "{}: found a key that does not belong to {}: set the right folder with --authority",
        keys_of_authority.join(AUTHORITY_KEY).display(),
        path.display()
    );
    Ok(authority)
}

#[cfg(test)]
mod tests;
