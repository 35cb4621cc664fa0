//! Processor time of this process.

use std::time::Duration;

/// A point in the processor time of all threads of the process, in user and system mode.
#[derive(Clone, Copy, Debug)]
pub struct CpuClock(Option<Duration>);

impl CpuClock {
    /// Now.
    pub fn now() -> CpuClock {
        CpuClock(spent())
    }

    /// Nanoseconds of processor time since; `None` if the system does not report it.
    pub fn elapsed_ns(&self) -> Option<f64> {
        let (before, now) = (self.0?, spent()?);
        Some(now.saturating_sub(before).as_nanos() as f64)
    }
}

#[cfg(unix)]
fn spent() -> Option<Duration> {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    let (seconds, nanoseconds) = (u64::try_from(time.tv_sec).ok()?, u32::try_from(time.tv_nsec).ok()?);
    Some(Duration::new(seconds, nanoseconds))
}

#[cfg(not(unix))]
fn spent() -> Option<Duration> {
    None
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn work_takes_time() {
        let clock = CpuClock::now();
        let mut sum = 0u64;
        while clock.elapsed_ns().is_some_and(|ns| ns < 1e6) {
            sum = std::hint::black_box(sum + 1);
        }
        assert!(sum > 0, "a millisecond passed without any work");
    }
}
