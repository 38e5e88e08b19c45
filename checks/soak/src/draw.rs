//! Random choices.

use fastrand::Rng;

/// True in `percent` of 100 cases.
pub fn chance(r: &mut Rng, percent: u32) -> bool {
    r.u32(..100) < percent
}

pub fn pick<T: Copy>(r: &mut Rng, choices: &[T]) -> T {
    choices[r.usize(..choices.len())]
}

/// One of the choices, each as often as its weight.
pub fn weighted<T: Copy>(r: &mut Rng, choices: &[(u32, T)]) -> T {
    let total: u32 = choices.iter().map(|(weight, _)| weight).sum();
    let mut at = r.u32(..total);
    for (weight, choice) in choices {
        match at.checked_sub(*weight) {
            Some(rest) => at = rest,
            None => return *choice,
        }
    }
    choices[0].1
}
