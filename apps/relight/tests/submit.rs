//! `relight submit` end to end, against a server of a few lines.

#![allow(clippy::unwrap_used)]

mod common;

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpListener;
use std::thread::{self, JoinHandle};

use common::Workshop;
use relight_scene::{Image, Scene};

/// A workshop with a trained run.
fn workshop() -> Workshop {
    let workshop = Workshop::new();
    workshop.train("run");
    workshop
}

#[test]
fn what_is_packed_passes_the_check() {
    let workshop = workshop();
    let told = workshop.succeed("submit pack run --out a.zip");
    let verdict = workshop.json("submit check a.zip --scenes scene --json");
    assert_eq!((&verdict["passed"], &verdict["problems"]), (&true.into(), &serde_json::json!([])));
    assert_eq!(verdict["splits"], serde_json::json!(["easy", "hard"]));
    assert!(told.contains(&format!("a.zip: {} images", verdict["images"])), "{told}");
    assert!(!workshop.path("a.zip.pictures").exists());
    // The test images of a participant are black, and the check is the same.
    let scene = Scene::open(&workshop.path("scene")).unwrap();
    let asked = relight_server::benchmark::Benchmark::layout(&scene.root).unwrap();
    for image in &asked.scenes[0].images {
        let data = vec![0; 3 * (image.width * image.height) as usize];
        Image { width: image.width, height: image.height, data }.write_png(&image.truth).unwrap();
    }
    workshop.succeed("submit check a.zip --scenes scene");
    // The same run makes the same bytes.
    workshop.succeed("submit pack run --out b.zip --phase test");
    assert_eq!(fs::read(workshop.path("a.zip")).unwrap(), fs::read(workshop.path("b.zip")).unwrap());
    workshop.succeed("submit pack run --out val.zip --phase val");
    let verdict = workshop.json("submit check val.zip --scenes scene --json");
    assert_eq!(verdict["splits"], serde_json::json!(["val"]));
}

#[test]
fn packing_goes_on_with_what_was_drawn() {
    let workshop = workshop();
    let asked = relight_server::benchmark::Benchmark::layout(&workshop.path("scene")).unwrap();
    let image = asked.scenes[0].images.last().unwrap();
    let weights = crc32fast::hash(&fs::read(workshop.path("run/weights.safetensors")).unwrap());
    let kept = workshop.path(&format!("a.zip.pictures/scene-{weights:08x}"));
    fs::create_dir_all(&kept).unwrap();
    let data = vec![77; 3 * (image.width * image.height) as usize];
    let drawn = Image { width: image.width, height: image.height, data };
    drawn.write_png(&kept.join(&image.entry)).unwrap();
    workshop.succeed("submit pack run --out a.zip");
    let zip = fs::read(workshop.path("a.zip")).unwrap();
    let png = drawn.png().unwrap();
    assert!(zip.windows(png.len()).any(|part| part == png));
}

#[test]
fn every_problem_of_a_zip_is_told() {
    let workshop = workshop();
    workshop.succeed("submit pack run --out a.zip");
    fs::create_dir(workshop.path("pictures")).unwrap();
    let asked = relight_server::benchmark::Benchmark::layout(&workshop.path("scene")).unwrap();
    let images: Vec<_> =
        asked.scenes[0].images.iter().filter(|image| image.split != relight_scene::Split::Val).collect();
    for image in &images[1..] {
        let (width, height) =
            if image.entry == images[1].entry { (3, 2) } else { (image.width, image.height) };
        let data = vec![9; 3 * (width * height) as usize];
        let path = workshop.path("pictures").join(&image.entry);
        Image { width, height, data }.write_png(&path).unwrap();
    }
    workshop.succeed("submit pack --images pictures --out b.zip");
    let output = workshop.run("submit check b.zip --scenes scene");
    let told = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(1));
    let missing = format!("{}: is missing", images[0].entry);
    assert!(told.contains(&missing) && told.contains("[missing-image]"), "{told}");
    fs::write(workshop.path("pictures").join(&images[0].entry), b"\xff\xd8\xff\xe0").unwrap();
    workshop.succeed("submit pack --images pictures --out b.zip");
    let output = workshop.run("submit check b.zip --scenes scene --json");
    let verdict: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let codes: Vec<&str> = verdict["problems"]
        .as_array()
        .unwrap()
        .iter()
        .map(|problem| problem["code"].as_str().unwrap())
        .collect();
    assert_eq!((output.status.code(), codes), (Some(1), vec!["not-png", "wrong-size"]));
    fs::write(workshop.path("c.zip"), "no zip").unwrap();
    workshop.fail("submit check c.zip --scenes scene", 1);
    workshop.fail("submit check missing.zip --scenes scene", 1);
    workshop.fail("submit pack run run --out d.zip", 1);
    workshop.fail("submit pack --out d.zip", 2);
}

/// A request as the server got it.
struct Got {
    line: String,
    headers: String,
    body: Vec<u8>,
}

