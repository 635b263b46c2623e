//! Poses as JSON: the messages of the stream `websocket` on one key, and each person on keys of its own.

use std::collections::BTreeSet;

use farfield_proto::id::PersonId;
use farfield_proto::key::is_key_chunk;
use zenoh::bytes::Encoding;
use zenoh::qos::CongestionControl;
use zenoh::{Session, Wait as _};

use super::Publish;
use crate::frame::{Frame, PersonFrame};
use crate::websocket::{message, message_of_person};

/// What all keys of a venue begin with. Nodes' own keys begin with the venue's name: `farfield/` stands before these.
fn root(venue: &str) -> String {
    // Names of venues are checked; who streams otherwise may have others.
    let venue = if is_key_chunk(venue) { venue } else { "venue" };
    format!("farfield/{venue}")
}

/// The key of the poses of all.
fn key(venue: &str) -> String {
    format!("{}/poses", root(venue))
}

/// The keys of one person: by the id, and by the name where there is one.
fn keys_of(root: &str, person: &PersonFrame) -> Vec<String> {
    let id = person.id;
    let mut keys = vec![format!("{root}/person/{id}")];
    if *person.name != *format!("person_{id}") {
        keys.push(format!("{root}/name/{}", chunk_of(&person.name, id)));
    }
    keys
}

/// A name as a part of a key: what cannot stand there becomes `_`, and the id follows then: names of people differ, and two could
/// be written alike by that.
fn chunk_of(name: &str, id: PersonId) -> String {
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
    /// The keys that were put and not deleted since.
    there: BTreeSet<String>,
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
            there: BTreeSet::new(),
        })
    }

    fn publish_each(&mut self, frame: &Frame) -> zenoh::Result<()> {
        let mut now = BTreeSet::new();
        for person in frame.confirmed() {
            let text = message_of_person(frame, person);
            for key in keys_of(&self.root, person) {
                if now.contains(&key) {
                    continue;
                }
                // Before it is said: what comes after it may fail, and it is to be deleted all the same.
                self.there.insert(key.clone());
                let put = self.session.put(&key, text.as_str());
                let put = put.encoding(Encoding::APPLICATION_JSON);
                put.congestion_control(CongestionControl::Drop)
                    .express(true)
                    .wait()?;
                now.insert(key);
            }
        }
        self.delete_all_but(&now)
    }

    /// Who has gone, or is called otherwise, is deleted: an engine takes the figure away.
    fn delete_all_but(&mut self, now: &BTreeSet<String>) -> zenoh::Result<()> {
        let gone: Vec<String> = self.there.difference(now).cloned().collect();
        for key in gone {
            let delete = self.session.delete(&key);
            // It is said once: what is lost stays for ever.
            delete
                .congestion_control(CongestionControl::Block)
                .express(true)
                .wait()?;
            self.there.remove(&key);
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
    fn a_person_has_a_key_by_id_and_one_by_name() {
        let frame = synthetic::frame(120);
        let keys: Vec<String> = frame
            .persons
            .iter()
            .flat_map(|person| keys_of(&root("hall"), person))
            .collect();
        assert!(
            keys.contains(&"farfield/hall/person/1".to_owned()),
            "{keys:?}"
        );
        let named = keys.iter().filter(|key| key.contains("/name/"));
        assert_eq!(named.count(), 1, "{keys:?}");
    }

    /// Once figures stood for ever in an engine whose stream had ended, since nobody said that they were gone.
    #[test]
    fn all_keys_are_deleted_when_the_stream_ends() {
        let free = std::net::TcpListener::bind("127.0.0.1:0").and_then(|it| it.local_addr());
        let address = free.unwrap();
        let open = |mode, way| {
            let config = super::super::config(mode, way, address).unwrap();
            zenoh::open(config).wait().unwrap()
        };
        let (session, engine) = (open("peer", "listen"), open("client", "connect"));
        let (heard, samples) = std::sync::mpsc::channel();
        let subscriber = engine.declare_subscriber("farfield/*/*/*");
        let subscriber = subscriber.callback(move |sample| {
            let said = (sample.key_expr().to_string(), sample.kind());
            heard.send(said).unwrap_or_default();
        });
        let _subscriber = subscriber.wait().unwrap();
        let soon = std::time::Duration::from_secs(10);
        let mut publisher = Publisher::new(&session, "hall").unwrap();
        let mut there = BTreeSet::new();
        // Until the engine is known to listen; ids and a name then.
        for tick in 120.. {
            let frame = synthetic::frame(tick);
            let n_keys = frame.persons.len() + 1;
            publisher.publish(&frame).unwrap();
            let pause = std::time::Duration::from_millis(20);
            while let Ok((key, _)) = samples.recv_timeout(pause) {
                there.insert(key);
            }
            assert!(tick < 720, "nothing comes");
            if there.len() >= n_keys {
                break;
            }
        }
        publisher.end().unwrap();
        drop(publisher);
        session.close().wait().unwrap();
        while !there.is_empty() {
            let (key, kind) = samples.recv_timeout(soon).unwrap();
            if kind == zenoh::sample::SampleKind::Delete {
                assert!(there.remove(&key), "{key} was deleted twice");
            }
        }
    }

    #[test]
    fn a_name_is_one_part_of_a_key_and_nobody_elses() {
        let of = |name| chunk_of(name, PersonId(3));
        assert_eq!(of("Žofia"), "Žofia");
        assert_eq!(of("Anna B"), "Anna_B_3");
        assert_eq!(of("a/**"), "a____3");
        assert_eq!(of("Anna_B"), "Anna_B");
        for name in ["$*", "?", "a#b", "@x", "\u{2028}"] {
            let key = format!("farfield/hall/name/{}", of(name));
            assert!(zenoh::key_expr::KeyExpr::new(key).is_ok(), "{name}");
        }
    }
}
