//! Output files: they do not overwrite existing data unless requested, and follow no symbolic link.
//!
//! A file that is written at once is complete or does not exist: [`WholeFile`] and [`write()`]. A file
//! that grows while a program runs, such as a recording, can be read from its start: [`create`]. Pipes
//! and devices are written directly, also through a link such as `/dev/stdout`.

use std::fs::{File, Metadata, OpenOptions, Permissions};
use std::io;
use std::io::{ErrorKind, Write};
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _, PermissionsExt as _, fchown};
use std::path::{Path, PathBuf};

use rustix::fs::OFlags;
use tempfile::NamedTempFile;

use super::screen::{CleanWriter, Stream};

/// Policy for an existing file that is not empty.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Existing {
    /// Keep it and return an error.
    Keep,
    /// Replace its contents.
    Replace,
}

impl Existing {
    /// Policy of an option `--force`.
    pub fn forced(is_forced: bool) -> Self {
        if is_forced { Self::Replace } else { Self::Keep }
    }
}

/// Returns whether a path is `-`, standard input or output.
pub fn is_standard_stream(path: &Path) -> bool {
    path == Path::new("-")
}

/// Kind of what exists at the path of an output file.
#[derive(Debug)]
enum Found {
    Nothing,
    File(Metadata),
    /// A pipe or a device, or a link to one.
    Stream,
}

fn find(path: &Path, existing: Existing) -> io::Result<Found> {
    let found = match path.symlink_metadata() {
        Ok(found) => found,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Found::Nothing),
        Err(error) => return Err(error),
    };
    if found.is_symlink() {
        let is_stream = path.metadata().is_ok_and(|target| !target.is_file());
        return if is_stream { Ok(Found::Stream) } else { Err(link_error()) };
    }
    if !found.is_file() {
        return Ok(Found::Stream);
    }
    if existing == Existing::Keep && found.len() > 0 {
        return Err(exists_error());
    }
    Ok(Found::File(found))
}

fn link_error() -> io::Error {
    let text = "the path is a symbolic link; name the file itself, or remove the link";
    io::Error::new(ErrorKind::InvalidInput, text)
}

fn missing_folder_error() -> io::Error {
    io::Error::new(
        ErrorKind::NotFound,
        "the directory does not exist; create it, or name another one",
    )
}

fn exists_error() -> io::Error {
    io::Error::new(ErrorKind::AlreadyExists, "file exists; use --force to overwrite it")
}

/// Opens a pipe or a device. A regular file that has taken its place is not written.
fn open_stream(path: &Path) -> io::Result<File> {
    let file = OpenOptions::new().write(true).open(path)?;
    if file.metadata()?.is_file() { Err(link_error()) } else { Ok(file) }
}

/// Opens a regular file, or creates one; the last component of the path is no link.
fn open_file(path: &Path, options: &mut OpenOptions) -> io::Result<File> {
    let flags = OFlags::NOFOLLOW.bits().cast_signed();
    options.write(true).custom_flags(flags).open(path).map_err(|error| {
        let raw = error.raw_os_error();
        if raw == Some(rustix::io::Errno::LOOP.raw_os_error()) { link_error() } else { error }
    })
}

/// Opens a file for writing while it grows; `-` is standard output.
///
/// # Errors
/// The file cannot be written, it exists and is to be kept, or the path is a link to a file.
pub fn create(path: &Path, existing: Existing) -> io::Result<Box<dyn Write + Send>> {
    if is_standard_stream(path) {
        // Data for another program stay as they are.
        return Ok(match Stream::Output.is_terminal() {
            true => Box::new(CleanWriter::new(Stream::Output)),
            false => Stream::Output.unfiltered(),
        });
    }
    Ok(Box::new(open(path, existing)?))
}

/// Opens a regular file for writing at any place while it grows.
///
/// # Errors
/// As of [`create`]; the path is a pipe or a device.
pub fn create_seekable(path: &Path, existing: Existing) -> io::Result<File> {
    if is_standard_stream(path) {
        return Err(stream_error());
    }
    let file = open(path, existing)?;
    if file.metadata()?.is_file() { Ok(file) } else { Err(stream_error()) }
}

