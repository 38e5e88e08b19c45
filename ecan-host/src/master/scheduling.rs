//! The scheduling of the thread that runs the cycle.
use ecrt_sys::Errno;

/// Puts the calling thread under SCHED_FIFO with a priority of 1 (lowest) to 99; threads that it
/// starts later inherit it.
///
/// Concerns the calling thread alone. Not for the cycle.
///
/// # Errors
/// [`Errno::EPERM`] where that is not permitted, [`Errno::EINVAL`] for a priority out of range.
pub fn set_fifo_priority(priority: u8) -> Result<(), Errno> {
    let parameters = libc::sched_param { sched_priority: libc::c_int::from(priority) };
    // SAFETY: `pthread_self` always names a living thread, and `parameters` is valid for reading
    // and initialised as a whole.
    let fault =
        unsafe { libc::pthread_setschedparam(libc::pthread_self(), libc::SCHED_FIFO, &parameters) };
    if fault == 0 { Ok(()) } else { Err(Errno::new(fault)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn priority_out_of_range_is_rejected() {
        assert_eq!(set_fifo_priority(0), Err(Errno::EINVAL));
        assert_eq!(set_fifo_priority(200), Err(Errno::EINVAL));
    }
}
