//! Poses as JSON: the messages of the `websocket` stream on one key, and each person on separate
//! keys.

use std::collections::BTreeSet;

use farfield_proto::id::PersonId;
use farfield_proto::key::is_key_chunk;
use zenoh::bytes::Encoding;
use zenoh::qos::CongestionControl;
use zenoh::{Session, Wait as _};

use super::Publish;
use crate::frame::{Frame, PersonFrame};
use crate::websocket::{message, message_of_person};

/// Prefix of all keys of a venue. Keys of nodes begin with the venue's name, so `farfield/` avoids
/// conflicts.
fn root(venue: &str) -> String {
    // Venue names in venue files are checked; other callers may use invalid ones.
    let venue = if is_key_chunk(venue) { venue } else { "venue" };
    format!("farfield/{venue}")
}

/// The key for all people together.
fn key(venue: &str) -> String {
    format!("{}/poses", root(venue))
}

/// The keys of one person: by id, and by name if it has one.
fn person_keys(root: &str, person: &PersonFrame) -> Vec<String> {
    let id = person.id;
    let mut keys = vec![format!("{root}/person/{id}")];
    if *person.name != *format!("person_{id}") {
        keys.push(format!("{root}/name/{}", name_chunk(&person.name, id)));
    }
    keys
}

/// Converts a name to a part of a key. Invalid characters become `_`; then the id is appended,
/// since different names could become equal.
fn name_chunk(name: &str, id: PersonId) -> String {
    let is_refused = |c: char| "/*$?#@".contains(c) || c.is_whitespace() || c.is_control();
    let chunk: String = name
        .chars()
        .map(|c| if is_refused(c) { '_' } else { c })
        .collect();
    if chunk == name {
        chunk
    } else {
        format!("{chunk}_{id}")
    }
}

pub(super) struct Publisher<'a> {
    session: &'a Session,
    all: zenoh::pubsub::Publisher<'a>,
    root: String,
    /// Keys that were published and not deleted since.
    published: BTreeSet<String>,
}

impl<'a> Publisher<'a> {
    pub(super) fn new(session: &'a Session, venue: &str) -> zenoh::Result<Self> {
        let all = session
            .declare_publisher(key(venue))
            .encoding(Encoding::APPLICATION_JSON)
            .congestion_control(CongestionControl::Drop)
            .express(true)
            .wait()?;
        Ok(Self {
            session,
            all,
            root: root(venue),
            published: BTreeSet::new(),
        })
    }

    fn publish_each(&mut self, frame: &Frame) -> zenoh::Result<()> {
        let mut current = BTreeSet::new();
        for person in frame.confirmed() {
            let text = message_of_person(frame, person);
            for key in person_keys(&self.root, person) {
                if current.contains(&key) {
                    continue;
                }
                // Recorded before publishing, so that the key is deleted even if a later step
                // fails.
                self.published.insert(key.clone());
                let put = self.session.put(&key, text.as_str());
                let put = put.encoding(Encoding::APPLICATION_JSON);
                put.congestion_control(CongestionControl::Drop)
                    .express(true)
                    .wait()?;
                current.insert(key);
            }
        }
        self.delete_all_but(&current)
    }

    /// Deletes keys of people who left or were renamed, so that receivers remove their figures.
    fn delete_all_but(&mut self, current: &BTreeSet<String>) -> zenoh::Result<()> {
        let gone: Vec<String> = self.published.difference(current).cloned().collect();
        for key in gone {
            let delete = self.session.delete(&key);
            // Sent only once; a lost message would leave the figure forever.
            delete
                .congestion_control(CongestionControl::Block)
                .express(true)
                .wait()?;
            self.published.remove(&key);
        }
        Ok(())
    }
}

impl Publish for Publisher<'_> {
    fn publish(&mut self, frame: &Frame) -> zenoh::Result<()> {
        self.all.put(message(frame)).wait()?;
        self.publish_each(frame)
    }

    fn end(&mut self) -> zenoh::Result<()> {
        self.delete_all_but(&BTreeSet::new())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic;

    #[test]
    fn people_have_a_key_by_id_and_one_by_name() {
        let frame = synthetic::frame(120);
        let keys: Vec<String> = frame
            .persons
            .iter()
            .flat_map(|person| person_keys(&root("hall"), person))
            .collect();
        assert!(
            keys.contains(&"farfield/hall/person/1".to_owned()),
            "{keys:?}"
        );
        let named = keys.iter().filter(|key| key.contains("/name/"));
        assert_eq!(named.count(), 1, "{keys:?}");
    }

    /// Regression: figures remained in a game engine after the stream ended, since their keys were
    /// not deleted.
    #[test]
    fn all_keys_are_deleted_when_the_stream_ends() {
        let free = std::net::TcpListener::bind("127.0.0.1:0").and_then(|it| it.local_addr());
        let address = free.unwrap();
        let open = |mode, way| {
            let config = super::super::config(mode, way, address).unwrap();
            zenoh::open(config).wait().unwrap()
        };
        let (session, engine) = (open("peer", "listen"), open("client", "connect"));
        let (received, samples) = std::sync::mpsc::channel();
        let subscriber = engine.declare_subscriber("farfield/*/*/*");
        let subscriber = subscriber.callback(move |sample| {
            let sample = (sample.key_expr().to_string(), sample.kind());
            received.send(sample).unwrap_or_default();
        });
        let _subscriber = subscriber.wait().unwrap();
        let soon = std::time::Duration::from_secs(10);
        let mut publisher = Publisher::new(&session, "hall").unwrap();
        let mut published = BTreeSet::new();
        // Repeat until the receiver is known to be subscribed; then all ids and a name have
        // arrived.
        for tick in 120.. {
            let frame = synthetic::frame(tick);
            let n_keys = frame.persons.len() + 1;
            publisher.publish(&frame).unwrap();
            let pause = std::time::Duration::from_millis(20);
            while let Ok((key, _)) = samples.recv_timeout(pause) {
                published.insert(key);
            }
            assert!(tick < 720, "nothing comes");
            if published.len() >= n_keys {
                break;
            }
        }
        publisher.end().unwrap();
        drop(publisher);
        session.close().wait().unwrap();
        while !published.is_empty() {
            let (key, kind) = samples.recv_timeout(soon).unwrap();
            if kind == zenoh::sample::SampleKind::Delete {
                assert!(published.remove(&key), "{key} was deleted twice");
            }
        }
    }

    #[test]
    fn names_become_unique_valid_key_chunks() {
        let chunk = |name| name_chunk(name, PersonId(3));
        assert_eq!(chunk("Žofia"), "Žofia");
        assert_eq!(chunk("Anna B"), "Anna_B_3");
        assert_eq!(chunk("a/**"), "a____3");
        assert_eq!(chunk("Anna_B"), "Anna_B");
        for name in ["$*", "?", "a#b", "@x", "\u{2028}"] {
            let key = format!("farfield/hall/name/{}", chunk(name));
            assert!(zenoh::key_expr::KeyExpr::new(key).is_ok(), "{name}");
        }
    }
}
