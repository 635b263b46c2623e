//! What stands beside the keys: which file goes where.

use farfield_proto::venue::Venue;

use super::authority::{Bearer, NodeRole};

/// The text of the folder's README.
pub(super) fn text(venue: &Venue, bearers: &[Bearer]) -> String {
    let head = format!(
        "Keys of the venue \"{}\", made by `farfield certs`.\n\n\
         Each node gets ca.pem, generations.toml and the two files with its own name, in the folder\n\
         that the venue file names as `[security] certificates`. No node needs another node's .key.\n\n",
        venue.name
    );
    let line = |Bearer { node, role }: &Bearer| {
        let (who, what) = match role {
            NodeRole::Fusion(hosts) => {
                ("the fusion node", format!("good for {}", hosts.join(", ")))
            }
            NodeRole::Edge => (
                "an edge",
                format!("publishes as {node} only, hears its own boxes"),
            ),
            NodeRole::Recorder => (
                "`farfield record`",
                "hears everything, publishes nothing".to_owned(),
            ),
            NodeRole::Reader => (
                "whoever only listens",
                "hears poses and statuses, publishes nothing".to_owned(),
            ),
        };
        format!("{node}.pem, {node}.key: {who}; {what}\n")
    };
    let lines: String = bearers.iter().map(line).collect();
    let foot = "\nca.key makes new keys for this venue. Keep it apart from all nodes, offline if you can;\n\
         only `farfield certs VENUE --out DIR --renew NODE` needs it (`--authority DIR` says where it is).\n\
         If a node's key has come into other hands: `--renew NODE`, give that node its new files,\n\
         copy generations.toml to fusion's machine (after `--renew fusion` to all machines), and start\n\
         fusion again: the old key is refused from then on. If fusion is to be reached by another name:\n\
         `--renew fusion --host NAME`; the names that its key has now stay.\n";
    head + &lines + foot
}
