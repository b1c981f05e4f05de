//! Numbers of some bits each, the highest bit first.

/// Reads bits one after the other.
#[derive(Clone, Debug)]
pub struct BitReader<'a> {
    bytes: &'a [u8],
    next: usize,
}

impl<'a> BitReader<'a> {
    /// From the first bit on.
    #[must_use]
    pub const fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, next: 0 }
    }

    /// A number of up to 32 bits; `None` beyond the end.
    pub fn read_bits(&mut self, count: usize) -> Option<u32> {
        let end = self.next.checked_add(count)?;
        if end > self.bytes.len() * 8 {
            return None;
        }
        let mut value = 0_u32;
        for bit in self.next..end {
            let byte = self.bytes.get(bit / 8)?;
            value = value << 1 | u32::from(byte >> (7 - bit % 8) & 1);
        }
        self.next = end;
        Some(value)
    }

    /// A number with a sign, as the complement of two.
    pub fn read_signed_bits(&mut self, count: usize) -> Option<i64> {
        let value = i64::from(self.read_bits(count)?);
        let half = 1_i64 << (count - 1);
        Some(if value >= half { value - 2 * half } else { value })
    }

    /// A number that stands for one from `min` to `max`.
    pub fn read_fraction(&mut self, count: usize, (min, max): (f64, f64)) -> Option<f64> {
        let most = (2.0_f64).powi(i32::try_from(count).ok()?) - 1.0;
        Some(min + (max - min) * f64::from(self.read_bits(count)?) / most)
    }

    /// Passes over bits.
    pub fn skip_bits(&mut self, count: usize) -> Option<()> {
        let end = self.next.checked_add(count)?;
        (end <= self.bytes.len() * 8).then(|| self.next = end)
    }

    /// Passes over a text: its length in bytes, and the bytes.
    pub fn skip_text(&mut self) -> Option<()> {
        let length = self.read_bits(8)?;
        self.skip_bits(8 * usize::try_from(length).ok()?)
    }

    /// The next whole bytes; the reader must be at the begin of one.
    pub fn take_bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let begin = self.next.is_multiple_of(8).then_some(self.next / 8)?;
        let taken = self.bytes.get(begin..begin.checked_add(count)?)?;
        self.next += 8 * count;
        Some(taken)
    }

    /// Whether all has been read.
    #[must_use]
    pub const fn is_at_end(&self) -> bool {
        self.next >= self.bytes.len() * 8
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_read_from_the_highest_on() {
        let mut bits = BitReader::new(&[0b1010_0110, 0xff, 2, b'a', b'b']);
        assert_eq!((bits.read_bits(3), bits.read_signed_bits(5)), (Some(5), Some(6)));
        assert_eq!(bits.clone().read_signed_bits(8), Some(-1));
        assert_eq!(bits.read_fraction(8, (-1.0, 1.0)), Some(1.0));
        assert_eq!((bits.skip_text(), bits.is_at_end(), bits.read_bits(1)), (Some(()), true, None));
    }
}
