//! The pages, over HTTP but without a browser: who sees what, what is escaped, which forms are taken.

#![allow(clippy::unwrap_used)]

mod fair;

use std::sync::Arc;

use axum::body::Body;
use axum::http::{Request, StatusCode, header};
use fair::{Fair, HOSTILE, text, token_in};
use relight_server::accounts;
use relight_server::method::{Method, Phase, Visibility};
use serde_json::Value;

/// Every address that answers with a page, and whether one must be signed in.
const PAGES: [(&str, bool); 14] = [
    ("/", false),
    ("/benchmarks/rene", false),
    ("/benchmarks/rene?split=hard&metric=ssim&sort=rank&order=desc&q=a", false),
    ("/benchmarks/rene?split=val", false),
    ("/benchmarks/rene/submit", false),
    ("/submissions/0000", false),
    ("/submissions/5a1", false),
    ("/sign-in", false),
    ("/sign-up", false),
    ("/account", true),
    ("/account/submissions", true),
    ("/benchmarks/rene/upload", true),
    ("/submissions/0000", true),
    ("/submissions/bad", true),
];

#[tokio::test]
async fn leaderboards_that_did_not_change_stay_drawn() {
    let fair = Fair::with(&["one", "two"]).await;
    let board = async || fair.app.boards.current(&fair.app.store).await.unwrap().board("rene").unwrap();
    let before = board().await;
    // What only its user sees is nobody else's news.
    let private = Method { name: "three".into(), ..Method::default() };
    fair.scored("3333", private, Phase::Test, Visibility::Private, 30.0).await;
    fair.app.boards.changed();
    assert!(Arc::ptr_eq(&board().await, &before));
    fair.app.store.set_hidden("0001", true, "admin").await.unwrap();
    fair.app.boards.changed();
    assert!(!Arc::ptr_eq(&board().await, &before));
}

#[tokio::test]
async fn every_page_escapes_hostile_names() {
    let long = "W".repeat(200);
    let names: Vec<&str> = HOSTILE.iter().copied().chain([long.as_str()]).collect();
    let mut fair = Fair::with(&names).await;
    let mallory =
        accounts::sign_up(&fair.app.store, HOSTILE[0], "m@example.org", "analytical engine").await.unwrap();
    accounts::new_token(&fair.app.store, &mallory, HOSTILE[1], "test").await.unwrap();
    let method = Method { name: HOSTILE[1].into(), authors: HOSTILE[2].into(), ..Method::default() };
    let hers = std::mem::replace(&mut fair.ada, mallory.clone());
    fair.scored("eeee", method, Phase::Test, Visibility::Public, 30.0).await;
    fair.ada = hers;
    fair.cookie =
        format!("relight_session={}", accounts::new_session(&fair.app.store, &mallory).await.unwrap());
    let hostile_query = "?q=%22%3E%3Cscript%3Ealert(1)%3C/script%3E";
    let mut shown = 0;
    for (address, signed_in) in PAGES {
        // Others' refused submissions are nobody's business.
        let expected = if address.ends_with("bad") { StatusCode::NOT_FOUND } else { StatusCode::OK };
        let mut addresses = vec![(address.to_owned(), expected)];
        if address == "/benchmarks/rene" {
            addresses.push((format!("{address}{hostile_query}"), StatusCode::OK));
            addresses.push((format!("{address}?sort=%3Cscript%3E"), StatusCode::BAD_REQUEST));
        }
        for (address, expected) in addresses {
            let (status, page) = fair.get(&address, signed_in).await;
            assert_eq!(status, expected, "{address}: {page}");
            let inner = page.replace("<script type=\"module\" src=\"/static/script-", "");
            assert!(!inner.contains("<script") && !inner.contains("<img src=x"), "{address}: {page}");
            // Nothing that the policy would refuse.
            assert!(
                !page.contains(" style=") && !page.contains("<style") && !page.contains(" onclick="),
                "{address}"
            );
            assert!(page.starts_with("<!DOCTYPE html>") && page.ends_with("</html>"), "{address}");
            shown += page.matches("&lt;script&gt;alert(1)").count();
        }
    }
    assert!(shown > 10, "hostile names are shown, escaped: {shown}");
}

