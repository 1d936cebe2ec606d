//! `relight submit send`: a zip to an evaluation server.

use std::fs::File;
use std::io::{self, Read};
use std::path::PathBuf;
use std::thread;
use std::time::Duration;

use anyhow::{Context, bail, ensure};
use relight_server::method::Phase;
use serde_json::Value;
use ureq::http::StatusCode;
use ureq::{Agent, SendBody};

use super::check::{check_phase, checked, phase_of};
use super::client;
use crate::console::{Progress, cancel_flag, print_json, print_line, unless};

/// The variable that holds the token.
const TOKEN: &str = "RELIGHT_TOKEN";
/// How long it takes until the server is asked again.
const ASK_EVERY: Duration = Duration::from_secs(2);

/// Send a zip to an evaluation server. Prints the submission's id.
///
/// The server refuses at once who may not submit (a wrong token, a spent quota) and checks the zip when its turn comes; a zip that
/// fails the check costs no quota. With --wait the scores are printed too.
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  RELIGHT_TOKEN=… relight submit send entry.zip --to https://bench.example.org --benchmark rene \\\n      \
                  --method \"My method\" --authors \"A. Author\" --paper https://arxiv.org/abs/… --wait"
)]
pub struct Args {
    /// The submission.
    zip: PathBuf,
    /// Address of the server.
    #[arg(long, value_name = "URL")]
    to: String,
    /// The benchmark's name there.
    #[arg(long, value_name = "NAME")]
    benchmark: String,
    /// Your token; better in the variable RELIGHT_TOKEN, since other users of a machine see arguments.
    #[arg(long)]
    token: Option<String>,
    /// Which images: test (easy and hard) or val. [default: with --scenes whichever the zip's images are for, else test]
    #[arg(long, value_name = "test|val")]
    phase: Option<Phase>,
    /// Who shall see it: public, anonymous or private. [default: the server's, public]
    #[arg(long, value_name = "public|anonymous|private")]
    visibility: Option<String>,
    /// Name of the method. [default: your name there]
    #[arg(long, visible_alias = "name")]
    method: Option<String>,
    /// Its authors.
    #[arg(long)]
    authors: Option<String>,
    /// A few words on it.
    #[arg(long)]
    description: Option<String>,
    /// Address of its paper.
    #[arg(long, value_name = "URL")]
    paper: Option<String>,
    /// Address of its code.
    #[arg(long, value_name = "URL")]
    code: Option<String>,
    /// What it was trained on.
    #[arg(long)]
    hardware: Option<String>,
    /// How long training a scene took.
    #[arg(long, value_name = "TEXT")]
    training_time: Option<String>,
    /// Folder of the benchmark's scenes: check the zip against it before it is sent.
    #[arg(long, value_name = "DIR")]
    scenes: Option<PathBuf>,
    /// Wait for the scores.
    #[arg(long)]
    wait: bool,
    /// One JSON object on standard output: the server's answer.
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args, quiet: bool) -> anyhow::Result<()> {
    let token = args.token.clone().or_else(|| std::env::var(TOKEN).ok()).filter(|token| !token.is_empty());
    let token = token.with_context(|| {
        format!("no token: set the variable {TOKEN} to yours, or give --token; the server's account page makes one")
    })?;
    let server = client::server(&args.to)?;
    if !client::is_private(&server) {
        tracing::warn!("{server}: the token is sent unencrypted; use https where the server has it");
    }
    let mut phase = args.phase;
    if let Some(scenes) = &args.scenes {
        let submission = checked(&args.zip, scenes, quiet)?;
        check_phase(&submission, phase, &args.zip)?;
        phase = Some(phase_of(&submission));
    }
    let agent = client::agent();
    let answer = upload(args, phase, &agent, &server, &token, quiet)?;
    let id = answer["id"].as_str().with_context(|| format!("{server}: its answer names no id: {answer}"))?;
    if !args.wait {
        return if args.json { print_json(&answer) } else { print_line(id) };
    }
    if !args.json {
        print_line(id)?;
    }
    let answer = wait(&agent, &server, &token, id, quiet)?;
    if args.json {
        print_json(&answer)?;
    }
    tell(&answer, args.json)
}

