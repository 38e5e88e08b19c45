//! The scheduling of the thread that runs the cycle.
use ecrt_sys::Errno;

/// musl has further fields, for a policy that is not used.
fn parameters(priority: u8) -> libc::sched_param {
    // SAFETY: all fields are numbers, or structures of numbers, for which zeros are valid.
    let mut parameters: libc::sched_param = unsafe { std::mem::zeroed() };
    parameters.sched_priority = libc::c_int::from(priority);
    parameters
}

/// Puts the calling thread under SCHED_FIFO with a priority of 1 (lowest) to 99; threads that it
/// starts later inherit it.
///
/// Concerns the calling thread alone. Not for the cycle.
///
/// # Errors
/// [`Errno::EPERM`] where that is not permitted, [`Errno::EINVAL`] for a priority out of range.
pub fn set_fifo_priority(priority: u8) -> Result<(), Errno> {
    let parameters = parameters(priority);
    // SAFETY: `pthread_self` always names a living thread, and `parameters` is valid for reading
    // and initialised as a whole.
    let fault =
        unsafe { libc::pthread_setschedparam(libc::pthread_self(), libc::SCHED_FIFO, &parameters) };
    if fault == 0 { Ok(()) } else { Err(Errno::new(fault)) }
}

/// Puts the calling thread under SCHED_OTHER, for threads that a real-time thread starts: they inherit its
/// scheduling. Returns whether it was real-time.
///
/// # Errors
/// The error of the system.
pub fn leave_real_time() -> Result<bool, Errno> {
    let (mut policy, mut parameters) = (0, parameters(0));
    // SAFETY: `pthread_self` always names a living thread; the pointers are valid for the calls.
    let fault = unsafe {
        match libc::pthread_getschedparam(libc::pthread_self(), &mut policy, &mut parameters) {
            0 if policy == libc::SCHED_OTHER => return Ok(false),
            0 => {
                parameters.sched_priority = 0;
                libc::pthread_setschedparam(libc::pthread_self(), libc::SCHED_OTHER, &parameters)
            }
            fault => fault,
        }
    };
    if fault == 0 { Ok(true) } else { Err(Errno::new(fault)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn priority_out_of_range_is_rejected() {
        assert_eq!(set_fifo_priority(0), Err(Errno::EINVAL));
        assert_eq!(set_fifo_priority(200), Err(Errno::EINVAL));
    }

    #[test]
    fn thread_of_a_real_time_thread_leaves_it() {
        let inner = || std::thread::spawn(leave_real_time).join().unwrap();
        let outer = move || set_fifo_priority(1).is_ok() == inner().unwrap();
        assert!(std::thread::spawn(outer).join().unwrap());
        assert_eq!(inner(), Ok(false));
    }
}
