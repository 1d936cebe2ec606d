//! A TCP connection on which every wait has a limit and every message a length.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::{Duration, Instant};

use super::error::ArmError;

/// More bytes than this without a whole message are no message of ours; RTDE's frames end at 64 KiB.
const LONGEST: usize = 1 << 16;

/// How long a driver waits for its controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimeLimits {
    /// For a connection.
    pub connect: Duration,
    /// For an answer.
    pub reply: Duration,
    /// Between two messages of a stream. Without one for so long, the link counts as lost.
    pub silence: Duration,
    /// Until an arm that does not move counts as resting. An arm that was never seen to move must be still three times as
    /// long: the order may be on its way.
    pub rest: Duration,
}

impl Default for TimeLimits {
    fn default() -> Self {
        Self {
            connect: Duration::from_secs(3),
            reply: Duration::from_secs(2),
            silence: Duration::from_secs(1),
            rest: Duration::from_millis(100),
        }
    }
}

/// A connection to one port of a controller.
#[derive(Debug)]
pub(super) struct Link {
    stream: TcpStream,
    address: String,
    protocol: &'static str,
    pending: Vec<u8>,
}

impl Link {
    /// Connects to `address` (`host:port`), to speak `protocol`.
    pub fn connect(address: &str, protocol: &'static str, limits: &TimeLimits) -> Result<Link, ArmError> {
        let unreachable = |reason: String| ArmError::Unreachable { address: address.to_owned(), reason };
        let hosts = address.to_socket_addrs().map_err(|e| unreachable(e.to_string()))?;
        let mut reason = "the name stands for no address".to_owned();
        for host in hosts {
            match TcpStream::connect_timeout(&host, limits.connect.max(Duration::from_millis(1))) {
                Ok(stream) => {
                    let set = stream.set_nodelay(true).and_then(|()| {
                        stream.set_write_timeout(Some(limits.reply.max(Duration::from_millis(1))))
                    });
                    set.map_err(|e| unreachable(e.to_string()))?;
                    return Ok(Link { stream, address: address.to_owned(), protocol, pending: Vec::new() });
                }
                Err(e) => reason = e.to_string(),
            }
        }
        Err(unreachable(reason))
    }

    /// Sends all of `bytes`.
    pub fn send(&mut self, bytes: &[u8]) -> Result<(), ArmError> {
        self.stream.write_all(bytes).map_err(|e| self.lost(&e))
    }

    /// The next message, within `limit`. `complete` looks at the bytes that are there and says how many make a message,
    /// `None` if more must come, or what is wrong with them.
    pub fn take(
        &mut self,
        awaited: &'static str,
        limit: Duration,
        mut complete: impl FnMut(&[u8]) -> Result<Option<usize>, String>,
    ) -> Result<Vec<u8>, ArmError> {
        let deadline = Instant::now() + limit;
        loop {
            match complete(&self.pending) {
                Ok(Some(length)) if length <= self.pending.len() => {
                    return Ok(self.pending.drain(..length).collect());
                }
                Ok(_) if self.pending.len() > LONGEST => {
                    return Err(self.fault(format!("a message of more than {LONGEST} bytes")));
                }
                Ok(_) => {}
                Err(fault) => return Err(self.fault(fault)),
            }
            let left = deadline.saturating_duration_since(Instant::now());
            let late = || ArmError::TimedOut {
                address: self.address.clone(),
                awaited,
                seconds: limit.as_secs_f64(),
            };
            if left.is_zero() {
                return Err(late());
            }
            // A zero time-out would mean none.
            let set = self.stream.set_read_timeout(Some(left.max(Duration::from_millis(1))));
            let mut chunk = [0; 4096];
            match set.and_then(|()| self.stream.read(&mut chunk)) {
                Ok(0) => return Err(self.lost(&io::Error::other("closed by the controller"))),
                Ok(n) => self.pending.extend_from_slice(chunk.get(..n).unwrap_or_default()),
                Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                    return Err(late());
                }
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(e) => return Err(self.lost(&e)),
            }
        }
    }

    /// The next line of text, without its end.
    pub fn take_line(&mut self, awaited: &'static str, limit: Duration) -> Result<String, ArmError> {
        let line =
            self.take(awaited, limit, |bytes| Ok(bytes.iter().position(|b| *b == b'\n').map(|i| i + 1)))?;
        match String::from_utf8(line) {
            Ok(line) => Ok(line.trim_end().to_owned()),
            Err(_) => Err(self.fault("a line that is not text".to_owned())),
        }
    }

    /// The peer broke the protocol.
    pub fn fault(&self, fault: String) -> ArmError {
        ArmError::Protocol { address: self.address.clone(), protocol: self.protocol, fault }
    }

    /// Host and port.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// A second handle to the socket, to shut it from elsewhere.
    pub fn handle(&self) -> Result<TcpStream, ArmError> {
        self.stream.try_clone().map_err(|e| self.lost(&e))
    }

    fn lost(&self, error: &io::Error) -> ArmError {
        ArmError::LinkLost { address: self.address.clone(), reason: error.to_string() }
    }
}
