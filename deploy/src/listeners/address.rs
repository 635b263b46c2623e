//! Where a page is served, as it is said on the command line.

use std::net::SocketAddr;

use anyhow::ensure;

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

/// Refuses an `address`, up to which `option` says where a page is, that other machines can reach: what is served has no keys, and is
/// called `what`.
///
/// # Errors
/// Names the option, and how to look from elsewhere.
pub(super) fn check_own_machine(
    option: &str,
    address: SocketAddr,
    what: &str,
) -> anyhow::Result<()> {
    ensure!(
        address.ip().is_loopback(),
        "{}: found {address}, expected an address of this machine alone: {what} has no keys; from elsewhere \
         `ssh -L 7460:127.0.0.1:7460 HOST`",
        option.trim_end_matches(['=', ' '])
    );
    Ok(())
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

    #[test]
    fn what_has_no_keys_is_not_served_to_other_machines() {
        let check = |address: &str| check_own_machine("--at ", address.parse().unwrap(), "it");
        check("127.0.0.1:7460").unwrap();
        check("[::1]:7460").unwrap();
        for address in ["0.0.0.0:7460", "10.0.0.1:7460"] {
            let said = check(address).unwrap_err().to_string();
            let begin = format!("--at: found {address}, expected");
            assert!(
                said.starts_with(&begin) && said.contains("ssh -L"),
                "{said}"
            );
        }
    }
}
