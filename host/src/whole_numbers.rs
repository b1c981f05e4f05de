//! Whole numbers in JSON: `3.0` and `1e1` are as good as `3` and `10`, as JSON Schema has it (2020-12, 6.1.1), whose `integer` is what the
//! interface's description says.

use serde::Deserializer;
use serde::de::{Error, Unexpected, Visitor};
use std::fmt;
use std::marker::PhantomData;

/// Beyond this not every whole number is a float of 64 bits: one that is written with a point may have been another one.
const EXACT: f64 = 9_007_199_254_740_992.0;

/// A type of whole numbers.
pub trait WholeNumber: TryFrom<i64> + TryFrom<u64> {
    /// Its name where a message says what was expected; `daemon::api::json` puts it into words.
    const NAME: &'static str;
}

impl WholeNumber for u32 {
    const NAME: &'static str = "u32";
}

impl WholeNumber for i64 {
    const NAME: &'static str = "i64";
}

/// Reads a whole number.
///
/// # Errors
/// What is there instead: no number, one with a fraction, or one beyond the type.
pub fn deserialize_whole_number<'de, T: WholeNumber, D: Deserializer<'de>>(deserializer: D) -> Result<T, D::Error> {
    deserializer.deserialize_i64(WholeVisitor(PhantomData))
}

/// The same where there may be none, or null; with `#[serde(default)]`.
///
/// # Errors
/// As [`deserialize_whole_number`].
pub fn deserialize_whole_number_or_null<'de, T: WholeNumber, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Option<T>, D::Error> {
    deserializer.deserialize_option(OptionVisitor(PhantomData))
}

/// The whole number that a float is, within what a float holds exactly; `None` for any other.
#[expect(clippy::cast_possible_truncation, reason = "a whole number that an f64 holds exactly")]
#[must_use]
pub fn to_exact_whole_number(value: f64) -> Option<i64> {
    (value.fract() == 0.0 && value.abs() <= EXACT).then_some(value as i64)
}

struct WholeVisitor<T>(PhantomData<T>);

impl<T: WholeNumber> Visitor<'_> for WholeVisitor<T> {
    type Value = T;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(T::NAME)
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<T, E> {
        T::try_from(value).map_err(|_| E::invalid_value(Unexpected::Signed(value), &self))
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<T, E> {
        T::try_from(value).map_err(|_| E::invalid_value(Unexpected::Unsigned(value), &self))
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<T, E> {
        let whole = to_exact_whole_number(value).and_then(|whole| T::try_from(whole).ok());
        whole.ok_or_else(|| E::invalid_value(Unexpected::Float(value), &self))
    }
}

struct OptionVisitor<T>(PhantomData<T>);

impl<'de, T: WholeNumber> Visitor<'de> for OptionVisitor<T> {
    type Value = Option<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(T::NAME)
    }

    fn visit_none<E: Error>(self) -> Result<Self::Value, E> {
        Ok(None)
    }

    fn visit_unit<E: Error>(self) -> Result<Self::Value, E> {
        Ok(None)
    }

    fn visit_some<D: Deserializer<'de>>(self, deserializer: D) -> Result<Self::Value, D::Error> {
        deserialize_whole_number(deserializer).map(Some)
    }
}
