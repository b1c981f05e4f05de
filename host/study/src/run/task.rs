//! What there is to do, in pieces.

use std::fmt;
use std::str::FromStr;

/// A piece of a study's work.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum StudyTask {
    /// The scene as it is in its file.
    Base,
    /// Some of the designs that are known beforehand.
    Designs {
        /// The number of the chunk, from zero.
        chunk: usize,
    },
    /// A generation of an evolution, once those before it are there.
    Generation {
        /// Which search.
        run: usize,
        /// Which of its generations, from zero.
        generation: usize,
    },
}

impl StudyTask {
    /// Name of the file of its rows.
    #[must_use]
    pub fn rows_file_name(&self) -> String {
        format!("{self}.rows")
    }
}

/// A name that is no task's.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{name:?} is not the name of a task; examples of names: base, designs-0000003, run-0001-generation-00002")]
pub struct TaskError {
    name: String,
}

impl fmt::Display for StudyTask {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Base => f.write_str("base"),
            Self::Designs { chunk } => write!(f, "designs-{chunk:07}"),
            Self::Generation { run, generation } => write!(f, "run-{run:04}-generation-{generation:05}"),
        }
    }
}

impl FromStr for StudyTask {
    type Err = TaskError;

    fn from_str(name: &str) -> Result<Self, TaskError> {
        let number = |digits: &str| digits.parse().ok();
        let task = if let Some(chunk) = name.strip_prefix("designs-") {
            number(chunk).map(|chunk| Self::Designs { chunk })
        } else if let Some((run, generation)) =
            name.strip_prefix("run-").and_then(|rest| rest.split_once("-generation-"))
        {
            number(run).zip(number(generation)).map(|(run, generation)| Self::Generation { run, generation })
        } else {
            Some(Self::Base)
        };
        // One task has one name.
        task.filter(|task| task.to_string() == name).ok_or_else(|| TaskError { name: name.into() })
    }
}

/// A share of the work: the `number`-th of `count`, from one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    number: usize,
    count: usize,
}

/// A share that is none.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{text:?} is not of the form I/N, with N from 1 to {most} and I from 1 to N", most = Shard::MOST)]
pub struct ShardError {
    text: String,
}

impl Shard {
    /// All of the work.
    pub const ALL: Self = Self { number: 1, count: 1 };
    /// Most shares.
    pub const MOST: usize = 1_000_000;

    /// Whether a task belongs to it: chunks go around in turn, and all generations of a search stay together. The scene itself is
    /// looked at by all, as searches begin from it.
    #[must_use]
    pub const fn contains_task_counting_base_in_every_shard(&self, task: StudyTask) -> bool {
        match task {
            StudyTask::Base => true,
            StudyTask::Designs { chunk } => chunk % self.count + 1 == self.number,
            StudyTask::Generation { run, .. } => run % self.count + 1 == self.number,
        }
    }

    /// Whether the shard is all of the work.
    #[must_use]
    pub const fn is_whole_study(&self) -> bool {
        self.count == 1
    }
}

impl FromStr for Shard {
    type Err = ShardError;

    fn from_str(text: &str) -> Result<Self, ShardError> {
        let numbers =
            text.split_once('/').and_then(|(number, count)| Some((number.parse().ok()?, count.parse().ok()?)));
        let shard = numbers.map(|(number, count)| Self { number, count });
        let is_one =
            |shard: &Self| (1..=Self::MOST).contains(&shard.count) && (1..=shard.count).contains(&shard.number);
        shard.filter(is_one).ok_or_else(|| ShardError { text: text.into() })
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_counted_from_one() {
        assert!("1/3".parse::<Shard>().is_ok() && "3/3".parse::<Shard>().is_ok());
        for text in ["0/3", "4/3", "1", "1/0", "a/b", "1/2/3", "-1/2"] {
            assert!(text.parse::<Shard>().is_err(), "{text}");
        }
    }

    #[test]
    fn a_task_is_known_by_its_name() {
        let tasks =
            [StudyTask::Base, StudyTask::Designs { chunk: 12 }, StudyTask::Generation { run: 3, generation: 123_456 }];
        for task in tasks {
            assert_eq!(task.to_string().parse(), Ok(task));
        }
        for name in
            ["", "bases", "designs-12", "designs-0000012.rows", "designs--000001", "run-0001", "run-0001-generation-1"]
        {
            assert!(name.parse::<StudyTask>().is_err(), "{name}");
        }
    }

    #[test]
    fn shares_make_up_the_work_and_do_not_overlap() {
        let tasks = (0..20).map(|chunk| StudyTask::Designs { chunk });
        let generations =
            (0..6).flat_map(|run| (0..3).map(move |generation| StudyTask::Generation { run, generation }));
        for task in tasks.chain(generations) {
            let owners = (1..=4)
                .filter(|number| Shard { number: *number, count: 4 }.contains_task_counting_base_in_every_shard(task))
                .count();
            assert_eq!(owners, 1, "{task:?}");
        }
    }
}
