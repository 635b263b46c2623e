//! The secret parts of a camera's address. They stay in the process that opens the camera, whatever
//! ffmpeg prints, and are in no recording.

use std::borrow::Cow;

/// Replaces a secret.
const MASK: &str = "…";
/// Names of address parameters with secret values contain one of these.
const SECRET_NAMES: [&str; 7] = ["pass", "pwd", "psw", "token", "key", "secret", "auth"];

/// The secrets of one address.
#[derive(Debug, Clone, Default)]
pub struct Secrets(Vec<String>);

impl Secrets {
    /// The secrets of an address such as `rtsp://user:password@host/path?token=...`; other text has
    /// none.
    pub fn of(url: &str) -> Self {
        let Some((_, rest)) = url.split_once("://") else {
            return Self::default();
        };
        let parameters = rest
            .split_once('?')
            .map_or("", |(_, parameters)| parameters);
        let mut secrets: Vec<&str> = parameters
            .split(['&', ';'])
            .filter_map(|parameter| parameter.split_once('='))
            .filter(|(name, _)| {
                let name = name.to_lowercase();
                SECRET_NAMES.iter().any(|secret| name.contains(secret))
            })
            .map(|(_, value)| value)
            .collect();
        secrets.extend(password(rest));
        let decoded = secrets.iter().filter_map(|it| percent_decoded(it));
        let mut all: Vec<String> = decoded.collect();
        all.extend(secrets.into_iter().map(str::to_owned));
        all.retain(|secret| !secret.is_empty());
        // One secret may be the start of another.
        all.sort_by_key(|secret| std::cmp::Reverse(secret.len()));
        Self(all)
    }

    /// `text` without the secrets.
    pub fn mask<'a>(&self, text: &'a str) -> Cow<'a, str> {
        self.0.iter().fold(Cow::Borrowed(text), |text, secret| {
            if text.contains(secret.as_str()) {
                Cow::Owned(text.replace(secret.as_str(), MASK))
            } else {
                text
            }
        })
    }
}

/// The password in `user:password@host/path`. For ffmpeg, `/`, `?` or `#` in a password end the
/// address, and it prints the rest as a port.
fn password(rest: &str) -> Option<&str> {
    let host = rest.split(['/', '?', '#']).next().unwrap_or(rest);
    let user_info = if let Some((user_info, _)) = host.rsplit_once('@') {
        user_info
    } else {
        let (_, port) = host.split_once(':')?;
        // A port, or an IPv6 address.
        if host.starts_with('[') || port.bytes().all(|byte| byte.is_ascii_digit()) {
            return None;
        }
        rest.rsplit_once('@')?.0
    };
    user_info.split_once(':').map(|(_, password)| password)
}

/// `text` with each percent escape decoded; `None` if that changes nothing or is not text.
fn percent_decoded(text: &str) -> Option<String> {
    let mut parts = text.split('%');
    let mut bytes = parts.next()?.as_bytes().to_vec();
    for part in parts {
        let byte = part
            .get(..2)
            .and_then(|hex| u8::from_str_radix(hex, 16).ok())?;
        bytes.push(byte);
        bytes.extend(&part.as_bytes()[2..]);
    }
    String::from_utf8(bytes).ok().filter(|it| it != text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn masked(url: &str, text: &str) -> String {
        Secrets::of(url).mask(text).into_owned()
    }

    #[test]
    fn secrets_are_masked_in_every_encoding() {
        let url = "rtsp://admin:p%40ss-1@cam.local:554/1?channel=2&token=t0ken&User_Pwd=xyz";
        let text = "p%40ss-1 p@ss-1 t0ken xyz cam.local channel=2 admin";
        assert_eq!(masked(url, text), "… … … … cam.local channel=2 admin");
        assert_eq!(
            masked(url, url),
            "rtsp://admin:…@cam.local:554/1?channel=2&token=…&User_Pwd=…"
        );
    }

    #[test]
    fn a_password_with_special_characters_is_recognised() {
        assert_eq!(masked("rtsp://me:p@ss@cam/1", "p@ss"), "…");
        assert_eq!(
            masked("rtsp://me:p/ss@cam/1", "port p/ss of me"),
            "port … of me"
        );
        assert_eq!(masked("rtsp://me:p?s#s@cam/1", "p?s#s"), "…");
        assert_eq!(masked("http://me:50%@cam/1", "50%"), "…");
    }

    #[test]
    fn an_address_without_secrets_masks_nothing() {
        for url in [
            "rtsp://cam.local:554/a@b",
            "rtsp://[fe80::1]/a@b",
            "rtsp://me@cam/1",
            "/dev/video0",
            "rtsp://me:@cam/?token=",
            "",
        ] {
            assert_eq!(
                masked(url, "a@b me cam 554 /dev/video0"),
                "a@b me cam 554 /dev/video0"
            );
        }
    }
}
