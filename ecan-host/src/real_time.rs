//! Privileges of the thread that runs the cycle: scheduling, affinity, locked memory (manual 13.9 and
//! 15.5.2, step 7).

use std::fmt;
use std::fs::{File, OpenOptions};
use std::hint::black_box;
use std::io::Write;
use std::sync::{Mutex, PoisonError};

use ecrt_sys::Errno;
use nix::sched::{CpuSet, sched_getaffinity, sched_setaffinity};
use nix::sys::mman::{MlockAllFlags, mlockall};
use nix::sys::resource::{RLIM_INFINITY, Resource, getrlimit};
use nix::unistd::Pid;
use thiserror::Error;

use crate::config::Faults;
use crate::cycle_timing::{CycleTiming, MAX_SPIN_NS};
use crate::master::set_fifo_priority;

/// Most of the stack that settings may ask to have touched in advance, in bytes: half of what Rust
/// gives a thread.
pub const MAX_STACK_PREFAULT_BYTES: usize = 1024 * 1024;

/// Need of a privilege.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Need {
    /// Without it the application continues; the report states that.
    #[default]
    Optional,
    /// Without it [`RealTimeConfig::apply`] fails.
    Required,
}

/// One fault of a [`RealTimeConfig`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum RealTimeFault {
    /// A priority that SCHED_FIFO does not have.
    #[error("real-time priority {priority} is outside 1..99")]
    Priority {
        /// The configured priority.
        priority: u8,
    },
    /// An affinity without a processor.
    #[error("the CPU affinity names no CPU")]
    NoCpus,
    /// More stack than a thread is sure to have.
    #[error("stack prefault of {bytes} bytes is above {MAX_STACK_PREFAULT_BYTES}")]
    StackPrefault {
        /// The configured bytes.
        bytes: usize,
    },
    /// A final spin that only burns the processor.
    #[error("final spin of {spin_ns} ns is above {MAX_SPIN_NS} ns")]
    Spin {
        /// The configured spin, in nanoseconds.
        spin_ns: u64,
    },
}

/// Privileges of the cycle thread (manual 15.5.2, step 7), and the timing of its waits.
///
/// The default requests no privilege.
///
/// ```
/// use ecan_host::{CycleTiming, Need, RealTimeConfig};
///
/// let settings = RealTimeConfig {
///     priority: Some(80),
///     cpus: Some(vec![0]),
///     timing: CycleTiming { spin_ns: 100_000, ..CycleTiming::default() },
///     ..RealTimeConfig::default()
/// };
/// settings.check()?;
/// assert_eq!(settings.priority_need, Need::Optional);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RealTimeConfig {
    /// SCHED_FIFO with this priority, 1 (lowest) to 99; none leaves the scheduling as it is.
    pub priority: Option<u8>,
    /// Need of the priority.
    pub priority_need: Need,
    /// CPUs that the thread may run on, counted from 0; none leaves the affinity as it is.
    pub cpus: Option<Vec<usize>>,
    /// Need of the affinity.
    pub cpus_need: Need,
    /// Keeps all memory of the process in RAM, present and future, and touches this number of bytes of
    /// the thread's stack in advance, 0 to [`MAX_STACK_PREFAULT_BYTES`]; none locks nothing.
    ///
    /// If RLIMIT_MEMLOCK bounds what may be locked, it bounds what the process can allocate
    /// from then on.
    pub lock_memory: Option<usize>,
    /// Need of locked memory.
    pub lock_memory_need: Need,
    /// Keeps the processors of the machine out of sleep states that take longer than this time
    /// to leave, in microseconds, for as long as the process lives; 0 allows none. It costs power.
    pub wake_up_latency_us: Option<u32>,
    /// Need of the latency.
    pub wake_up_latency_need: Need,
    /// Timing of the wait for the next cycle, for
    /// [`Adapter::set_cycle_timing`](crate::Adapter::set_cycle_timing) or a
    /// [`CycleTimer`](crate::CycleTimer). [`apply`](Self::apply) only checks it.
    pub timing: CycleTiming,
}

impl RealTimeConfig {
    /// Checks the values, without a request to the system.
    ///
    /// # Errors
    /// Every fault found.
    pub fn check(&self) -> Result<(), Faults<RealTimeFault>> {
        let mut faults = Vec::new();
        if let Some(priority) = self.priority.filter(|p| !(1..=99).contains(p)) {
            faults.push(RealTimeFault::Priority { priority });
        }
        if self.cpus.as_ref().is_some_and(Vec::is_empty) {
            faults.push(RealTimeFault::NoCpus);
        }
        if let Some(bytes) = self.lock_memory.filter(|bytes| *bytes > MAX_STACK_PREFAULT_BYTES) {
            faults.push(RealTimeFault::StackPrefault { bytes });
        }
        let spin_ns = self.timing.spin_ns;
        if spin_ns > MAX_SPIN_NS {
            faults.push(RealTimeFault::Spin { spin_ns });
        }
        Faults::check(faults)
    }
}

