//! How much memory a piece of work takes, by the resident size that Linux tells.

use std::fs;

/// What a piece of work took.
pub struct Taken {
    /// Largest resident size during the work, less that before it.
    pub peak_bytes: u64,
}

/// The memory that `work` takes beside what is there already; none where the system does not tell.
pub fn taken_by<T>(work: impl FnOnce() -> T) -> Option<Taken> {
    // 5 sets the high-water mark back to the present size (man 5 proc).
    fs::write("/proc/self/clear_refs", "5").ok()?;
    let before = status_bytes("VmRSS:")?;
    let result = work();
    let peak = status_bytes("VmHWM:")?;
    drop(result);
    Some(Taken { peak_bytes: peak.saturating_sub(before) })
}

fn status_bytes(key: &str) -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with(key))?;
    let kilobytes: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(1024 * kilobytes)
}
