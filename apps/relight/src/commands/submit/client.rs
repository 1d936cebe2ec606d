//! Asking an evaluation server.

use std::time::Duration;

use anyhow::Context;
use serde_json::Value;
use ureq::http::Response;
use ureq::{Agent, Body};

/// The longest answer that is read.
const LONGEST_ANSWER: u64 = 1 << 26;

/// What asks. Answers of every status are answers.
pub(super) fn agent() -> Agent {
    Agent::new_with_config(
        Agent::config_builder()
            .http_status_as_error(false)
            .user_agent(concat!("relight/", env!("CARGO_PKG_VERSION")))
            .timeout_connect(Some(Duration::from_secs(30)))
            .timeout_recv_response(Some(Duration::from_secs(600)))
            .build(),
    )
}

/// The server's address without what an address may end in.
pub(super) fn server(address: &str) -> anyhow::Result<String> {
    let server = address.trim_end_matches('/');
    let host = server.strip_prefix("https://").or_else(|| server.strip_prefix("http://"));
    host.filter(|host| !host.is_empty()).with_context(|| {
        format!("{address}: is not the address of a server, such as https://bench.example.org")
    })?;
    Ok(server.to_owned())
}

/// Whether nobody on the way can listen, or answer instead.
pub(super) fn is_private(server: &str) -> bool {
    let local = ["localhost", "127.", "[::1]"];
    match server.strip_prefix("http://") {
        Some(host) => local.iter().any(|local| host.starts_with(local)),
        None => true,
    }
}

/// The JSON of an answer.
pub(super) fn json(mut answer: Response<Body>) -> anyhow::Result<Value> {
    let status = answer.status();
    let text = answer.body_mut().with_config().limit(LONGEST_ANSWER).read_to_string()?;
    serde_json::from_str(&text)
        .with_context(|| format!("the answer ({status}) is not JSON: is this an evaluation server?"))
}

/// A mean score as people read it, to the digits of the tables.
pub(super) fn mean_line(split: &str, psnr: Option<f64>, ssim: f64) -> String {
    let psnr = psnr.map_or("infinite".to_owned(), |psnr| format!("{psnr:.2}"));
    format!("{split:<6} PSNR {psnr} dB, SSIM {ssim:.3}")
}
