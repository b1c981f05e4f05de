//! The longest chain of calls.

use super::{Program, StackError};
use std::collections::{BTreeMap, BTreeSet};

/// What an exception saves: 26 words with floating point (ARMv7-M, B1.5.7), and one word to align the stack.
const EXCEPTION_FRAME: u32 = 27 * 4;
/// Vectors: reset, NMI, HardFault, and the first interrupt.
const RESET: usize = 1;
const HARD_FAULT: usize = 3;
const FIRST_INTERRUPT: usize = 16;
/// Name of every program's panic handler. It masks interrupts and never returns, so it is a level of its own.
const PANIC_HANDLER: &str = "__rustc::rust_begin_unwind";

/// What the code alone does not tell.
#[derive(Clone, Debug)]
pub struct Rules<'a> {
    /// Names of the functions that call tasks.
    pub executors: &'a [String],
    /// How often each function of a circle of calls is on the stack at once.
    pub recursion: u32,
    /// Handlers of interrupts whose priority is not 0.
    pub priorities: &'a BTreeMap<String, u8>,
}

/// One level of the nesting.
#[derive(Clone, Debug)]
pub struct StackLevel {
    /// What runs there.
    pub name: String,
    /// Bytes, with the exception frame that leads to it.
    pub bytes: u32,
    /// The chain of calls, each with what it has on the stack.
    pub chain: Vec<(String, u32)>,
}

/// What a function is, as far as calls through pointers go.
#[derive(Clone, Copy, PartialEq, Eq)]
enum FunctionClass {
    Task,
    Formatting,
    Logging,
    Executor,
    Other,
}

/// The levels that can be on the stack at once, the lowest first.
///
/// # Errors
/// [`StackError::NoFunction`] if the rules name what the image does not have.
pub fn find_deepest_call_chain_of_each_nesting_level(
    program: &Program,
    rules: &Rules<'_>,
) -> Result<Vec<StackLevel>, StackError> {
    let find = |name: &str| program.functions.iter().position(|function| function.names.iter().any(|own| own == name));
    let known = |name: &String| find(name).ok_or_else(|| StackError::NoFunction(name.clone()));
    let executors = rules.executors.iter().map(known).collect::<Result<BTreeSet<_>, _>>()?;
    let priorities = rules
        .priorities
        .iter()
        .map(|(name, priority)| Ok((known(name)?, *priority)))
        .collect::<Result<BTreeMap<_, _>, StackError>>()?;

    let panic = find(PANIC_HANDLER).ok_or_else(|| StackError::NoFunction(PANIC_HANDLER.to_owned()))?;

    let mut calls = list_possible_callees_of_each_function(program, &executors);
    for callees in &mut calls {
        callees.remove(&panic);
    }
    let mut depths = Depths::new(program, &calls, rules.recursion);
    let mut level = |name: String, position: usize, frame: u32| {
        let (bytes, chain) = depths.find_deepest_stack_and_call_chain(position);
        StackLevel { name, bytes: bytes + frame, chain }
    };

    let mut levels = Vec::new();
    if let Some(reset) = program.vectors.get(&RESET) {
        levels.push(level("thread mode".to_owned(), *reset, 0));
    }
    // By priority, highest number (lowest urgency) first: the deepest handler of each.
    let mut handlers: BTreeMap<u8, StackLevel> = BTreeMap::new();
    for (_, position) in program.vectors.range(FIRST_INTERRUPT..) {
        let priority = priorities.get(position).copied().unwrap_or(0);
        let names = program.functions.get(*position).map(|function| function.names.join(", ")).unwrap_or_default();
        // Interrupts without a handler share one that does nothing, whose many names would tell nothing.
        let name = if names.contains("DefaultHandler") { "no handler".to_owned() } else { names };
        let found = level(format!("priority {priority}: {name}"), *position, EXCEPTION_FRAME);
        let place = handlers.entry(priority).or_insert_with(|| found.clone());
        if found.bytes > place.bytes {
            *place = found;
        }
    }
    levels.extend(handlers.into_values().rev());
    levels.push(level("a panic".to_owned(), panic, 0));
    if let Some(fault) = program.vectors.get(&HARD_FAULT) {
        levels.push(level("a HardFault".to_owned(), *fault, EXCEPTION_FRAME));
    }
    Ok(levels)
}

