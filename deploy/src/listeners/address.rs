//! Where a page is served, as it is said on the command line.

use std::net::SocketAddr;

/// The address that `word` means: an IP address and a port.
pub(crate) fn page_address(word: &str) -> Result<SocketAddr, String> {
    let found = word.parse().ok();
    found.ok_or_else(|| {
        let port: Option<u16> = word
            .trim_start_matches("localhost")
            .trim_start_matches(':')
            .parse()
            .ok();
        let example = format!("127.0.0.1:{}", port.unwrap_or(7460));
        format!("found `{word}`, expected an IP address and a port, for example {example}")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_alone_is_refused_with_the_address_that_was_meant() {
        assert!(page_address("127.0.0.1:7460").is_ok());
        for word in ["8080", ":8080", "localhost:8080"] {
            let said = page_address(word).unwrap_err();
            assert!(said.contains("127.0.0.1:8080"), "{said}");
        }
        assert!(page_address("hall").unwrap_err().contains("found `hall`"));
    }
}
