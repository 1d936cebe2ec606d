use super::*;

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
    assert!(error.contains("server.db") && error.contains("format 1 (found format 7)"), "{error}");
}
