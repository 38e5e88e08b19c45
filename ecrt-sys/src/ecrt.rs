//! A libethercat, loaded or simulated.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ecan_protocol::text::Printable;

use crate::bindings::ec_master_t;
use crate::clock::{Clock, MonotonicClock};
use crate::functions::Functions;
use crate::library::{self, LoadedLibrary, OpenMaster, SimulatedClock};
use crate::load_error::{LoadError, RELEASES, tested_releases};

/// Source of the functions of an [`Ecrt`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Origin {
    /// A shared object.
    Library {
        /// Path or name given to the dynamic loader.
        path: PathBuf,
        /// Result of its `ecrt_version_magic`: 0x105 for 1.5, 0x106 for 1.6.
        version_magic: u32,
    },
    /// A simulation, which moves no real device.
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
                Printable(path.display()),
                version_magic >> 8,
                version_magic & 0xff
            ),
            Self::Simulated { scenario } => {
                write!(f, "simulated EtherCAT master (scenario {})", Printable(scenario))
            }
        }
    }
}

struct Shared {
    functions: Functions,
    opener: Arc<dyn OpenMaster>,
    origin: Origin,
    version: (u8, u8),
    clock: Arc<dyn Clock>,
}

/// A libethercat: its functions and the clock that belongs to them. A clone refers to the same
/// library, which stays loaded as long as a clone exists.
#[derive(Clone)]
pub struct Ecrt {
    shared: Arc<Shared>,
}

impl Ecrt {
    /// Loads a shared object; `None` selects [`DEFAULT_LIBRARY`](crate::DEFAULT_LIBRARY) in the
    /// directories of the dynamic loader. The clock is [`MonotonicClock`], or that of the library if
    /// it is the simulated libethercat, which identifies itself.
    ///
    /// Opens no master: the call succeeds on a machine without a running master, too.
    ///
    /// # Errors
    ///
    /// The file is missing or not a libethercat, or its release is unknown or lacks functions. A minor
    /// release after the tested [`RELEASES`](crate::RELEASES) is accepted if no function is missing.
    pub fn load(path: Option<&Path>) -> Result<Self, LoadError> {
        let (library, functions) = library::load(path)?;
        Self::of_library(library, functions)
    }

    /// The libethercat that this process has loaded already, for attaching to a master of the
    /// application: the one that the program or one of its libraries is linked to, otherwise the
    /// loaded one with the name [`DEFAULT_LIBRARY`](crate::DEFAULT_LIBRARY). Loads nothing.
    ///
    /// [`EcrtSetting::find_loaded`](crate::EcrtSetting::find_loaded) also evaluates the setting.
    ///
    /// # Errors
    ///
    /// [`LoadError::NotLoaded`]; otherwise as [`load`](Self::load).
    pub fn loaded() -> Result<Self, LoadError> {
        Self::find_loaded(None)
    }

    pub(crate) fn find_loaded(path: Option<&Path>) -> Result<Self, LoadError> {
        match library::find_loaded(path)? {
            Some((library, functions)) => Self::of_library(library, functions),
            None => Err(LoadError::NotLoaded {
                path: path.unwrap_or(Path::new(library::DEFAULT_LIBRARY)).to_owned(),
            }),
        }
    }

    /// The clock of a simulated libethercat is its own, that of the real one the system's.
    fn of_library(library: LoadedLibrary, functions: Functions) -> Result<Self, LoadError> {
        let (path, version_magic) = (library.path.clone(), library.version_magic);
        let library = Arc::new(library);
        let (origin, clock): (_, Arc<dyn Clock>) = match library.simulated {
            None => (Origin::Library { path, version_magic }, Arc::new(MonotonicClock)),
            Some(simulated) => {
                let scenario = simulated.scenario().ok_or(LoadError::NoWorld { path })?;
                let clock = SimulatedClock { functions: simulated, _library: library.clone() };
                (Origin::Simulated { scenario }, Arc::new(clock))
            }
        };
        let version = version(version_magic);
        Ok(Self { shared: Arc::new(Shared { functions, version, opener: library, origin, clock }) })
    }

    /// A simulated library: its functions, its masters, the version that it simulates (0x106 is
    /// 1.6), the name of its scenario, and its clock.
    ///
    /// # Safety
    ///
    /// - The pointers that `masters` returns, and every pointer that `functions` returns for them,
    ///   are valid arguments of `functions`, on any thread but one at a time, as long as
    ///   libethercat keeps such handles: until they are released or the master is deactivated.
    /// - `functions` behave like libethercat's: they write only to their arguments, in the layout
    ///   of [`ec_master_info_t`](crate::ec_master_info_t) and the others; domain and request memory
    ///   has the reported size, is initialised, keeps its address, and is written only during
    ///   calls.
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
                opener: masters,
                origin: Origin::Simulated { scenario: scenario.into() },
                version: version(version_magic),
                clock,
            }),
        }
    }

    /// Source of the functions.
    #[must_use]
    pub fn origin(&self) -> &Origin {
        &self.shared.origin
    }

    /// Returns whether this is a simulation.
    #[must_use]
    pub fn is_simulated(&self) -> bool {
        matches!(self.shared.origin, Origin::Simulated { .. })
    }

    /// Release of the library, major and minor: `(1, 6)`.
    #[must_use]
    pub fn version(&self) -> (u8, u8) {
        self.shared.version
    }

    /// Warning for the user if the SDK was not tested with the release of the library; `None`
    /// otherwise. Allocates.
    pub fn release_warning(&self) -> Option<String> {
        let Origin::Library { .. } = self.origin() else { return None };
        let is_tested = RELEASES.contains(&self.version());
        (!is_tested).then(|| {
            format!(
                "{}: not tested with this SDK, which was tested with {}; all its functions were found; \
                 compare its types with CMake's ECRT_INCLUDE_DIR, and report what differs",
                self.origin(),
                tested_releases()
            )
        })
    }

    /// Clock of this library.
    #[must_use]
    pub fn clock(&self) -> &Arc<dyn Clock> {
        &self.shared.clock
    }

    /// Function table of this library.
    #[inline]
    #[must_use]
    pub fn functions(&self) -> &Functions {
        &self.shared.functions
    }

    /// Calls `ecrt_request_master`: reserves a master for this process. The caller releases the
    /// handle; it is null on failure, with the cause in [`Errno::last`](crate::Errno::last). May
    /// block while the master is busy.
    #[must_use]
    pub fn request_master(&self, index: u32) -> *mut ec_master_t {
        self.shared.opener.request(index)
    }

    /// Calls `ecrt_open_master`: an unreserved handle for information, states and SDO transfers.
    /// Release and failure as for [`request_master`](Self::request_master).
    #[must_use]
    pub fn open_master(&self, index: u32) -> *mut ec_master_t {
        self.shared.opener.open(index)
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

/// Major and minor of a version magic.
fn version(magic: u32) -> (u8, u8) {
    let [_, _, major, minor] = magic.to_be_bytes();
    (major, minor)
}