fn stream_error() -> io::Error {
    let text = "this format needs a file; a pipe or a device cannot hold it";
    io::Error::new(ErrorKind::InvalidInput, text)
}

fn open(path: &Path, existing: Existing) -> io::Result<File> {
    let mut options = OpenOptions::new();
    match find(path, existing)? {
        Found::Stream => open_stream(path),
        Found::File(_) => open_file(path, options.truncate(true)),
        Found::Nothing if existing == Existing::Keep => open_file(path, options.create_new(true)),
        Found::Nothing => open_file(path, options.create(true).truncate(true)),
    }
}

/// A file that is complete or does not exist.
///
/// It is written under a random name in the same folder and then renamed; without
/// [`finish`](Self::finish) nothing remains. A replaced file keeps its mode and its owner.
#[derive(Debug)]
pub struct WholeFile {
    target: Target,
    path: PathBuf,
    existing: Existing,
}

#[derive(Debug)]
enum Target {
    New(NamedTempFile),
    /// A pipe, a device, or a file that cannot be replaced: its folder is not writable, or it has
    /// another owner.
    InPlace(File),
}

impl WholeFile {
    /// Prepares the file, so that its faults are known before there is anything to write.
    ///
    /// # Errors
    /// As of [`create`].
    pub fn create(path: &Path, existing: Existing) -> io::Result<Self> {
        let target = match find(path, existing)? {
            Found::Stream => Target::InPlace(open_stream(path)?),
            Found::Nothing => Target::New(create_temporary(path)?),
            Found::File(before) => match replacement(path, &before) {
                Ok(new) => Target::New(new),
                Err(error) if error.kind() == ErrorKind::PermissionDenied => {
                    Target::InPlace(open_file(path, &mut OpenOptions::new())?)
                }
                Err(error) => return Err(error),
            },
        };
        Ok(Self { target, path: path.to_owned(), existing })
    }

    /// Writes the contents; from then on the file exists.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn finish(self, contents: &[u8]) -> io::Result<()> {
        match self.target {
            Target::InPlace(mut file) => {
                if file.metadata()?.is_file() {
                    file.set_len(0)?;
                }
                file.write_all(contents)
            }
            Target::New(mut new) => {
                new.write_all(contents)?;
                new.as_file().sync_all()?;
                // Another program may have written the file since it was checked.
                let persisted = match (find(&self.path, self.existing)?, self.existing) {
                    (Found::Nothing, Existing::Keep) => new.persist_noclobber(&self.path),
                    _ => new.persist(&self.path),
                };
                persisted.map_err(|error| error.error)?;
                File::open(folder(&self.path))?.sync_all()
            }
        }
    }
}

/// Writes a file at once, instead of an existing one.
///
/// # Errors
/// As of [`create`].
pub fn write(path: &Path, contents: impl AsRef<[u8]>) -> io::Result<()> {
    WholeFile::create(path, Existing::Replace)?.finish(contents.as_ref())
}

fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// Creates a file with a random name and the mode of a new file.
fn create_temporary(path: &Path) -> io::Result<NamedTempFile> {
    // The error of the system would name the temporary file.
    if !folder(path).is_dir() {
        return Err(missing_folder_error());
    }
    let mut builder = tempfile::Builder::new();
    let mode = Permissions::from_mode(0o666);
    builder.prefix(".ecan-").suffix(".part").permissions(mode).tempfile_in(folder(path))
}

