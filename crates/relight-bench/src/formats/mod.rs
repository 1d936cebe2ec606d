//! One file a format.

mod chart;
pub mod csv;
pub mod html;
pub mod json;
pub mod latex;
pub mod markdown;
