//! Signing up and in, and the account with its tokens.

use maud::{Markup, html};

use super::shell::{Visitor, alert, form_token, moment, page};
use crate::store::{TokenEntry, User, UserStatus};

/// The form to sign in; `name` and what went wrong come from the attempt before.
pub fn sign_in(visitor: &Visitor, name: &str, problem: &str, next: &str) -> Markup {
    page(
        Some(visitor),
        "Sign in",
        &html! {
            section.narrow {
                h1 { "Sign in" }
                (alert(problem))
                form.stack method="post" action="/sign-in" {
                    (form_token(visitor))
                    input type="hidden" name="next" value=(next);
                    label for="name" { "Name or e-mail address" }
                    input #name name="name" value=(name) autocomplete="username" required autofocus;
                    label for="password" { "Password" }
                    input #password type="password" name="password" autocomplete="current-password" required;
                    button { "Sign in" }
                }
                p { "No account yet? " a href="/sign-up" { "Sign up" } }
            }
        },
    )
}

/// The form to sign up; the texts come from the attempt before.
pub fn sign_up(visitor: &Visitor, name: &str, email: &str, problem: &str) -> Markup {
    page(
        Some(visitor),
        "Sign up",
        &html! {
            section.narrow {
                h1 { "Sign up" }
                (alert(problem))
                form.stack method="post" action="/sign-up" {
                    (form_token(visitor))
                    label for="name" { "Name" small { "Shown beside your public entries." } }
                    input #name name="name" value=(name) maxlength="64" autocomplete="username" required autofocus;
                    label for="email" { "E-mail address" small { "Shown to the hosts alone." } }
                    input #email type="email" name="email" value=(email) maxlength="254" autocomplete="email" required;
                    label for="password" { "Password" small { "At least 10 characters." } }
                    input #password type="password" name="password" minlength="10" autocomplete="new-password" required;
                    button { "Sign up" }
                }
                p { "Have an account? " a href="/sign-in" { "Sign in" } }
            }
        },
    )
}

/// The account of whoever is signed in. `new_token` was just made and is never shown again.
pub fn account(
    visitor: &Visitor,
    user: &User,
    tokens: &[TokenEntry],
    new_token: Option<&str>,
    problem: &str,
) -> Markup {
    page(
        Some(visitor),
        "Account",
        &html! {
            section.head {
                h1 { "Account" }
                p.facts { bdi { (user.name) } " " bdi { (user.email) } }
            }
            (alert(problem))
            @match user.status {
                UserStatus::Waiting => { p.alert { "Your account waits for the hosts’ approval; until then you cannot submit." } }
                UserStatus::Blocked => { p.alert { "Your account is blocked; ask the hosts." } }
                UserStatus::Active => {}
            }
            section {
                h2 { "Tokens" }
                p.note { "Programs submit with a token in place of your password. Revoke one that someone else may have seen." }
                @if let Some(token) = new_token {
                    div.fresh role="status" {
                        p { "Your new token. Copy it now: it is not shown again." }
                        p { code.secret #token { (token) } " " button.plain type="button" data-copy="token" hidden { "Copy" } }
                    }
                }
                @if !tokens.is_empty() {
                    div.scroll role="region" aria-label="Tokens" tabindex="0" {
                        table {
                            thead { tr {
                                th scope="col" { "Name" } th scope="col" { "Made" } th scope="col" { "Last used" }
                                th scope="col" { span.hidden { "Revoke" } }
                            } }
                            tbody {
                                @for token in tokens {
                                    tr {
                                        th scope="row" dir="auto" { (token.name) }
                                        td { (moment(&token.created_at.to_string())) }
                                        td {
                                            @if let Some(used) = token.used_at { (moment(&used.to_string())) } @else { "never" }
                                        }
                                        td {
                                            form method="post" action=(format!("/account/tokens/{}/revoke", token.id)) {
                                                (form_token(visitor))
                                                button.plain aria-label=(format!("Revoke {}", token.name)) { "Revoke" }
                                            }
                                        }
                                    }
                                }
                            }
                        }
                    }
                }
                form.row method="post" action="/account/tokens" {
                    (form_token(visitor))
                    label for="token-name" { "Name of a new token" }
                    input #token-name name="name" maxlength="64" required placeholder="laptop";
                    button { "Make a token" }
                }
            }
            section {
                h2 { "Password" }
                details {
                    summary { "Change the password" }
                    form.stack.narrow method="post" action="/account/password" {
                        (form_token(visitor))
                        label for="old" { "Old password" }
                        input #old type="password" name="old" autocomplete="current-password" required;
                        label for="new" { "New password" small { "At least 10 characters. Signs you out everywhere." } }
                        input #new type="password" name="new" minlength="10" autocomplete="new-password" required;
                        button { "Change" }
                    }
                }
            }
        },
    )
}