#[tokio::test]
async fn every_answer_tells_the_browser_what_not_to_do() {
    let fair = Fair::with(&["V5"]).await;
    let mut addresses: Vec<&str> = PAGES.iter().map(|(address, _)| *address).collect();
    addresses.extend(["/nowhere", "/api/v1/nowhere", "/healthz", "/api/v1/benchmarks/rene/leaderboard.csv"]);
    for address in addresses {
        let response = fair.send(Request::get(address).body(Body::empty()).unwrap()).await;
        let headers = response.headers();
        let of = |name: &str| {
            headers.get(name).unwrap_or_else(|| panic!("{address}: no {name}")).to_str().unwrap()
        };
        let policy = of("content-security-policy");
        assert!(policy.starts_with("default-src 'none'; script-src 'self'; style-src 'self'"), "{policy}");
        assert!(!policy.contains("unsafe") && policy.contains("frame-ancestors 'none'"), "{policy}");
        assert_eq!(of("x-content-type-options"), "nosniff");
        assert_eq!(of("x-frame-options"), "DENY");
        assert_eq!(of("referrer-policy"), "same-origin");
        assert_eq!(of("cache-control"), "no-cache");
    }
    let request = Request::get("/account").header(header::COOKIE, &fair.cookie).body(Body::empty()).unwrap();
    assert_eq!(fair.send(request).await.headers()[header::CACHE_CONTROL], "private, no-store");
}

#[tokio::test]
async fn assets_are_kept_for_ever_under_names_of_what_they_hold() {
    let fair = Fair::new().await;
    let (_, page) = fair.get("/", false).await;
    for (start, kind) in [
        ("/static/style-", "text/css"),
        ("/static/script-", "text/javascript"),
        ("/static/icon-", "image/svg"),
    ] {
        let at = page.find(start).unwrap_or_else(|| panic!("no {start}"));
        let address = page[at..].split('"').next().unwrap();
        let response = fair.send(Request::get(address).body(Body::empty()).unwrap()).await;
        assert_eq!(response.status(), StatusCode::OK);
        assert!(response.headers()[header::CONTENT_TYPE].to_str().unwrap().starts_with(kind));
        assert!(response.headers()[header::CACHE_CONTROL].to_str().unwrap().contains("immutable"));
    }
    assert_eq!(fair.get("/static/style-0000000000000000.css", false).await.0, StatusCode::NOT_FOUND);
}

#[tokio::test]
async fn forms_without_their_token_are_refused() {
    let fair = Fair::with(&["V5"]).await;
    let forms = [
        ("/sign-in", "name=a&password=b"),
        ("/sign-up", "name=a&email=b@c&password=0123456789"),
        ("/sign-out", ""),
        ("/account/tokens", "name=laptop"),
        ("/account/tokens/1/revoke", ""),
        ("/account/password", "old=analytical+engine&new=0123456789"),
        ("/submissions/0000/visibility", "to=private"),
        ("/submissions/0000/withdraw", ""),
    ];
    for (address, form) in forms {
        for token in ["", "form_token=", "form_token=00", &format!("form_token={}", "0".repeat(64))] {
            let (status, page) = fair.post(address, &format!("{form}&{token}")).await;
            assert_eq!(status, StatusCode::FORBIDDEN, "{address} {token}: {page}");
        }
        // Of no cookie at all, the token of no cookie is none.
        let request = Request::post(address).body(Body::from(format!("{form}&form_token=")));
        assert_eq!(fair.send(request.unwrap()).await.status(), StatusCode::FORBIDDEN, "{address}");
    }
    let (status, _) =
        upload(&fair, &[("phase", "val"), ("visibility", "public"), ("method", "m"), ("zip", "PK")]).await;
    assert_eq!(status, StatusCode::FORBIDDEN);
    // Nothing has happened.
    assert!(fair.app.store.tokens(&fair.ada).await.unwrap().is_empty());
    let entry = fair.app.store.submission("0000").await.unwrap();
    assert_eq!((entry.visibility, entry.withdrawn_at), (Visibility::Public, None));
    assert_eq!(fair.app.store.users().await.unwrap().len(), 1);
    assert_eq!(fair.get("/account", true).await.0, StatusCode::OK);
}

