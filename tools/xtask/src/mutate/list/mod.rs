//! The mistakes: what is wrong, where, and how.

mod firmware;
mod readers;
mod shared;

use super::board_checks::BoardCheck;

/// A mistake: the text that stands once in a file, and what takes its place.
pub struct Mutation {
    /// What is wrong.
    pub name: &'static str,
    /// The file, from the repository's root.
    pub file: &'static str,
    /// What stands there.
    pub from: &'static str,
    /// What takes its place.
    pub to: &'static str,
    /// Why no test can detect it, if none can.
    pub unseen_because: Option<&'static str>,
    /// The check of the emulated board that is tried first, because it detects this mistake; the others follow if it does not.
    pub first_check: Option<BoardCheck>,
}

impl Mutation {
    /// The same mistake, with this check of the emulated board tried first.
    const fn with_first_check(mut self, check: BoardCheck) -> Self {
        self.first_check = Some(check);
        self
    }
}

const fn new_mutation(name: &'static str, file: &'static str, from: &'static str, to: &'static str) -> Mutation {
    Mutation { name, file, from, to, unseen_because: None, first_check: None }
}

/// A mistake that no test can detect, for this reason.
const fn new_undetectable_mutation(
    name: &'static str,
    file: &'static str,
    [from, to]: [&'static str; 2],
    reason: &'static str,
) -> Mutation {
    Mutation { name, file, from, to, unseen_because: Some(reason), first_check: None }
}

/// All of them.
pub fn list_mutations() -> impl Iterator<Item = &'static Mutation> {
    shared::MUTATIONS.iter().chain(readers::MUTATIONS).chain(firmware::MUTATIONS)
}
