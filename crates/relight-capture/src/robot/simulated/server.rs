//! Connections of a simulated controller, and the faults of its network.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use super::Handler;
use super::arm::SimulatedArm;
use super::fault::{Fault, FaultKind};

/// Connections to one port at a time.
const MOST: usize = 32;
/// Bytes that a client may send without completing a message.
const LONGEST: usize = 1 << 17;
/// How late slow replies are: later than any client waits.
const SLOW: Duration = Duration::from_secs(6);
/// No frame, no packet, no text, no JSON; a line, so that nobody waits for its end.
const GARBAGE: [u8; 64] = {
    let mut garbage = [0xFF; 64];
    garbage[63] = b'\n';
    garbage
};
/// How often an idle thread looks whether it is over.
const LOOK: Duration = Duration::from_millis(20);

/// What all connections share.
#[derive(Debug)]
pub(super) struct Simulation {
    arm: Mutex<SimulatedArm>,
    /// Those that count messages.
    faults: Vec<Fault>,
    /// Messages sent so far.
    sent: AtomicU64,
    has_garbled: AtomicBool,
    is_severed: AtomicBool,
    is_over: AtomicBool,
}

impl Simulation {
    pub fn new(arm: SimulatedArm, faults: &[Fault]) -> Self {
        Self {
            arm: Mutex::new(arm),
            faults: faults.iter().filter(|fault| fault.kind.counts_messages()).copied().collect(),
            sent: AtomicU64::new(0),
            has_garbled: AtomicBool::new(false),
            is_severed: AtomicBool::new(false),
            is_over: AtomicBool::new(false),
        }
    }

    /// Ends every thread, soon.
    pub fn end(&self) {
        self.is_over.store(true, Ordering::Relaxed);
    }

    fn check(&self) -> io::Result<()> {
        if self.is_over.load(Ordering::Relaxed) || self.is_severed.load(Ordering::Relaxed) {
            return Err(ErrorKind::ConnectionAborted.into());
        }
        Ok(())
    }
}

/// Accepts connections and serves each with `handler` in a thread of its own, until the simulation ends.
pub(super) fn accept(simulation: Arc<Simulation>, listener: TcpListener, handler: Handler) -> JoinHandle<()> {
    thread::spawn(move || {
        let mut served: Vec<JoinHandle<()>> = Vec::new();
        while !simulation.is_over.load(Ordering::Relaxed) {
            served.retain(|thread| !thread.is_finished());
            match listener.accept() {
                Ok((stream, _)) if served.len() < MOST && simulation.check().is_ok() => {
                    let simulation = Arc::clone(&simulation);
                    served.push(thread::spawn(move || {
                        if let Ok(mut wire) = Wire::new(stream, simulation) {
                            // Any error ends the connection; the client sees that.
                            let _ = handler(&mut wire);
                        }
                    }));
                }
                Ok(_) => {}
                Err(_) => thread::sleep(LOOK / 4),
            }
        }
        for thread in served {
            let _ = thread.join();
        }
    })
}

/// One connection of a client.
pub(super) struct Wire {
    stream: TcpStream,
    simulation: Arc<Simulation>,
    pending: Vec<u8>,
}

impl Wire {
    fn new(stream: TcpStream, simulation: Arc<Simulation>) -> io::Result<Wire> {
        stream.set_nonblocking(false)?;
        stream.set_nodelay(true)?;
        // A client that does not read is let go.
        stream.set_write_timeout(Some(Duration::from_secs(1)))?;
        Ok(Wire { stream, simulation, pending: Vec::new() })
    }

    /// The arm, for as long as the guard lives.
    pub fn arm(&self) -> MutexGuard<'_, SimulatedArm> {
        self.simulation.arm.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sends a message, or what a fault makes of it.
    pub fn send(&mut self, message: &[u8]) -> io::Result<()> {
        self.simulation.check()?;
        let number = self.simulation.sent.fetch_add(1, Ordering::Relaxed) + 1;
        let mut message = message;
        for fault in &self.simulation.faults {
            if number <= fault.at {
                continue;
            }
            match fault.kind {
                FaultKind::LinkLoss => self.simulation.is_severed.store(true, Ordering::Relaxed),
                FaultKind::SlowReplies => self.dawdle()?,
                FaultKind::Garbage if !self.simulation.has_garbled.swap(true, Ordering::Relaxed) => {
                    message = &GARBAGE;
                }
                _ => {}
            }
        }
        self.simulation.check()?;
        self.stream.write_all(message)
    }

    fn dawdle(&self) -> io::Result<()> {
        let until = Instant::now() + SLOW;
        while Instant::now() < until {
            self.simulation.check()?;
            thread::sleep(LOOK);
        }
        Ok(())
    }

    /// Waits for bytes, for at most `wait`. An error means that the connection is over.
    pub fn receive(&mut self, wait: Duration) -> io::Result<()> {
        self.simulation.check()?;
        if self.pending.len() > LONGEST {
            return Err(ErrorKind::InvalidData.into());
        }
        // A zero time-out would mean none.
        self.stream.set_read_timeout(Some(wait.clamp(Duration::from_micros(100), LOOK)))?;
        let mut chunk = [0; 4096];
        match self.stream.read(&mut chunk) {
            Ok(0) => Err(ErrorKind::UnexpectedEof.into()),
            Ok(n) => {
                self.pending.extend_from_slice(chunk.get(..n).unwrap_or_default());
                Ok(())
            }
            Err(e)
                if matches!(
                    e.kind(),
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                ) =>
            {
                Ok(())
            }
            Err(e) => Err(e),
        }
    }

    /// Takes a message off the bytes that came, if one is whole. `complete` tells its length.
    pub fn take(
        &mut self,
        complete: impl Fn(&[u8]) -> Result<Option<usize>, String>,
    ) -> io::Result<Option<Vec<u8>>> {
        match complete(&self.pending).map_err(io::Error::other)? {
            Some(length) if length <= self.pending.len() => Ok(Some(self.pending.drain(..length).collect())),
            _ => Ok(None),
        }
    }

    /// Waits for the next line of text.
    pub fn line(&mut self) -> io::Result<String> {
        loop {
            let end = |bytes: &[u8]| Ok(bytes.iter().position(|b| *b == b'\n').map(|i| i + 1));
            if let Some(line) = self.take(end)? {
                return Ok(String::from_utf8_lossy(&line).trim_end().to_owned());
            }
            self.receive(LOOK)?;
        }
    }
}
