//! Objects of the axes of a drive (CiA 402-1: logical devices).

/// Most axes of a node.
pub(super) const MOST_AXES: usize = 8;

/// Objects of the first axis; those of the others follow at this distance.
const FIRST_OBJECTS: u16 = 0x6000;
const OBJECTS: u16 = 0x800;

/// Splits the index of an object of the profile into the axis and the index for the first axis; other
/// objects belong to the first axis.
pub(super) const fn split_index(index: u16) -> (usize, u16) {
    match index.checked_sub(FIRST_OBJECTS) {
        Some(offset) if (offset / OBJECTS) < MOST_AXES as u16 => {
            ((offset / OBJECTS) as usize, FIRST_OBJECTS + offset % OBJECTS)
        }
        _ => (0, index),
    }
}

/// Index of an object of an axis, by that of the first one.
pub(super) const fn axis_index(axis: usize, index: u16) -> u16 {
    if index >= FIRST_OBJECTS && index - FIRST_OBJECTS < OBJECTS {
        index + axis as u16 * OBJECTS
    } else {
        index
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_of_an_axis_are_at_their_distance() {
        assert_eq!(axis_index(0, 0x6040), 0x6040);
        assert_eq!(axis_index(1, 0x6040), 0x6840);
        assert_eq!(axis_index(7, 0x67FF), 0x9FFF);
        assert_eq!(axis_index(3, 0x1017), 0x1017);
        assert_eq!(axis_index(1, 0x6800), 0x6800, "already of the second axis");
        for (index, expected) in [
            (0x6040, (0, 0x6040)),
            (0x6840, (1, 0x6040)),
            (0x9FFF, (7, 0x67FF)),
            (0xA000, (0, 0xA000)),
            (0x2000, (0, 0x2000)),
        ] {
            assert_eq!(split_index(index), expected);
        }
    }
}
