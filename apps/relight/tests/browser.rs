//! Pages in a real browser, headless Chromium: needs `chromium` on the path (Debian's package of that name), or the
//! browser that `RELIGHT_BROWSER` names.

mod common;

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use common::Workshop;

/// Writes what the browser made of the page into its title: pictures that it could not decode, their number, width and
/// length of the film, the training's curve, pixels that the page is too wide by, and faults of scripts.
const INSPECTION: &str = r#"<script>
const faults = [];
addEventListener("error", e => faults.push(e.message));
addEventListener("load", () => {
  const images = [...document.images], film = document.querySelector("video");
  const tell = () => document.title = JSON.stringify({
    broken: images.filter(i => !i.complete || i.naturalWidth === 0).length,
    images: images.length,
    film: film.videoWidth,
    seconds: film.duration,
    curve: document.querySelector("svg path + path").getAttribute("d"),
    wide: document.documentElement.scrollWidth - innerWidth,
    faults,
  });
  if (film.readyState > 0) tell(); else film.addEventListener("loadedmetadata", tell);
});
</script>"#;

/// What the inspection tells of a page in a window so wide.
#[allow(clippy::unwrap_used)]
fn inspect(page: &Path, profile: &Path, width: u32) -> serde_json::Value {
    let inspected = page.with_file_name("inspected.html");
    let text = fs::read_to_string(page).unwrap();
    fs::write(&inspected, text.replacen("</head>", &format!("{INSPECTION}</head>"), 1)).unwrap();
    let browser = std::env::var("RELIGHT_BROWSER").unwrap_or_else(|_| "chromium".to_owned());
    let output = Command::new(&browser)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-sync"])
        .args(["--disable-background-networking", "--disable-component-update", "--dump-dom"])
        .arg("--virtual-time-budget=10000")
        .arg(format!("--window-size={width},900"))
        .arg(format!("--user-data-dir={}", profile.display()))
        .arg(format!("file://{}", inspected.display()))
        .stdin(Stdio::null())
        .output()
        .unwrap_or_else(|e| panic!("{browser}: {e}; install chromium, or set RELIGHT_BROWSER"));
    let dom = String::from_utf8_lossy(&output.stdout);
    let (_, rest) = dom.split_once("<title>").unwrap_or_else(|| panic!("no page: {output:?}"));
    let (title, _) = rest.split_once("</title>").unwrap();
    serde_json::from_str(title).unwrap_or_else(|e| panic!("{e}: {title}"))
}

#[test]
#[ignore = "needs Chromium"]
fn the_page_of_the_demo_shows_all_that_is_on_it() {
    let shop = Workshop::new();
    shop.succeed("demo --out demo --minutes 0.05");
    for width in [1200, 500] {
        let told = inspect(&shop.path("demo/index.html"), &shop.path("browser"), width);
        // Three unseen images in four versions, and four maps.
        assert_eq!((&told["images"], &told["broken"]), (&16.into(), &0.into()), "{told}");
        assert_eq!(told["film"], 192, "{told}");
        assert!((told["seconds"].as_f64().unwrap() - 3.0).abs() < 0.1, "{told}");
        assert!(told["curve"].as_str().unwrap().starts_with('M'), "{told}");
        assert!(told["wide"].as_f64().unwrap() <= 0.0, "{told}");
        assert_eq!(told["faults"], serde_json::json!([]), "{told}");
    }
}
