//! The process that serves: accepts connections, answers, has submissions scored, and stops gracefully.

use std::collections::HashMap;
use std::future::Future;
use std::net::{IpAddr, SocketAddr};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use axum::Router;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::{Service, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};

use crate::app::{App, AppError, AppState, Connection, Settings, router};
use crate::data_folder::{DataFolder, FolderError};
use crate::limits::network;
use crate::retention::{Pruned, prune};
use crate::store::StoreError;
use crate::time::Time;
use crate::worker::{Scorer, score_queue};

/// Connections at a time; more wait in the system's queue.
const CONNECTIONS: usize = 2000;
/// Connections of one client at a time, unless a proxy stands between: its connections are everybody's.
const OF_A_CLIENT: usize = 500;
/// How long a client may take to send the head of a request.
const HEAD: Duration = Duration::from_secs(15);
/// How long requests may go on after the server was asked to stop.
const GRACE: Duration = Duration::from_secs(20);
/// Between two rounds of forgetting idle clients.
const FORGET: Duration = Duration::from_secs(60);
/// Between two looks for zips that need be kept no longer.
const PRUNE: Duration = Duration::from_secs(3600);
/// After a connection could not be accepted: there are too many open files, say.
const PAUSE: Duration = Duration::from_millis(200);

/// Why a server ended or did not start.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// Its folder.
    #[error(transparent)]
    Folder(#[from] FolderError),
    /// Its database.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Something else that it needs.
    #[error(transparent)]
    App(#[from] AppError),
    /// The address is not to be had.
    #[error("{address}: cannot be listened on: {source}")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// Why.
        source: std::io::Error,
    },
}

/// Serves the data in `data` at `address` until `stop` comes. Requests are then answered to their end, within limits; what is
/// being scored goes back into the queue. `ready` is told the address once the server listens.
///
/// # Errors
/// If another process serves the folder, or the server cannot start.
pub async fn serve(
    data: &Path,
    settings: Settings,
    scorer: Scorer,
    address: SocketAddr,
    ready: impl FnOnce(SocketAddr),
    stop: impl Future<Output = ()>,
) -> Result<(), ServeError> {
    let folder = DataFolder::create(data)?;
    let _serving = folder.serve()?;
    let app = App::open(data, settings).await?;
    let interrupted = app.store.requeue_interrupted().await?;
    let kept = app.store.kept_zips().await?;
    folder.sweep(|id| kept.contains_key(id))?;
    let listen = |source| ServeError::Listen { address, source };
    let listener = TcpListener::bind(address).await.map_err(listen)?;
    let address = listener.local_addr().map_err(listen)?;
    tracing::info!(%address, data = %data.display(), interrupted, "serving");
    // What all entries' intervals take no reader should have to wait for.
    let warming = tokio::spawn(warm(Arc::clone(&app)));
    let (stopping, stopped) = watch::channel(false);
    let scoring = tokio::spawn(score_queue(Arc::clone(&app), scorer, stopped));
    let forgetting = tokio::spawn(forget_idle(Arc::clone(&app)));
    let pruning = tokio::spawn(prune_now_and_then(Arc::clone(&app)));
    ready(address);
    let of_a_client = if app.settings.behind_proxy { CONNECTIONS } else { OF_A_CLIENT };
    accept(listener, router(Arc::clone(&app)), of_a_client, stop).await;
    tracing::info!("stopping");
    // Whoever listens to it has ended if nobody does.
    let _ = stopping.send(true);
    warming.abort();
    forgetting.abort();
    pruning.abort();
    if let Err(error) = scoring.await {
        tracing::error!(%error, "the scorer failed");
    }
    app.store.close().await;
    Ok(())
}