/// Sends the upload form with these fields.
#[allow(clippy::unwrap_used)]
async fn upload(fair: &Fair, fields: &[(&str, &str)]) -> (StatusCode, String) {
    let mut body = String::new();
    for (name, value) in fields {
        let file = if *name == "zip" { "; filename=\"a.zip\"" } else { "" };
        body += &format!("--XX\r\nContent-Disposition: form-data; name=\"{name}\"{file}\r\n\r\n{value}\r\n");
    }
    let request = Request::post("/benchmarks/rene/upload")
        .header(header::COOKIE, &fair.cookie)
        .header(header::CONTENT_TYPE, "multipart/form-data; boundary=XX")
        .body(Body::from(body + "--XX--\r\n"));
    let response = fair.send(request.unwrap()).await;
    let to = response.headers().get(header::LOCATION).map(|to| to.to_str().unwrap().to_owned());
    let (status, page) = text(response).await;
    (status, to.unwrap_or(page))
}

#[tokio::test]
async fn a_zip_comes_in_through_the_form() {
    let fair = Fair::new().await;
    let token = fair.form_token().await;
    let fields = [
        ("form_token", token.as_str()),
        ("phase", "val"),
        ("method", "V5 <b>"),
        ("description", "a\r\nb"),
        ("visibility", "private"),
    ];
    let (status, to) = upload(&fair, &[&fields[..], &[("zip", "PK no zip")]].concat()).await;
    assert_eq!(status, StatusCode::SEE_OTHER, "{to}");
    let id = to.strip_prefix("/submissions/").unwrap();
    let entry = fair.app.store.submission(id).await.unwrap();
    assert_eq!((entry.phase, entry.visibility, entry.bytes), (Phase::Val, Visibility::Private, 9));
    assert_eq!((entry.method.name.as_str(), entry.method.description.as_str()), ("V5 <b>", "a\nb"));
    assert_eq!(std::fs::read(fair.app.folder.zip(id)).unwrap(), b"PK no zip");
    let (status, page) = fair.get(&to, true).await;
    assert!(status == StatusCode::OK && page.contains("Waiting") && page.contains("data-waiting"), "{page}");
    assert_eq!(fair.get(&to, false).await.0, StatusCode::NOT_FOUND);
    // What is wrong is told on the form.
    for (fields, told) in [
        (vec![("form_token", token.as_str()), ("phase", "val"), ("zip", "PK")], "Say who shall see it."),
        (vec![("form_token", &token), ("phase", "all")], "none of val, test"),
        (vec![("form_token", &token), ("phase", "val")], "There is no zip in the form"),
        (
            [&fields[..], &[("paper", "javascript:alert(1)"), ("zip", "PK")]].concat(),
            "no http or https address",
        ),
        ([&fields[..], &[("zip", "")]].concat(), "The body is empty"),
    ] {
        let (status, page) = upload(&fair, &fields).await;
        assert_eq!(status, StatusCode::BAD_REQUEST, "{page}");
        assert!(page.contains(told) && page.contains("multipart/form-data"), "{told}: {page}");
    }
}

