//! Requests of inlets: one at the start of a TCP connection, and datagrams.

use super::{OLD_VERSION, VERSION};

/// Maximum size of a TCP request, bytes.
const MAX_HEAD: usize = 16 * 1024;
/// Maximum length of a query id.
const MAX_ID: usize = 64;

/// A TCP request of an inlet.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Request {
    /// The description of the stream, if it matches a query.
    ShortInfo(String),
    /// The description of the stream and its channels.
    FullInfo,
    /// The samples.
    Feed(FeedRequest),
}

/// Options of a request for samples.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FeedRequest {
    /// Requested protocol version, hundredths.
    version: u32,
    /// Id of the requested outlet; empty for any.
    uid: String,
    /// Requested version of the samples, hundredths.
    data_version: u32,
    /// Whether the inlet uses IEEE 754 numbers of 4 bytes.
    has_our_floats: bool,
    /// Whether the inlet supports subnormal numbers.
    has_subnormals: bool,
}

/// The answer to a [`FeedRequest`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Answer {
    /// Header before the samples.
    pub head: Vec<u8>,
    /// Version of the samples, hundredths; `None` for no samples.
    pub data_version: Option<u32>,
}

/// Why bytes are not a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum RequestError {
    /// Too long.
    #[error("found a request of more than {MAX_HEAD} bytes")]
    TooLong,
    /// Another protocol.
    #[error("found another request than LSL:streamfeed, LSL:fullinfo or LSL:shortinfo")]
    Unknown,
}

/// Bytes of a connection until they form a request.
#[derive(Debug, Clone, Default)]
pub struct Incoming(Vec<u8>);

impl Incoming {
    /// Adds received bytes and returns the request when complete.
    ///
    /// # Errors
    /// [`RequestError`]; the connection is unusable then.
    pub fn push(&mut self, bytes: &[u8]) -> Result<Option<Request>, RequestError> {
        let room = MAX_HEAD.saturating_sub(self.0.len());
        let (taken, left) = bytes.split_at_checked(room).unwrap_or((bytes, &[]));
        self.0.extend_from_slice(taken);
        match parse(&String::from_utf8_lossy(&self.0)) {
            Ok(None) if !left.is_empty() || self.0.len() == MAX_HEAD => Err(RequestError::TooLong),
            parsed => parsed,
        }
    }
}

fn parse(text: &str) -> Result<Option<Request>, RequestError> {
    let Some((method, rest)) = text.split_once('\n') else {
        return Ok(None);
    };
    let line = || {
        rest.split_once('\n')
            .map(|(line, _)| line.trim().to_owned())
    };
    let method = method.trim();
    let request = match method.strip_prefix("LSL:").unwrap_or_default() {
        "fullinfo" => Some(Request::FullInfo),
        "shortinfo" => line().map(Request::ShortInfo),
        // The requested number of samples to buffer is ignored, since none are buffered.
        "streamfeed" => line().map(|_| Request::Feed(FeedRequest::old())),
        other => {
            let version = other.strip_prefix("streamfeed/");
            let version = version.ok_or(RequestError::Unknown)?;
            feed(version, rest).map(Request::Feed)
        }
    };
    Ok(request)
}

/// Parses a request whose first line ends with `version` and whose lines end with an empty one.
fn feed(version: &str, lines: &str) -> Option<FeedRequest> {
    let (version, uid) = version.split_once([' ', '\t']).unwrap_or((version, ""));
    let version = version.trim().parse().unwrap_or(u32::MAX);
    let mut feed = FeedRequest {
        version,
        uid: uid.trim().to_ascii_lowercase(),
        data_version: version,
        ..FeedRequest::old()
    };
    let mut rest = lines;
    loop {
        let (line, after) = rest.split_once('\n')?;
        if line.trim().is_empty() {
            return Some(feed);
        }
        rest = after;
        let line = line.split(';').next().unwrap_or_default();
        let Some((name, value)) = line.split_once(':') else {
            continue;
        };
        let (name, value) = (name.trim().to_ascii_lowercase(), value.trim());
        let is_true = || matches!(value.to_ascii_lowercase().as_str(), "1" | "true");
        match name.as_str() {
            "has-ieee754-floats" => feed.has_our_floats &= is_true(),
            "value-size" => feed.has_our_floats &= value == "4",
            "supports-subnormals" => feed.has_subnormals = is_true(),
            "data-protocol-version" | "protocol-version" => {
                feed.data_version = value.parse().unwrap_or(OLD_VERSION);
            }
            // Byte orders too: ours is announced, and the inlet converts.
            _ => {}
        }
    }
}