/// A privilege that a real-time thread requests from the system.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Privilege {
    /// All memory in RAM, with the stack touched in advance.
    LockedMemory {
        /// Bytes of stack.
        stack_bytes: usize,
    },
    /// Execution on these CPUs only.
    Affinity {
        /// The CPUs, counted from 0.
        cpus: Vec<usize>,
    },
    /// No sleep state of a processor that takes longer to leave.
    WakeUpLatency {
        /// In microseconds.
        latency_us: u32,
    },
    /// SCHED_FIFO.
    Priority {
        /// Priority of the thread, 1 to 99.
        priority: u8,
    },
}

impl fmt::Display for Privilege {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::LockedMemory { stack_bytes } => {
                write!(f, "locked memory with {stack_bytes} bytes of stack")
            }
            Self::Affinity { cpus } => {
                let noun = if cpus.len() == 1 { "CPU" } else { "CPUs" };
                write!(f, "{noun} {}", join(cpus, ", "))
            }
            Self::WakeUpLatency { latency_us } => {
                write!(f, "processors that wake up within {latency_us} us")
            }
            Self::Priority { priority } => write!(f, "SCHED_FIFO priority {priority}"),
        }
    }
}

/// The texts of the items, with a separator between them.
pub(crate) fn join<T: fmt::Display>(items: impl IntoIterator<Item = T>, separator: &str) -> String {
    let texts: Vec<String> = items.into_iter().map(|item| item.to_string()).collect();
    texts.join(separator)
}

/// Error of a privilege that was not granted.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{cause}; {remedy}")]
pub struct PrivilegeError {
    /// Cause.
    pub cause: String,
    /// Remedy.
    pub remedy: String,
}

/// Result of one requested privilege.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PrivilegeOutcome {
    /// Requested privilege.
    pub privilege: Privilege,
    /// Need of the privilege.
    pub need: Need,
    /// Error; `None` if it was granted.
    pub denial: Option<PrivilegeError>,
}

impl PrivilegeOutcome {
    /// Returns whether it was granted.
    pub fn is_granted(&self) -> bool {
        self.denial.is_none()
    }
}

impl fmt::Display for PrivilegeOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.denial {
            None => write!(f, "{}: done", self.privilege),
            Some(denial) => write!(f, "{}: not granted, {denial}", self.privilege),
        }
    }
}

/// Result of every requested privilege, in the order of application. Displays a line for each.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RealTimeReport {
    /// Requested privileges only.
    pub outcomes: Vec<PrivilegeOutcome>,
}

impl RealTimeReport {
    /// Returns whether every requested privilege was granted.
    pub fn is_complete(&self) -> bool {
        self.outcomes.iter().all(PrivilegeOutcome::is_granted)
    }

    /// Returns whether everything required was granted.
    pub fn is_sufficient(&self) -> bool {
        self.missing().next().is_none()
    }

    fn missing(&self) -> impl Iterator<Item = &PrivilegeOutcome> {
        self.outcomes.iter().filter(|o| !o.is_granted() && o.need == Need::Required)
    }
}

impl fmt::Display for RealTimeReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&join(&self.outcomes, "\n"))
    }
}

