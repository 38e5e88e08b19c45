//! Copies of frame data, optimised for the lengths of CAN frames.

use core::hint::select_unpredictable;

/// Copies `N` bytes as one block; false if either side is shorter.
#[inline(always)]
fn block<const N: usize>(to: &mut [u8], from: &[u8]) -> bool {
    match (to.first_chunk_mut::<N>(), from.first_chunk::<N>()) {
        (Some(to), Some(from)) => {
            *to = *from;
            true
        }
        _ => false,
    }
}

/// Copies `from` to the start of `to`, or the part that fits.
///
/// Frame data nearly always has 8 or 64 bytes; a copy of fixed size is a few instructions, one of
/// variable size is a call.
#[inline(always)]
pub(crate) fn copy_data(to: &mut [u8], from: &[u8]) {
    let done = match from.len() {
        8 => block::<8>(to, from),
        64 => block::<64>(to, from),
        _ => {
            copy_other(to, from);
            true
        }
    };
    if !done {
        copy_other(to, from);
    }
}

/// Copies `from`, at most 64 bytes, to the start of `to`, and may set up to eight bytes after it to zero.
///
/// With few branches, for data whose length cannot be predicted.
#[inline(always)]
pub(crate) fn copy_over(to: &mut [u8], from: &[u8]) {
    if from.len() >= 16 {
        for block in 0..4 {
            copy_block::<16>(to, from, block * 16);
        }
    } else if from.len() >= 8 {
        copy_block::<8>(to, from, 0);
        copy_block::<8>(to, from, 8);
    } else if let Some(to) = to.first_chunk_mut() {
        *to = short_word(from).to_le_bytes();
    }
}

/// Copies `N` bytes at `at`, or the last `N` bytes of `from` if it ends before.
#[inline(always)]
fn copy_block<const N: usize>(to: &mut [u8], from: &[u8], at: usize) {
    let at = at.min(from.len().saturating_sub(N));
    let to = to.get_mut(at..).and_then(<[u8]>::first_chunk_mut::<N>);
    if let (Some(to), Some(from)) = (to, from.get(at..).and_then(<[u8]>::first_chunk::<N>)) {
        *to = *from;
    }
}

/// Up to seven bytes as a little-endian word.
#[inline(always)]
fn short_word(from: &[u8]) -> u64 {
    let length = from.len();
    let four =
        select_unpredictable(length & 4 != 0, from.first_chunk().unwrap_or(&[0; 4]), &[0; 4]);
    let two = from.get(length & 4..).and_then(<[u8]>::first_chunk);
    let two = select_unpredictable(length & 2 != 0, two.unwrap_or(&[0; 2]), &[0; 2]);
    let one = select_unpredictable(length & 1 != 0, from.last().unwrap_or(&0), &0);
    u64::from(u32::from_le_bytes(*four))
        | u64::from(u16::from_le_bytes(*two)) << (8 * (length & 4))
        | u64::from(*one) << (8 * (length & 6))
}

/// Writes `bytes` to the start of `to` and returns the rest.
#[inline(always)]
pub(crate) fn put<const N: usize>(to: &mut [u8], bytes: [u8; N]) -> &mut [u8] {
    match to.split_first_chunk_mut::<N>() {
        Some((first, rest)) => {
            *first = bytes;
            rest
        }
        // infallible: callers have room for what they write
        None => &mut [],
    }
}

/// Copies `from`, of `N` to `2 * N` bytes, as two blocks that may overlap.
#[inline(always)]
fn both_ends<const N: usize>(to: &mut [u8], from: &[u8]) {
    if let (Some(to), Some(from)) = (to.first_chunk_mut::<N>(), from.first_chunk::<N>()) {
        *to = *from;
    }
    if let (Some(to), Some(from)) = (to.last_chunk_mut::<N>(), from.last_chunk::<N>()) {
        *to = *from;
    }
}

/// Few cases, so that random lengths do not cause a branch misprediction at every frame.
fn copy_other(to: &mut [u8], from: &[u8]) {
    let length = to.len().min(from.len());
    let (Some(to), Some(from)) = (to.get_mut(..length), from.get(..length)) else { return };
    if length >= 8 {
        if length <= 16 {
            both_ends::<8>(to, from);
        } else if length <= 32 {
            both_ends::<16>(to, from);
        } else if length <= 64 {
            both_ends::<32>(to, from);
        } else {
            to.copy_from_slice(from);
        }
    } else if length >= 4 {
        both_ends::<4>(to, from);
    } else if length >= 2 {
        both_ends::<2>(to, from);
    } else {
        both_ends::<1>(to, from);
    }
}

#[cfg(test)]
mod tests {
    use super::{copy_data, copy_over};

    #[test]
    fn every_length_is_copied_exactly() {
        let from: [u8; 70] = core::array::from_fn(|i| i as u8 + 1);
        for length in 0..=70 {
            let mut to = [0; 72];
            copy_data(&mut to, &from[..length]);
            assert_eq!(&to[..length], &from[..length]);
            assert!(to[length..].iter().all(|&byte| byte == 0), "{length}");
        }
    }

    #[test]
    fn copy_over_sets_at_most_eight_bytes_to_zero() {
        let from: [u8; 64] = core::array::from_fn(|i| i as u8 + 1);
        for length in 0..=64 {
            let mut to = [0xFF; 72];
            copy_over(&mut to, &from[..length]);
            assert_eq!(&to[..length], &from[..length]);
            let kept = to[length..].iter().filter(|&&byte| byte == 0xFF).count();
            let zeros = to[length..].iter().filter(|&&byte| byte == 0).count();
            assert_eq!(kept + zeros, 72 - length, "{length}");
            assert!(zeros <= 8 && to[length + zeros..].iter().all(|&byte| byte == 0xFF));
        }
    }

    #[test]
    fn short_destination_gets_what_fits() {
        let mut to = [0; 5];
        copy_data(&mut to, &[1; 8]);
        assert_eq!(to, [1; 5]);
    }
}
