//! Threads that must not be late.

#[cfg(target_os = "linux")]
use thread_priority::NormalThreadSchedulePolicy;
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

/// Of 0 to 99 the priority whose niceness is 10: a tenth of the time that a thread without one gets where both want all of it.
#[cfg(target_os = "linux")]
const LOW: u8 = 22;

/// Raises this thread's priority, because a board that hears nothing for a quarter of a second goes off. Where that is not allowed the
/// priority stays as it is. Returns whether it is raised.
pub fn raise_thread_priority() -> bool {
    // The lowest of the real-time priorities is above everything that is not real-time.
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::RoundRobin);
    let lowest = ThreadPriorityValue::try_from(1_u8).map(ThreadPriority::Crossplatform);
    let raised = lowest
        .map_err(|_| ())
        .and_then(|priority| set_thread_priority_and_policy(thread_native_id(), priority, policy).map_err(|_| ()));
    if raised.is_err() {
        tracing::debug!("the priority of this thread could not be raised; RLIMIT_RTPRIO limits the priority");
    }
    raised.is_ok()
}

/// Whether this process may raise a thread's priority. It is tried with a thread of its own, as more than limits decides (root needs none, a container may
/// forbid it).
#[must_use]
pub fn can_raise_thread_priority() -> bool {
    let tried = std::thread::Builder::new().spawn(raise_thread_priority);
    tried.is_ok_and(|thread| thread.join().unwrap_or(false))
}

/// Lowers this thread's priority below all others, because what it does may be late. Where the system cannot do that the priority stays as it is.
pub fn lower_thread_priority_below_normal() {
    #[cfg(target_os = "linux")]
    {
        let policy = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Other);
        let low = ThreadPriorityValue::try_from(LOW).map(ThreadPriority::Crossplatform);
        let lowered = low
            .map_err(|_| ())
            .and_then(|low| set_thread_priority_and_policy(thread_native_id(), low, policy).map_err(|_| ()));
        if lowered.is_err() {
            tracing::debug!("the priority of this thread could not be lowered");
        }
    }
}
