//! Copies of frame data by their few possible lengths.

/// Copies `N` bytes as one block; false where either side is shorter.
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

/// Copies the whole of `from` to the start of `to`, or as much as fits.
///
/// Frame data nearly always has 8 or 64 bytes; a copy of fixed size costs a few instructions
/// where one of variable size is a call.
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

fn copy_other(to: &mut [u8], from: &[u8]) {
    let done = match from.len() {
        0 => true,
        1 => block::<1>(to, from),
        2 => block::<2>(to, from),
        3 => block::<3>(to, from),
        4 => block::<4>(to, from),
        5 => block::<5>(to, from),
        6 => block::<6>(to, from),
        7 => block::<7>(to, from),
        12 => block::<12>(to, from),
        16 => block::<16>(to, from),
        20 => block::<20>(to, from),
        24 => block::<24>(to, from),
        32 => block::<32>(to, from),
        48 => block::<48>(to, from),
        _ => false,
    };
    if !done {
        for (to, from) in to.iter_mut().zip(from) {
            *to = *from;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::copy_data;

    #[test]
    fn every_length_is_copied_and_no_more() {
        let from: [u8; 70] = core::array::from_fn(|i| i as u8 + 1);
        for length in 0..=70 {
            let mut to = [0; 72];
            copy_data(&mut to, &from[..length]);
            assert_eq!(&to[..length], &from[..length]);
            assert!(to[length..].iter().all(|&byte| byte == 0), "{length}");
        }
    }

    #[test]
    fn a_short_destination_takes_what_fits() {
        let mut to = [0; 5];
        copy_data(&mut to, &[1; 8]);
        assert_eq!(to, [1; 5]);
    }
}
