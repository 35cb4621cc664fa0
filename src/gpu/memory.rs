//! Memory use of buffers and images, by name.

use std::collections::BTreeMap;

/// Bytes of the buffers of one name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MemoryUse {
    /// Current bytes.
    pub bytes: u64,
    /// Bytes at the peak of all buffers together.
    pub peak_bytes: u64,
}

/// Bytes of the current allocations and their peaks.
#[derive(Debug, Default)]
pub(super) struct MemoryTracker {
    by_name: BTreeMap<String, MemoryUse>,
    /// Current bytes.
    pub(super) bytes: u64,
    /// Maximum of `bytes`.
    pub(super) peak_bytes: u64,
    /// Maximum bytes of the allocator's blocks.
    pub(super) reserved_peak_bytes: u64,
}

impl MemoryTracker {
    /// Adds an allocation; `reserved`: current bytes of the allocator's blocks.
    pub(super) fn take(&mut self, name: &str, bytes: u64, reserved: u64) {
        self.by_name.entry(name.to_owned()).or_default().bytes += bytes;
        self.bytes += bytes;
        self.reserved_peak_bytes = self.reserved_peak_bytes.max(reserved);
        if self.bytes > self.peak_bytes {
            self.mark_peak();
        }
    }

    /// Removes an allocation.
    pub(super) fn give(&mut self, name: &str, bytes: u64) {
        if let Some(entry) = self.by_name.get_mut(name) {
            entry.bytes -= bytes;
        }
        self.bytes -= bytes;
    }

    /// Resets the peaks to the current values.
    pub(super) fn reset_peak(&mut self, reserved: u64) {
        self.reserved_peak_bytes = reserved;
        self.mark_peak();
        self.by_name.retain(|_, entry| entry.bytes > 0);
    }

    fn mark_peak(&mut self) {
        self.peak_bytes = self.bytes;
        for entry in self.by_name.values_mut() {
            entry.peak_bytes = entry.bytes;
        }
    }

    /// Memory of each name with bytes now or at the peak.
    pub(super) fn by_name(&self) -> Vec<(String, MemoryUse)> {
        let entries = self.by_name.iter();
        entries
            .filter(|(_, entry)| entry.bytes.max(entry.peak_bytes) > 0)
            .map(|(name, entry)| (name.clone(), *entry))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_peak_is_divided_among_names_as_it_was() {
        let mut tracker = MemoryTracker::default();
        tracker.take("a", 10, 16);
        tracker.take("b", 5, 16);
        tracker.give("a", 10);
        tracker.take("b", 4, 32);
        tracker.give("b", 5);
        let [a, b] = [(0, 10), (4, 5)].map(|(bytes, peak_bytes)| MemoryUse { bytes, peak_bytes });
        assert_eq!(tracker.by_name(), [("a".into(), a), ("b".into(), b)]);
        let totals = (tracker.bytes, tracker.peak_bytes, tracker.reserved_peak_bytes);
        assert_eq!(totals, (4, 15, 32));
        tracker.reset_peak(16);
        let b = MemoryUse {
            bytes: 4,
            peak_bytes: 4,
        };
        assert_eq!(tracker.by_name(), [("b".into(), b)]);
        let totals = (tracker.bytes, tracker.peak_bytes, tracker.reserved_peak_bytes);
        assert_eq!(totals, (4, 4, 16));
    }
}
