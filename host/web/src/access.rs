//! Who may open the page: by token, and only under the rig's own address.

use axum::http::{header, HeaderMap, Uri};
use std::io;
use std::net::{IpAddr, SocketAddr};

/// Bytes of a token that is made: 128 bits can't be guessed.
const TOKEN_BYTES: usize = 16;

/// A new token, in hexadecimal digits.
///
/// # Errors
/// The operating system gives no random bytes.
pub fn make_token() -> io::Result<String> {
    let mut bytes = [0; TOKEN_BYTES];
    getrandom::fill(&mut bytes).map_err(|error| io::Error::other(error.to_string()))?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// The token that the link carries, if any.
pub(crate) struct Access {
    token: Option<String>,
}

impl Access {
    pub(crate) const fn new(token: Option<String>) -> Self {
        Self { token }
    }

    /// Whether the query of an address has the token.
    pub(crate) fn may_enter(&self, uri: &Uri) -> bool {
        let Some(token) = &self.token else {
            return true;
        };
        let given = uri
            .query()
            .and_then(|query| {
                query
                    .split('&')
                    .find_map(|pair| pair.strip_prefix("token="))
            })
            .unwrap_or_default();
        // In a time that does not depend on where they differ.
        given.len() == token.len()
            && given
                .bytes()
                .zip(token.bytes())
                .fold(0, |differ, (a, b)| differ | (a ^ b))
                == 0
    }

    /// The link to the page at this address.
    pub(crate) fn link(&self, address: SocketAddr) -> String {
        let host = if address.ip().is_unspecified() {
            own_name()
        } else {
            SocketAddr::new(address.ip(), 0)
                .to_string()
                .trim_end_matches(":0")
                .to_owned()
        };
        let query = (self.token.as_ref()).map_or_else(String::new, |t| format!("?token={t}"));
        format!("http://{host}:{}/{query}", address.port())
    }
}

/// This computer's name.
fn own_name() -> String {
    let name = rustix::system::uname();
    name.nodename().to_string_lossy().into_owned()
}

/// Whether a `Host` can only mean this computer: an address in figures, `localhost`, or its own
/// name. A name that somebody else lets point here could be any other.
pub(crate) fn host_is_ours(host: &str) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|b| b.is_ascii_digit()) && !port.is_empty() => name,
        _ => host,
    };
    let bare = name.trim_start_matches('[').trim_end_matches(']');
    if bare.parse::<IpAddr>().is_ok() {
        return true;
    }
    let own = own_name();
    let name = name.strip_suffix('.').unwrap_or(name);
    name.eq_ignore_ascii_case("localhost")
        || name.eq_ignore_ascii_case(&own)
        || name.eq_ignore_ascii_case(&format!("{own}.local"))
}

/// Whether a WebSocket is opened by the rig's own page. A browser always says whose page it is.
pub(crate) fn origin_is_host(headers: &HeaderMap) -> bool {
    let text = |name| headers.get(name).and_then(|value| value.to_str().ok());
    match (text(header::ORIGIN), text(header::HOST)) {
        (Some(origin), Some(host)) => {
            (origin.strip_prefix("http://")).is_some_and(|origin| origin.eq_ignore_ascii_case(host))
        }
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_this_computers_names_are_taken() {
        let own = own_name();
        for host in [
            "localhost",
            "LOCALHOST:4750",
            "127.0.0.1:4750",
            "192.168.3.7",
            "[::1]:80",
            "[fe80::1]",
            &format!("{own}:1"),
            &format!("{own}.local:1"),
        ] {
            assert!(host_is_ours(host), "{host}");
        }
        for host in [
            "",
            "evil.example",
            "evil.example:4750",
            "localhost.evil.example",
            "127.0.0.1.evil.example:4750",
            "127.0.0.1@evil.example",
            "localhost:",
            "a:b",
        ] {
            assert!(!host_is_ours(host), "{host}");
        }
    }

    #[test]
    fn the_token_is_compared_whole() {
        let uri = |text: &str| text.parse::<Uri>().unwrap();
        let access = Access::new(Some("0123456789abcdef".to_owned()));
        assert!(access.may_enter(&uri("/?token=0123456789abcdef")));
        assert!(access.may_enter(&uri("/ws?a=1&token=0123456789abcdef")));
        for wrong in [
            "/",
            "/?token=",
            "/?token=0123456789abcde",
            "/?token=0123456789abcdef0",
            "/?token=0123456789abcdeF",
            "/?xtoken=0123456789abcdef",
        ] {
            assert!(!access.may_enter(&uri(wrong)), "{wrong}");
        }
        assert!(Access::new(None).may_enter(&uri("/")));
        assert_eq!(make_token().unwrap().len(), 2 * TOKEN_BYTES);
        assert_ne!(make_token().unwrap(), make_token().unwrap());
    }

    #[test]
    fn the_link_can_be_opened() {
        let open = Access::new(None);
        let link = |address: &str| open.link(address.parse().unwrap());
        assert_eq!(link("127.0.0.1:4750"), "http://127.0.0.1:4750/");
        assert_eq!(link("[::1]:80"), "http://[::1]:80/");
        assert_eq!(link("0.0.0.0:80"), format!("http://{}:80/", own_name()));
        let shut = Access::new(Some("secret".to_owned()));
        let address = "127.0.0.1:1".parse().unwrap();
        assert_eq!(shut.link(address), "http://127.0.0.1:1/?token=secret");
    }

    #[test]
    fn another_sites_page_opens_no_socket() {
        let headers = |origin: Option<&str>| {
            let mut headers = HeaderMap::new();
            headers.insert(header::HOST, "127.0.0.1:4750".parse().unwrap());
            if let Some(origin) = origin {
                headers.insert(header::ORIGIN, origin.parse().unwrap());
            }
            headers
        };
        assert!(origin_is_host(&headers(Some("http://127.0.0.1:4750"))));
        for wrong in [
            None,
            Some("null"),
            Some("http://127.0.0.1:4751"),
            Some("http://127.0.0.1"),
            Some("https://evil.example"),
            Some("http://127.0.0.1:4750.evil.example"),
        ] {
            assert!(!origin_is_host(&headers(wrong)), "{wrong:?}");
        }
    }
}
