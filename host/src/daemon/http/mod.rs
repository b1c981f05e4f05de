//! Connections and HTTP: what listens, how connections are served and ended, and a function for each path.
//!
//! `listener` is where connections come in (`damaged_certificate` finds certificates whose writing was cut off), `server` serves them,
//! with `stop_places` kept for stops, and `linger` ends those whose sender still sends. `routes` has a function for each path (`effect_routes` those of effects),
//! `authorize` says which role a path needs, `body` reads bodies, `page_files` is the web page, `description` makes the description of the interface (OpenAPI) from all of these.
//! `cache_warmer` keeps what a touch needs in the processor's caches.
//!
//! Uses all other folders.

mod authorize;
mod body;
mod cache_warmer;
mod damaged_certificate;
mod description;
mod effect_routes;
mod linger;
pub mod listener;
mod page_files;
pub mod routes;
pub mod server;
mod stop_places;
