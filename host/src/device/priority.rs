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

/// Has the system prefer every other thread to this one: what it does may be late. Where the system has no such thing it stays as it is.
pub fn lower() {
    #[cfg(target_os = "linux")]
    {
        let policy = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Other);
        let low = ThreadPriorityValue::try_from(LOW).map(ThreadPriority::Crossplatform);
        let lowered = low
            .map_err(|_| ())
            .and_then(|low| set_thread_priority_and_policy(thread_native_id(), low, policy).map_err(|_| ()));
        if lowered.is_err() {
            tracing::debug!("this thread has no lower priority");
        }
    }
}