/// Creates a file that can replace another one.
fn replacement(path: &Path, before: &Metadata) -> io::Result<NamedTempFile> {
    // A file that is not writable is not replaced either.
    open_file(path, &mut OpenOptions::new())?;
    let new = create_temporary(path)?;
    let created = new.as_file().metadata()?;
    if (created.uid(), created.gid()) != (before.uid(), before.gid()) {
        fchown(new.as_file(), Some(before.uid()), Some(before.gid()))?;
    }
    new.as_file().set_permissions(before.permissions())?;
    Ok(new)
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn existing_file_is_kept_unless_forced() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.log");
        let write = |existing, text: &[u8]| {
            create(&path, existing).and_then(|mut file| file.write_all(text))
        };
        write(Existing::Keep, b"").unwrap();
        write(Existing::Keep, b"first").unwrap();
        let error = write(Existing::Keep, b"second").unwrap_err();
        assert_eq!(error.to_string(), "file exists; use --force to overwrite it");
        assert_eq!(std::fs::read(&path).unwrap(), b"first");
        write(Existing::Replace, b"third").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"third");
        // A device is never rejected.
        drop(create(Path::new("/dev/null"), Existing::Keep).unwrap());
    }

    #[test]
    fn whole_file_appears_complete_or_not_at_all() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("report.json");
        let names = || std::fs::read_dir(directory.path()).unwrap().count();
        let file = WholeFile::create(&path, Existing::Keep).unwrap();
        assert!(!path.exists());
        drop(file);
        assert_eq!(names(), 0);
        WholeFile::create(&path, Existing::Keep).unwrap().finish(b"first").unwrap();
        assert_eq!((std::fs::read(&path).unwrap(), names()), (b"first".to_vec(), 1));
        let error = WholeFile::create(&path, Existing::Keep).unwrap_err();
        assert_eq!(error.to_string(), "file exists; use --force to overwrite it");
        // A file that another program creates in between is kept.
        let late = directory.path().join("late");
        let file = WholeFile::create(&late, Existing::Keep).unwrap();
        std::fs::write(&late, "theirs").unwrap();
        assert_eq!(file.finish(b"ours").unwrap_err().kind(), ErrorKind::AlreadyExists);
        assert_eq!((std::fs::read(&late).unwrap(), names()), (b"theirs".to_vec(), 2));
        write(Path::new("/dev/null"), "nothing").unwrap();
        let error = write(&directory.path().join("none/report.json"), "").unwrap_err();
        assert!(error.to_string().starts_with("the directory does not exist"), "{error}");
    }

    #[test]
    fn replaced_file_keeps_its_mode() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("cell.toml");
        let mode = |path: &Path| std::fs::metadata(path).unwrap().mode() & 0o777;
        let as_new = directory.path().join("as_new");
        std::fs::write(&as_new, "").unwrap();
        write(&path, "first").unwrap();
        assert_eq!(mode(&path), mode(&as_new));
        std::fs::set_permissions(&path, Permissions::from_mode(0o640)).unwrap();
        write(&path, "second").unwrap();
        assert_eq!((mode(&path), std::fs::read(&path).unwrap()), (0o640, b"second".to_vec()));
    }

    /// Links at the names of the output, of the temporary file of earlier versions, and to nothing.
    #[test]
    fn symbolic_links_are_never_followed() {
        let directory = tempfile::tempdir().unwrap();
        let at = |name: &str| directory.path().join(name);
        std::fs::write(at("victim"), "precious").unwrap();
        symlink(at("victim"), at("link")).unwrap();
        symlink(at("missing"), at("dangling")).unwrap();
        symlink(at("victim"), at(&format!("report.{}.part", std::process::id()))).unwrap();
        symlink(at("victim"), at(".report.part")).unwrap();
        for existing in [Existing::Keep, Existing::Replace] {
            for name in ["link", "dangling"] {
                let whole = WholeFile::create(&at(name), existing).unwrap_err().to_string();
                let growing = create(&at(name), existing).map(drop).unwrap_err().to_string();
                assert_eq!(whole, growing);
                assert!(whole.starts_with("the path is a symbolic link"), "{whole}");
            }
        }
        // A link that appears between the preparation and the end.
        let late = WholeFile::create(&at("late"), Existing::Replace).unwrap();
        symlink(at("victim"), at("late")).unwrap();
        assert!(late.finish(b"theirs").is_err());
        write(&at("report"), "ours").unwrap();
        create(&at("growing"), Existing::Keep).unwrap().write_all(b"ours").unwrap();
        assert_eq!(std::fs::read(at("victim")).unwrap(), b"precious");
        assert!(!at("missing").exists());
        // A link to a pipe or a device is followed.
        symlink("/dev/null", at("stream")).unwrap();
        write(&at("stream"), "text").unwrap();
        create(&at("stream"), Existing::Keep).unwrap().write_all(b"text").unwrap();
    }
}
