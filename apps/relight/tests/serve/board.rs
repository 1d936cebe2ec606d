//! A tiny benchmark, the real server on a real port, and a client that can misbehave.

use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use relight_scene::{Image, Intrinsics, Pose, ReneWriter};
use relight_server::benchmark::Benchmark;
use serde_json::Value;
use tempfile::TempDir;

/// Pixels a row and rows of the benchmark's images.
const SIZE: (u32, u32) = (32, 24);

/// A server's folder with a benchmark `tiny` of two scenes, and a user `ada`.
pub struct Board {
    folder: TempDir,
    pub token: String,
}

impl Board {
    pub fn new() -> Board {
        Board::with(SIZE, None)
    }

    /// With images of that size, in a folder of data that another server has left.
    pub fn with(size: (u32, u32), data: Option<&Path>) -> Board {
        let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
        for (seed, name) in ["box", "cup"].into_iter().enumerate() {
            write_scene(&folder.path().join("scenes").join(name), seed, size);
        }
        if let Some(data) = data {
            std::os::unix::fs::symlink(data, folder.path().join("data")).unwrap();
        }
        Board::hosting(folder)
    }

    /// Of the scenes in the folder's `scenes`.
    pub fn hosting(folder: TempDir) -> Board {
        let mut board = Board { folder, token: String::new() };
        let scenes = board.path("scenes");
        board.admin(&["add-benchmark", "tiny", scenes.to_str().unwrap()]);
        board.token = board.add_user("ada");
        board
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn benchmark(&self) -> Benchmark {
        Benchmark::open(&self.path("scenes")).unwrap()
    }

    /// Runs an admin's command.
    pub fn try_admin(&self, arguments: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_relight"))
            .args(["-q", "serve", "admin", "--data"])
            .arg(self.path("data"))
            .args(arguments)
            .stdin(Stdio::null())
            .output()
            .unwrap()
    }

    /// Standard output of an admin's command that must succeed.
    pub fn admin(&self, arguments: &[&str]) -> String {
        let output = self.try_admin(arguments);
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap().trim_end().to_owned()
    }

    /// Adds a user; the token.
    pub fn add_user(&self, name: &str) -> String {
        self.admin(&["add-user", name, &format!("{name}@example.org")])
    }

    pub fn start(&self) -> Server {
        self.start_with(&[])
    }

    /// Starts the server, with further arguments.
    pub fn start_with(&self, arguments: &[&str]) -> Server {
        Server::start(&self.path("data"), arguments)
    }

    /// A zip for the benchmark: the hidden images, with validation if asked, each off the ground truth in a way that `salt`
    /// chooses.
    pub fn zip(&self, salt: u8, with_validation: bool) -> Vec<u8> {
        let mut entries = Vec::new();
        for image in self.benchmark().scenes.iter().flat_map(|scene| &scene.images) {
            if with_validation || image.split != relight_scene::Split::Val {
                let mut picture = image.read_truth().unwrap();
                picture.data.iter_mut().step_by(3).for_each(|byte| *byte ^= salt);
                entries.push((image.entry.clone(), picture.png().unwrap()));
            }
        }
        zip(&entries)
    }
}

/// A running server. Killed when dropped.
pub struct Server {
    child: Child,
    pub address: SocketAddr,
}

impl Server {
    pub fn start(data: &Path, arguments: &[&str]) -> Server {
        let mut child = Command::new(env!("CARGO_BIN_EXE_relight"))
            .args(["-q", "serve", "--listen", "127.0.0.1:0", "--data"])
            .arg(data)
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let address = line.trim().strip_prefix("http://").unwrap_or_else(|| panic!("{line:?}"));
        Server { address: address.parse().unwrap(), child }
    }

    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// `kill -9`.
    pub fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Asks it to stop, as service managers do.
    pub fn ask_to_stop(&self) {
        let asked = Command::new("kill").args(["-TERM", &self.id().to_string()]).status().unwrap();
        assert!(asked.success());
    }

    /// Waits until it has stopped by itself, without a fault.
    pub fn join(mut self) {
        assert!(self.child.wait().unwrap().success());
    }

    pub fn get(&self, path: &str, token: Option<&str>) -> Answer {
        request(self.address, "GET", path, token, &[]).unwrap()
    }

    pub fn post(&self, path: &str, token: Option<&str>, body: &[u8]) -> Answer {
        request(self.address, "POST", path, token, body).unwrap()
    }

    /// Uploads a zip with further words of the query.
    pub fn upload(&self, query: &str, token: &str, zip: &[u8]) -> Answer {
        self.post(&format!("/api/v1/benchmarks/tiny/submissions?{query}"), Some(token), zip)
    }

    /// Uploads a zip that must be taken; its name.
    pub fn submit(&self, query: &str, token: &str, zip: &[u8]) -> String {
        let answer = self.upload(query, token, zip);
        assert_eq!(answer.status, 202, "{answer:?}");
        answer.json()["id"].as_str().unwrap().to_owned()
    }

