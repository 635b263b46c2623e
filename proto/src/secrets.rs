//! What of a camera's address nobody may read: it stays where the camera is opened, whatever ffmpeg writes, and in no recording.

use std::borrow::Cow;

/// What stands in its place.
const MASK: &str = "…";
/// Names of an address's parameters whose values are secret hold one of these.
const SECRET_NAMES: [&str; 7] = ["pass", "pwd", "psw", "token", "key", "secret", "auth"];

/// The secrets of one address.
#[derive(Debug, Clone, Default)]
pub struct Secrets(Vec<String>);

impl Secrets {
    /// Of an address as `rtsp://user:password@host/path?token=...`; anything else has none.
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
        // One may be the beginning of another.
        all.sort_by_key(|secret| std::cmp::Reverse(secret.len()));
        Self(all)
    }

    /// `text` without them.
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

/// The password in `user:password@host/path`. One with `/`, `?` or `#` ends an address for ffmpeg, which then says it as a port.
fn password(rest: &str) -> Option<&str> {
    let host = rest.split(['/', '?', '#']).next().unwrap_or(rest);
    let user_info = if let Some((user_info, _)) = host.rsplit_once('@') {
        user_info
    } else {
        let (_, port) = host.split_once(':')?;
        // A port, or an address of IPv6.
        if host.starts_with('[') || port.bytes().all(|byte| byte.is_ascii_digit()) {
            return None;
        }
        rest.rsplit_once('@')?.0
    };
    user_info.split_once(':').map(|(_, password)| password)
}

/// `text` with each `%20` as the byte it stands for; `None` where that changes nothing, or is no text.
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
    fn a_secret_of_an_address_is_in_no_text_however_it_is_written() {
        let url = "rtsp://admin:p%40ss-1@cam.local:554/1?channel=2&token=t0ken&User_Pwd=xyz";
        let text = "p%40ss-1 p@ss-1 t0ken xyz cam.local channel=2 admin";
        assert_eq!(masked(url, text), "… … … … cam.local channel=2 admin");
        assert_eq!(
            masked(url, url),
            "rtsp://admin:…@cam.local:554/1?channel=2&token=…&User_Pwd=…"
        );
    }

    #[test]
    fn a_password_with_signs_that_addresses_have_is_found() {
        assert_eq!(masked("rtsp://me:p@ss@cam/1", "p@ss"), "…");
        assert_eq!(
            masked("rtsp://me:p/ss@cam/1", "port p/ss of me"),
            "port … of me"
        );
        assert_eq!(masked("rtsp://me:p?s#s@cam/1", "p?s#s"), "…");
        assert_eq!(masked("http://me:50%@cam/1", "50%"), "…");
    }

    #[test]
    fn an_address_without_secrets_changes_no_text() {
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
