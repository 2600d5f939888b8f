//! Times and positions of joints, validated once.

use crate::error::{Error, Result};

/// Positions of J joints at N rising times.
///
/// ```
/// use mirror_core::joint_log::JointLog;
///
/// // Two joints at three times; a row is a time.
/// let log = JointLog::new(vec![0.0, 1.0, 2.0], vec![0.0, 1.0, 0.0, 1.0, 0.5, 1.0], 2)?;
/// assert_eq!(log.at(1.5).collect::<Vec<_>>(), [0.25, 1.0]);
/// # Ok::<(), mirror_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct JointLog {
    time_s: Vec<f64>,
    /// (N, J) in C order, rad (m).
    positions: Vec<f64>,
    joints: usize,
}

impl JointLog {
    /// A log of `time_s` (N,) and `positions` (N, J) in C order, rad (m).
    ///
    /// # Errors
    /// Fewer than two rows, no joint, another number of positions than N·J, a number that is not finite, times that do not rise.
    pub fn new(time_s: Vec<f64>, positions: Vec<f64>, joints: usize) -> Result<Self> {
        if time_s.len() < 2 {
            return Err(Error::TooFew {
                what: "rows of the joints' log".into(),
                got: time_s.len(),
                needed: 2,
            });
        }
        if joints == 0 {
            return Err(Error::TooFew { what: "joints of the log".into(), got: 0, needed: 1 });
        }
        if positions.len() != time_s.len() * joints {
            let what = "positions of the joints' log".into();
            return Err(Error::LengthMismatch { what, got: positions.len(), needed: time_s.len() * joints });
        }
        if let Some(&got) = time_s.iter().chain(&positions).find(|x| !x.is_finite()) {
            return Err(Error::NotFinite { what: "a time or a position of the joints' log".into(), got });
        }
        if let Some(pair) = time_s.windows(2).find(|pair| pair[1] <= pair[0]) {
            let needed = format!("later than {}, the time before it", pair[0]);
            return Err(Error::OutOfRange {
                what: "a time of the joints' log, s".into(),
                got: pair[1],
                needed,
            });
        }
        Ok(Self { time_s, positions, joints })
    }

    /// The times, s, rising; two or more.
    pub fn time_s(&self) -> &[f64] {
        &self.time_s
    }

    /// The positions of a row, one a joint, rad (m).
    pub fn row(&self, row: usize) -> &[f64] {
        &self.positions[row * self.joints..(row + 1) * self.joints]
    }

    /// The first and the last time, s.
    pub fn ends_s(&self) -> (f64, f64) {
        (self.time_s[0], self.time_s[self.time_s.len() - 1])
    }

    /// The positions at a time, linear between the rows, constant beyond the first and the last: one a joint, rad (m).
    pub fn at(&self, time_s: f64) -> impl Iterator<Item = f64> + '_ {
        let (row, share) = place(&self.time_s, time_s);
        self.row(row).iter().zip(self.row(row + 1)).map(move |(a, b)| a + share * (b - a))
    }

    /// How far the joint that moves farthest is from one time to another, rad (m).
    pub fn farthest(&self, from_s: f64, to_s: f64) -> f64 {
        self.at(from_s).zip(self.at(to_s)).map(|(a, b)| (b - a).abs()).fold(0.0, f64::max)
    }
}

/// Where a number lies among two or more that rise: the index of the one before it, not the last, and the share of the step to the
/// next, in [0, 1].
pub(super) fn place(rising: &[f64], x: f64) -> (usize, f64) {
    let before = rising.partition_point(|&at| at <= x).clamp(1, rising.len() - 1) - 1;
    let (low, high) = (rising[before], rising[before + 1]);
    (before, ((x - low) / (high - low)).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use crate::error::Result;
    use crate::joint_log::log::JointLog;

    #[test]
    fn positions_are_linear_between_rows_and_constant_beyond() -> Result<()> {
        let log = JointLog::new(vec![1.0, 2.0, 4.0], vec![0.0, 10.0, 2.0, 10.0, 3.0, 6.0], 2)?;
        for (time, expected) in [(0.0, [0.0, 10.0]), (1.5, [1.0, 10.0]), (3.0, [2.5, 8.0]), (9.0, [3.0, 6.0])]
        {
            assert_eq!(log.at(time).collect::<Vec<_>>(), expected, "at {time} s");
        }
        assert_eq!(log.farthest(1.0, 4.0), 4.0);
        Ok(())
    }

    #[test]
    fn a_log_that_is_none_is_refused() {
        let told = |time_s: &[f64], positions: &[f64], joints| {
            JointLog::new(time_s.to_vec(), positions.to_vec(), joints)
                .map_or_else(|e| e.to_string(), |_| String::new())
        };
        assert!(told(&[0.0], &[1.0], 1).contains("got 1, needed at least 2"));
        assert!(told(&[0.0, 1.0], &[], 0).contains("joints of the log"));
        assert!(told(&[0.0, 1.0], &[1.0], 1).contains("needed 2"));
        assert!(told(&[0.0, 1.0], &[1.0, f64::NAN], 1).contains("finite"));
        assert!(told(&[1.0, 1.0], &[1.0, 1.0], 1).contains("later than 1"));
    }
}
