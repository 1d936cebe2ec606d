//! How often one client may ask, so that none keeps the server from the others.

use std::hash::Hash;
use std::net::{IpAddr, Ipv6Addr};
use std::num::NonZeroU32;
use std::time::Duration;

use governor::clock::{Clock, DefaultClock};
use governor::{DefaultKeyedRateLimiter, Quota, RateLimiter};

/// Turned away; ask again after this long.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooMany(pub Duration);

/// The rate limits of a server.
#[derive(Debug)]
pub struct RateLimits {
    /// All requests of an address.
    requests: Limit<IpAddr>,
    /// Attempts of an address to sign in or up: passwords shall not be tried out, and hashing them is dear.
    sign_ins: Limit<IpAddr>,
    /// Wrong tokens of an address.
    wrong_tokens: Limit<IpAddr>,
    /// Uploads of a user.
    uploads: Limit<i64>,
}

#[derive(Debug)]
struct Limit<K: Clone + Hash + Eq>(DefaultKeyedRateLimiter<K>);

impl<K: Clone + Hash + Eq> Limit<K> {
    fn new(quota: Quota) -> Limit<K> {
        Limit(RateLimiter::hashmap(quota))
    }

    fn check(&self, key: &K) -> Result<(), TooMany> {
        self.0
            .check_key(key)
            .map(drop)
            .map_err(|not| TooMany(not.wait_time_from(DefaultClock::default().now())))
    }
}

const fn number(n: u32) -> NonZeroU32 {
    match NonZeroU32::new(n) {
        Some(n) => n,
        None => NonZeroU32::MIN,
    }
}

impl RateLimits {
    /// Limits with so many requests a second for one address, and twice that at once.
    pub fn new(requests_per_second: NonZeroU32) -> RateLimits {
        let twice = requests_per_second.saturating_add(requests_per_second.get());
        RateLimits {
            requests: Limit::new(Quota::per_second(requests_per_second).allow_burst(twice)),
            sign_ins: Limit::new(Quota::per_minute(number(10)).allow_burst(number(20))),
            wrong_tokens: Limit::new(Quota::per_minute(number(30)).allow_burst(number(60))),
            uploads: Limit::new(Quota::per_second(number(2)).allow_burst(number(60))),
        }
    }

    /// Any request.
    ///
    /// # Errors
    /// [`TooMany`].
    pub fn request(&self, client: IpAddr) -> Result<(), TooMany> {
        self.requests.check(&network(client))
    }

    /// An attempt to sign in or up.
    ///
    /// # Errors
    /// [`TooMany`].
    pub fn sign_in(&self, client: IpAddr) -> Result<(), TooMany> {
        self.sign_ins.check(&network(client))
    }

    /// A token that is none.
    ///
    /// # Errors
    /// [`TooMany`].
    pub fn wrong_token(&self, client: IpAddr) -> Result<(), TooMany> {
        self.wrong_tokens.check(&network(client))
    }

    /// An upload of a user's.
    ///
    /// # Errors
    /// [`TooMany`].
    pub fn upload(&self, user: i64) -> Result<(), TooMany> {
        self.uploads.check(&user)
    }

    /// Forgets those who have not asked for a while.
    pub fn forget_idle(&self) {
        for limit in [&self.requests, &self.sign_ins, &self.wrong_tokens] {
            limit.0.retain_recent();
            limit.0.shrink_to_fit();
        }
        self.uploads.0.retain_recent();
        self.uploads.0.shrink_to_fit();
    }
}

/// The address itself, or of IPv6 the /64 network: one client has all of that to itself.
pub(crate) fn network(client: IpAddr) -> IpAddr {
    match client.to_canonical() {
        IpAddr::V6(address) => IpAddr::V6(Ipv6Addr::from_bits(address.to_bits() >> 64 << 64)),
        address => address,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_client_is_limited_and_another_is_not() {
        let limits = RateLimits::new(number(1));
        let [a, a_too, b, v4] =
            ["2001:db8::1", "2001:db8::ffff", "2001:db8:0:1::1", "192.0.2.1"].map(|ip| ip.parse().unwrap());
        for _ in 0..60 {
            assert_eq!(limits.wrong_token(a), Ok(()));
        }
        let TooMany(wait) = limits.wrong_token(a_too).unwrap_err();
        assert!(wait > Duration::ZERO && wait <= Duration::from_secs(3), "{wait:?}");
        assert_eq!(limits.wrong_token(b), Ok(()));
        assert_eq!(limits.wrong_token(v4), Ok(()));
        assert_eq!(limits.sign_in(a), Ok(()));
    }
}
