//! The pages of admins, over HTTP: who may see and use them, what they change, and that the audit log tells of it.

#![allow(clippy::unwrap_used)]

mod fair;

use axum::http::StatusCode;
use fair::{Fair, HOSTILE};
use relight_server::store::Quota;

const PAGES: [&str; 3] = ["/admin", "/admin/submissions", "/admin/audit"];
/// What admins can send, and what the audit log then says of it.
const FORMS: [(&str, &str, (&str, &str, &str)); 3] = [
    ("/admin/benchmarks/rene/open", "open=false", ("close-benchmark", "rene", "")),
    (
        "/admin/benchmarks/rene/quota",
        "phase=test&per_day=2&total=20&gap_seconds=3600",
        ("set-quota", "rene", "test: 2 a day, 20 in all, 3600 s apart"),
    ),
    ("/admin/submissions/0001/hidden", "hidden=true", ("hide", "0001", "")),
];

/// With two entries; Ada is an admin if so asked.
async fn fair(is_admin: bool) -> Fair {
    let fair = Fair::with(&["first", "second"]).await;
    if is_admin {
        fair.app.store.set_admin("Ada Lovelace", true).await.unwrap();
    }
    fair
}

#[tokio::test]
async fn nobody_but_admins_sees_or_changes_anything() {
    let fair = fair(false).await;
    let before = fair.app.store.audit(1000).await.unwrap();
    let token = fair.form_token().await;
    for page in PAGES {
        for signed_in in [false, true] {
            let (status, text) = fair.get(page, signed_in).await;
            assert_eq!(status, StatusCode::FORBIDDEN, "{page}: {text}");
            assert!(!text.contains("rene") && !text.contains("second"), "{page}: {text}");
        }
    }
    for (address, form, _) in FORMS {
        let (status, text) = fair.post(address, &format!("{form}&form_token={token}")).await;
        assert_eq!(status, StatusCode::FORBIDDEN, "{address}: {text}");
    }
    assert!(!fair.get("/", true).await.1.contains("/admin"));
    assert_eq!(fair.app.store.audit(1000).await.unwrap(), before);
}

#[tokio::test]
async fn admins_forms_without_their_token_are_refused() {
    let fair = fair(true).await;
    let before = fair.app.store.audit(1000).await.unwrap();
    for (address, form, _) in FORMS {
        for token in ["", "&form_token=", &format!("&form_token={}", "0".repeat(64))] {
            let (status, text) = fair.post(address, &format!("{form}{token}")).await;
            assert_eq!(status, StatusCode::FORBIDDEN, "{address}: {text}");
        }
    }
    assert_eq!(fair.app.store.audit(1000).await.unwrap(), before);
}

#[tokio::test]
async fn what_admins_change_is_seen_and_told_under_their_names() {
    let fair = fair(true).await;
    let token = fair.form_token().await;
    assert!(fair.get("/", true).await.1.contains("href=\"/admin\""));
    assert!(fair.get("/benchmarks/rene", false).await.1.contains("second"));
    for (address, form, (action, subject, detail)) in FORMS {
        let (status, text) = fair.post(address, &format!("{form}&form_token={token}")).await;
        assert_eq!(status, StatusCode::SEE_OTHER, "{address}: {text}");
        let line = fair.app.store.audit(1).await.unwrap().remove(0);
        let told = (line.actor.as_str(), line.action.as_str(), line.subject.as_str(), line.detail.as_str());
        assert_eq!(told, ("Ada Lovelace", action, subject, detail));
        let (_, log) = fair.get("/admin/audit", true).await;
        assert!(log.contains(action) && log.contains(detail), "{log}");
    }
    let benchmark = fair.app.store.benchmark("rene").await.unwrap();
    assert_eq!(benchmark.test, Quota { per_day: 2, total: 20, gap_seconds: 3600 });
    assert!(!benchmark.open);
    let (_, page) = fair.get("/admin", true).await;
    assert!(page.contains("closed") && page.contains("value=\"3600\""), "{page}");
    assert!(fair.get("/benchmarks/rene/upload", true).await.1.contains("takes no submissions any more"));
    assert!(!fair.get("/benchmarks/rene", false).await.1.contains("second"));
    assert!(fair.get("/admin/submissions", true).await.1.contains("second"));
    let form = format!("hidden=false&form_token={token}");
    assert_eq!(fair.post("/admin/submissions/0001/hidden", &form).await.0, StatusCode::SEE_OTHER);
    assert!(fair.get("/benchmarks/rene", false).await.1.contains("second"));
    assert_eq!(fair.post("/admin/submissions/none/hidden", &form).await.0, StatusCode::NOT_FOUND);
    // The right is taken at once, not at the next sign-in.
    fair.app.store.set_admin("Ada Lovelace", false).await.unwrap();
    assert_eq!(fair.get("/admin", true).await.0, StatusCode::FORBIDDEN);
    assert_eq!(fair.post("/admin/submissions/0001/hidden", &form).await.0, StatusCode::FORBIDDEN);
}

#[tokio::test]
async fn hostile_names_are_escaped() {
    let fair = Fair::with(&HOSTILE).await;
    fair.app.store.set_admin("Ada Lovelace", true).await.unwrap();
    fair.app.store.set_open("rene", false, HOSTILE[0]).await.unwrap();
    for address in PAGES {
        let (status, page) = fair.get(address, true).await;
        assert_eq!(status, StatusCode::OK, "{address}");
        let inner = page.replace("<script type=\"module\" src=\"/static/script-", "");
        assert!(!inner.contains("<script") && !inner.contains("<img src=x"), "{address}: {page}");
        assert!(!page.contains(" style=") && !page.contains("<style"), "{address}");
    }
    assert!(fair.get("/admin/audit", true).await.1.contains("&lt;script&gt;alert(1)"));
}