/// A server that gives these answers, one a connection.
fn serve(answers: Vec<(&'static str, &'static str)>) -> (String, JoinHandle<Vec<Got>>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("http://{}", listener.local_addr().unwrap());
    let answering = thread::spawn(move || {
        let answer = |(status, body): (&str, &str)| {
            let (mut stream, _) = listener.accept().unwrap();
            let mut reader = BufReader::new(stream.try_clone().unwrap());
            let (mut line, mut headers) = (String::new(), String::new());
            reader.read_line(&mut line).unwrap();
            loop {
                let mut header = String::new();
                reader.read_line(&mut header).unwrap();
                if header.trim().is_empty() {
                    break;
                }
                headers.push_str(&header.to_lowercase());
            }
            let length = headers.lines().find_map(|line| line.strip_prefix("content-length: "));
            let mut bytes = vec![0; length.map_or(0, |length| length.trim().parse().unwrap())];
            // As real servers do: who is refused need not send.
            let is_taken = status.starts_with('2');
            if is_taken && headers.contains("expect: 100-continue") {
                stream.write_all(b"HTTP/1.1 100 Continue\r\n\r\n").unwrap();
            }
            if is_taken {
                reader.read_exact(&mut bytes).unwrap();
            }
            let length = body.len();
            write!(
                stream,
                "HTTP/1.1 {status}\r\ncontent-length: {length}\r\nconnection: close\r\n\r\n{body}"
            )
            .unwrap();
            Got { line, headers, body: bytes }
        };
        answers.into_iter().map(answer).collect()
    });
    (address, answering)
}

#[test]
fn a_zip_is_sent_and_its_scores_are_waited_for() {
    let workshop = Workshop::new();
    let zip: Vec<u8> = (0..200_000_u32).map(|i| i.wrapping_mul(i) as u8).collect();
    fs::write(workshop.path("a.zip"), &zip).unwrap();
    let scores = r#"{"state":"scored","scores":{"means":[{"split":"easy","psnr":25.791,"ssim":0.6204},{"split":"hard","psnr":null,"ssim":1}]}}"#;
    let (address, server) = serve(vec![
        ("202 Accepted", r#"{"id":"7k3"}"#),
        ("200 OK", r#"{"state":"scoring","progress":0.5}"#),
        ("200 OK", scores),
    ]);
    let mut command = workshop.command(&format!("submit send a.zip --to {address}/ --benchmark rene --wait"));
    let output = command
        .args(["--method", "A & B, größer", "--training-time", "5 h"])
        .env("RELIGHT_TOKEN", "se-cret")
        .output()
        .unwrap();
    let told = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(told, "7k3\neasy   PSNR 25.79 dB, SSIM 0.620\nhard   PSNR infinite dB, SSIM 1.000\n");
    let got = server.join().unwrap();
    assert!(got[0].line.starts_with("POST /api/v1/benchmarks/rene/submissions?"), "{}", got[0].line);
    let query = got[0].line.split([' ', '?']).nth(2).unwrap();
    let fields: Vec<&str> = query.split('&').collect();
    assert_eq!(fields.len(), 2, "{query}");
    assert!(fields[0].contains("%26") && fields[0].contains("gr%C3%B6%C3%9Fer"), "{query}");
    assert!(fields[1].starts_with("training_time=5"), "{query}");
    assert!(got[0].headers.contains("authorization: bearer se-cret"));
    assert_eq!(got[0].body, zip);
    assert!(got[2].line.starts_with("GET /api/v1/submissions/7k3 "));
}

#[test]
fn refusals_of_the_server_say_what_to_do() {
    let workshop = Workshop::new();
    fs::write(workshop.path("a.zip"), vec![1; 100_000]).unwrap();
    let refusals = [
        ("401 Unauthorized", r#"{"error":"give a token that works"}"#, "Check the token"),
        ("413 Payload Too Large", r#"{"error":"too large"}"#, "100000 bytes"),
        ("429 Too Many Requests", r#"{"error":"the quota of 2 a day is spent"}"#, "2 a day is spent"),
        ("404 Not Found", r#"{"error":"no such benchmark"}"#, "\"rene\""),
        ("200 OK", "<html>", "is this an evaluation server"),
    ];
    for (status, body, hint) in refusals {
        let (address, server) = serve(vec![(status, body)]);
        let told =
            workshop.fail(&format!("submit send a.zip --to {address} --benchmark rene --token wrong"), 1);
        assert!(told.contains(hint), "{status}: {told}");
        server.join().unwrap();
    }
    let (address, server) = serve(vec![
        ("202 Accepted", r#"{"id":"7k3"}"#),
        (
            "200 OK",
            r#"{"state":"refused","reason":"2 problems","problems":[{"code":"not-png","entry":"a.png","message":"is a JPEG file"}]}"#,
        ),
    ]);
    let output = workshop.run(&format!("submit send a.zip --to {address} --benchmark rene --token x --wait"));
    let told = String::from_utf8(output.stdout).unwrap();
    assert_eq!((output.status.code(), told.as_str()), (Some(1), "7k3\na.png: is a JPEG file [not-png]\n"));
    server.join().unwrap();
    let told = workshop.fail("submit send a.zip --to http://127.0.0.1:1 --benchmark rene --token x", 1);
    assert!(told.contains("cannot be reached"), "{told}");
    let mut without = workshop.command("submit send a.zip --to http://127.0.0.1:1 --benchmark rene");
    let output = without.env_remove("RELIGHT_TOKEN").output().unwrap();
    assert!(String::from_utf8_lossy(&output.stderr).contains("RELIGHT_TOKEN"));
    workshop.fail("submit send a.zip --to bench.example.org --benchmark rene --token x", 1);
    workshop.fail("submit send a.zip --to http://127.0.0.1:1 --benchmark ../x --token x", 1);
}
