use ecan_host::{Error, OpenError, OpenFailure};
use ecan_sim::{Backend, BackendError, ClockKind};

use crate::context::{Context, Result};

use super::{Check, Root};

/// Loads the library. An invalid setting is an error of the program, not a result.
pub(super) fn load(context: &Context) -> Result<Result<Backend, String>> {
    match context.backend(&context.setting()?, ClockKind::Stepped) {
        Ok(backend) => Ok(Ok(backend)),
        Err(BackendError::Load(error)) => Ok(Err(error.to_string())),
        Err(other) => Err(other.into()),
    }
}

pub(super) fn check(library: &Result<Backend, String>) -> Check {
    match library {
        Ok(Backend { ecrt, .. }) => {
            let (major, minor) = ecrt.version();
            Check::good(format!("{}, version {major}.{minor}", ecrt.origin()))
        }
        Err(error) if cfg!(all(target_env = "musl", target_feature = "crt-static")) => {
            Check::bad(error, "install the Debian package of ecan, or use a service (--via)")
        }
        Err(error) => Check::bad(
            error,
            "install the IgH EtherCAT master's library (make install, then ldconfig), or name it \
             with --ecrt",
        ),
    }
}

/// Library and kernel module must have the same version. `failure`: the error of opening the master,
/// because releases with equal numbers may have different interfaces, which the library compares.
pub(super) fn same_version(root: &Root, library: (u8, u8), failure: Option<&Error>) -> Check {
    const REMEDY: &str = "install both from one version, and reload the module";
    let (major, minor) = library;
    if let Some(Error::Open(OpenError { failure, .. })) = failure
        && matches!(failure, OpenFailure::VersionMismatch { .. })
    {
        return Check::bad(failure.to_string(), REMEDY);
    }
    let Some(module) = root.first_line("sys/module/ec_master/version") else {
        return Check::skipped("module version unknown");
    };
    let found = format!("library {major}.{minor}, module {module}");
    let mut parts = module.split(['.', ' ', '-']).map(|part| part.parse::<u8>().ok());
    if [parts.next(), parts.next()] == [Some(Some(major)), Some(Some(minor))] {
        return Check::good(found);
    }
    Check::bad(found, REMEDY)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn library_and_module_versions_are_compared() {
        let directory = tempfile::tempdir().unwrap();
        let root = Root::at(directory.path().to_owned());
        assert!(!same_version(&root, (1, 6), None).has_problem());
        let module = directory.path().join("sys/module/ec_master");
        std::fs::create_dir_all(&module).unwrap();
        std::fs::write(module.join("version"), "1.6.2 1.6.2-2-gabcdef\n").unwrap();
        assert!(!same_version(&root, (1, 6), None).has_problem());
        let other = same_version(&root, (1, 5), None);
        assert_eq!(other.found, "library 1.5, module 1.6.2 1.6.2-2-gabcdef");
        assert!(other.has_problem() && other.remedy.contains("from one version"));
    }
}
