//! Names of bits.

/// Names of the set bits, in the order of the table.
pub(crate) fn set_names(raw: u32, table: &[(u8, &'static str)]) -> Vec<&'static str> {
    let is_set = |bit: u8| raw.checked_shr(bit.into()).is_some_and(|it| it & 1 == 1);
    table.iter().filter(|(bit, _)| is_set(*bit)).map(|(_, word)| *word).collect()
}
