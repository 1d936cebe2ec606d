//! What admins do by pages: the same as by commands, under their own names.

use axum::extract::{Path, Query, State};
use axum::response::{Html, Redirect};
use serde::Deserialize;

use super::admin;
use super::history::Pages;
use super::session::{Guest, PageError, Posted};
use crate::api::Part;
use crate::app::AppState;
use crate::method::Phase;
use crate::store::Quota;

/// Lines of the audit log that are shown.
const SHOWN: u32 = 500;

pub(super) async fn benchmarks(State(app): State<AppState>, guest: Guest) -> Result<Html<String>, PageError> {
    guest.admin()?;
    let benchmarks = app.store.benchmarks().await?;
    Ok(Html(admin::benchmarks(&guest.visitor(), &benchmarks).into_string()))
}

pub(super) async fn submissions(
    State(app): State<AppState>,
    Query(part): Query<Part>,
    guest: Guest,
) -> Result<Html<String>, PageError> {
    guest.admin()?;
    let (entries, has_more) = app.store.submissions_page(None, part.page()).await?;
    let pages = Pages { page: part.page(), has_more };
    Ok(Html(admin::submissions(&guest.visitor(), &entries, pages).into_string()))
}

pub(super) async fn audit(State(app): State<AppState>, guest: Guest) -> Result<Html<String>, PageError> {
    guest.admin()?;
    let lines = app.store.audit(SHOWN).await?;
    Ok(Html(admin::audit(&guest.visitor(), &lines).into_string()))
}

#[derive(Debug, Deserialize)]
pub(super) struct Open {
    open: bool,
}

pub(super) async fn set_open(
    State(app): State<AppState>,
    Path(name): Path<String>,
    Posted { guest, form }: Posted<Open>,
) -> Result<Redirect, PageError> {
    app.store.set_open(&name, form.open, &guest.admin()?.name).await?;
    app.boards.changed();
    Ok(Redirect::to("/admin"))
}

#[derive(Debug, Deserialize)]
pub(super) struct NewQuota {
    phase: Phase,
    per_day: u32,
    total: u32,
    gap_seconds: u32,
}

pub(super) async fn set_quota(
    State(app): State<AppState>,
    Path(name): Path<String>,
    Posted { guest, form }: Posted<NewQuota>,
) -> Result<Redirect, PageError> {
    let actor = &guest.admin()?.name;
    let quota = Quota { per_day: form.per_day, total: form.total, gap_seconds: form.gap_seconds };
    app.store.set_quota(&name, form.phase, quota, actor).await?;
    app.boards.changed();
    Ok(Redirect::to("/admin"))
}

#[derive(Debug, Deserialize)]
pub(super) struct Hidden {
    hidden: bool,
}

pub(super) async fn set_hidden(
    State(app): State<AppState>,
    Path(id): Path<String>,
    Posted { guest, form }: Posted<Hidden>,
) -> Result<Redirect, PageError> {
    app.store.set_hidden(&id, form.hidden, &guest.admin()?.name).await?;
    app.boards.changed();
    Ok(Redirect::to("/admin/submissions"))
}