impl FeedRequest {
    /// A request of the first version, which has no options.
    fn old() -> Self {
        Self {
            version: OLD_VERSION,
            uid: String::new(),
            data_version: OLD_VERSION,
            has_our_floats: true,
            has_subnormals: true,
        }
    }

    /// The answer of the outlet `uid`.
    pub fn answer(&self, uid: &str) -> Answer {
        let refused = |why: &str| Answer {
            head: format!("LSL/{VERSION} {why}\r\n\r\n").into_bytes(),
            data_version: None,
        };
        if self.version / 100 > VERSION / 100 {
            return refused("505 Version not supported");
        }
        if !self.uid.is_empty() && self.uid != uid {
            return refused("404 Not found");
        }
        let data_version = if self.has_our_floats && self.data_version >= VERSION {
            VERSION
        } else {
            OLD_VERSION
        };
        // A request of the first version expects the samples immediately.
        let head = if self.version < VERSION {
            String::new()
        } else {
            let order = if data_version == VERSION { 1234 } else { 0 };
            let is_without = data_version == VERSION && !self.has_subnormals;
            format!(
                "LSL/{VERSION} 200 OK\r\nUID: {uid}\r\nByte-Order: {order}\r\nSuppress-Subnormals: {}\r\nData-Protocol-Version: {data_version}\r\n\r\n",
                u8::from(is_without)
            )
        };
        Answer {
            head: head.into_bytes(),
            data_version: Some(data_version),
        }
    }
}

/// A UDP request of an inlet.
#[derive(Debug, Clone, PartialEq)]
pub enum Datagram<'a> {
    /// The description of the stream, if it matches the query.
    ShortInfo {
        /// The query.
        query: &'a str,
        /// Port of the reply, at the sender's address.
        return_port: u16,
        /// Id to repeat in the reply.
        id: &'a str,
    },
    /// The outlet's clock.
    TimeData {
        /// Id to repeat in the reply.
        wave: i64,
        /// Time of the inlet's clock, seconds.
        t0_s: f64,
    },
}

impl<'a> Datagram<'a> {
    /// Parses a datagram; `None` if unknown.
    pub fn parse(bytes: &'a [u8]) -> Option<Self> {
        let mut lines = std::str::from_utf8(bytes).ok()?.lines();
        let method = lines.next()?.trim();
        let line = lines.next()?.trim();
        match method {
            "LSL:shortinfo" => {
                let mut words = lines.next()?.split_whitespace();
                let return_port = words.next()?.parse().ok().filter(|port| *port != 0)?;
                let is_id =
                    |id: &&str| id.len() <= MAX_ID && id.bytes().all(|b| b.is_ascii_graphic());
                let id = words.next().unwrap_or_default();
                Some(Self::ShortInfo {
                    query: line,
                    return_port,
                    id: Some(id).filter(is_id)?,
                })
            }
            "LSL:timedata" => {
                let mut words = line.split_whitespace();
                let wave = words.next()?.parse().ok()?;
                let t0_s: f64 = words.next()?.parse().ok()?;
                t0_s.is_finite().then_some(Self::TimeData { wave, t0_s })
            }
            _ => None,
        }
    }
}

