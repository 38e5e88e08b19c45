//! The shared object: search, version check, lookup of its functions. The simulated libethercat has further ones,
//! which identify it and share its clock: in stepped time only sleeping on that clock lets time pass.

use std::ffi::{CStr, OsStr, c_char, c_int, c_uint};
use std::os::unix::ffi::OsStrExt as _;
use std::path::{Path, PathBuf};

use libloading::os::unix::{Library, RTLD_LOCAL, RTLD_NOW};

use crate::bindings::ec_master_t;
use crate::clock::Clock;
use crate::functions::{Functions, SymbolSource, table_symbols};
use crate::load_error::{LoadError, RELEASES};

/// The default library: IgH's soname, searched in the directories of the dynamic
/// loader (`LD_LIBRARY_PATH`, `ld.so.conf`, `/lib`, `/usr/lib`).
pub const DEFAULT_LIBRARY: &str = "libethercat.so.1";

/// Directories of IgH's own installation, which the dynamic loader does not search.
const USUAL_DIRECTORIES: [&str; 4] =
    ["/usr/local/etherlab/lib", "/opt/etherlab/lib", "/usr/local/lib", "/usr/local/lib64"];

/// Programs that are linked statically with musl have no dynamic loader.
const IS_STATIC: bool = cfg!(all(target_env = "musl", target_feature = "crt-static"));

const SYMBOL_VERSION: &str = "ecrt_version_magic";
const SYMBOL_REQUEST: &str = "ecrt_request_master";
const SYMBOL_OPEN: &str = "ecrt_open_master";

type VersionMagic = unsafe extern "C" fn() -> c_uint;
type MasterByIndex = unsafe extern "C" fn(c_uint) -> *mut ec_master_t;

/// All names that are looked up in a library, and whether the library must have them.
pub fn symbols() -> impl Iterator<Item = (&'static str, bool)> {
    [SYMBOL_VERSION, SYMBOL_REQUEST, SYMBOL_OPEN]
        .map(|symbol| (symbol, true))
        .into_iter()
        .chain(table_symbols())
}

/// A library that stays loaded as long as one of its functions can be called.
pub(crate) struct LoadedLibrary {
    pub(crate) path: PathBuf,
    pub(crate) version_magic: u32,
    request: MasterByIndex,
    open: MasterByIndex,
    /// Its further functions, if it is the simulated libethercat.
    pub(crate) simulated: Option<SimulatedLibrary>,
    _library: Library,
}

impl OpenMaster for LoadedLibrary {
    fn request(&self, index: u32) -> *mut ec_master_t {
        // SAFETY: `request` is the library's function of this type, and the library is loaded.
        unsafe { (self.request)(index) }
    }

    fn open(&self, index: u32) -> *mut ec_master_t {
        // SAFETY: as in `request`.
        unsafe { (self.open)(index) }
    }
}

/// Loads a library and looks up its functions.
pub(crate) fn load(path: Option<&Path>) -> Result<(LoadedLibrary, Functions), LoadError> {
    let path = path.unwrap_or(Path::new(DEFAULT_LIBRARY));
    if IS_STATIC {
        return Err(LoadError::StaticProgram { path: path.into() });
    }
    // SAFETY: loading runs the library's initialisers. It is the one that the user names, or
    // the system's libethercat; trusting it is what loading it means.
    let library = unsafe { Library::open(Some(path), RTLD_NOW | RTLD_LOCAL) }
        .map_err(|error| not_loaded(path, &loader_text(&error)))?;
    look_up(path, library)
}

/// The libethercat that this process has loaded already: the one with this path, or without a path
/// the first one whose functions the program finds, otherwise the one with the default name. Loads
/// nothing.
pub(crate) fn find_loaded(
    path: Option<&Path>,
) -> Result<Option<(LoadedLibrary, Functions)>, LoadError> {
    if IS_STATIC {
        return Ok(None);
    }
    let found = match path {
        Some(path) => already_loaded(path).map(|library| (path.to_owned(), library)),
        None => in_global_scope().or_else(|| {
            let path = Path::new(DEFAULT_LIBRARY);
            already_loaded(path).map(|library| (path.to_owned(), library))
        }),
    };
    found.map(|(path, library)| look_up(&path, library)).transpose()
}

fn already_loaded(path: &Path) -> Option<Library> {
    // SAFETY: with RTLD_NOLOAD nothing is loaded, so no initialiser runs.
    unsafe { Library::open(Some(path), libc::RTLD_NOLOAD | RTLD_NOW | RTLD_LOCAL) }.ok()
}