#[tokio::test]
async fn people_sign_up_make_a_token_and_sign_out() {
    let fair = Fair::new().await;
    let response = fair.send(Request::get("/sign-up").body(Body::empty()).unwrap()).await;
    let cookie = response.headers()[header::SET_COOKIE].to_str().unwrap().to_owned();
    assert!(cookie.contains("; HttpOnly; SameSite=Lax") && !cookie.contains("Secure"), "{cookie}");
    let guest = cookie.split(';').next().unwrap().to_owned();
    let token = token_in(&text(response).await.1);
    let send = async |address: &str, cookie: &str, form: String| {
        let request = Request::post(address).header(header::COOKIE, cookie).body(Body::from(form)).unwrap();
        let response = fair.send(request).await;
        let set = response.headers().get(header::SET_COOKIE).map(|set| set.to_str().unwrap().to_owned());
        let (status, page) = text(response).await;
        (status, set.unwrap_or_default(), page)
    };
    let form =
        |password: &str| format!("form_token={token}&name=Bob&email=bob%40example.org&password={password}");
    let (status, _, page) = send("/sign-up", &guest, form("short")).await;
    assert_eq!(status, StatusCode::BAD_REQUEST);
    assert!(
        page.contains("role=\"alert\"")
            && page.contains("value=\"bob@example.org\"")
            && !page.contains("short"),
        "{page}"
    );
    let (status, set, page) = send("/sign-up", &guest, form("long+enough+a+word")).await;
    assert_eq!(status, StatusCode::SEE_OTHER, "{page}");
    let session = set.split(';').next().unwrap().to_owned();
    assert!(session.starts_with("relight_session="), "{set}");
    // The guest's token does not fit the session's forms.
    let (status, ..) = send("/account/tokens", &session, format!("form_token={token}&name=laptop")).await;
    assert_eq!(status, StatusCode::FORBIDDEN);
    let request = Request::get("/account").header(header::COOKIE, &session).body(Body::empty()).unwrap();
    let own = token_in(&text(fair.send(request).await).await.1);
    let (status, _, page) = send("/account/tokens", &session, format!("form_token={own}&name=laptop")).await;
    assert_eq!(status, StatusCode::OK);
    let at = page.find("relight_").unwrap();
    let secret = page[at..].split('<').next().unwrap();
    assert_eq!(accounts::user_of_token(&fair.app.store, secret).await.unwrap().unwrap().name, "Bob");
    let request = Request::get("/account").header(header::COOKIE, &session).body(Body::empty()).unwrap();
    let (_, page) = text(fair.send(request).await).await;
    assert!(page.contains("laptop") && !page.contains(secret), "a token is shown once");
    let (status, set, _) = send("/sign-out", &session, format!("form_token={own}")).await;
    assert!(status == StatusCode::SEE_OTHER && set.contains("Max-Age=0"), "{set}");
    let request = Request::get("/account").header(header::COOKIE, &session).body(Body::empty()).unwrap();
    assert_eq!(fair.send(request).await.headers()[header::LOCATION], "/sign-in?next=%2Faccount");
    // Nobody is sent to another site.
    let form = format!("form_token={token}&name=Bob&password=long+enough+a+word&next=%2F%2Fevil.example");
    let request = Request::post("/sign-in").header(header::COOKIE, &guest).body(Body::from(form)).unwrap();
    assert_eq!(fair.send(request).await.headers()[header::LOCATION], "/account/submissions");
    let (status, _, page) =
        send("/sign-in", &guest, format!("form_token={token}&name=Bob&password=wrong")).await;
    assert!(status == StatusCode::UNAUTHORIZED && page.contains("There is no user of that name"), "{page}");
}

#[tokio::test]
async fn anonymous_and_private_entries_stay_so() {
    let fair = Fair::with(&["a", "b", "c", "secretive", "e"]).await;
    let board = "/benchmarks/rene";
    let data = "/api/v1/benchmarks/rene/leaderboard";
    // The fourth is anonymous: everywhere its name alone.
    for address in [board, data, "/submissions/0003"] {
        let (status, page) = fair.get(address, false).await;
        assert_eq!(status, StatusCode::OK);
        assert!(page.contains("secretive") && !page.contains("Builder of secretive"), "{address}");
        assert!(!page.contains("What secretive does"), "{address}");
    }
    let (_, page) = fair.get("/submissions/0003", false).await;
    assert!(!page.contains("Ada") && !page.contains("example.org") && !page.contains("RTX"), "{page}");
    assert!(fair.get("/submissions/0003", true).await.1.contains("Builder of secretive"));
    // Made private, it is gone at once, and comes back.
    let token = fair.form_token().await;
    for (to, seen) in [("private", false), ("public", true)] {
        let (status, _) =
            fair.post("/submissions/0003/visibility", &format!("form_token={token}&to={to}")).await;
        assert_eq!(status, StatusCode::SEE_OTHER);
        assert_eq!(fair.get(board, false).await.1.contains("secretive"), seen);
        assert_eq!(fair.get(data, false).await.1.contains("secretive"), seen);
        assert_eq!(fair.get("/submissions/0003", false).await.0.is_success(), seen);
        assert_eq!(fair.get("/submissions/0003/receipt.json", false).await.0.is_success(), seen);
    }
    let (status, _) = fair.post("/submissions/0003/withdraw", &format!("form_token={token}")).await;
    assert_eq!(status, StatusCode::SEE_OTHER);
    assert!(!fair.get(board, false).await.1.contains("secretive"));
    assert!(fair.get("/submissions/0003", true).await.1.contains("Withdrawn"));
    let (_, page) = fair.post("/submissions/0003/withdraw", &format!("form_token={token}")).await;
    assert!(page.contains("is withdrawn already"), "{page}");
}

