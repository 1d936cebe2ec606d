//! One file a format.

pub mod csv;
pub mod html;
pub mod json;
pub mod latex;
pub mod markdown;
