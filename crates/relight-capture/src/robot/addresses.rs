//! Where controllers listen.

/// Ports of Universal Robots' controllers: RTDE, the secondary interface, the dashboard, the real-time interface.
const UR_PORTS: [u16; 4] = [30004, 30002, 29999, 30003];
/// Ports of Elite's EC controllers: control and monitor.
const ELITE_PORTS: [u16; 2] = [8055, 8056];

/// Where a controller of Universal Robots listens, each `host:port`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UrAddresses {
    /// Real-time data exchange.
    pub rtde: String,
    /// The secondary interface, which takes scripts.
    pub script: String,
    /// The dashboard server.
    pub dashboard: String,
    /// The real-time interface, which some clients send scripts to. Ours does not.
    pub realtime: String,
}

/// Where a controller of Elite's EC series listens, each `host:port`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EliteAddresses {
    /// JSON-RPC.
    pub control: String,
    /// The binary monitor.
    pub monitor: String,
}

/// Why an address is none.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AddressFault {
    /// There is no host in it.
    #[error("{0:?} names no host; write HOST or HOST:PORT, an IPv6 address in brackets")]
    NoHost(String),
    /// The port is no number, or the ports after it do not exist.
    #[error("{0:?} has no port from 0 to {1}; write HOST or HOST:PORT, an IPv6 address in brackets")]
    Port(String, u16),
}

impl UrAddresses {
    /// The four addresses of `at`: HOST stands for the vendor's ports there, HOST:PORT for RTDE on PORT, script on
    /// PORT + 1, dashboard on PORT + 2 and real-time on PORT + 3, and HOST:0 for any that are free (to listen on).
    ///
    /// # Errors
    /// If `at` is neither.
    pub fn parse(at: &str) -> Result<UrAddresses, AddressFault> {
        let [rtde, script, dashboard, realtime] = parse(at, UR_PORTS)?;
        Ok(UrAddresses { rtde, script, dashboard, realtime })
    }
}

impl EliteAddresses {
    /// The two addresses of `at`: HOST stands for the vendor's ports there, HOST:PORT for control on PORT and monitor on
    /// PORT + 1, and HOST:0 for any two that are free (to listen on).
    ///
    /// # Errors
    /// If `at` is neither.
    pub fn parse(at: &str) -> Result<EliteAddresses, AddressFault> {
        let [control, monitor] = parse(at, ELITE_PORTS)?;
        Ok(EliteAddresses { control, monitor })
    }
}

fn parse<const N: usize>(at: &str, vendor: [u16; N]) -> Result<[String; N], AddressFault> {
    let (host, port) = match at.rsplit_once(':') {
        // An IPv6 address without brackets has colons of its own, and so no port.
        Some((host, port)) if !host.contains(':') || host.ends_with(']') => (host, Some(port)),
        _ => (at, None),
    };
    if host.is_empty() || host == "[]" {
        return Err(AddressFault::NoHost(at.to_owned()));
    }
    let host =
        if host.contains(':') && !host.starts_with('[') { format!("[{host}]") } else { host.to_owned() };
    let ports = match port {
        None => vendor,
        Some(port) => {
            let last = u16::MAX - (N as u16 - 1);
            let first = port.parse().ok().filter(|first| *first <= last);
            let first: u16 = first.ok_or_else(|| AddressFault::Port(at.to_owned(), last))?;
            std::array::from_fn(|i| if first == 0 { 0 } else { first + i as u16 })
        }
    };
    Ok(ports.map(|port| format!("{host}:{port}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_host_alone_means_the_vendors_ports() {
        let ur = UrAddresses::parse("10.0.0.7").unwrap();
        assert_eq!(
            [ur.rtde, ur.script, ur.dashboard],
            ["10.0.0.7:30004", "10.0.0.7:30002", "10.0.0.7:29999"]
        );
        let elite = EliteAddresses::parse("::1").unwrap();
        assert_eq!([elite.control, elite.monitor], ["[::1]:8055", "[::1]:8056"]);
    }

    #[test]
    fn a_port_is_the_first_of_a_row() {
        let ur = UrAddresses::parse("[::1]:5000").unwrap();
        assert_eq!([ur.rtde, ur.script, ur.dashboard], ["[::1]:5000", "[::1]:5001", "[::1]:5002"]);
        let any = EliteAddresses::parse("localhost:0").unwrap();
        assert_eq!([any.control, any.monitor], ["localhost:0", "localhost:0"]);
    }

    #[test]
    fn what_is_no_address_is_refused() {
        for bad in ["", ":80", "[]:80", "host:", "host:x", "host:65533", "host:-1"] {
            assert!(UrAddresses::parse(bad).is_err(), "{bad:?}");
        }
        assert!(EliteAddresses::parse("host:65534").is_ok());
    }
}
