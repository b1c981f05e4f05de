//! Design studies of touch panels: a scene and what may change in it, what is wanted, and ways to look for it.
//!
//! Rooms, in the order in which they use each other: [`spec`] reads a study's file, [`space`] makes scenes of points of the unit cube, [`bounds`] says what a study takes before that is done,
//! [`evaluate`] knows a scene's figures, [`methods`] chooses the points, [`run`] does the work in tasks that are kept in a folder as they
//! are done, [`result`] makes a table of them, [`mod@report`] a page to read, and [`written`] puts all of that into the folder. [`tolerances`] is about one plan instead: what it does on a
//! panel that is a little off.

pub mod bounds;
pub mod evaluate;
pub mod methods;
pub mod report;
pub mod result;
pub mod run;
pub mod space;
pub mod spec;
pub mod tolerances;
pub mod written;