/// Accepts and serves connections until `stop`, then waits for those that are answering.
async fn accept(listener: TcpListener, router: Router, of_a_client: usize, stop: impl Future<Output = ()>) {
    let clients = Arc::new(Clients::default());
    let service = TowerToHyperService::new(router);
    let room = Arc::new(Semaphore::new(CONNECTIONS));
    let graceful = GracefulShutdown::new();
    let mut stop = std::pin::pin!(stop);
    loop {
        let permit = tokio::select! {
            permit = Arc::clone(&room).acquire_owned() => permit,
            () = &mut stop => break,
        };
        let Ok(permit) = permit else { break };
        let (stream, peer) = tokio::select! {
            accepted = listener.accept() => match accepted {
                Ok(accepted) => accepted,
                Err(error) => {
                    tracing::warn!(%error, "a connection was not accepted");
                    tokio::time::sleep(PAUSE).await;
                    continue;
                }
            },
            () = &mut stop => break,
        };
        // One that has its share already is hung up on, so that there is room for others.
        if let Some(client) = clients.join(peer.ip(), of_a_client) {
            answer(stream, peer, service.clone(), &graceful, (permit, client));
        }
    }
    drop(listener);
    if tokio::time::timeout(GRACE, graceful.shutdown()).await.is_err() {
        tracing::warn!("requests were still going on, and were cut off");
    }
}

/// How many connections each client has.
#[derive(Debug, Default)]
struct Clients(Mutex<HashMap<IpAddr, usize>>);

/// A connection that counts until it is dropped.
struct Joined {
    clients: Arc<Clients>,
    client: IpAddr,
}

impl Clients {
    /// One more of a client's, if it has fewer than `most`.
    fn join(self: &Arc<Self>, client: IpAddr, most: usize) -> Option<Joined> {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let client = network(client);
        let own = all.entry(client).or_default();
        if *own >= most {
            return None;
        }
        *own += 1;
        Some(Joined { clients: Arc::clone(self), client })
    }
}

impl Drop for Joined {
    fn drop(&mut self) {
        let mut all = self.clients.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(own) = all.get_mut(&self.client) {
            *own -= 1;
            if *own == 0 {
                all.remove(&self.client);
            }
        }
    }
}

/// Serves a connection in a task of its own.
fn answer(
    stream: TcpStream,
    peer: SocketAddr,
    service: TowerToHyperService<Router>,
    graceful: &GracefulShutdown,
    permits: (OwnedSemaphorePermit, Joined),
) {
    // Answers are whole; waiting for more to send with them only delays them.
    let _ = stream.set_nodelay(true);
    let service = service_fn(move |mut request: hyper::Request<Incoming>| {
        request.extensions_mut().insert(Connection(peer.ip()));
        service.call(request)
    });
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD)
        .max_buf_size(64 << 10)
        .serve_connection(TokioIo::new(stream), service);
    let connection = graceful.watch(connection);
    tokio::spawn(async move {
        if let Err(error) = connection.await {
            tracing::debug!(%peer, %error, "a connection broke");
        }
        drop(permits);
    });
}

async fn warm(app: AppState) {
    if let Err(error) = app.boards.current(&app.store).await {
        tracing::error!(%error, "the leaderboards cannot be worked out");
    }
}

async fn forget_idle(app: AppState) {
    loop {
        tokio::time::sleep(FORGET).await;
        app.rates.forget_idle();
    }
}

async fn prune_now_and_then(app: AppState) {
    loop {
        match prune(&app.folder, &app.store, "server", Time::now()).await {
            Ok(Pruned { zips: 0, .. }) => {}
            Ok(Pruned { zips, bytes }) => {
                tracing::info!(zips, bytes, "zips were kept for their time, and are removed")
            }
            Err(error) => tracing::error!(%error, "zips that need be kept no longer stay"),
        }
        tokio::time::sleep(PRUNE).await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_client_leaves_room_for_others() {
        let clients = Arc::new(Clients::default());
        let [one, other] = [[192, 0, 2, 1], [192, 0, 2, 2]].map(IpAddr::from);
        let held: Vec<Joined> = (0..3).map(|_| clients.join(one, 3).unwrap()).collect();
        assert!(clients.join(one, 3).is_none());
        assert!(clients.join(other, 3).is_some());
        drop(held);
        assert!(clients.0.lock().unwrap().is_empty());
        assert!(clients.join(one, 3).is_some());
    }
}
