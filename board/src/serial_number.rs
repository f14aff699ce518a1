//! The serial number of the USB device.

/// Length of a serial number.
pub const LENGTH: usize = 24;

/// The controller's unique number of 96 bits as hexadecimal digits, word by word, the highest digit
/// of each first.
#[must_use]
pub fn hexadecimal(unique: [u32; 3]) -> [u8; LENGTH] {
    core::array::from_fn(|i| {
        let digit = unique[i / 8] >> (28 - 4 * (i % 8)) & 0xF;
        b"0123456789ABCDEF"[digit as usize]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_word_comes_first_and_its_highest_digit() {
        let digits = hexadecimal([0x0123_4567, 0x89AB_CDEF, 0x0000_000A]);
        assert_eq!(&digits, b"0123456789ABCDEF0000000A");
    }
}
