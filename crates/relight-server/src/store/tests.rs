// Helpers outside of test functions unwrap too.
#![allow(clippy::unwrap_used)]

use std::time::Duration;

use tempfile::TempDir;

use super::*;
use crate::disclosure::tell;
use crate::method::{Method, Phase, Visibility};
use crate::receipt::Receipt;
use crate::scoring::Scores;

/// A moment to count from.
const NOON: Time = Time(1_764_000_000_000);
const HOUR: Duration = Duration::from_secs(3600);

/// A store with a benchmark `b` and an active user.
async fn store() -> (TempDir, Store, User) {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(&folder.path().join("server.db")).await.unwrap();
    store.add_benchmark("b", Path::new("/truth"), &[]).await.unwrap();
    let user = store.add_user("ada", "ada@example.org", None, UserStatus::Active, "admin").await.unwrap();
    (folder, store, user)
}

fn new(id: &str, phase: Phase) -> NewSubmission {
    NewSubmission {
        id: id.into(),
        benchmark: "b".into(),
        phase,
        visibility: Visibility::Public,
        method: Method { name: "m".into(), ..Method::default() },
        sha256: "00".repeat(32),
        bytes: 1,
    }
}

fn scored() -> Verdict {
    let scores = Scores { evaluator: "e".into(), means: Vec::new(), scenes: Vec::new(), images: Vec::new() };
    let text = String::new;
    let receipt = Receipt {
        format: text(),
        submission: text(),
        benchmark: text(),
        method: text(),
        sha256: text(),
        submitted_at: text(),
        scored_at: text(),
        evaluator: text(),
        scores: tell(&scores),
        public_key: text(),
        signature: text(),
    };
    Verdict::Scored { scores: Box::new(scores), receipt: Box::new(receipt), phase: Phase::Test }
}

fn refused() -> Verdict {
    Verdict::Refused { reason: "torn".into(), problems: None }
}

async fn quota(store: &Store, per_day: u32, total: u32, gap_seconds: u32) {
    store.set_quota("b", Phase::Test, Quota { per_day, total, gap_seconds }, "admin").await.unwrap();
}

/// What keeps a submission from being taken, in the words of the error.
async fn submit(store: &Store, user: &User, id: &str, now: Time) -> Result<(), String> {
    store.submit(&new(id, Phase::Test), user.id, now).await.map_err(|error| error.to_string())
}

#[tokio::test]
async fn a_database_of_another_format_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("server.db");
    Store::open(&path).await.unwrap().close().await;
    // The same file opens again: the numbers in the pragmas are those of the constants.
    let store = Store::open(&path).await.unwrap();
    sqlx::raw_sql("PRAGMA user_version = 7").execute(&store.writer).await.unwrap();
    store.close().await;
    let error = Store::open(&path).await.unwrap_err().to_string();
    assert!(error.contains("server.db") && error.contains("format 2 (found format 7)"), "{error}");
}

#[tokio::test]
async fn a_database_of_the_first_format_is_carried_over() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("server.db");
    let store = Store::open(&path).await.unwrap();
    store.add_user("ada", "ada@example.org", None, UserStatus::Active, "admin").await.unwrap();
    let first = "ALTER TABLE users DROP COLUMN is_admin; PRAGMA user_version = 1;";
    sqlx::raw_sql(first).execute(&store.writer).await.unwrap();
    store.close().await;
    let store = Store::open(&path).await.unwrap();
    assert!(!store.user("ada").await.unwrap().is_admin);
    store.set_admin("ada", true).await.unwrap();
    store.close().await;
    assert!(Store::open(&path).await.unwrap().user("ada").await.unwrap().is_admin);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn of_many_at_once_as_many_pass_as_the_quota_allows() {
    let (folder, store, user) = store().await;
    quota(&store, 3, 100, 0).await;
    // Another process' connections to the same file.
    let other = Store::open(&folder.path().join("server.db")).await.unwrap();
    let tasks: Vec<_> = (0..24)
        .map(|i| {
            let (store, user) = (if i % 2 == 0 { store.clone() } else { other.clone() }, user.clone());
            tokio::spawn(async move { submit(&store, &user, &format!("s{i}"), Time(NOON.0 + i)).await })
        })
        .collect();
    let mut passed = 0;
    for task in tasks {
        match task.await.unwrap() {
            Ok(()) => passed += 1,
            Err(error) => assert!(error.contains("the 3 submissions of 24 hours are used up"), "{error}"),
        }
    }
    assert_eq!(passed, 3);
    assert_eq!(store.submissions_page(Some(user.id), 1).await.unwrap().0.len(), 3);
}