#[tokio::test]
async fn leaderboards_are_data_too() {
    let fair = Fair::with(&["first", "second"]).await;
    let address = "/api/v1/benchmarks/rene/leaderboard";
    let (status, json) = fair.get(&format!("{address}.json?split=easy"), false).await;
    assert_eq!(status, StatusCode::OK);
    let json: Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["format"], "relight-leaderboard-1");
    let entries = json["splits"][0]["entries"].as_array().unwrap();
    let methods: Vec<&str> = entries.iter().map(|entry| entry["method"].as_str().unwrap()).collect();
    assert_eq!(methods, ["second", "first", "mean image"]);
    assert_eq!(entries[2]["baseline"], true);
    // What is told of a submission elsewhere is what is told here.
    let (_, told) = fair.get("/api/v1/submissions/0001", false).await;
    let told: Value = serde_json::from_str(&told).unwrap();
    assert_eq!(told["scores"]["means"][0]["psnr"], entries[0]["psnr"]["mean"]);
    assert_eq!(told["scores"]["scenes"][3]["means"][0]["ssim"], entries[0]["scenes"][3]["ssim"]);
    for (accept, kind) in [
        ("text/csv", "text/csv; charset=utf-8; header=present"),
        ("text/html, text/csv;q=0.9", "text/csv; charset=utf-8; header=present"),
        ("application/json, text/csv", "application/json"),
        ("*/*", "application/json"),
    ] {
        let request = Request::get(address).header(header::ACCEPT, accept).body(Body::empty()).unwrap();
        assert_eq!(fair.send(request).await.headers()[header::CONTENT_TYPE], kind, "{accept}");
    }
    let (_, csv) = fair.get(&format!("{address}.csv"), false).await;
    // A head; in val one, in easy and hard three each.
    assert_eq!(csv.lines().count(), 1 + 1 + 3 + 3, "{csv}");
    let (status, error) = fair.get(&format!("{address}.json?split=train"), false).await;
    assert!(status == StatusCode::BAD_REQUEST && error.contains("val, easy, hard"), "{error}");
    assert_eq!(fair.get("/api/v1/benchmarks/none/leaderboard", false).await.0, StatusCode::NOT_FOUND);
}

#[tokio::test]
async fn pictures_are_those_of_the_submission_and_nothing_else() {
    let fair = Fair::with(&["V5"]).await;
    let (_, page) = fair.get("/submissions/5a1", false).await;
    assert_eq!(page.matches("data-compare").count(), 20);
    let base = "/submissions/5a1/pictures";
    for file in ["cube_00_04.png", "cube_00_04_truth.png", "cube_00_04_error.png"] {
        let response = fair.send(Request::get(format!("{base}/{file}")).body(Body::empty()).unwrap()).await;
        assert_eq!(response.status(), StatusCode::OK, "{file}");
        assert_eq!(response.headers()[header::CONTENT_TYPE], "image/png");
    }
    std::fs::write(fair.folder.path().join("pictures/outside.png"), "x").unwrap();
    for file in [
        "none.png",
        "..%2Foutside.png",
        "..%2F..%2Fserver.db",
        "%2Fetc%2Fpasswd",
        ".png",
        "cube_00_04.png%00",
        "..%5Coutside.png",
    ] {
        assert_eq!(fair.get(&format!("{base}/{file}"), false).await.0, StatusCode::NOT_FOUND, "{file}");
    }
}
