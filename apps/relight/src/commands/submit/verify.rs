//! `relight submit verify`: whether a receipt says what its server signed.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use relight_scene::read_text;
use relight_server::digest::sha256;
use relight_server::receipt::Receipt;
use serde_json::Value;

use super::client;
use crate::console::print_line;

/// The longest receipt that is read, bytes.
const LONGEST: u64 = 1 << 26;

/// Verify a receipt: that the server signed it, and that nothing in it was changed since.
///
/// The signature is held against the server's public key. Whoever remembers the key (URL/api/v1/receipt-key tells it) needs no server, and
/// older receipts verify when it is gone. With --zip also whether the scores are that zip's.
#[derive(clap::Args)]
#[command(
    group = clap::ArgGroup::new("public key").required(true).args(["from", "key"]),
    after_help = "Examples:\n  relight submit verify receipt.json --from https://bench.example.org --zip entry.zip\n  \
                  relight submit verify receipt.json --key 3b6a27bc…"
)]
pub struct Args {
    /// The receipt: the file that a submission's page hands out, or what `submit send --wait --json` printed.
    receipt: PathBuf,
    /// Address of the server, to ask it for its key.
    #[arg(long, value_name = "URL")]
    from: Option<String>,
    /// The server's public key, 64 hexadecimal digits.
    #[arg(long, value_name = "KEY")]
    key: Option<String>,
    /// The zip that the receipt should be about.
    #[arg(long, value_name = "FILE")]
    zip: Option<PathBuf>,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let receipt = read(&args.receipt)?;
    let key = match (&args.key, &args.from) {
        (Some(key), _) => key.clone(),
        (None, Some(address)) => key_of(address)?,
        (None, None) => bail!("give the server's address (--from) or its key (--key)"),
    };
    receipt.verify(&key).with_context(|| args.receipt.display().to_string())?;
    if let Some(zip) = &args.zip {
        let sum = sha256(zip).with_context(|| zip.display().to_string())?;
        ensure!(
            sum.eq_ignore_ascii_case(&receipt.sha256),
            "{}: is not the zip that the receipt is about: its SHA-256 is {sum}, and the receipt's {}",
            zip.display(),
            receipt.sha256
        );
    }
    let Receipt { method, benchmark, submission, scored_at, evaluator, scores, .. } = &receipt;
    print_line(&format!("{}: genuine", args.receipt.display()))?;
    print_line(&format!(
        "{method}, submission {submission} to {benchmark}, scored {scored_at} by {evaluator}"
    ))?;
    for mean in &scores.means {
        print_line(&client::mean_line(&mean.split.to_string(), mean.psnr, mean.ssim))?;
    }
    if let Some(zip) = &args.zip {
        print_line(&format!("{}: is the zip that was scored", zip.display()))?;
    }
    Ok(())
}

/// A receipt, alone or within the server's answer.
fn read(path: &Path) -> anyhow::Result<Receipt> {
    let at = || format!("{}: is no receipt", path.display());
    let mut value: Value = serde_json::from_str(&read_text(path, LONGEST)?).with_context(at)?;
    if let Some(receipt) = value.get_mut("receipt").map(Value::take) {
        value = receipt;
    }
    ensure!(
        !value.is_null(),
        "{}: holds no receipt: only submissions that are scored have one",
        path.display()
    );
    serde_json::from_value(value).with_context(at)
}

/// The public key that a server tells.
fn key_of(address: &str) -> anyhow::Result<String> {
    let server = client::server(address)?;
    if !client::is_private(&server) {
        tracing::warn!(
            "{server}: without https others may answer in its place; use https where the server has it"
        );
    }
    let address = format!("{server}/api/v1/receipt-key");
    let answer = client::agent().get(&address).call();
    let answer =
        answer.with_context(|| format!("{server}: cannot be reached; with --key its key will do"))?;
    let answer = client::json(answer).with_context(|| address.clone())?;
    let key = answer["public_key"].as_str();
    key.map(str::to_owned).with_context(|| format!("{address}: its answer holds no key: {answer}"))
}