#[tokio::test]
async fn quotas_count_a_day_in_total_and_ask_for_a_gap() {
    let (_folder, store, user) = store().await;
    quota(&store, 2, 4, 60).await;
    submit(&store, &user, "a", NOON).await.unwrap();
    let error = submit(&store, &user, "b", NOON.after(Duration::from_secs(59))).await.unwrap_err();
    assert!(error.contains("60 s apart") && error.contains("try again at 2025-11-24T16:01:00Z"), "{error}");
    submit(&store, &user, "b", NOON.after(Duration::from_secs(60))).await.unwrap();
    let error = submit(&store, &user, "c", NOON.after(HOUR)).await.unwrap_err();
    assert!(error.contains("2 submissions of 24 hours"), "{error}");
    // 24 hours after the first there is room for one, not for two.
    submit(&store, &user, "c", NOON.after(24 * HOUR)).await.unwrap();
    submit(&store, &user, "d", NOON.after(24 * HOUR + Duration::from_secs(60))).await.unwrap();
    let error = submit(&store, &user, "e", NOON.after(100 * HOUR)).await.unwrap_err();
    assert!(error.contains("all 4 submissions are used up") && error.contains("no further"), "{error}");
    // The other phase has a quota of its own, and so has the other user.
    store.submit(&new("v", Phase::Val), user.id, NOON).await.unwrap();
    let eve = store.add_user("eve", "eve@example.org", None, UserStatus::Active, "admin").await.unwrap();
    submit(&store, &eve, "f", NOON.after(100 * HOUR)).await.unwrap();
}

#[tokio::test]
async fn without_a_gap_it_does_not_matter_who_got_the_lock_first() {
    let (_folder, store, user) = store().await;
    quota(&store, 2, 2, 0).await;
    submit(&store, &user, "a", Time(NOON.0 + 1)).await.unwrap();
    submit(&store, &user, "b", NOON).await.unwrap();
    submit(&store, &user, "c", NOON).await.unwrap_err();
}

#[tokio::test]
async fn what_is_refused_or_withdrawn_unscored_costs_nothing() {
    let (_folder, store, user) = store().await;
    quota(&store, 1, 1, 3600).await;
    submit(&store, &user, "a", NOON).await.unwrap();
    submit(&store, &user, "b", NOON).await.unwrap_err();
    store.claim(false, NOON).await.unwrap().unwrap();
    store.finish("a", &refused(), NOON).await.unwrap();
    submit(&store, &user, "b", NOON).await.unwrap();
    store.withdraw("b", Some(user.id), "ada", NOON).await.unwrap();
    submit(&store, &user, "c", NOON).await.unwrap();
    store.claim(false, NOON).await.unwrap().unwrap();
    store.finish("c", &scored(), NOON).await.unwrap();
    store.withdraw("c", Some(user.id), "ada", NOON).await.unwrap();
    submit(&store, &user, "d", NOON).await.unwrap_err();
    let benchmark = store.benchmark("b").await.unwrap();
    let used = store.quota_use(&benchmark, &user, Phase::Test, NOON).await.unwrap();
    assert_eq!((used.used, used.used_in_day), (1, 1));
}

#[tokio::test]
async fn validation_goes_first_and_each_is_claimed_once() {
    let (_folder, store, user) = store().await;
    submit(&store, &user, "a", NOON).await.unwrap();
    submit(&store, &user, "b", NOON).await.unwrap();
    store.submit(&new("v", Phase::Val), user.id, NOON).await.unwrap();
    let claim = async || store.claim(false, NOON).await.unwrap().map(|claim| claim.id);
    let claim_validation = async || store.claim(true, NOON).await.unwrap().map(|claim| claim.id);
    assert_eq!(claim().await.as_deref(), Some("v"));
    // Whoever scores validation alone has nothing to do, until more comes.
    assert_eq!(claim_validation().await, None);
    store.submit(&new("w", Phase::Val), user.id, NOON).await.unwrap();
    assert_eq!(claim_validation().await.as_deref(), Some("w"));
    assert_eq!(claim().await.as_deref(), Some("a"));
    assert_eq!(claim().await.as_deref(), Some("b"));
    assert_eq!(claim().await, None);
}

