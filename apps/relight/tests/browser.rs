//! Pages in a real browser, headless Chromium: needs `chromium` on the path (Debian's package of that name), or the
//! browser that `RELIGHT_BROWSER` names.

#![allow(clippy::unwrap_used)]

mod common;
#[path = "common/browser.rs"]
mod driver;
// The server's tests use the rest of it.
#[allow(dead_code)]
#[path = "serve/board.rs"]
mod served;

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use common::Workshop;
use driver::Browser;
use served::Board;

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
        assert_eq!(told["film"], 320, "{told}");
        assert!((told["seconds"].as_f64().unwrap() - 3.0).abs() < 0.1, "{told}");
        assert!(told["curve"].as_str().unwrap().starts_with('M'), "{told}");
        assert!(told["wide"].as_f64().unwrap() <= 0.0, "{told}");
        assert_eq!(told["faults"], serde_json::json!([]), "{told}");
    }
}

/// Pages of the server as they look, from narrow to wide, by day and by night: nothing reaches over the side, nothing fails, nothing
/// is refused by the browser.
#[allow(clippy::unwrap_used)]
fn looks_right(browser: &mut Browser, pages: &[String]) {
    for address in pages {
        for (width, dark) in [(390, false), (390, true), (1280, false)] {
            browser.look(width, dark);
            browser.open(address);
            let wide = browser.ask("document.documentElement.scrollWidth - innerWidth");
            assert!(wide.as_f64().unwrap() <= 0.0, "{address} at {width}: {wide} too wide");
            assert_eq!(browser.faults(), [""; 0], "{address} at {width}");
            // The style has arrived, and follows the user's preference.
            let paper = browser.ask("getComputedStyle(document.body).backgroundColor");
            let expected = if dark { "rgb(22, 19, 16)" } else { "rgb(251, 250, 247)" };
            assert_eq!(paper, expected, "{address}");
            let nameless = "[...document.querySelectorAll('input:not([type=hidden]), select, textarea, button')].filter(e => \
                !(e.labels?.length || e.getAttribute('aria-label') || e.textContent.trim())).map(e => e.outerHTML)";
            assert_eq!(browser.ask(nameless), serde_json::json!([]), "{address}: controls without a name");
            let scopeless = "document.querySelectorAll('th:not([scope])').length";
            assert_eq!(browser.ask(scopeless), 0, "{address}: heads of tables without a scope");
            if let Some(folder) = std::env::var_os("RELIGHT_SHEETS") {
                let name: String =
                    address.chars().map(|c| if c.is_alphanumeric() { c } else { '-' }).collect();
                let scheme = if dark { "dark" } else { "light" };
                browser.picture(&Path::new(&folder).join(format!("{name}-{width}-{scheme}.png")));
            }
        }
    }
}