    /// Asks after a submission until it has a verdict.
    pub fn verdict(&self, id: &str, token: &str) -> Value {
        let begun = Instant::now();
        loop {
            let told = self.get(&format!("/api/v1/submissions/{id}"), Some(token)).json();
            match told["state"].as_str() {
                Some("scored" | "refused") => return told,
                Some("queued" | "scoring") => std::thread::sleep(Duration::from_millis(20)),
                _ => panic!("{told}"),
            }
            assert!(begun.elapsed() < Duration::from_secs(120), "{told}");
        }
    }
}

/// Waits for what happens soon after an answer.
pub fn wait_until(what: &str, is_so: impl Fn() -> bool) {
    let begun = Instant::now();
    while !is_so() {
        assert!(begun.elapsed() < Duration::from_secs(30), "{what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// What a server answered.
#[derive(Debug)]
pub struct Answer {
    pub status: u16,
    pub head: String,
    pub body: Vec<u8>,
}

impl Answer {
    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|error| panic!("{error}: {}", self.text()))
    }

    pub fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    /// The message of an error.
    pub fn error(&self) -> String {
        self.json()["error"].as_str().unwrap_or_else(|| panic!("{self:?}")).to_owned()
    }

    pub fn header(&self, name: &str) -> Option<&str> {
        let line = self.head.lines().find(|line| line.to_lowercase().starts_with(&format!("{name}:")))?;
        line.split_once(':').map(|(_, value)| value.trim())
    }
}

/// The head of a request that announces a body of `length` bytes.
pub fn head(method: &str, path: &str, token: Option<&str>, length: usize) -> String {
    let token = token.map(|token| format!("Authorization: Bearer {token}\r\n")).unwrap_or_default();
    format!(
        "{method} {path} HTTP/1.1\r\nHost: board\r\nConnection: close\r\n{token}Content-Length: {length}\r\n\r\n"
    )
}

/// A whole request and its answer.
pub fn request(
    address: SocketAddr,
    method: &str,
    path: &str,
    token: Option<&str>,
    body: &[u8],
) -> io::Result<Answer> {
    let mut stream = TcpStream::connect(address)?;
    stream.write_all(head(method, path, token, body.len()).as_bytes())?;
    // A server that has answered already may not want the rest.
    let sent = stream.write_all(body);
    read_answer(&mut stream).and_then(|answer| sent.map(|()| answer))
}

/// Reads an answer to its end.
pub fn read_answer(stream: &mut TcpStream) -> io::Result<Answer> {
    stream.set_read_timeout(Some(Duration::from_secs(60)))?;
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes)?;
    let torn = || io::Error::new(io::ErrorKind::UnexpectedEof, "no whole answer");
    let end = bytes.windows(4).position(|window| window == b"\r\n\r\n").ok_or_else(torn)?;
    let head = String::from_utf8_lossy(&bytes[..end]).into_owned();
    let status = head.split(' ').nth(1).and_then(|status| status.parse().ok()).ok_or_else(torn)?;
    let answer = Answer { status, head, body: bytes[end + 4..].to_vec() };
    match answer.header("content-length").map(|length| length.parse() == Ok(answer.body.len())) {
        Some(false) => Err(torn()),
        _ => Ok(answer),
    }
}

/// A zip with its entries stored as they are.
pub fn zip(entries: &[(String, Vec<u8>)]) -> Vec<u8> {
    let (mut zip, mut directory) = (Vec::new(), Vec::new());
    for (name, bytes) in entries {
        let (size, offset) = (bytes.len() as u32, zip.len() as u32);
        let mut stated = Vec::new();
        stated.extend([20u16, 0, 0, 0, 0x21].map(u16::to_le_bytes).concat());
        stated.extend([crc32fast::hash(bytes), size, size].map(u32::to_le_bytes).concat());
        stated.extend([name.len() as u16, 0].map(u16::to_le_bytes).concat());
        zip.extend(b"PK\x03\x04");
        zip.extend(&stated);
        zip.extend(name.as_bytes());
        zip.extend(bytes);
        directory.extend(b"PK\x01\x02\x14\x03");
        directory.extend(&stated);
        directory.extend([0u16, 0, 0].map(u16::to_le_bytes).concat());
        directory.extend([0o100_644u32 << 16, offset].map(u32::to_le_bytes).concat());
        directory.extend(name.as_bytes());
    }
    let (offset, size) = (zip.len() as u32, directory.len() as u32);
    zip.extend(&directory);
    zip.extend(b"PK\x05\x06");
    zip.extend([0, 0, entries.len() as u16, entries.len() as u16].map(u16::to_le_bytes).concat());
    zip.extend([size, offset].map(u32::to_le_bytes).concat());
    zip.extend([0, 0]);
    zip
}

fn write_scene(folder: &Path, seed: usize, (width, height): (u32, u32)) {
    let lens = Intrinsics { width, height, fx: 40.0, fy: 40.0, cx: 15.5, cy: 11.5, distortion: vec![0.0; 5] };
    let around = |i: usize, radius: f64, z: f64| {
        let angle = i as f64;
        Pose::look_at([radius * angle.cos(), radius * angle.sin(), z], [0.0; 3])
    };
    let cameras: Vec<Pose> = (0..6).map(|i| around(i, 0.5, 0.3)).collect();
    let lights: Vec<Pose> = (0..5).map(|i| around(i, 0.2, 0.35)).collect();
    let writer = ReneWriter::create(folder, &lens, cameras, &lights).unwrap();
    for (view, light) in (0..6).flat_map(|view| (0..5).map(move |light| (view, light))) {
        let shift = 100 * seed + 10 * view + light;
        let bytes = 3 * (width * height) as usize;
        let data = (0..bytes).map(|i| ((i * (7 + shift) + i * i / (3 + shift)) % 251) as u8).collect();
        let image = Image { width, height, data };
        writer.write_frame(view, light, &image.png().unwrap()).unwrap();
    }
}
