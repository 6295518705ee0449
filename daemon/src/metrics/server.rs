//! Who may ask, how often, and how long: HTTP/1.1 on the loopback, a few connections at a time, each for one request.

use std::convert::Infallible;
use std::io;
use std::net::{SocketAddr, TcpListener as StdListener};
use std::sync::Arc;
use std::time::Duration;

use hyper::body::Incoming;
use hyper::header::{ALLOW, CONTENT_TYPE, HeaderValue};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::TokioIo;
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::Handle;
use tokio::sync::Semaphore;
use tokio::task::{JoinHandle, JoinSet};
use tokio::time::timeout;

use super::{families, text};
use crate::control::Engine;

/// Connections at a time; others wait until one of these has its answer or ran out of time.
const MAX_CONNECTIONS: usize = 4;

/// How long a connection may take, from its start to its last byte.
const PATIENCE: Duration = Duration::from_secs(5);

/// The head of a request, above which it is refused; hyper takes no less.
const MAX_HEAD_BYTES: usize = 8 << 10;

/// How long accepting rests after an error, such as too many open files.
const PAUSE_AFTER_ERROR: Duration = Duration::from_millis(100);

/// An address that metrics cannot be had at.
#[derive(Debug, thiserror::Error)]
#[error("cannot offer metrics at {address}: {source}; hint: name another metrics.listen, or see what listens there")]
pub struct MetricsError {
    /// Where.
    pub address: SocketAddr,
    /// What the system said.
    pub source: io::Error,
}

/// A page of metrics that is served until this is dropped.
#[derive(Debug)]
pub struct Server {
    task: JoinHandle<()>,
}

impl Server {
    /// Answers `GET /metrics` at an address of the loopback, on tasks of `runtime`.
    ///
    /// # Errors
    /// [`MetricsError`] where nobody can listen there.
    pub fn start(runtime: &Handle, address: SocketAddr, engine: Arc<dyn Engine>) -> Result<Self, MetricsError> {
        let failed = |source| MetricsError { address, source };
        let socket = StdListener::bind(address).map_err(failed)?;
        socket.set_nonblocking(true).map_err(failed)?;
        let at = socket.local_addr().map_err(failed)?;
        // A socket belongs to the runtime that it is made in.
        let _guard = runtime.enter();
        let socket = TcpListener::from_std(socket).map_err(failed)?;
        tracing::info!(address = %at, "metrics at http://{at}/metrics");
        Ok(Self { task: runtime.spawn(accept(socket, engine)) })
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.task.abort();
    }
}

/// Accepts until it is aborted; its connections end with it.
async fn accept(socket: TcpListener, engine: Arc<dyn Engine>) {
    let places = Arc::new(Semaphore::new(MAX_CONNECTIONS));
    let mut connections = JoinSet::new();
    // The semaphore is never closed.
    while let Ok(place) = places.clone().acquire_owned().await {
        while connections.try_join_next().is_some() {}
        match socket.accept().await {
            Ok((stream, _)) => {
                let engine = engine.clone();
                connections.spawn(async move {
                    serve(stream, engine).await;
                    drop(place);
                });
            }
            Err(error) => {
                tracing::warn!(%error, "cannot accept a connection for metrics");
                tokio::time::sleep(PAUSE_AFTER_ERROR).await;
            }
        }
    }
}

async fn serve(stream: TcpStream, engine: Arc<dyn Engine>) {
    let answering = service_fn(|request| answer(request, engine.clone()));
    let mut http = http1::Builder::new();
    // Time is bounded for the connection as a whole.
    http.keep_alive(false).header_read_timeout(None).max_buf_size(MAX_HEAD_BYTES);
    match timeout(PATIENCE, http.serve_connection(TokioIo::new(stream), answering)).await {
        Ok(Ok(())) => {}
        Ok(Err(error)) => tracing::debug!(%error, "a connection for metrics broke off"),
        Err(_) => tracing::debug!("a connection for metrics took too long, and is dropped"),
    }
}

async fn answer(request: Request<Incoming>, engine: Arc<dyn Engine>) -> Result<Response<String>, Infallible> {
    if request.uri().path() != "/metrics" {
        return Ok(plain(StatusCode::NOT_FOUND, "there is /metrics alone\n"));
    }
    if !matches!(*request.method(), Method::GET | Method::HEAD) {
        let mut refused = plain(StatusCode::METHOD_NOT_ALLOWED, "metrics can be read alone\n");
        refused.headers_mut().insert(ALLOW, HeaderValue::from_static("GET, HEAD"));
        return Ok(refused);
    }
    // The status may wait for locks, as a client's does.
    Ok(match tokio::task::spawn_blocking(move || families::page_of(&engine.status())).await {
        Ok(page) => {
            let mut response = Response::new(page);
            response.headers_mut().insert(CONTENT_TYPE, HeaderValue::from_static(text::CONTENT_TYPE));
            response
        }
        Err(error) => {
            tracing::error!(%error, "the metrics have failed inside");
            plain(StatusCode::INTERNAL_SERVER_ERROR, "the daemon failed inside; see its log\n")
        }
    })
}

fn plain(status: StatusCode, words: &str) -> Response<String> {
    let mut response = Response::new(words.to_owned());
    *response.status_mut() = status;
    response
}
