//! Threads that must not be late.

use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

/// Has the system prefer this thread: a board that hears nothing for a quarter of a second goes off. Where that is not allowed
/// it stays as it is; whether it is raised.
pub fn raise() -> bool {
    // The lowest of the real-time priorities is above everything that is not real-time.
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::RoundRobin);
    let lowest = ThreadPriorityValue::try_from(1_u8).map(ThreadPriority::Crossplatform);
    let raised = lowest
        .map_err(|_| ())
        .and_then(|priority| set_thread_priority_and_policy(thread_native_id(), priority, policy).map_err(|_| ()));
    if raised.is_err() {
        tracing::debug!("this thread has no raised priority; the limit for it is RLIMIT_RTPRIO");
    }
    raised.is_ok()
}

/// Whether a thread of this process can be: tried on one of its own, as limits are not all that decides (root needs none, a container may forbid it).
#[must_use]
pub fn can_be_raised() -> bool {
    let tried = std::thread::Builder::new().spawn(raise);
    tried.is_ok_and(|thread| thread.join().unwrap_or(false))
}
