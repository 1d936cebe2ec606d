//! The stream of states that a controller sends, read in the background.

use std::net::{Shutdown, TcpStream};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use super::arm::ArmState;
use super::error::ArmError;
use super::link::Link;

/// The newest state of an arm. A thread reads the stream, so that it never backs up while the session does other things,
/// and so that a lost link is noticed between motions too.
#[derive(Debug)]
pub(super) struct Feed {
    /// Where it comes from, for errors.
    address: String,
    shared: Arc<Shared>,
    socket: TcpStream,
    reader: Option<JoinHandle<()>>,
}

#[derive(Debug, Default)]
struct Shared {
    newest: Mutex<Newest>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct Newest {
    /// States that came so far.
    count: u64,
    state: Option<ArmState>,
    /// Why no more will come.
    ended: Option<ArmError>,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Newest> {
        self.newest.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Feed {
    /// Reads `link` with `next` until it fails. `next` has its own limit on silence.
    pub fn start(
        mut link: Link,
        mut next: impl FnMut(&mut Link) -> Result<ArmState, ArmError> + Send + 'static,
    ) -> Result<Feed, ArmError> {
        let (socket, address) = (link.handle()?, link.address().to_owned());
        let shared = Arc::new(Shared::default());
        let theirs = Arc::clone(&shared);
        let read = move || {
            loop {
                let came = next(&mut link);
                let mut newest = theirs.lock();
                let is_over = came.is_err();
                match came {
                    Ok(state) => {
                        newest.count += 1;
                        newest.state = Some(state);
                    }
                    Err(ArmError::TimedOut { address, seconds, .. }) => {
                        let reason = format!("no word for {seconds:.1} s");
                        newest.ended = Some(ArmError::LinkLost { address, reason });
                    }
                    Err(error) => newest.ended = Some(error),
                }
                drop(newest);
                theirs.changed.notify_all();
                if is_over {
                    return;
                }
            }
        };
        Ok(Feed { address, shared, socket, reader: Some(thread::spawn(read)) })
    }

    /// The newest state, and its number. It is as old as the limit on silence at most.
    pub fn newest(&self, limit: Duration) -> Result<(u64, ArmState), ArmError> {
        self.after(0, limit)
    }

    /// The newest state, once it has a number above `count`.
    pub fn after(&self, count: u64, limit: Duration) -> Result<(u64, ArmState), ArmError> {
        let deadline = Instant::now() + limit;
        let mut newest = self.shared.lock();
        loop {
            if let Some(error) = &newest.ended {
                return Err(error.clone());
            }
            if let Some(state) = newest.state
                && newest.count > count
            {
                return Ok((newest.count, state));
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                let reason = format!("no state for {:.1} s", limit.as_secs_f64());
                return Err(ArmError::LinkLost { address: self.address.clone(), reason });
            }
            newest = match self.shared.changed.wait_timeout(newest, left) {
                Ok((newest, _)) => newest,
                Err(poisoned) => poisoned.into_inner().0,
            };
        }
    }
}

impl Drop for Feed {
    fn drop(&mut self) {
        // Wakes the reader; an error means that the link is down already, which wakes it too.
        let _ = self.socket.shutdown(Shutdown::Both);
        if let Some(reader) = self.reader.take() {
            let _ = reader.join();
        }
    }
}
