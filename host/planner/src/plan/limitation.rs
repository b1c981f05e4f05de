//! What keeps a plan or an effect below its wish: a code for programs, a text for people.

use crate::physics::limits::Limit;
use crate::table::PlanTable;
use era_shared::waveform::MAX_WINDOWS;
use serde::{Serialize, Serializer, ser::SerializeStruct};
use std::fmt;

/// One reason.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Limitation {
    /// A limit of one actuator.
    Actuator {
        /// Which limit.
        limit: Limit,
        /// The actuator's `id`.
        id: String,
    },
    /// The mean current of the board's supply.
    Supply,
    /// What a quiet zone allows.
    QuietZone,
    /// No actuator moves the place.
    Node,
    /// An effect that is over before the panel has come up.
    TooShort,
    /// What is left of the touches before.
    StillMoving,
    /// A click that needs more windows than a board plays.
    Windows,
}

impl Limitation {
    /// A limit of an actuator of a table's scene; the supply's is nobody's.
    #[must_use]
    pub fn for_actuator(table: &PlanTable, limit: Limit, actuator: usize) -> Self {
        if limit == Limit::Supply {
            return Self::Supply;
        }
        Self::Actuator { limit, id: table.scene.actuators.get(actuator).map_or_else(String::new, |own| own.id.clone()) }
    }

    /// Its code, which stays the same from version to version.
    #[must_use]
    pub const fn code(&self) -> &'static str {
        match self {
            Self::Actuator { limit, .. } => limit.name(),
            Self::Supply => Limit::Supply.name(),
            Self::QuietZone => "quiet-zone",
            Self::Node => "node",
            Self::TooShort => "too-short",
            Self::StillMoving => "still-moving",
            Self::Windows => "windows",
        }
    }

    /// All codes.
    #[must_use]
    pub fn list_limitation_codes() -> Vec<&'static str> {
        let others = [Self::QuietZone, Self::Node, Self::TooShort, Self::StillMoving, Self::Windows];
        let others = others.iter().map(Self::code);
        Limit::ALL.into_iter().map(Limit::name).chain(others).collect()
    }

    /// The actuator whose limit it is, by its `id`.
    #[must_use]
    pub fn actuator_id_if_limit_of_actuator(&self) -> Option<&str> {
        match self {
            Self::Actuator { id, .. } => Some(id),
            _ => None,
        }
    }
}

impl fmt::Display for Limitation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Actuator { limit, id } => write!(f, "{} of {id}", limit.name()),
            Self::Supply | Self::Node => f.write_str(self.code()),
            Self::QuietZone => f.write_str("quiet zone"),
            Self::TooShort => f.write_str("the panel, which does not reach its steady motion within the effect"),
            Self::StillMoving => f.write_str("motion that remains from earlier touches"),
            Self::Windows => write!(
                f,
                "the number of windows: a board plays at most {MAX_WINDOWS} (for a double click, half of them per click)"
            ),
        }
    }
}

#[cfg(feature = "schema")]
impl utoipa::PartialSchema for Limitation {
    fn schema() -> utoipa::openapi::RefOr<utoipa::openapi::Schema> {
        use utoipa::openapi::schema::{ObjectBuilder, SchemaType, Type};
        let code = ObjectBuilder::new()
            .schema_type(Type::String)
            .description(Some("Code of the limit, for programs. Codes do not change between versions."))
            .enum_values(Some(Self::list_limitation_codes()));
        let actuator = ObjectBuilder::new().schema_type(SchemaType::Array(vec![Type::String, Type::Null])).description(
            Some("The `id` of the actuator whose limit this is; null for limits that belong to no single actuator."),
        );
        ObjectBuilder::new()
            .description(Some("A limit that keeps a plan or an effect below the wanted peak."))
            .property("code", code)
            .property("actuator", actuator)
            .required("code")
            .required("actuator")
            .into()
    }
}

#[cfg(feature = "schema")]
impl utoipa::ToSchema for Limitation {
    fn name() -> std::borrow::Cow<'static, str> {
        "Limit".into()
    }
}

impl Serialize for Limitation {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut object = serializer.serialize_struct("Limitation", 2)?;
        object.serialize_field("code", self.code())?;
        object.serialize_field("actuator", &self.actuator_id_if_limit_of_actuator())?;
        object.end()
    }
}

/// Adds a reason, unless it is known.
pub(crate) fn add_limitation_if_new(reasons: &mut Vec<Limitation>, reason: Limitation) {
    if !reasons.contains(&reason) {
        reasons.push(reason);
    }
}

/// All of them as a text; `None` without any.
#[must_use]
pub fn join_limitations_as_text_if_any(reasons: &[Limitation]) -> Option<String> {
    (!reasons.is_empty()).then(|| reasons.iter().map(Limitation::to_string).collect::<Vec<_>>().join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_and_texts() {
        let of = |limit| Limitation::Actuator { limit, id: "left".into() };
        let all = [of(Limit::PullIn), of(Limit::Voltage), Limitation::QuietZone];
        assert_eq!(
            join_limitations_as_text_if_any(&all).as_deref(),
            Some("pull-in of left, voltage of left, quiet zone")
        );
        assert_eq!(join_limitations_as_text_if_any(&[]), None);
        let json = serde_json::to_string(&all).unwrap();
        assert!(json.starts_with(r#"[{"code":"pull-in","actuator":"left"},"#), "{json}");
        assert!(json.ends_with(r#"{"code":"quiet-zone","actuator":null}]"#), "{json}");
        let mut known = all.to_vec();
        add_limitation_if_new(&mut known, Limitation::QuietZone);
        add_limitation_if_new(&mut known, Limitation::Node);
        assert_eq!(known.len(), 4);
    }
}
