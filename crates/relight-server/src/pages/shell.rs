//! What all pages have around them.

use maud::{DOCTYPE, Markup, html};

use super::assets;

/// Who looks at a page.
#[derive(Clone, Debug, Default)]
pub struct Visitor {
    /// Their name, if they are signed in.
    pub name: Option<String>,
    /// Whether they see the pages of admins.
    pub is_admin: bool,
    /// What their forms carry to show that they came from our pages.
    pub form_token: String,
}

/// A whole page: `title` for the window, `main` between the head and the foot that all pages have. Without a visitor nothing is said
/// of accounts.
pub fn page(visitor: Option<&Visitor>, title: &str, main: &Markup) -> Markup {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { (title) " · Relight benchmark" }
                link rel="icon" type="image/svg+xml" href=(assets::ICON.address());
                link rel="stylesheet" href=(assets::STYLE.address());
                script type="module" src=(assets::SCRIPT.address()) {}
            }
            body {
                a.skip href="#main" { "Skip to content" }
                header.site {
                    a.brand href="/" {
                        img src=(assets::ICON.address()) width="22" height="22" alt="";
                        span { "Relight" } " benchmark"
                    }
                    @if let Some(visitor) = visitor {
                      nav aria-label="Account" {
                        @if visitor.is_admin { a href="/admin" { "Administration" } }
                        @if let Some(name) = &visitor.name {
                            a href="/account/submissions" { "My submissions" }
                            a.who href="/account" { bdi { (name) } }
                            form method="post" action="/sign-out" {
                                (form_token(visitor))
                                button.plain { "Sign out" }
                            }
                        } @else {
                            a href="/sign-in" { "Sign in" }
                            a href="/sign-up" { "Sign up" }
                        }
                      }
                    }
                }
                main #main tabindex="-1" { (main) }
                footer.site {
                    p {
                        "Relight novel views under novel lights. Scored by "
                        (crate::scoring::EVALUATOR) "."
                    }
                }
            }
        }
    }
}

/// The hidden field that every form carries.
pub fn form_token(visitor: &Visitor) -> Markup {
    html! { input type="hidden" name="form_token" value=(visitor.form_token); }
}

/// A page that says why there is no other: a short title, and what to do.
pub fn problem(title: &str, text: &str) -> Markup {
    page(
        None,
        title,
        &html! {
            section.narrow {
                h1 { (title) }
                p { (text) }
                p { a href="/" { "All benchmarks" } }
            }
        },
    )
}

/// A message above a form: what went wrong.
pub fn alert(text: &str) -> Markup {
    html! { @if !text.is_empty() { p.alert role="alert" { (text) } } }
}

/// A moment, RFC 3339, as the day and the minute.
pub fn moment(rfc3339: &str) -> Markup {
    let day = rfc3339.get(..10).unwrap_or(rfc3339);
    html! { time datetime=(rfc3339) title=(rfc3339) { (day) } }
}

/// A link to somewhere else, if it leads to the web: what people write is not trusted to.
pub fn outward(address: &str, text: &str) -> Markup {
    let web = address.starts_with("https://") || address.starts_with("http://");
    html! { @if web { a href=(address) rel="nofollow noopener noreferrer ugc" { (text) } } }
}

/// Bytes as people read them.
pub fn size(bytes: u64) -> String {
    match bytes {
        0..1_000_000 => format!("{:.1} kB", bytes as f64 / 1e3),
        1_000_000..1_000_000_000 => format!("{:.1} MB", bytes as f64 / 1e6),
        _ => format!("{:.2} GB", bytes as f64 / 1e9),
    }
}
