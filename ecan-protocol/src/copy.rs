//! Copies of frame data, optimised for the lengths of CAN frames.

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
    use super::copy_data;

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
    fn short_destination_gets_what_fits() {
        let mut to = [0; 5];
        copy_data(&mut to, &[1; 8]);
        assert_eq!(to, [1; 5]);
    }
}