/// The reply to [`Datagram::TimeData`] with the times of arrival and departure, seconds of the
/// outlet's clock.
pub fn time_answer(wave: i64, t0_s: f64, [came_s, leaves_s]: [f64; 2]) -> String {
    // In C++ format: `{:?}` uses exponents for very large numbers, and all numbers read back
    // exactly.
    format!(" {wave} {t0_s:?} {came_s:?} {leaves_s:?}")
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const UID: &str = "01234567-89ab-cdef-0123-456789abcdef";

    fn request(text: &str) -> Result<Option<Request>, RequestError> {
        Incoming::default().push(text.as_bytes())
    }

    fn answer(text: &str) -> (String, Option<u32>) {
        match request(text) {
            Ok(Some(Request::Feed(feed))) => {
                let answer = feed.answer(UID);
                (String::from_utf8(answer.head).unwrap(), answer.data_version)
            }
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn current_inlets_get_the_current_version() {
        let text = format!(
            "LSL:streamfeed/110 {UID}\r\nNative-Byte-Order: 1234\r\nHas-IEEE754-Floats: 1\r\nSupports-Subnormals: 1\r\nValue-Size: 4\r\n\
             Data-Protocol-Version: 110\r\nMax-Buffer-Length: 360\r\nMax-Chunk-Length: 0\r\nHostname: lab\r\nSource-Id: \r\nSession-Id: default\r\n\r\n"
        );
        let (head, version) = answer(&text);
        assert_eq!(version, Some(110));
        assert_eq!(
            head,
            format!(
                "LSL/110 200 OK\r\nUID: {UID}\r\nByte-Order: 1234\r\nSuppress-Subnormals: 0\r\nData-Protocol-Version: 110\r\n\r\n"
            )
        );
        let (head, _) =
            answer(&text.replace("Supports-Subnormals: 1", "supports-subnormals: 0 ; none"));
        assert!(head.contains("Suppress-Subnormals: 1"), "{head}");
        let (head, version) = answer(&text.replace("Value-Size: 4", "Value-Size: 8"));
        assert_eq!(version, Some(100));
        assert!(head.contains("Data-Protocol-Version: 100"), "{head}");
    }

    #[test]
    fn inlets_of_the_first_version_get_samples_immediately() {
        assert_eq!(
            answer("LSL:streamfeed\r\n360 0\r\n"),
            (String::new(), Some(100))
        );
    }

    #[test]
    fn unknown_streams_and_later_protocols_are_refused() {
        let (head, version) = answer("LSL:streamfeed/110 another\r\n\r\n");
        assert_eq!(
            (head.as_str(), version),
            ("LSL/110 404 Not found\r\n\r\n", None)
        );
        let (head, version) = answer("LSL:streamfeed/200\r\n\r\n");
        assert_eq!(
            (head.as_str(), version),
            ("LSL/110 505 Version not supported\r\n\r\n", None)
        );
    }

    #[test]
    fn requests_may_arrive_in_pieces() {
        let text = "LSL:shortinfo\r\nsession_id='default'\r\n";
        let mut incoming = Incoming::default();
        for byte in &text.as_bytes()[..text.len() - 1] {
            assert_eq!(incoming.push(&[*byte]), Ok(None));
        }
        let first = incoming.push(b"\n").unwrap().unwrap();
        assert_eq!(first, Request::ShortInfo("session_id='default'".to_owned()));
        assert_eq!(request("LSL:fullinfo\r\n"), Ok(Some(Request::FullInfo)));
    }

    #[test]
    fn invalid_requests_are_errors() {
        assert_eq!(request("GET / HTTP/1.1\r\n"), Err(RequestError::Unknown));
        assert_eq!(
            request("LSL:timedata\r\n1 2\r\n"),
            Err(RequestError::Unknown)
        );
        let endless = format!("LSL:streamfeed/110\r\n{}", "a: b\r\n".repeat(10_000));
        assert_eq!(request(&endless), Err(RequestError::TooLong));
        assert_eq!(request(&"x".repeat(MAX_HEAD)), Err(RequestError::TooLong));
    }

    #[test]
    fn datagrams_query_streams_and_the_time() {
        let query = b"LSL:shortinfo\r\nsession_id='default' and type='MoCap'\r\n16573 2558488061587787625\r\n";
        assert_eq!(
            Datagram::parse(query),
            Some(Datagram::ShortInfo {
                query: "session_id='default' and type='MoCap'",
                return_port: 16573,
                id: "2558488061587787625",
            })
        );
        let time = Datagram::parse(b"LSL:timedata\r\n-7 74628.778050646\r\n");
        assert_eq!(
            time,
            Some(Datagram::TimeData {
                wave: -7,
                t0_s: 74_628.778_050_646
            })
        );
        assert_eq!(time_answer(-7, 1.5, [2.25, 3.0]), " -7 1.5 2.25 3.0");
        for nothing in [
            &b"LSL:shortinfo\r\n\r\n0 1\r\n"[..],
            b"LSL:shortinfo\r\n\r\n70000 1\r\n",
            b"LSL:timedata\r\n1 nan\r\n",
            b"LSL:fullinfo\r\n\r\n",
            b"\xff\xfe",
            b"",
        ] {
            assert_eq!(Datagram::parse(nothing), None);
        }
    }

    proptest! {
        #[test]
        fn arbitrary_requests_are_parsed_or_refused(
            pieces in proptest::collection::vec("(LSL:streamfeed/110|[ -~]{0,9}|\r\n)", 0..20),
        ) {
            let mut incoming = Incoming::default();
            for piece in &pieces {
                if let Ok(Some(Request::Feed(feed))) = incoming.push(piece.as_bytes()) {
                    feed.answer(UID);
                }
            }
            Datagram::parse(pieces.concat().as_bytes());
        }
    }
}