/// The libethercat that the program or one of its libraries is linked to.
fn in_global_scope() -> Option<(PathBuf, Library)> {
    let program = Library::this();
    let source = SymbolSource { library: &program, reports_status: true, missing: Vec::new() };
    let version: VersionMagic = source.find(SYMBOL_VERSION)?;
    let (text, address) = (std::ptr::null(), std::ptr::null_mut());
    let mut info =
        libc::Dl_info { dli_fname: text, dli_fbase: address, dli_sname: text, dli_saddr: address };
    // SAFETY: `info` is valid for writing, and any address may be asked for.
    let is_known = unsafe { libc::dladdr(version as *const libc::c_void, &mut info) } != 0;
    if !is_known || info.dli_fname.is_null() {
        return None;
    }
    // SAFETY: the loader's text of a loaded object, which `program` keeps loaded.
    let path = unsafe { CStr::from_ptr(info.dli_fname) };
    let path = PathBuf::from(OsStr::from_bytes(path.to_bytes()));
    // without a handle of its own the functions are in the program itself
    let library = already_loaded(&path).unwrap_or(program);
    Some((path, library))
}

/// Checks the release of a library and looks up its functions.
fn look_up(path: &Path, library: Library) -> Result<(LoadedLibrary, Functions), LoadError> {
    let mut source = SymbolSource { library: &library, reports_status: true, missing: Vec::new() };
    // Every release has this function.
    let version: VersionMagic = source
        .required(SYMBOL_VERSION)
        .ok_or_else(|| LoadError::NotEthercat { path: path.into() })?;
    // SAFETY: `ecrt_version_magic` has had this type in every release.
    let version_magic = unsafe { version() };
    let Some(release) = release(version_magic) else {
        return Err(LoadError::UnknownVersion { path: path.into(), version_magic });
    };
    source.reports_status = release >= (1, 6);

    let request = source.required(SYMBOL_REQUEST);
    let open = source.required(SYMBOL_OPEN);
    let simulated = SimulatedLibrary::look_up(&mut source);
    // SAFETY: the library reports that it is libethercat of a supported release, whose return
    // types `reports_status` selects.
    let functions = unsafe { Functions::look_up(&mut source) };
    let missing = source.missing;
    let (Some(request), Some(open), Some(functions)) = (request, open, functions) else {
        return Err(LoadError::MissingFunctions { path: path.into(), release, missing });
    };
    let path = path.into();
    let loaded = LoadedLibrary { path, version_magic, request, open, simulated, _library: library };
    Ok((loaded, functions))
}

/// The release of a version magic: a tested one, or a later minor release, since IgH changes neither a
/// function nor a type within a major release and its soname.
fn release(version_magic: u32) -> Option<(u8, u8)> {
    let [minor, major, 0, 0] = version_magic.to_le_bytes() else { return None };
    RELEASES
        .into_iter()
        .any(|tested| tested.0 == major && tested.1 <= minor)
        .then_some((major, minor))
}

/// Text of the dynamic loader without the crate's prefix.
fn loader_text(error: &libloading::Error) -> String {
    use std::error::Error;
    match error.source() {
        Some(text) => text.to_string(),
        None => error.to_string(),
    }
}

/// The loader's message without the name of the library; `None` if it is about another file.
fn without_name<'a>(path: &Path, loader: &'a str) -> Option<&'a str> {
    loader.strip_prefix(&*path.to_string_lossy())?.strip_prefix(": ")
}

fn not_loaded(path: &Path, loader: &str) -> LoadError {
    let has_directory = path.components().count() > 1 || path.is_absolute();
    if has_directory {
        return match std::fs::metadata(path) {
            Ok(_) => LoadError::NotLoadable {
                path: path.into(),
                loader: without_name(path, loader).unwrap_or(loader).into(),
            },
            Err(error) => LoadError::NotFound {
                path: path.into(),
                loader: error.to_string(),
                elsewhere: None,
            },
        };
    }
    // For a bare name the loader's message begins with the file it speaks of: when that is
    // not the library itself, the library was found and something that it needs was not.
    let about_itself = without_name(path, loader);
    let absent = loader.contains("cannot open shared object file") || loader.contains("not found");
    if let (Some(reason), true) = (about_itself, absent) {
        LoadError::NotFound {
            path: path.into(),
            loader: reason.into(),
            elsewhere: USUAL_DIRECTORIES
                .iter()
                .map(|directory| Path::new(directory).join(path))
                .find(|candidate| candidate.is_file()),
        }
    } else {
        LoadError::NotLoadable { path: path.into(), loader: loader.into() }
    }
}