/// Error of [`RealTimeConfig::apply`](crate::RealTimeConfig::apply).
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum RealTimeError {
    /// The values are faulty; nothing was applied.
    #[error("real-time settings: {0}")]
    Settings(#[from] Faults<RealTimeFault>),
    /// A required privilege was not granted. The report contains all results.
    #[error("no real-time thread: {}", join(.0.missing(), "\n"))]
    Missing(RealTimeReport),
}

/// The calling thread, in calls that take a thread id.
const THIS_THREAD: Pid = Pid::from_raw(0);
const PAGE_BYTES: usize = 4096;

impl RealTimeConfig {
    /// Applies them to the calling thread, locked memory to its whole process, the latency of
    /// waking up to the machine, and reports what was granted.
    ///
    /// To be called once by the thread of the cycle, before the cycle and after threads were
    /// started that shall not inherit priority and affinity. Not real-time safe.
    ///
    /// # Errors
    /// [`RealTimeError::Settings`] for faulty values, with nothing applied;
    /// [`RealTimeError::Missing`] where a required privilege was not granted, with the report. What
    /// was granted stays in force.
    pub fn apply(&self) -> Result<RealTimeReport, RealTimeError> {
        self.check()?;
        let mut outcomes = Vec::new();
        if let Some(stack_bytes) = self.lock_memory {
            outcomes.push(lock_memory(stack_bytes, self.lock_memory_need));
        }
        if let Some(cpus) = &self.cpus {
            outcomes.push(bind_to_cpus(cpus, self.cpus_need));
        }
        if let Some(latency_us) = self.wake_up_latency_us {
            outcomes.push(limit_wake_up(latency_us, self.wake_up_latency_need));
        }
        // Last, so that the preparation is not done at a priority above everything else.
        if let Some(priority) = self.priority {
            outcomes.push(raise_priority(priority, self.priority_need));
        }
        let report = RealTimeReport { outcomes };
        if report.is_sufficient() { Ok(report) } else { Err(RealTimeError::Missing(report)) }
    }
}

/// Locks all memory of the process and touches the thread's stack.
fn lock_memory(stack_bytes: usize, need: Need) -> PrivilegeOutcome {
    let locked = mlockall(MlockAllFlags::MCL_CURRENT | MlockAllFlags::MCL_FUTURE);
    // Not locked, the stack is at least there before the cycle needs it.
    touch_stack(stack_bytes);
    let denial =
        locked.err().map(|errno| memory_denial(errno, soft_limit(Resource::RLIMIT_MEMLOCK)));
    PrivilegeOutcome { privilege: Privilege::LockedMemory { stack_bytes }, need, denial }
}

fn memory_denial(errno: nix::errno::Errno, limit_bytes: Option<u64>) -> PrivilegeError {
    let errno = Errno::new(errno as i32);
    let limit = match limit_bytes {
        Some(bytes) => format!("RLIMIT_MEMLOCK is {} KiB", bytes / 1024),
        None => "RLIMIT_MEMLOCK is not what bounds it".into(),
    };
    let remedy = "run as root, give the program CAP_IPC_LOCK (setcap cap_ipc_lock+ep PROGRAM) or \
                  raise RLIMIT_MEMLOCK (memlock in /etc/security/limits.conf, LimitMEMLOCK= of a \
                  systemd service); a container needs it from its host";
    PrivilegeError { cause: format!("{errno}, {limit}"), remedy: remedy.into() }
}

/// Writes to this number of bytes of the stack below the caller.
#[inline(never)]
fn touch_stack(bytes: usize) {
    let mut page = [0_u8; PAGE_BYTES];
    black_box(&mut page);
    if bytes > PAGE_BYTES {
        touch_stack(bytes - PAGE_BYTES);
        // Work after the call keeps it from becoming a loop over one page.
        black_box(&mut page);
    }
}

fn bind_to_cpus(cpus: &[usize], need: Need) -> PrivilegeOutcome {
    let privilege = Privilege::Affinity { cpus: cpus.to_vec() };
    PrivilegeOutcome { privilege, need, denial: try_bind_to_cpus(cpus).err() }
}

fn try_bind_to_cpus(cpus: &[usize]) -> Result<(), PrivilegeError> {
    let mut set = CpuSet::new();
    // The system's set cannot hold CPUs above its size.
    let beyond: Vec<usize> = cpus.iter().copied().filter(|cpu| set.set(*cpu).is_err()).collect();
    let before = sched_getaffinity(THIS_THREAD).map_err(|errno| affinity_denial(errno, cpus))?;
    if !beyond.is_empty() {
        return Err(absent_cpus(&beyond, cpus.len(), &before));
    }
    match sched_setaffinity(THIS_THREAD, &set) {
        Ok(()) => {}
        Err(nix::errno::Errno::EINVAL) => return Err(absent_cpus(cpus, cpus.len(), &before)),
        Err(errno) => return Err(affinity_denial(errno, cpus)),
    }
    // The system leaves out without a word what is not there, as long as one CPU is.
    let now = sched_getaffinity(THIS_THREAD).map_err(|errno| affinity_denial(errno, cpus))?;
    let absent: Vec<usize> =
        cpus.iter().copied().filter(|cpu| !now.is_set(*cpu).unwrap_or(false)).collect();
    if absent.is_empty() {
        return Ok(());
    }
    // An incomplete affinity is restored to the previous one, which was possible before.
    let _ = sched_setaffinity(THIS_THREAD, &before);
    Err(absent_cpus(&absent, cpus.len(), &before))
}

/// The error names the absent CPUs, unless they are all that were requested, which the privilege names.
fn absent_cpus(cpus: &[usize], requested: usize, usable: &CpuSet) -> PrivilegeError {
    let there: Vec<usize> =
        (0..CpuSet::count()).filter(|cpu| usable.is_set(*cpu).unwrap_or(false)).collect();
    let subject = match cpus {
        [_] if requested == 1 => "the CPU is".to_owned(),
        [only] => format!("CPU {only} is"),
        several => format!("CPUs {} are", join(several, ", ")),
    };
    PrivilegeError {
        cause: format!("{subject} not there, off line or kept from this process"),
        remedy: format!(
            "this thread could use {}; /sys/devices/system/cpu/online lists those of the machine, \
             and the process's cpuset (its container or systemd's AllowedCPUs=) must include them",
            join(&there, ", ")
        ),
    }
}

fn affinity_denial(errno: nix::errno::Errno, cpus: &[usize]) -> PrivilegeError {
    PrivilegeError {
        cause: format!("{} for CPU {}", Errno::new(errno as i32), join(cpus, ", ")),
        remedy: "the sandbox or container that the process runs in must permit \
                 sched_setaffinity"
            .into(),
    }
}

/// The kernel's device for a limit of the processors' sleep states, active while it is open.
const WAKE_UP_DEVICE: &str = "/dev/cpu_dma_latency";
static WAKE_UP_LIMIT: Mutex<Option<File>> = Mutex::new(None);

/// Keeps the processors out of sleep states that take longer to leave.
fn limit_wake_up(latency_us: u32, need: Need) -> PrivilegeOutcome {
    let limit = i32::try_from(latency_us).unwrap_or(i32::MAX);
    let taken = OpenOptions::new().write(true).open(WAKE_UP_DEVICE).and_then(|mut device| {
        device.write_all(&limit.to_ne_bytes())?;
        *WAKE_UP_LIMIT.lock().unwrap_or_else(PoisonError::into_inner) = Some(device);
        Ok(())
    });
    let denial = taken.err().map(|error| PrivilegeError {
        cause: format!("{WAKE_UP_DEVICE}: {error}"),
        remedy: "run as root or let a udev rule give the program's group write access to it; a \
                 container needs it from its host"
            .into(),
    });
    PrivilegeOutcome { privilege: Privilege::WakeUpLatency { latency_us }, need, denial }
}

fn raise_priority(priority: u8, need: Need) -> PrivilegeOutcome {
    let denial = set_fifo_priority(priority)
        .err()
        .map(|errno| priority_denial(errno, priority, soft_limit(Resource::RLIMIT_RTPRIO)));
    PrivilegeOutcome { privilege: Privilege::Priority { priority }, need, denial }
}

fn priority_denial(errno: Errno, priority: u8, limit: Option<u64>) -> PrivilegeError {
    let limit = match limit {
        Some(limit) => format!("RLIMIT_RTPRIO is {limit}"),
        None => "RLIMIT_RTPRIO is not what bounds it".into(),
    };
    let remedy = format!(
        "run as root, give the program CAP_SYS_NICE (setcap cap_sys_nice+ep PROGRAM) or raise \
         RLIMIT_RTPRIO to {priority} (rtprio in /etc/security/limits.conf, LimitRTPRIO= of a \
         systemd service); a container needs it from its host, and a control group with \
         real-time scheduling needs cpu.rt_runtime_us"
    );
    PrivilegeError { cause: format!("{errno}, {limit}"), remedy }
}

/// The active limit; `None` if there is none or it is unknown.
fn soft_limit(resource: Resource) -> Option<u64> {
    getrlimit(resource).ok().map(|(soft, _)| soft).filter(|soft| *soft != RLIM_INFINITY)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn denied_priority_names_limit_and_remedies() {
        let text = priority_denial(Errno::EPERM, 80, Some(0)).to_string();
        for part in ["not permitted", "RLIMIT_RTPRIO is 0", "CAP_SYS_NICE", "RLIMIT_RTPRIO to 80"] {
            assert!(text.contains(part), "{part} is not in: {text}");
        }
    }

    #[test]
    fn denied_memory_lock_names_limit_and_remedies() {
        let text = memory_denial(nix::errno::Errno::ENOMEM, Some(65_536)).to_string();
        for part in ["RLIMIT_MEMLOCK is 64 KiB", "CAP_IPC_LOCK", "LimitMEMLOCK="] {
            assert!(text.contains(part), "{part} is not in: {text}");
        }
    }

    #[test]
    fn stack_is_touched_up_to_the_allowed_maximum() {
        touch_stack(0);
        touch_stack(super::MAX_STACK_PREFAULT_BYTES);
    }
}