#[test]
#[ignore = "needs Chromium"]
fn the_servers_pages_work() {
    let board = Board::new();
    let server = board.start();
    let at = |path: &str| format!("http://{}{path}", server.address);
    let hostile = "%3Cscript%3Ealert(1)%3C/script%3E%20%F0%9F%94%A6%20";
    let mut ids = Vec::new();
    for (salt, name) in [(1, "one"), (9, "nine"), (3, &format!("{hostile}{}", "W".repeat(150)))] {
        ids.push(server.submit(
            &format!("method={name}&authors=A.%20Author"),
            &board.token,
            &board.zip(salt, true),
        ));
        assert_eq!(server.verdict(&ids[ids.len() - 1], &board.token)["state"], "scored");
    }
    let mut browser = Browser::start(&board.path("browser"));

    // Someone signs up and makes a token.
    browser.open(&at("/sign-up"));
    browser.fill("#name", "Grace Hopper");
    browser.fill("#email", "grace@example.org");
    browser.fill("#password", "nanoseconds are short");
    browser.follow("form.stack button");
    browser.fill("#token-name", "laptop");
    browser.follow("form.row button");
    assert!(
        browser.ask("document.querySelector('#token').textContent").as_str().unwrap().starts_with("relight_")
    );

    // Uploads a zip on the page, sees it being scored and then its scores, without touching anything.
    std::fs::write(board.path("mine.zip"), board.zip(5, true)).unwrap();
    browser.open(&at("/benchmarks/tiny/upload"));
    browser.ask("document.querySelector('#phase-test').click(); document.querySelector('#visibility-anonymous').click()");
    browser.fill("#method", "mine");
    let root = browser.call("DOM.getDocument", serde_json::json!({}))["root"]["nodeId"].clone();
    let zip = browser.call("DOM.querySelector", serde_json::json!({ "nodeId": root, "selector": "#zip" }));
    let files = serde_json::json!({ "nodeId": zip["nodeId"], "files": [board.path("mine.zip")] });
    browser.call("DOM.setFileInputFiles", files);
    browser.ask("document.querySelector('form.upload button').click()");
    browser.wait("location.pathname.startsWith('/submissions/') && document.querySelector('table.scores')");
    browser.wait("[...document.images].filter(i => i.closest('.pictures')).every(i => i.complete && i.naturalWidth > 0)");
    let mine = browser.ask("location.pathname").as_str().unwrap().to_owned();
    assert_eq!(browser.faults(), [""; 0]);

    // The slider moves by the keyboard, and moves the picture.
    let at_percent = "document.querySelector('.compare').style.getPropertyValue('--at')";
    let clip = "getComputedStyle(document.querySelector('.compare .over')).clipPath";
    assert_eq!(browser.ask(at_percent), "50%");
    assert_eq!(browser.ask(clip), "inset(0px 0px 0px 50%)");
    browser.ask("document.querySelector('.compare input').focus()");
    for _ in 0..3 {
        browser.press("ArrowRight", 39);
    }
    browser.wait(&format!("{at_percent} === '53%'"));
    assert_eq!(browser.ask(clip), "inset(0px 0px 0px 53%)");
    browser.press("Home", 36);
    browser.wait(&format!("{at_percent} === '0%'"));
    assert_eq!(
        browser.ask("document.querySelector('.compare input').getAttribute('aria-valuetext')"),
        "0 % photograph"
    );

    // Sorting in place, by the keyboard; the address follows, and the server sorts the same way.
    let address = at("/benchmarks/tiny?split=easy");
    let order =
        "[...document.querySelectorAll('tr[data-text] th a')].map(a => a.textContent.slice(0, 4)).join()";
    browser.open(&address);
    assert_eq!(browser.ask(order), "one,<scr,mine,nine");
    browser.ask("window.isOld = true; document.querySelector('thead th a').focus()");
    browser.press("Enter", 13);
    browser.wait(&format!("{order} === '<scr,mine,nine,one'"));
    assert_eq!(browser.ask("document.querySelector('thead th').getAttribute('aria-sort')"), "ascending");
    assert_eq!(browser.ask("document.querySelector('tr[data-text] .place').textContent"), "2");
    browser.press("Enter", 13);
    browser.wait(&format!("{order} === 'one,nine,mine,<scr'"));
    assert_eq!(browser.ask("isOld"), true, "no page was loaded");
    browser.ask("location.reload()");
    browser.wait("!window.isOld && document.readyState === 'complete'");
    assert_eq!(browser.ask(order), "one,nine,mine,<scr");
    assert_eq!(browser.ask("document.querySelector('thead th').getAttribute('aria-sort')"), "descending");
    // And without a script.
    browser.call("Emulation.setScriptExecutionDisabled", serde_json::json!({ "value": true }));
    browser.follow("thead th:nth-child(2) a");
    assert_eq!(browser.ask(order), "one,<scr,mine,nine");
    browser.call("Emulation.setScriptExecutionDisabled", serde_json::json!({ "value": false }));

    // Filtering while one types.
    browser.open(&address);
    browser.fill("#q", "NIN");
    browser.wait("[...document.querySelectorAll('tr[data-text]')].filter(row => !row.hidden).length === 1");

    board.admin(&["grant-admin", "Grace Hopper"]);
    let mut pages: Vec<String> =
        ["/", "/benchmarks/tiny", "/benchmarks/tiny?split=val&metric=ssim", "/benchmarks/tiny/submit"]
            .into_iter()
            .chain(["/benchmarks/tiny/upload", "/account", "/account/submissions", &mine])
            .chain(["/admin", "/admin/submissions", "/admin/audit"])
            .map(at)
            .collect();
    pages.extend(ids.iter().map(|id| at(&format!("/submissions/{id}"))));
    looks_right(&mut browser, &pages);
    browser.open(&at("/account"));
    browser.follow("header form button");
    looks_right(&mut browser, &["/sign-in", "/sign-up", "/", "/benchmarks/tiny"].map(at));
    assert_eq!(browser.ask("document.querySelector('header nav').textContent"), "Sign inSign up");
}
