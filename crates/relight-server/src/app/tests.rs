// Helpers outside of test functions unwrap too.
#![allow(clippy::unwrap_used)]

use axum::body::{Body, to_bytes};
use axum::routing::get;
use hyper::service::Service;
use hyper_util::service::TowerToHyperService;

use super::*;

async fn app(settings: Settings) -> (tempfile::TempDir, AppState) {
    let folder = tempfile::tempdir().unwrap();
    let app = App::open(folder.path(), settings).await.unwrap();
    (folder, app)
}

/// Status and body of an answer to whoever asks from 192.0.2.1.
async fn ask(router: &Router, path: &str) -> (u16, String) {
    let mut request = Request::builder().uri(path).body(Body::empty()).unwrap();
    request.extensions_mut().insert(Connection([192, 0, 2, 1].into()));
    let response = TowerToHyperService::new(router.clone()).call(request).await.unwrap();
    let status = response.status().as_u16();
    let body = to_bytes(response.into_body(), 1 << 20).await.unwrap();
    (status, String::from_utf8(body.to_vec()).unwrap())
}

#[tokio::test]
async fn a_panic_ends_its_request_alone_and_is_counted() {
    async fn boom() -> &'static str {
        panic!("the secret of the handler")
    }
    let (_folder, app) = app(Settings::default()).await;
    let routes = api::routes().route("/boom", get(boom));
    let router = guarded(app, routes);
    let (status, body) = ask(&router, "/boom").await;
    assert_eq!(status, 500);
    assert!(!body.contains("secret"), "{body}");
    assert_eq!(ask(&router, "/healthz").await.0, 200);
    let metrics = ask(&router, "/metrics").await.1;
    assert!(metrics.contains("\nrelight_panics_total 1\n"), "{metrics}");
    assert!(metrics.contains("{route=\"/boom\",status=\"500\"} 1"), "{metrics}");
}

#[tokio::test]
async fn who_asks_too_often_waits() {
    let settings = Settings { requests_per_second: NonZeroU32::MIN, ..Settings::default() };
    let (_folder, app) = app(settings).await;
    let router = router(app);
    let statuses = [ask(&router, "/healthz").await.0, ask(&router, "/healthz").await.0];
    assert_eq!(statuses, [200, 200]);
    let (status, body) = ask(&router, "/healthz").await;
    assert_eq!(status, 429);
    assert!(body.contains("try again in 1 s"), "{body}");
}

#[tokio::test]
async fn addresses_are_the_proxys_word_only_where_there_is_a_proxy() {
    let direct: IpAddr = [192, 0, 2, 1].into();
    let mut headers = HeaderMap::new();
    // What a client claims comes first, what the proxy adds last.
    headers.insert("x-forwarded-for", "10.0.0.1, 198.51.100.7".parse().unwrap());
    let (_folder, plain) = app(Settings::default()).await;
    assert_eq!(plain.client(&headers, Some(direct)), direct);
    let (_folder, behind) = app(Settings { behind_proxy: true, ..Settings::default() }).await;
    assert_eq!(behind.client(&headers, Some(direct)), IpAddr::from([198, 51, 100, 7]));
    assert_eq!(behind.client(&HeaderMap::new(), Some(direct)), direct);
}

#[tokio::test]
async fn who_comes_by_tls_is_told_to_stay_with_it() {
    for (behind_proxy, scheme, is_secure) in
        [(true, "https", true), (true, "http", false), (false, "https", false)]
    {
        let (_folder, app) = app(Settings { behind_proxy, ..Settings::default() }).await;
        let request = Request::builder().uri("/sign-in").header("x-forwarded-proto", scheme);
        let service = TowerToHyperService::new(router(app));
        let answer = service.call(request.body(Body::empty()).unwrap()).await.unwrap();
        let cookie = answer.headers()[header::SET_COOKIE].to_str().unwrap();
        assert_eq!(cookie.contains("; Secure"), is_secure, "{cookie}");
        assert_eq!(answer.headers().contains_key(header::STRICT_TRANSPORT_SECURITY), is_secure);
    }
}