/// The two functions of a libethercat that take no handle, so that each simulated library can have
/// its own world ([`Ecrt::simulated`](crate::Ecrt::simulated) lists the requirements on the returned pointers).
pub trait OpenMaster: Send + Sync {
    /// `ecrt_request_master`: a master reserved for the caller, or null with the thread's error
    /// number set ([`Errno::set_last`](crate::Errno::set_last)): `ENOENT` no such master, `EBUSY`
    /// reserved by another application.
    fn request(&self, index: u32) -> *mut ec_master_t;

    /// `ecrt_open_master`: an unreserved handle, or null as above.
    fn open(&self, index: u32) -> *mut ec_master_t;
}

const SYMBOL_SCENARIO: &str = "ecan_sim_scenario";

/// The additional functions of a loaded library. Valid while it is loaded.
#[derive(Clone, Copy)]
pub(crate) struct SimulatedLibrary {
    scenario: unsafe extern "C" fn() -> *const c_char,
    now_ns: unsafe extern "C" fn() -> u64,
    sleep_until_ns: unsafe extern "C" fn(deadline_ns: u64, spin_ns: u64),
    clock_is_stepped: unsafe extern "C" fn() -> c_int,
    gateways_ready: unsafe extern "C" fn(),
}

impl SimulatedLibrary {
    /// `None` for a library that is not simulated.
    pub(crate) fn look_up(source: &mut SymbolSource<'_>) -> Option<Self> {
        let scenario = source.find(SYMBOL_SCENARIO)?;
        let now_ns = source.required("ecan_sim_now_ns");
        let sleep_until_ns = source.required("ecan_sim_sleep_until_ns");
        let clock_is_stepped = source.required("ecan_sim_clock_is_stepped");
        let gateways_ready = source.required("ecan_sim_gateways_ready");
        Some(Self {
            scenario,
            now_ns: now_ns?,
            sleep_until_ns: sleep_until_ns?,
            clock_is_stepped: clock_is_stepped?,
            gateways_ready: gateways_ready?,
        })
    }

    /// Scenario of its world, which this call opens; `None` if that fails. The library has then
    /// written the reason to stderr.
    pub(crate) fn scenario(&self) -> Option<String> {
        // SAFETY: the library is loaded, and its function takes nothing.
        let text = unsafe { (self.scenario)() };
        if text.is_null() {
            return None;
        }
        // SAFETY: not null, so a text that lives as long as the library.
        Some(unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned())
    }
}

/// The clock of a simulated library.
pub(crate) struct SimulatedClock<L> {
    pub(crate) functions: SimulatedLibrary,
    /// Keeps the library loaded.
    pub(crate) _library: L,
}

impl<L: Send + Sync> Clock for SimulatedClock<L> {
    fn now_ns(&self) -> u64 {
        // SAFETY: the library is loaded, and its function takes nothing.
        unsafe { (self.functions.now_ns)() }
    }

    fn sleep_until_ns(&self, deadline_ns: u64) {
        self.sleep_and_spin_until_ns(deadline_ns, 0);
    }

    fn sleep_and_spin_until_ns(&self, deadline_ns: u64, spin_ns: u64) {
        // SAFETY: the library is loaded, and its function takes any numbers.
        unsafe { (self.functions.sleep_until_ns)(deadline_ns, spin_ns) }
    }

    fn is_free_running(&self) -> bool {
        // SAFETY: the library is loaded, and its function takes nothing.
        unsafe { (self.functions.clock_is_stepped)() == 0 }
    }

    fn gateways_ready(&self) {
        // SAFETY: the library is loaded, and its function takes nothing.
        unsafe { (self.functions.gateways_ready)() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tested_and_later_minor_releases_are_accepted() {
        assert_eq!(release(0x105), Some((1, 5)));
        assert_eq!(release(0x106), Some((1, 6)));
        assert_eq!(release(0x107), Some((1, 7)));
        assert_eq!(release(0x104), None);
        assert_eq!(release(0x206), None);
        // A fork that counts three parts, and lays its structures out differently.
        assert_eq!(release(0x0001_050a), None);
        assert_eq!(release(0), None);
    }

    #[test]
    fn missing_dependency_is_not_a_missing_library() {
        let error = not_loaded(
            Path::new("libethercat.so.1"),
            "librt_special.so.3: cannot open shared object file: No such file or directory",
        );
        assert!(matches!(error, LoadError::NotLoadable { .. }), "{error}");
        let error = not_loaded(
            Path::new("libethercat.so.1"),
            "libethercat.so.1: cannot open shared object file: No such file or directory",
        );
        assert!(matches!(error, LoadError::NotFound { .. }), "{error}");
    }
}