fn classify_function(names: &[String], is_executor: bool) -> FunctionClass {
    let any = |test: fn(&str) -> bool| names.iter().any(|name| test(name));
    if is_executor {
        FunctionClass::Executor
    } else if any(|name| name.contains("TaskStorage<") && name.ends_with("::poll")) {
        FunctionClass::Task
    } else if any(|name| name.contains("core::fmt::")) {
        FunctionClass::Formatting
    } else if any(|name| name.contains("_defmt_") || name.contains("defmt_rtt::")) {
        FunctionClass::Logging
    } else {
        FunctionClass::Other
    }
}

/// Direct calls, and what calls through pointers may reach.
fn list_possible_callees_of_each_function(program: &Program, executors: &BTreeSet<usize>) -> Vec<BTreeSet<usize>> {
    let classes: Vec<FunctionClass> = program
        .functions
        .iter()
        .enumerate()
        .map(|(position, function)| classify_function(&function.names, executors.contains(&position)))
        .collect();
    let of = |position: usize| classes.get(position).copied().unwrap_or(FunctionClass::Other);
    let calls = program.functions.iter().enumerate().map(|(position, function)| {
        let mut calls = function.calls.clone();
        if function.calls_indirectly {
            calls.extend(program.address_taken.iter().filter(|target| match of(position) {
                FunctionClass::Executor => true,
                own @ (FunctionClass::Formatting | FunctionClass::Logging) => of(**target) == own,
                FunctionClass::Task | FunctionClass::Other => {
                    !matches!(of(**target), FunctionClass::Task | FunctionClass::Logging)
                }
            }));
        }
        calls
    });
    calls.collect()
}

/// Depths of functions, each computed once. Functions that call one another in a circle are one node.
struct Depths<'a> {
    program: &'a Program,
    calls: &'a [BTreeSet<usize>],
    recursion: u32,
    /// By function: the members of its circle, or itself alone.
    circles: Vec<Vec<usize>>,
    /// By the first function of a circle.
    known: BTreeMap<usize, (u32, Vec<(String, u32)>)>,
}

impl<'a> Depths<'a> {
    fn new(program: &'a Program, calls: &'a [BTreeSet<usize>], recursion: u32) -> Self {
        // With a few hundred functions, who reaches whom is found by plain search.
        let reached: Vec<BTreeSet<usize>> =
            (0..calls.len()).map(|start| find_reachable_by_one_or_more_calls(calls, start)).collect();
        let reaches = |from: usize, to: usize| reached.get(from).is_some_and(|set| set.contains(&to));
        let circle = |position: usize| {
            let mut members: Vec<usize> =
                (0..calls.len()).filter(|other| reaches(position, *other) && reaches(*other, position)).collect();
            if members.is_empty() {
                members.push(position);
            }
            members
        };
        let circles = (0..calls.len()).map(circle).collect();
        Self { program, calls, recursion, circles, known: BTreeMap::new() }
    }

    /// Bytes below and including this function, and the chain.
    fn find_deepest_stack_and_call_chain(&mut self, function: usize) -> (u32, Vec<(String, u32)>) {
        let members = self.circles.get(function).cloned().unwrap_or_default();
        let first = members.first().copied().unwrap_or(function);
        if let Some(known) = self.known.get(&first) {
            return known.clone();
        }
        let frames = members.iter().filter_map(|member| self.program.functions.get(*member));
        let sum: u32 = frames.map(|function| function.frame).sum();
        let calls = |member: &usize| self.calls.get(*member);
        let in_circle = members.iter().any(|member| calls(member).is_some_and(|set| set.contains(&first)));
        let own = if in_circle { sum * self.recursion } else { sum };
        let name = self.program.functions.get(function).and_then(|function| function.names.first());
        let mut name = name.cloned().unwrap_or_default();
        if in_circle {
            name = format!("{} times a circle of {} functions with {name}", self.recursion, members.len());
        }
        let outside: BTreeSet<usize> =
            members.iter().filter_map(calls).flatten().copied().filter(|callee| !members.contains(callee)).collect();
        let deepest = outside
            .into_iter()
            .map(|callee| self.find_deepest_stack_and_call_chain(callee))
            .max_by_key(|(bytes, _)| *bytes);
        let (below, rest) = deepest.unwrap_or_default();
        let result = (own + below, [vec![(name, own)], rest].concat());
        self.known.insert(first, result.clone());
        result
    }
}

