//! The largest acceleration under each touch. The sensor is put under the finger when a touch begins; what it shows from then until the next one
//! begins is that touch's, however often and by whomever it is read.

use std::collections::VecDeque;

/// Touches whose peaks are kept: as many as the daemon keeps answers of.
const MOST_KEPT: usize = 256;

/// What the sensor has shown under one touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TouchPeak {
    /// The touch's number, which is its plan's.
    pub plan_id: u64,
    /// Largest magnitude in m/s^2 from its beginning until the next touch began, or until now.
    pub peak_m_per_s2: f64,
}

/// The last touches' peaks, in the order in which they began.
#[derive(Debug, Default)]
pub struct TouchPeaks {
    kept: VecDeque<TouchPeak>,
}

impl TouchPeaks {
    /// Peaks that are noted from here on belong to this touch; a touch that has been there before is continued.
    pub fn begin_touch_or_continue_kept_one(&mut self, plan_id: u64) {
        let known = self.kept.iter().position(|peak| peak.plan_id == plan_id).and_then(|place| self.kept.remove(place));
        self.kept.push_back(known.unwrap_or(TouchPeak { plan_id, peak_m_per_s2: 0.0 }));
        if self.kept.len() > MOST_KEPT {
            self.kept.pop_front();
        }
    }

    /// Notes an acceleration of the touch that began last.
    pub fn raise_peak_of_newest_touch(&mut self, peak_m_per_s2: f64) {
        if let Some(newest) = self.kept.back_mut() {
            newest.peak_m_per_s2 = newest.peak_m_per_s2.max(peak_m_per_s2);
        }
    }

    /// The peaks of the last `max_count` touches, the newest first.
    #[must_use]
    pub fn newest_peaks(&self, max_count: usize) -> Vec<TouchPeak> {
        self.kept.iter().rev().take(max_count).copied().collect()
    }

    /// The peak of one touch; `None` if the touch never began, or is not kept any more.
    #[must_use]
    pub fn find_peak_of_touch_if_kept(&self, plan_id: u64) -> Option<TouchPeak> {
        self.kept.iter().find(|peak| peak.plan_id == plan_id).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_touch_keeps_its_own_peak() {
        let mut peaks = TouchPeaks::default();
        peaks.raise_peak_of_newest_touch(9.0);
        assert_eq!(peaks.newest_peaks(5), [], "of no touch");
        peaks.begin_touch_or_continue_kept_one(1);
        peaks.raise_peak_of_newest_touch(3.0);
        peaks.raise_peak_of_newest_touch(2.0);
        peaks.begin_touch_or_continue_kept_one(2);
        peaks.raise_peak_of_newest_touch(1.0);
        let of = |peaks: &TouchPeaks, id| peaks.find_peak_of_touch_if_kept(id).map(|peak| peak.peak_m_per_s2);
        assert_eq!((of(&peaks, 1), of(&peaks, 2), of(&peaks, 3)), (Some(3.0), Some(1.0), None));
        // A touch of several stretches, or one whose successor was refused, goes on.
        peaks.begin_touch_or_continue_kept_one(1);
        peaks.raise_peak_of_newest_touch(2.5);
        assert_eq!(of(&peaks, 1), Some(3.0));
        assert_eq!(peaks.newest_peaks(1)[0].plan_id, 1);
        for id in 10..1000 {
            peaks.begin_touch_or_continue_kept_one(id);
        }
        assert_eq!((peaks.newest_peaks(usize::MAX).len(), of(&peaks, 1)), (MOST_KEPT, None));
    }
}