#[tokio::test]
async fn lists_come_in_parts() {
    let (_folder, store, user) = store().await;
    quota(&store, 200, 200, 0).await;
    for i in 0..101 {
        submit(&store, &user, &format!("s{i:03}"), NOON).await.unwrap();
    }
    for of in [Some(user.id), None] {
        let mut seen = Vec::new();
        for (page, length, follows) in [(1, 50, true), (2, 50, true), (3, 1, false), (4, 0, false)] {
            let (entries, has_more) = store.submissions_page(of, page).await.unwrap();
            assert_eq!((entries.len(), has_more), (length, follows), "page {page}");
            seen.extend(entries.into_iter().map(|entry| entry.id));
        }
        let all: Vec<String> = (0..101).rev().map(|i| format!("s{i:03}")).collect();
        assert_eq!(seen, all);
    }
    assert!(store.submissions_page(Some(user.id + 1), 1).await.unwrap().0.is_empty());
}

#[tokio::test]
async fn an_entry_that_bears_its_users_name_cannot_become_anonymous() {
    let (_folder, store, user) = store().await;
    let named = |id: &str, name: &str| NewSubmission {
        method: Method { name: name.to_owned(), ..Method::default() },
        ..new(id, Phase::Test)
    };
    store.submit(&named("a", "Ada"), user.id, NOON).await.unwrap();
    store.submit(&named("b", "Nameless"), user.id, NOON).await.unwrap();
    let error = store.set_visibility("a", &user, Visibility::Anonymous).await.unwrap_err().to_string();
    assert!(error.contains("whose entry it is"), "{error}");
    store.set_visibility("a", &user, Visibility::Private).await.unwrap();
    store.set_visibility("b", &user, Visibility::Anonymous).await.unwrap();
}

#[tokio::test]
async fn a_verdict_is_written_once() {
    let (_folder, store, user) = store().await;
    submit(&store, &user, "a", NOON).await.unwrap();
    // Not before it is claimed.
    store.finish("a", &scored(), NOON).await.unwrap_err();
    store.claim(false, NOON).await.unwrap().unwrap();
    store.finish("a", &scored(), NOON).await.unwrap();
    for again in [scored(), refused()] {
        store.finish("a", &again, NOON.after(HOUR)).await.unwrap_err();
    }
    store.put_back("a", None, NOON).await.unwrap();
    assert_eq!(store.requeue_interrupted().await.unwrap(), 0);
    let entry = store.submission("a").await.unwrap();
    assert_eq!((entry.state, entry.finished_at), (State::Scored, Some(NOON)));
    // Not even a slip in a query changes it.
    let slip = sqlx::query("UPDATE submissions SET state = 'queued'").execute(&store.writer).await;
    assert!(slip.unwrap_err().to_string().contains("a finished submission does not change"));
}

#[tokio::test]
async fn what_a_kill_interrupted_is_claimed_again_and_failures_wait() {
    let (folder, store, user) = store().await;
    submit(&store, &user, "a", NOON).await.unwrap();
    store.claim(false, NOON).await.unwrap().unwrap();
    store.close().await;
    let store = Store::open(&folder.path().join("server.db")).await.unwrap();
    assert!(store.claim(false, NOON).await.unwrap().is_none());
    assert_eq!(store.requeue_interrupted().await.unwrap(), 1);
    assert_eq!(store.claim(false, NOON).await.unwrap().unwrap().failures, 0);
    store.put_back("a", Some(("no truth", HOUR)), NOON).await.unwrap();
    assert!(store.claim(false, NOON.after(HOUR / 2)).await.unwrap().is_none());
    assert_eq!(store.claim(false, NOON.after(HOUR)).await.unwrap().unwrap().failures, 1);
}