/// What can be reached from `start` by at least one call.
fn find_reachable_by_one_or_more_calls(calls: &[BTreeSet<usize>], start: usize) -> BTreeSet<usize> {
    let mut reached = BTreeSet::new();
    let mut open = vec![start];
    while let Some(position) = open.pop() {
        for callee in calls.get(position).into_iter().flatten() {
            if reached.insert(*callee) {
                open.push(*callee);
            }
        }
    }
    reached
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stack::program::Function;

    fn function(name: &str, frame: u32, calls: &[usize], calls_indirectly: bool) -> Function {
        Function { names: vec![name.to_owned()], frame, calls: calls.iter().copied().collect(), calls_indirectly }
    }

    fn program() -> Program {
        let functions = vec![
            function("Reset", 8, &[1], false),
            function("run", 100, &[2, 7], true),
            function("shallow", 10, &[], false),
            function("embassy_executor::raw::TaskStorage<F>::poll", 1000, &[4], true),
            function("core::fmt::write", 40, &[7], true),
            function("<&T as core::fmt::Display>::fmt", 20, &[4], false),
            function("Tick", 30, &[8], true),
            function(PANIC_HANDLER, 64, &[4], false),
            function("wake", 16, &[], false),
            function("Slow", 500, &[], false),
            function("HardFault", 48, &[], false),
        ];
        Program {
            functions,
            address_taken: [3, 5, 8].into(),
            vectors: [(RESET, 0), (HARD_FAULT, 10), (FIRST_INTERRUPT, 6), (FIRST_INTERRUPT + 1, 9)].into(),
            sleeps: Vec::new(),
        }
    }

    #[test]
    fn the_longest_chain_of_each_level_is_found() {
        let executors = ["run".to_owned()];
        let rules = Rules { executors: &executors, recursion: 3, priorities: &BTreeMap::new() };
        let levels = find_deepest_call_chain_of_each_nesting_level(&program(), &rules).expect("a bound");
        let bytes: Vec<u32> = levels.iter().map(|level| level.bytes).collect();
        // The executor calls the task, which formats: write and fmt call each other, counted three times each. Nobody
        // but the executor calls tasks, so the interrupt reaches formatting at most, and is less deep than the slow one.
        let circle = 3 * (40 + 20);
        assert_eq!(bytes, [8 + 100 + 1000 + circle, 500 + EXCEPTION_FRAME, 64 + circle, 48 + EXCEPTION_FRAME]);
        assert!(levels[1].name.contains("Slow"), "{levels:?}");
    }

    #[test]
    fn each_priority_is_a_level_of_its_own() {
        let priorities = [("Slow".to_owned(), 5)].into();
        let levels = find_deepest_call_chain_of_each_nesting_level(
            &program(),
            &Rules { executors: &[], recursion: 1, priorities: &priorities },
        );
        let names: Vec<String> = levels.expect("a bound").into_iter().map(|level| level.name).collect();
        assert_eq!(names, ["thread mode", "priority 5: Slow", "priority 0: Tick", "a panic", "a HardFault"]);
        let unknown = ["gone".to_owned()];
        let rules = Rules { executors: &unknown, recursion: 1, priorities: &BTreeMap::new() };
        assert!(
            matches!(find_deepest_call_chain_of_each_nesting_level(&program(), &rules), Err(StackError::NoFunction(name)) if name == "gone")
        );
    }
}
