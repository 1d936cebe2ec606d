use super::*;

async fn store() -> (tempfile::TempDir, Store) {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(&folder.path().join("server.db")).await.unwrap();
    (folder, store)
}

#[tokio::test]
async fn tokens_open_their_users_account_until_revoked() {
    let (_folder, store) = store().await;
    let (ada, token) = add_user(&store, "ada", "ada@example.org").await.unwrap();
    let (eve, _) = add_user(&store, "eve", "eve@example.org").await.unwrap();
    assert_eq!(user_of_token(&store, &token).await.unwrap(), Some(ada.clone()));
    // Another number with this secret, the secret with a digit changed, cut, or no token at all.
    let last = if token.ends_with('0') { "1" } else { "0" };
    for wrong in [
        token.replace("relight_1_", "relight_2_"),
        format!("{}{last}", &token[..token.len() - 1]),
        token[..token.len() - 1].to_owned(),
        token.replace("relight_", ""),
        "relight_1_".to_owned(),
        String::new(),
    ] {
        assert_eq!(user_of_token(&store, &wrong).await.unwrap(), None, "{wrong}");
    }
    let id = store.tokens(&ada).await.unwrap()[0].id;
    store.revoke_token(&eve, id).await.unwrap();
    assert!(user_of_token(&store, &token).await.unwrap().is_some(), "eve revoked ada's token");
    store.revoke_token(&ada, id).await.unwrap();
    assert_eq!(user_of_token(&store, &token).await.unwrap(), None);
}

#[tokio::test]
async fn secrets_are_stored_as_hashes_alone() {
    let (folder, store) = store().await;
    let (_, token) = add_user(&store, "ada", "ada@example.org").await.unwrap();
    let eve = sign_up(&store, "eve", "eve@example.org", "correct horse").await.unwrap();
    let session = new_session(&store, &eve).await.unwrap();
    store.close().await;
    let bytes = std::fs::read(folder.path().join("server.db")).unwrap();
    let holds = |text: &str| bytes.windows(text.len()).any(|window| window == text.as_bytes());
    assert!(holds("ada@example.org") && holds("$argon2id$"));
    for secret in [&token[10..], "correct horse", session.split_once('_').unwrap().1] {
        assert!(!holds(secret), "{secret}");
        let raw: Option<[u8; 32]> = from_hex_text(secret);
        assert!(raw.is_none_or(|raw| !bytes.windows(32).any(|window| window == raw)));
    }
}

fn from_hex_text(text: &str) -> Option<[u8; 32]> {
    crate::receipt::from_hex(text)
}

#[tokio::test]
async fn passwords_open_sessions_and_blocking_ends_them() {
    let (_folder, store) = store().await;
    let eve = sign_up(&store, "eve", "eve@example.org", "correct horse").await.unwrap();
    for (name, password) in [("eve", "wrong horse!"), ("nobody", "correct horse"), ("eve", "")] {
        let error = sign_in(&store, name, password).await.unwrap_err();
        assert!(matches!(error, AccountError::Unknown), "{error}");
    }
    let (_, session) = sign_in(&store, "EVE@example.org", "correct horse").await.unwrap();
    assert_eq!(user_of_session(&store, &session).await.unwrap(), Some(eve.clone()));
    let (_, other) = sign_in(&store, "eve", "correct horse").await.unwrap();
    sign_out(&store, &other).await.unwrap();
    assert_eq!(user_of_session(&store, &other).await.unwrap(), None);
    assert!(user_of_session(&store, &session).await.unwrap().is_some());
    store.set_user_status("eve", UserStatus::Blocked).await.unwrap();
    assert_eq!(user_of_session(&store, &session).await.unwrap(), None);
    sign_in(&store, "eve", "correct horse").await.unwrap_err();
    // A user without a password has no session.
    add_user(&store, "ada", "ada@example.org").await.unwrap();
    sign_in(&store, "ada", "").await.unwrap_err();
}

#[tokio::test]
async fn unfit_names_are_refused_and_hosts_decide_who_signs_up() {
    let (_folder, store) = store().await;
    let good = "long enough";
    for (name, email, password) in [
        ("", "a@b.c", good),
        ("a@b", "a@b.c", good),
        ("Admin", "a@b.c", good),
        ("a\u{202e}b", "a@b.c", good),
        ("a", "nowhere", good),
        ("a", "a @b.c", good),
        ("a", "a@b.c", "short"),
    ] {
        let error = sign_up(&store, name, email, password).await.unwrap_err();
        assert!(matches!(error, AccountError::Unfit(_)), "{name} {email}: {error}");
    }
    sign_up(&store, "ada", "ada@example.org", good).await.unwrap();
    for (name, email) in [("ADA", "x@example.org"), ("x", "Ada@example.org")] {
        let error = sign_up(&store, name, email, good).await.unwrap_err();
        assert!(error.to_string().contains("is taken"), "{error}");
    }
    store.set_sign_up_policy(SignUpPolicy::Approval).await.unwrap();
    let waiting = sign_up(&store, "eve", "eve@example.org", good).await.unwrap();
    assert_eq!(waiting.status, UserStatus::Waiting);
    store.set_sign_up_policy(SignUpPolicy::Closed).await.unwrap();
    let error = sign_up(&store, "bob", "bob@example.org", good).await.unwrap_err();
    assert!(matches!(error, AccountError::Closed), "{error}");
}

#[tokio::test]
async fn baselines_are_nobodys() {
    let (_folder, store) = store().await;
    for name in ["baselines", "Baselines"] {
        let error = sign_up(&store, name, "a@example.org", "correct horse").await.unwrap_err().to_string();
        assert!(error.contains("not to be had"), "{error}");
    }
    let made = baselines(&store).await.unwrap();
    assert_eq!(baselines(&store).await.unwrap().id, made.id);
    // Somebody had the name before it was kept.
    set_password(&store, &made, "correct horse", "baselines").await.unwrap();
    assert!(baselines(&store).await.unwrap_err().to_string().contains("somebody has an account"));
}
