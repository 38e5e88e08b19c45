//! Why a library could not be loaded.

use std::path::PathBuf;

use thiserror::Error;

use crate::library::RELEASES;

/// Why [`Ecrt::load`](crate::Ecrt::load) failed. The text says what was looked for, why it
/// failed and what to do.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum LoadError {
    /// The setting `ecrt` selects the simulator, which this program does not contain.
    #[error(
        "the setting `ecrt` is `sim`, but this program was built without the simulator; build with \
         the cargo feature `sim` (CMake: ECAN_IGH_SIM=ON) or select a libethercat"
    )]
    NoSimulator,
    /// There is no such file.
    #[error(
        "the EtherCAT master library {} was not found ({loader}): {}",
        path.display(),
        advice_not_found(path, elsewhere.as_ref())
    )]
    NotFound {
        /// What was looked for.
        path: PathBuf,
        /// The system's words.
        loader: String,
        /// A place that the dynamic loader does not search where the library does exist.
        elsewhere: Option<PathBuf>,
    },
    /// The file is there but the dynamic loader refuses it.
    #[error(
        "the EtherCAT master library {} cannot be loaded ({loader}): name a libethercat that is \
         built for this machine ({}) and whose own libraries are installed",
        path.display(),
        std::env::consts::ARCH
    )]
    NotLoadable {
        /// What was loaded.
        path: PathBuf,
        /// The dynamic loader's words.
        loader: String,
    },
    /// The library is something else.
    #[error(
        "{} is a library, but not IgH's libethercat (it has no function ecrt_version_magic): \
         name the libethercat of the installed EtherCAT master",
        path.display()
    )]
    NotEthercat {
        /// What was loaded.
        path: PathBuf,
    },
    /// A libethercat of a release whose interface is not known.
    #[error(
        "{} says that it is version {}, but this program knows the interface of {} only: install \
         one of these, or a newer version of this program",
        path.display(),
        version_words(*version_magic),
        known_releases()
    )]
    UnknownVersion {
        /// What was loaded.
        path: PathBuf,
        /// What its `ecrt_version_magic` returns.
        version_magic: u32,
    },
    /// A libethercat that lacks functions.
    #[error(
        "{} says that it is version {}.{}, but lacks {}: it was built without a part of the \
         interface, or is not IgH's; install the complete libethercat",
        path.display(),
        release.0,
        release.1,
        missing.join(", ")
    )]
    MissingFunctions {
        /// What was loaded.
        path: PathBuf,
        /// The release it says it is, major and minor.
        release: (u8, u8),
        /// Names of the functions.
        missing: Vec<&'static str>,
    },
}

fn advice_not_found(path: &std::path::Path, elsewhere: Option<&PathBuf>) -> String {
    match elsewhere {
        Some(place) => format!(
            "there is one at {}, where the loader does not look; name that path, or add its \
             directory to /etc/ld.so.conf.d and run ldconfig",
            place.display()
        ),
        None if path.components().count() > 1 => {
            "name an existing libethercat, or none for the system's".into()
        }
        None => "install the IgH EtherCAT master, or name the path of its libethercat".into(),
    }
}

fn known_releases() -> String {
    RELEASES.map(|(major, minor)| format!("{major}.{minor}")).join(" and ")
}

/// A version magic in words: two parts as IgH counts, or the three of some forks.
fn version_words(magic: u32) -> String {
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
