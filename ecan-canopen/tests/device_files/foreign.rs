//! Files of other makers, which are not part of the project.

use std::path::PathBuf;

use ecan_canopen::DeviceFile;

/// Names a directory with EDS and DCF.
const DIRECTORY: &str = "ECAN_DEVICE_FILES";

/// The device files in the named directory; none if there is no such directory.
pub fn foreign_files() -> Vec<(PathBuf, Vec<u8>)> {
    let Some(directory) = std::env::var_os(DIRECTORY).filter(|value| !value.is_empty()) else {
        eprintln!("skipped: {DIRECTORY} names no directory with device files");
        return Vec::new();
    };
    let entries = std::fs::read_dir(&directory).expect("a directory");
    let mut paths: Vec<_> = entries.map(|entry| entry.expect("an entry").path()).collect();
    paths.sort();
    paths.retain(|path| {
        path.extension().is_some_and(|extension| {
            extension.eq_ignore_ascii_case("eds") || extension.eq_ignore_ascii_case("dcf")
        })
    });
    let read = |path: PathBuf| {
        let bytes = std::fs::read(&path).expect("a readable file");
        (path, bytes)
    };
    paths.into_iter().map(read).collect()
}

#[test]
fn foreign_files_are_read_and_written() {
    for (path, bytes) in foreign_files() {
        let file = DeviceFile::parse(&bytes)
            .unwrap_or_else(|faults| panic!("{}: {faults}", path.display()));
        for warning in file.warnings() {
            println!("{}: {warning}", path.display());
        }
        let again = DeviceFile::parse(file.write().as_bytes());
        assert_eq!(again.as_ref(), Ok(&file), "{}", path.display());
        let (objects, entries) = (file.objects().count(), file.entries().count());
        println!(
            "{}: {objects} objects, {entries} entries, {} warnings",
            path.display(),
            file.warnings().len()
        );
    }
}
