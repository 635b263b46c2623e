//! Commands of clients, case-insensitive.

use std::net::IpAddr;

use super::Version;

/// Maximum number of words of a command: all components, and their rate.
const MAX_WORDS: usize = 64;

/// A command.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Command {
    /// Query the protocol version, or select one.
    Version(Option<Version>),
    /// Query the program.
    QtmVersion,
    /// Query the byte order.
    ByteOrder,
    /// Check the licence; always valid here.
    CheckLicense,
    /// Query the last event.
    GetState,
    /// Query settings as XML.
    GetParameters(Vec<Topic>),
    /// Query the newest frame.
    GetCurrentFrame(Components),
    /// Stream frames from now on.
    StreamFrames {
        /// Which frames.
        rate: Rate,
        /// Target of UDP; `None` for this connection. Without an address the client's own is used.
        udp: Option<(Option<IpAddr>, u16)>,
        /// Which components.
        components: Components,
    },
    /// Stop streaming.
    StopStreaming,
    /// Close the connection.
    Quit,
    /// Control of cameras, measurements or files.
    Control,
}

/// Requested parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Topic {
    /// Rate and processing.
    General,
    /// Labels of markers.
    Markers,
    /// Rigid bodies.
    Bodies,
    /// Skeletons: segments relative to their parents, or in the world.
    Skeletons {
        /// Whether in the world.
        global: bool,
    },
    /// Force plates; there are none.
    Force,
    /// Other topics without data.
    Nothing,
}

/// Which frames are streamed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rate {
    /// All.
    All,
    /// Every n-th.
    Divisor(u32),
    /// Frames per second.
    Hz(u32),
}

/// One component of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Component {
    /// Joints as labelled markers.
    Markers {
        /// With residuals.
        residual: bool,
    },
    /// Unlabelled markers; there are none.
    Unlabelled {
        /// With residuals.
        residual: bool,
    },
    /// Pelvises as rigid bodies.
    Bodies {
        /// Angles instead of matrices.
        euler: bool,
        /// With residuals.
        residual: bool,
    },
    /// Skeletons.
    Skeletons {
        /// In the world instead of relative to their parents.
        global: bool,
    },
}

/// Components in the requested order. Components without data are omitted.
pub type Components = Vec<Component>;

impl Command {
    /// Parses a command.
    ///
    /// # Errors
    /// The error text for the client.
    pub fn parse(text: &str) -> Result<Self, String> {
        let lower = text.to_ascii_lowercase();
        let mut words = lower.split_ascii_whitespace();
        let rest: Vec<&str> = words.clone().skip(1).take(MAX_WORDS).collect();
        match words.next().unwrap_or_default() {
            "version" => match rest.first() {
                None => Ok(Self::Version(None)),
                Some(word) => version(word).map(|version| Self::Version(Some(version))),
            },
            "qtmversion" => Ok(Self::QtmVersion),
            "byteorder" => Ok(Self::ByteOrder),
            "checklicense" => Ok(Self::CheckLicense),
            "getstate" | "getlastevent" => Ok(Self::GetState),
            "getparameters" => topics(&rest).map(Self::GetParameters),
            "getcurrentframe" => components(&rest).map(Self::GetCurrentFrame),
            "streamframes" => stream(&rest),
            "quit" => Ok(Self::Quit),
            "takecontrol" | "releasecontrol" | "new" | "close" | "start" | "stop" | "load"
            | "save" | "loadproject" | "getcapturec3d" | "getcaptureqtm" | "trig" | "event"
            | "setqtmevent" | "reprocess" | "calibrate" | "led" => Ok(Self::Control),
            _ => Err("Parse error".to_owned()),
        }
    }
}

fn version(word: &str) -> Result<Version, String> {
    let refused = || {
        let (oldest, newest) = (Version::OLDEST, Version::NEWEST);
        format!(
            "Version {word} not supported, only {}.{} to {}.{}",
            oldest.major, oldest.minor, newest.major, newest.minor
        )
    };
    let (major, minor) = word.split_once('.').ok_or_else(refused)?;
    let (Ok(major), Ok(minor)) = (major.parse(), minor.parse()) else {
        return Err(refused());
    };
    let version = Version { major, minor };
    (Version::OLDEST..=Version::NEWEST)
        .contains(&version)
        .then_some(version)
        .ok_or_else(refused)
}

fn topics(words: &[&str]) -> Result<Vec<Topic>, String> {
    let mut topics = Vec::new();
    for word in words {
        match *word {
            "all" => topics.extend([
                Topic::General,
                Topic::Markers,
                Topic::Bodies,
                Topic::Skeletons { global: false },
                Topic::Force,
            ]),
            "general" => topics.push(Topic::General),
            "3d" => topics.push(Topic::Markers),
            "6d" => topics.push(Topic::Bodies),
            "skeleton" => topics.push(Topic::Skeletons { global: false }),
            "skeleton:global" => topics.push(Topic::Skeletons { global: true }),
            "force" => topics.push(Topic::Force),
            "analog" | "image" | "gazevector" | "eyetracker" | "calibration" => {
                topics.push(Topic::Nothing);
            }
            _ => return Err("Parse error".to_owned()),
        }
    }
    if topics.is_empty() {
        return Err("Parse error".to_owned());
    }
    let mut once = Vec::new();
    for topic in topics {
        if !once.contains(&topic) {
            once.push(topic);
        }
    }
    Ok(once)
}

