use std::path::PathBuf;

use ecan_protocol::text::Printable;
use thiserror::Error;

/// Environment variable of the setting `ecrt`.
pub const ECRT_VARIABLE: &str = "ECAN_ECRT";

/// Releases that the SDK was tested with: 1.5 and 1.6. A newer minor release with all functions is
/// accepted, see [`Ecrt::release_warning`](crate::Ecrt::release_warning).
pub const RELEASES: [(u8, u8); 2] = [(1, 5), (1, 6)];

/// Error of [`Ecrt::load`](crate::Ecrt::load). The text states what was searched, the cause
/// and what to do.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum LoadError {
    /// The setting `ecrt` selects the simulator, which this program does not contain.
    #[error(
        "the setting `ecrt` is `sim`, but this program was built without the simulator; build with \
         the cargo feature `sim` (CMake: ECAN_IGH_SIM=ON) or select a libethercat"
    )]
    NoSimulator,
    /// A program that is linked statically with musl cannot load libraries.
    #[error(
        "the EtherCAT master library {} cannot be loaded, since this program is linked statically; \
         allowed: the simulator (`sim`), or a service (`ecan --via SOCKET`); for the library, install \
         a program that is linked dynamically",
        Printable(path.display())
    )]
    StaticProgram {
        /// Path or name of the library.
        path: PathBuf,
    },
    /// The process has not loaded the library.
    #[error(
        "this process has not loaded {}; attach needs the library that made the master's handle: \
         link the program with it, or load it before",
        Printable(path.display())
    )]
    NotLoaded {
        /// Path or name of the library.
        path: PathBuf,
    },
    /// The setting `ecrt` selects the simulator, but the loaded library is not simulated.
    #[error(
        "the setting `ecrt` is `sim`, but this process has loaded {}; unset it, or \
         start the program with the simulated libethercat (LD_LIBRARY_PATH=build/sim)",
        Printable(library)
    )]
    NotSimulated {
        /// Text of the loaded library.
        library: String,
    },
    /// The world of the loaded simulated library has another scenario than the setting.
    #[error(
        "the setting `ecrt` is `sim:{}`, but this process has loaded the simulated \
         libethercat, whose scenario is {}; select the scenario with {} alone",
        Printable(requested),
        Printable(loaded),
        ECRT_VARIABLE
    )]
    OtherScenario {
        /// Scenario of the setting.
        requested: String,
        /// Scenario of the loaded library.
        loaded: String,
    },
    /// The simulated library cannot open its world.
    #[error(
        "the simulated libethercat {} cannot open the scenario that {} selects; its message on \
         standard error states the reason",
        Printable(path.display()),
        ECRT_VARIABLE
    )]
    NoWorld {
        /// Path of the library.
        path: PathBuf,
    },
    /// The file does not exist.
    #[error(
        "the EtherCAT master library {} was not found ({}): {}",
        Printable(path.display()),
        Printable(loader),
        advice_not_found(path, elsewhere.as_ref())
    )]
    NotFound {
        /// Path or name that was searched.
        path: PathBuf,
        /// Text of the system.
        loader: String,
        /// Existing library in a directory that the dynamic loader does not search.
        elsewhere: Option<PathBuf>,
    },
    /// The dynamic loader rejects the file.
    #[error(
        "the EtherCAT master library {} cannot be loaded ({}): name a libethercat that is \
         built for this machine ({}) and whose own libraries are installed",
        Printable(path.display()),
        Printable(loader),
        std::env::consts::ARCH
    )]
    NotLoadable {
        /// Path of the library.
        path: PathBuf,
        /// Text of the dynamic loader.
        loader: String,
    },
    /// The library is not libethercat.
    #[error(
        "{} is a library, but not IgH's libethercat (it has no function ecrt_version_magic): \
         name the libethercat of the installed EtherCAT master",
        Printable(path.display())
    )]
    NotEthercat {
        /// Path of the library.
        path: PathBuf,
    },
    /// A libethercat of an unknown release.
    #[error(
        "{} reports version {}, but this program supports {} and newer minor releases only: install \
         one of these, or a newer version of this program",
        Printable(path.display()),
        version_text(*version_magic),
        tested_releases()
    )]
    UnknownVersion {
        /// Path of the library.
        path: PathBuf,
        /// Result of its `ecrt_version_magic`.
        version_magic: u32,
    },
    /// A libethercat that lacks functions.
    #[error(
        "{} reports version {}.{}, but lacks {}: it was built without a part of the \
         interface, or is not IgH's; install the complete libethercat",
        Printable(path.display()),
        release.0,
        release.1,
        missing.join(", ")
    )]
    MissingFunctions {
        /// Path of the library.
        path: PathBuf,
        /// Its release, major and minor.
        release: (u8, u8),
        /// Names of the functions.
        missing: Vec<&'static str>,
    },
}

fn advice_not_found(path: &std::path::Path, elsewhere: Option<&PathBuf>) -> String {
    match elsewhere {
        Some(path) => format!(
            "there is one at {}, where the loader does not look; name that path, or add its \
             directory to /etc/ld.so.conf.d and run ldconfig",
            Printable(path.display())
        ),
        None if path.components().count() > 1 => {
            "name an existing libethercat, or none for the system's".into()
        }
        None => "install the IgH EtherCAT master, or name the path of its libethercat".into(),
    }
}

/// `1.5 and 1.6`
pub(crate) fn tested_releases() -> String {
    RELEASES.map(|(major, minor)| format!("{major}.{minor}")).join(" and ")
}

/// Text of a version magic: IgH's two parts, or the three parts of some forks.
fn version_text(magic: u32) -> String {
    match magic {
        0..0x1_0000 => format!("{}.{}", magic >> 8, magic & 0xff),
        _ => format!(
            "{}.{}.{} (a fork that counts three parts)",
            magic >> 16,
            magic >> 8 & 0xff,
            magic & 0xff
        ),
    }
}