#[tokio::test]
async fn what_is_withdrawn_while_it_is_scored_is_not_scored_again() {
    let (_folder, store, user) = store().await;
    for id in ["a", "b", "c"] {
        submit(&store, &user, id, NOON).await.unwrap();
        store.claim(false, NOON).await.unwrap().unwrap();
        store.withdraw(id, Some(user.id), "ada", NOON).await.unwrap();
    }
    store.finish("a", &scored(), NOON).await.unwrap();
    store.put_back("b", None, NOON).await.unwrap();
    assert_eq!(store.requeue_interrupted().await.unwrap(), 1);
    assert!(store.claim(false, NOON.after(HOUR)).await.unwrap().is_none());
    let states = store.submissions_page(Some(user.id), 1).await.unwrap().0;
    let states: Vec<_> = states.iter().map(|entry| entry.state).collect();
    assert_eq!(states, [State::Refused, State::Refused, State::Scored]);
    assert!(store.kept_zips().await.unwrap().is_empty());
}

#[tokio::test]
async fn boards_show_what_is_public_and_say_when_they_change() {
    let (_folder, store, user) = store().await;
    let benchmark = store.benchmark("b").await.unwrap();
    for (id, visibility) in
        [("a", Visibility::Public), ("b", Visibility::Anonymous), ("c", Visibility::Private)]
    {
        let new = NewSubmission { visibility, ..new(id, Phase::Test) };
        store.submit(&new, user.id, NOON).await.unwrap();
    }
    let board = async || {
        let entries = store.submissions(Listing::Board(&benchmark)).await.unwrap();
        assert!(entries.iter().all(SubmissionEntry::is_listed));
        entries.into_iter().map(|entry| entry.id).collect::<Vec<_>>()
    };
    assert!(board().await.is_empty());
    for _ in 0..3 {
        let claim = store.claim(false, NOON).await.unwrap().unwrap();
        store.finish(&claim.id, &scored(), NOON).await.unwrap();
    }
    assert_eq!(board().await, ["b", "a"]);
    let mut revision = store.revision().await.unwrap();
    let mut changed = async || {
        let now = store.revision().await.unwrap();
        now > std::mem::replace(&mut revision, now)
    };
    assert!(!changed().await);
    store.set_hidden("a", true, "admin").await.unwrap();
    assert!(changed().await);
    assert_eq!(board().await, ["b"]);
    store.set_hidden("a", false, "admin").await.unwrap();
    store.withdraw("a", Some(user.id), "ada", NOON).await.unwrap();
    store.set_visibility("c", &user, Visibility::Public).await.unwrap();
    assert!(changed().await);
    assert_eq!(board().await, ["c", "b"]);
}

#[tokio::test]
async fn nobody_touches_what_is_someone_elses() {
    let (_folder, store, ada) = store().await;
    let eve = store.add_user("eve", "eve@example.org", None, UserStatus::Active, "admin").await.unwrap();
    submit(&store, &ada, "a", NOON).await.unwrap();
    for error in [
        store.withdraw("a", Some(eve.id), "eve", NOON).await.unwrap_err(),
        store.set_visibility("a", &eve, Visibility::Private).await.unwrap_err(),
    ] {
        assert!(matches!(error, StoreError::Missing { .. }), "{error}");
    }
    assert_eq!(store.submission("a").await.unwrap().visibility, Visibility::Public);
    store.set_user_status("eve", UserStatus::Blocked).await.unwrap();
    let error = submit(&store, &eve, "b", NOON).await.unwrap_err();
    assert!(error.contains("blocked"), "{error}");
    store.set_open("b", false, "admin").await.unwrap();
    let error = submit(&store, &ada, "b", NOON).await.unwrap_err();
    assert!(error.contains("takes no submissions"), "{error}");
}

#[tokio::test]
async fn the_audit_log_tells_what_was_done_and_only_grows() {
    let (_folder, store, user) = store().await;
    submit(&store, &user, "a", NOON).await.unwrap();
    store.set_hidden("a", true, "admin").await.unwrap();
    let told: Vec<_> = store.audit(3).await.unwrap();
    let told: Vec<_> =
        told.iter().map(|e| (e.actor.as_str(), e.action.as_str(), e.subject.as_str())).collect();
    assert_eq!(told, [("admin", "hide", "a"), ("ada", "submit", "a"), ("admin", "add-user", "ada")]);
    // What failed left no line.
    store.set_hidden("none", true, "admin").await.unwrap_err();
    assert_eq!(store.audit(1).await.unwrap()[0].action, "hide");
    for sql in ["DELETE FROM audit", "UPDATE audit SET actor = 'x'"] {
        sqlx::raw_sql(sql).execute(&store.writer).await.unwrap_err();
    }
}
