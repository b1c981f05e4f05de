//! Whether a daemon takes more and more of the machine.

use crate::daemon::MemoryThreadsAndHandles;

/// What a daemon may take more than when it was warm, in kB. The outcomes of the last 256 requests are kept, some 10 kB each where several
/// places and what can be had instead are told: 2.5 MB. Memory that is free again stays with the threads that had it, and comes to as
/// much. In ten minutes without faults 3.1 MB were measured. In a run of that length, with 39 000 touches, 8 MB is 210 bytes
/// left over by each touch.
const MEMORY_KB: u64 = 8192;
/// A thread for each of the eight clients whose plan is being worked out while another one does what there is to be done meanwhile; the
/// runtime ends them after ten seconds without work.
const THREADS: u64 = 8;
/// Connections that are closed, and that the daemon has not looked at since; when it was warm, all clients had theirs.
const HANDLES: u64 = 4;

/// What has grown by more than it may from `warm` to `later`, in words.
pub fn describe_growth_beyond_allowance(
    warm: MemoryThreadsAndHandles,
    later: MemoryThreadsAndHandles,
    when: &str,
) -> Vec<String> {
    // A process without a thread is none.
    if warm.threads == 0 || later.threads == 0 {
        return vec![format!("the memory, threads and handles of the daemon {when} could not be read")];
    }
    let all = [
        ("memory", " kB", warm.memory_kb, later.memory_kb, MEMORY_KB),
        ("threads", "", warm.threads, later.threads, THREADS),
        ("handles", "", warm.handles, later.handles, HANDLES),
    ];
    let grown = all.into_iter().filter(|(.., before, after, most)| *after > before + most);
    grown
        .map(|(name, unit, before, after, most)| {
            format!("{name} grew from {before}{unit} to {after}{unit} {when}, but may grow by at most {most}{unit}")
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_grows_by_itself_and_by_no_more_than_it_may() {
        let warm = MemoryThreadsAndHandles { memory_kb: 40_000, threads: 16, handles: 24 };
        assert_eq!(
            describe_growth_beyond_allowance(
                warm,
                MemoryThreadsAndHandles { memory_kb: 48_192, threads: 24, handles: 28 },
                "at the end"
            ),
            [""; 0]
        );
        for (later, name) in [
            (MemoryThreadsAndHandles { memory_kb: 48_193, ..warm }, "memory grew from 40000 kB to 48193 kB at the end"),
            (MemoryThreadsAndHandles { threads: 25, ..warm }, "threads grew"),
            (MemoryThreadsAndHandles { handles: 29, ..warm }, "handles grew"),
        ] {
            let found = describe_growth_beyond_allowance(warm, later, "at the end");
            assert!(found.len() == 1 && found[0].contains(name), "{found:?}");
        }
        assert_eq!(describe_growth_beyond_allowance(warm, MemoryThreadsAndHandles::default(), "at the end").len(), 1);
    }
}
