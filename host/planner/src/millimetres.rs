//! Metres, as they are inside, written as millimetres, as they are at the edges.

use serde::{Serialize, Serializer};

/// A length in m, for `serialize_with`.
///
/// # Errors
/// Those of the serializer.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "the signature that serde asks for")]
pub fn serialize_length_in_mm<S: Serializer>(metres: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_f64(metres * 1e3)
}

/// A place in m, for `serialize_with`.
///
/// # Errors
/// Those of the serializer.
pub fn serialize_position_in_mm<S: Serializer>(metres: &[f64; 2], serializer: S) -> Result<S::Ok, S::Error> {
    metres.map(|metres| metres * 1e3).serialize(serializer)
}