fn components(words: &[&str]) -> Result<Components, String> {
    let mut found: Components = Vec::new();
    if words.is_empty() {
        return Err("Parse error".to_owned());
    }
    let mut add = |component| {
        if !found.contains(&component) {
            found.push(component);
        }
    };
    for word in words {
        let residual = word.ends_with("res");
        match *word {
            "all" => {
                add(Component::Markers { residual: false });
                add(Component::Bodies {
                    euler: false,
                    residual: false,
                });
                add(Component::Skeletons { global: false });
            }
            "3d" | "3dres" => add(Component::Markers { residual }),
            "3dnolabels" | "3dnolabelsres" => add(Component::Unlabelled { residual }),
            "6d" | "6dres" => add(Component::Bodies {
                euler: false,
                residual,
            }),
            "6deuler" | "6deulerres" => add(Component::Bodies {
                euler: true,
                residual,
            }),
            "skeleton" => add(Component::Skeletons { global: false }),
            "skeleton:global" => add(Component::Skeletons { global: true }),
            "2d" | "2dlin" | "force" | "forcesingle" | "image" | "gazevector" | "eyetracker"
            | "timecode" => {}
            // With channels after a colon.
            analog if analog.starts_with("analog") => {}
            _ => return Err("Parse error".to_owned()),
        }
    }
    Ok(found)
}

fn stream(words: &[&str]) -> Result<Command, String> {
    let (mut rate, mut udp, mut rest) = (Rate::All, None, Vec::new());
    for word in words {
        match word.split_once(':') {
            None if *word == "stop" => return Ok(Command::StopStreaming),
            None if *word == "allframes" => rate = Rate::All,
            Some(("frequencydivisor", n)) => rate = Rate::Divisor(above_zero(n)?),
            Some(("frequency", n)) => rate = Rate::Hz(above_zero(n)?),
            Some(("udp", to)) => udp = Some(udp_target(to)?),
            _ => rest.push(*word),
        }
    }
    Ok(Command::StreamFrames {
        rate,
        udp,
        components: components(&rest)?,
    })
}

fn above_zero(number: &str) -> Result<u32, String> {
    match number.parse() {
        Ok(n) if n > 0 => Ok(n),
        _ => Err("Parse error".to_owned()),
    }
}

/// Parses `port` or `address:port`.
fn udp_target(to: &str) -> Result<(Option<IpAddr>, u16), String> {
    let (ip, port) = match to.rsplit_once(':') {
        None => (None, to),
        Some((ip, port)) => {
            let ip = ip.trim_start_matches('[').trim_end_matches(']');
            let ip = match ip {
                "localhost" => IpAddr::from([127, 0, 0, 1]),
                _ => ip.parse().map_err(|_| "Parse error".to_owned())?,
            };
            (Some(ip), port)
        }
    };
    match port.parse() {
        Ok(port) if port > 0 => Ok((ip, port)),
        _ => Err("Parse error".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn commands_of_published_clients_are_read() {
        let all = |minor| Ok(Command::Version(Some(Version { major: 1, minor })));
        assert_eq!(Command::parse("version 1.25"), all(25));
        assert_eq!(Command::parse("Version 1.8"), all(8));
        assert_eq!(
            Command::parse("GetParameters 3D Skeleton:global Analog"),
            Ok(Command::GetParameters(vec![
                Topic::Markers,
                Topic::Skeletons { global: true },
                Topic::Nothing
            ]))
        );
        assert_eq!(
            Command::parse(
                "StreamFrames FrequencyDivisor:3 UDP:127.0.0.1:4545 3D 6DEulerRes Timecode"
            ),
            Ok(Command::StreamFrames {
                rate: Rate::Divisor(3),
                udp: Some((Some(IpAddr::from([127, 0, 0, 1])), 4545)),
                components: vec![
                    Component::Markers { residual: false },
                    Component::Bodies {
                        euler: true,
                        residual: true
                    }
                ],
            })
        );
        assert_eq!(
            Command::parse("StreamFrames Stop"),
            Ok(Command::StopStreaming)
        );
        assert_eq!(Command::parse("TakeControl secret"), Ok(Command::Control));
    }

    #[test]
    fn invalid_commands_are_refused() {
        for text in [
            "",
            "hello",
            "version 1.7",
            "version 1.26",
            "version 2.0",
            "version x",
            "getparameters",
            "getparameters 3d 7d",
            "getcurrentframe",
            "streamframes",
            "streamframes frequency:0 3d",
            "streamframes frequencydivisor:-1 3d",
            "streamframes allframes udp:0 3d",
            "streamframes allframes udp:here:9 3d",
            "streamframes allframes 4d",
        ] {
            assert!(Command::parse(text).is_err(), "{text}");
        }
    }

    proptest! {
        #[test]
        fn no_command_panics(text in "(?i)(version|getparameters|streamframes|getcurrentframe|quit| |[a-z0-9:.]{0,6}){0,9}|.*") {
            let read = Command::parse(&text);
            prop_assert!(read.is_ok() || read.is_err());
        }
    }
}
