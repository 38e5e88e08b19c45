//! A libethercat, loaded or simulated.

use std::fmt;
use std::path::{Path, PathBuf};
use std::ptr::NonNull;
use std::sync::Arc;

use crate::bindings::ec_master_t;
use crate::clock::{Clock, MonotonicClock};
use crate::errno::Errno;
use crate::functions::Functions;
use crate::library;
use crate::load_error::LoadError;
use crate::master::{Master, Ownership};
use crate::open_error::OpenError;

/// The two functions of a libethercat that no handle is given to, so that each simulated library
/// can have a world of its own ([`Ecrt::simulated`] says what its pointers must be good for).
pub trait OpenMaster: Send + Sync {
    /// `ecrt_request_master`: a master reserved for the caller, or null with the thread's error
    /// number set ([`Errno::set_last`]): `ENOENT` no such master, `EBUSY` reserved by another.
    fn request(&self, index: u32) -> *mut ec_master_t;

    /// `ecrt_open_master`: a handle for looking only, or null as above.
    fn open(&self, index: u32) -> *mut ec_master_t;
}

/// Where the functions of an [`Ecrt`] come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Origin {
    /// A shared object.
    Library {
        /// As it was named to the dynamic loader.
        path: PathBuf,
        /// What its `ecrt_version_magic` returns: 0x105 for 1.5, 0x106 for 1.6.
        version_magic: u32,
    },
    /// A simulation. Nothing that happens there moves anything real.
    Simulated {
        /// Name of the scenario.
        scenario: String,
    },
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Library { path, version_magic } => write!(
                f,
                "{} (version {}.{})",
                path.display(),
                version_magic >> 8,
                version_magic & 0xff
            ),
            Self::Simulated { scenario } => {
                write!(f, "simulated EtherCAT master (scenario {scenario})")
            }
        }
    }
}

struct Shared {
    functions: Functions,
    opener: Box<dyn OpenMaster>,
    origin: Origin,
    version: (u8, u8),
    clock: Arc<dyn Clock>,
}

/// A libethercat: the functions, and the clock that belongs to it. Cloning gives another name
/// for the same one; it stays loaded as long as a name or a [`Master`] of it exists.
#[derive(Clone)]
pub struct Ecrt {
    shared: Arc<Shared>,
}

impl Ecrt {
    /// Loads a shared object; `None` is [`DEFAULT_LIBRARY`](crate::DEFAULT_LIBRARY), searched
    /// as the dynamic loader searches. The clock is [`MonotonicClock`].
    ///
    /// Nothing is opened: a machine without a running master loads the library just as well.
    ///
    /// # Errors
    ///
    /// The file is missing, not a library, not libethercat, of an unknown release, or
    /// incomplete.
    pub fn load(path: Option<&Path>) -> Result<Self, LoadError> {
        let (library, functions) = library::load(path)?;
        let origin =
            Origin::Library { path: library.path.clone(), version_magic: library.version_magic };
        Ok(Self {
            shared: Arc::new(Shared {
                functions,
                version: version(library.version_magic),
                opener: Box::new(library),
                origin,
                clock: Arc::new(MonotonicClock),
            }),
        })
    }

    /// A simulated library: its functions, its masters, the version it plays
    /// (`0x106` is 1.6), the name of its scenario, and its clock.
    ///
    /// # Safety
    ///
    /// - The pointers that `masters` gives, and every pointer that `functions` gives from them,
    ///   are valid arguments of `functions`, on any thread but one at a time, as long as
    ///   libethercat keeps such handles: until they are released or the master is deactivated.
    /// - `functions` behave as libethercat's: they write only into what they are given, in the
    ///   layout of [`ec_master_info_t`](crate::ec_master_info_t) and the others; domain and
    ///   request memory has the size that they say, is initialised, stays where it is, and is
    ///   written only during calls.
    pub unsafe fn simulated(
        functions: Functions,
        masters: Arc<dyn OpenMaster>,
        version_magic: u32,
        scenario: impl Into<String>,
        clock: Arc<dyn Clock>,
    ) -> Self {
        Self {
            shared: Arc::new(Shared {
                functions,
                opener: Box::new(masters),
                origin: Origin::Simulated { scenario: scenario.into() },
                version: version(version_magic),
                clock,
            }),
        }
    }

    /// Where the functions come from.
    #[must_use]
    pub fn origin(&self) -> &Origin {
        &self.shared.origin
    }

    /// Whether this is a simulation.
    #[must_use]
    pub fn is_simulated(&self) -> bool {
        matches!(self.shared.origin, Origin::Simulated { .. })
    }

    /// Release of the library, major and minor: `(1, 6)`.
    #[must_use]
    pub fn version(&self) -> (u8, u8) {
        self.shared.version
    }

    /// The clock of this library's world.
    #[must_use]
    pub fn clock(&self) -> &Arc<dyn Clock> {
        &self.shared.clock
    }

    /// Reserves a master for this process: needed for everything that configures or drives the
    /// bus. Given back when the [`Master`] is dropped. May block while the master is busy.
    ///
    /// # Errors
    ///
    /// The device node is missing or not permitted, another application has reserved the
    /// master, it waits for its network interface, or library and kernel module differ.
    pub fn request_master(&self, index: u32) -> Result<Master, OpenError> {
        self.obtain(index, Ownership::Reserved)
    }

    /// Opens a master for looking (information, states, SDO transfers) beside whoever drives it.
    ///
    /// # Errors
    ///
    /// As [`Ecrt::request_master`], except that a reserved master can be opened.
    pub fn open_master(&self, index: u32) -> Result<Master, OpenError> {
        self.obtain(index, Ownership::Opened)
    }

    fn obtain(&self, index: u32, ownership: Ownership) -> Result<Master, OpenError> {
        Errno::forget_last();
        let raw = match ownership {
            Ownership::Reserved => self.shared.opener.request(index),
            Ownership::Opened | Ownership::Foreign => self.shared.opener.open(index),
        };
        match NonNull::new(raw) {
            Some(raw) => Ok(Master::new(self.clone(), raw, ownership)),
            None => Err(OpenError::find_cause(
                index,
                Errno::last(),
                self.version(),
                self.is_simulated(),
            )),
        }
    }

    pub(crate) fn functions(&self) -> &Functions {
        &self.shared.functions
    }
}

impl fmt::Debug for Ecrt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Ecrt")
            .field("origin", self.origin())
            .field("version", &self.version())
            .finish_non_exhaustive()
    }
}

impl<M: OpenMaster + ?Sized> OpenMaster for Arc<M> {
    fn request(&self, index: u32) -> *mut ec_master_t {
        (**self).request(index)
    }

    fn open(&self, index: u32) -> *mut ec_master_t {
        (**self).open(index)
    }
}

/// Major and minor of a version magic.
fn version(magic: u32) -> (u8, u8) {
    let [_, _, major, minor] = magic.to_be_bytes();
    (major, minor)
}
