//! A fuzzer's bytes as the numbers that break things, and as those that do not.

const ODD: [f64; 12] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::MAX,
    f64::MIN_POSITIVE,
    1e-300,
    1e12,
    -1e150,
];

/// Reads bytes from the front; zeros when they are used up.
pub struct Bytes<'a> {
    left: &'a [u8],
}

impl<'a> Bytes<'a> {
    /// All bytes.
    pub fn new(data: &'a [u8]) -> Self {
        Self { left: data }
    }

    /// Whether all were read.
    pub fn is_empty(&self) -> bool {
        self.left.is_empty()
    }

    /// The next one.
    pub fn byte(&mut self) -> u8 {
        match self.left {
            [first, rest @ ..] => {
                self.left = rest;
                *first
            }
            [] => 0,
        }
    }

    /// A number below `count`.
    pub fn below(&mut self, count: usize) -> usize {
        usize::from(self.byte()) % count.max(1)
    }

    /// Yes or no, no most of the time.
    pub fn rarely(&mut self) -> bool {
        self.byte() > 240
    }

    /// A number: of ordinary size mostly, any double or an odd one else.
    pub fn number(&mut self) -> f64 {
        match self.byte() {
            tag @ 0..=199 => {
                let whole = i16::from_le_bytes([self.byte(), self.byte()]);
                f64::from(whole) * [1e-4, 1e-3, 1e-2, 0.1][usize::from(tag) % 4]
            }
            200..=219 => f64::from_le_bytes(core::array::from_fn(|_| self.byte())),
            tag => ODD[usize::from(tag) % ODD.len()],
        }
    }

    /// Several of them.
    pub fn numbers<const N: usize>(&mut self) -> [f64; N] {
        core::array::from_fn(|_| self.number())
    }
}
