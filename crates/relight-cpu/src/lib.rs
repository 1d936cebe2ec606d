//! The fast CPU engine.
//!
//! A step goes through the phases of the reference engine under the same names: [`march`] places samples, [`guide`]
//! where something is ([`walk`] stepping over what is empty, [`placing`] sharing them out), [`hash_grid`] encodes them, [`tile`] runs networks and compositing forward and backward while
//! they are in cache ([`deferred`] telling where colour is decoded, [`shade`] decoding it with visibility, [`probes`] adding lights that nobody photographed
//! and what [`shadow`] rays meet, as far as [`experience`] bears them out), [`roulette`] thins the gradients, [`hash_grid`] and the networks optimise ([`moments`], by [`adam`] or [`soap`]),
//! [`density_grid`] learns where to march, by [`survey`]s too, but for what is `unseen`. Threads share out lanes of some tiles each, and a lane goes through all of it up to
//! the optimisers by itself. Every result is the same for any number of threads. Pictures are
//! drawn front to back (`draw`, `front_to_back`), in ray [`packet`]s. [`stages`] counts what each phase takes, and [`limits`] measures what it
//! could; where memory is waited for, [`prefetch`] asks it ahead, and [`huge_pages`] spares looking for where it is.

pub mod adam;
pub mod aligned;
pub mod composite;
pub mod deferred;
pub mod dense;
pub mod density_grid;
mod draw;
mod engine;
pub mod experience;
pub mod exponential;
mod front_to_back;
pub mod guide;
pub mod harmonics;
pub mod hash_grid;
pub mod huge_pages;
pub mod limits;
pub mod march;
pub mod mlp;
pub mod moments;
pub mod networks;
pub mod packet;
pub mod placing;
pub mod pool;
pub mod prefetch;
pub mod probes;
pub mod roulette;
pub mod samples;
pub mod shade;
pub mod shadow;
pub mod soap;
pub mod stages;
mod state;
pub mod survey;
pub mod tile;
mod unseen;
pub mod walk;

pub use engine::CpuEngine;