/// Sends the zip; the answer, if the server took it.
fn upload(
    args: &Args,
    phase: Option<Phase>,
    agent: &Agent,
    server: &str,
    token: &str,
    quiet: bool,
) -> anyhow::Result<Value> {
    let at = || args.zip.display().to_string();
    let zip = File::open(&args.zip).with_context(at)?;
    let bytes = zip.metadata().with_context(at)?.len();
    let phase = phase.map(|phase| phase.to_string());
    let told = [
        ("phase", &phase),
        ("visibility", &args.visibility),
        ("method", &args.method),
        ("authors", &args.authors),
        ("description", &args.description),
        ("paper", &args.paper),
        ("code", &args.code),
        ("hardware", &args.hardware),
        ("training_time", &args.training_time),
    ];
    let address = format!("{server}/api/v1/benchmarks/{}/submissions", path_segment(&args.benchmark)?);
    let mut request = agent
        .post(&address)
        .header("authorization", format!("Bearer {token}"))
        .header("content-type", "application/zip")
        .header("content-length", bytes)
        // Who may not submit is told so before gigabytes are sent.
        .header("expect", "100-continue");
    for (name, value) in told {
        if let Some(value) = value {
            request = request.query(name, value);
        }
    }
    let bar = Progress::new("sending", bytes, quiet);
    let mut body = Watched { zip, sent: 0, bytes, bar: &bar, stopped: cancel_flag()? };
    let answer = request.send(SendBody::from_reader(&mut body));
    bar.clear();
    let answer = answer.with_context(|| format!("{server}: cannot be reached, or broke off"))?;
    let status = answer.status();
    let retry = answer.headers().get("retry-after").and_then(|value| value.to_str().ok()).map(str::to_owned);
    let body = client::json(answer).with_context(|| server.to_owned())?;
    if status.is_success() {
        return Ok(body);
    }
    let said = body["error"].as_str().unwrap_or("it does not say why");
    let hint = match status {
        StatusCode::UNAUTHORIZED => {
            format!(" Check the token ({TOKEN} or --token): it is made on the server's account page.")
        }
        StatusCode::NOT_FOUND => {
            format!(" Check the name of the benchmark, {:?}, and the address.", args.benchmark)
        }
        StatusCode::PAYLOAD_TOO_LARGE => {
            format!(" The zip has {bytes} bytes; relight submit check tells what it needs not hold.")
        }
        StatusCode::TOO_MANY_REQUESTS => {
            retry.map_or_else(String::new, |wait| format!(" Try again in {wait} s."))
        }
        _ => String::new(),
    };
    bail!("{server} refused the submission ({}): {said}.{hint}", status.as_u16())
}

/// A name as part of an address.
fn path_segment(name: &str) -> anyhow::Result<&str> {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.' | '~');
    ensure!(
        !name.is_empty() && name.chars().all(is_plain) && name.chars().any(|c| c != '.'),
        "{name:?} is no benchmark's name: these have letters, digits, - and _"
    );
    Ok(name)
}

/// The zip on its way, watched.
struct Watched<'a> {
    zip: File,
    sent: u64,
    bytes: u64,
    bar: &'a Progress,
    stopped: &'a std::sync::atomic::AtomicBool,
}

impl Read for Watched<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if unless(self.stopped).is_break() {
            // Not Interrupted: that asks for another try.
            return Err(io::Error::other("stopped before all was sent"));
        }
        let read = self.zip.read(buffer)?;
        self.sent += read as u64;
        self.bar.update(self.sent, self.bytes, || {
            format!("{} of {} MB", self.sent / 1_000_000, self.bytes / 1_000_000)
        });
        Ok(read)
    }
}

/// Asks after a submission until it is scored or refused.
fn wait(agent: &Agent, server: &str, token: &str, id: &str, quiet: bool) -> anyhow::Result<Value> {
    let address = format!("{server}/api/v1/submissions/{}", path_segment(id)?);
    let cancel = cancel_flag()?;
    let bar = Progress::new("waiting", 100, quiet);
    loop {
        let answer = agent.get(&address).header("authorization", format!("Bearer {token}")).call();
        // What was accepted is safe: a server that is away for a moment is asked again.
        match answer {
            Ok(answer) if answer.status().is_success() => {
                let answer = client::json(answer).with_context(|| address.clone())?;
                let state = answer["state"].as_str().unwrap_or_default().to_owned();
                if state != "queued" && state != "scoring" {
                    bar.clear();
                    return Ok(answer);
                }
                let share = answer["progress"].as_f64().unwrap_or(0.0);
                bar.update((100.0 * share) as u64, 100, || state);
            }
            Ok(answer)
                if answer.status().is_client_error() && answer.status() != StatusCode::TOO_MANY_REQUESTS =>
            {
                bail!("{address}: the server answers {}", answer.status());
            }
            Ok(answer) => tracing::debug!("{address}: {}", answer.status()),
            Err(error) => tracing::debug!("{address}: {error}"),
        }
        // In small parts, so that Ctrl-C need not wait.
        for _ in 0..20 {
            if unless(cancel).is_break() {
                bail!("stopped waiting; {address} will tell the scores");
            }
            thread::sleep(ASK_EVERY / 20);
        }
    }
}

/// Prints how a submission did.
fn tell(answer: &Value, is_told: bool) -> anyhow::Result<()> {
    if answer["state"] == "scored" {
        let means = answer["scores"]["means"].as_array().map(Vec::as_slice).unwrap_or_default();
        for mean in means.iter().filter(|_| !is_told) {
            let number = |name: &str| mean[name].as_f64();
            let split = mean["split"].as_str().unwrap_or_default();
            print_line(&client::mean_line(split, number("psnr"), number("ssim").unwrap_or(f64::NAN)))?;
        }
        return Ok(());
    }
    let problems = answer["problems"].as_array().map(Vec::as_slice).unwrap_or_default();
    for problem in problems.iter().filter(|_| !is_told) {
        let text = |name: &str| problem[name].as_str().unwrap_or_default();
        let entry = problem["entry"].as_str().unwrap_or("the zip");
        print_line(&format!("{entry}: {} [{}]", text("message"), text("code")))?;
    }
    let state = answer["state"].as_str().unwrap_or("in a state that it does not name");
    bail!("the submission is {state}: {}", answer["reason"].as_str().unwrap_or("see the problems above"))
}
