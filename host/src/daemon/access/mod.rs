//! Who asks, what they may do, how often, and how much of the daemon one connection may take.
//!
//! `permissions` decides by origin, name and token, with `origins` as browsers write them and the `head` of a request;
//! `refused_pages` logs pages from elsewhere. `client` is whose turn a request takes, `sender` whether it still waits for the answer.
//! `pace` delays clients that ask too fast; `limits` are the limits of connections.
//!
//! Uses `api`.

pub mod client;
pub mod head;
pub mod limits;
pub mod origins;
pub mod pace;
pub mod permissions;
mod refused_pages;
pub mod sender;
