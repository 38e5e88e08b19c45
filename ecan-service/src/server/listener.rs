//! The listening socket and its file.

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::fs::{FileTypeExt as _, MetadataExt as _, PermissionsExt as _};
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::{fs, io};

use rustix::io::Errno;
use rustix::net::{
    AddressFamily, SocketAddrUnix, SocketFlags, SocketType, accept_with, socket_with,
};
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

use super::config::{MAX_SOCKET_PATH, ServiceConfig, ServiceError};
use super::permission::{Peer, group_id};

/// File of a socket: device and inode.
type FileId = (u64, u64);

/// Listening socket. Dropping it removes the file that it has created.
#[derive(Debug)]
pub(crate) struct Listener {
    socket: UnixListener,
    file: Option<SocketFile>,
}

#[derive(Debug)]
struct SocketFile {
    path: PathBuf,
    mode: u32,
    group: Option<u32>,
    id: FileId,
}

impl Listener {
    /// Listens at the path of the configuration, or uses its listener.
    pub(crate) fn open(config: &mut ServiceConfig) -> Result<Self, ServiceError> {
        let group = config.group.as_deref();
        let Some(socket) = config.listener.take() else {
            return Self::create_at(config.path.clone(), config.mode, group);
        };
        group.map(group_id).transpose()?;
        let (path, what) = (config.path.clone(), "listener");
        socket.set_nonblocking(true).map_err(|source| ServiceError::Socket {
            path,
            what,
            source,
        })?;
        Ok(Self { socket, file: None })
    }

    /// Listens at a path.
    pub(crate) fn create_at(
        path: PathBuf,
        mode: u32,
        group: Option<&str>,
    ) -> Result<Self, ServiceError> {
        let group = group.map(group_id).transpose()?;
        if path.as_os_str().len() > MAX_SOCKET_PATH {
            return Err(ServiceError::PathTooLong { path });
        }
        check_free(&path)?;
        let (socket, id) = create(&path, mode, group)
            .map_err(|(what, source)| ServiceError::Socket { path: path.clone(), what, source })?;
        Ok(Self { socket, file: Some(SocketFile { path, mode, group, id }) })
    }

    pub(crate) fn accept(&self) -> rustix::io::Result<OwnedFd> {
        accept_with(&self.socket, SocketFlags::CLOEXEC | SocketFlags::NONBLOCK)
    }

    /// Creates the socket again if its file was removed; returns whether it did. A file of another
    /// program stays.
    pub(crate) fn restore(&mut self) -> Result<bool, ServiceError> {
        let Some(file) = &mut self.file else { return Ok(false) };
        match file_id(&file.path) {
            Ok(id) if id == file.id => return Ok(false),
            Ok(_) => check_free(&file.path)?,
            Err(_) => {}
        }
        let created = create(&file.path, file.mode, file.group);
        let (socket, id) = created.map_err(|(what, source)| ServiceError::Socket {
            path: file.path.clone(),
            what,
            source,
        })?;
        // Clients that wait in the old socket see its end, and connect again.
        (self.socket, file.id) = (socket, id);
        Ok(true)
    }
}

impl AsFd for Listener {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        if let Some(file) = &self.file
            && file_id(&file.path).is_ok_and(|id| id == file.id)
        {
            let _ = fs::remove_file(&file.path);
        }
    }
}

fn file_id(path: &Path) -> io::Result<FileId> {
    let metadata = fs::symlink_metadata(path)?;
    Ok((metadata.dev(), metadata.ino()))
}

/// Returns an error if a program listens at the path, or the file is not a socket.
fn check_free(path: &Path) -> Result<(), ServiceError> {
    let metadata = match fs::symlink_metadata(path) {
        Ok(metadata) => metadata,
        Err(_) => return Ok(()),
    };
    if !metadata.file_type().is_socket() {
        return Err(ServiceError::NotSocket { path: path.into() });
    }
    match connect(path) {
        Ok(stream) => {
            let pid = Peer::of(&stream).map(|peer| peer.pid);
            Err(ServiceError::InUse { path: path.into(), pid })
        }
        // Its program has ended.
        Err(Errno::CONNREFUSED | Errno::NOENT) => Ok(()),
        Err(_) => Err(ServiceError::InUse { path: path.into(), pid: None }),
    }
}

/// Connects without waiting for a program whose queue of clients is full.
fn connect(path: &Path) -> rustix::io::Result<OwnedFd> {
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    let socket = socket_with(AddressFamily::UNIX, SocketType::STREAM, flags, None)?;
    rustix::net::connect(&socket, &SocketAddrUnix::new(path)?)?;
    Ok(socket)
}

/// A name in the folder of the socket that no other program can predict.
fn random_name(path: &Path) -> io::Result<PathBuf> {
    let mut random = [0; 4];
    rustix::rand::getrandom(&mut random, rustix::rand::GetRandomFlags::empty())?;
    let mut name = path.as_os_str().to_owned();
    // Seven digits: MAX_SOCKET_PATH leaves room for eight characters.
    name.push(format!(".{:07x}", u32::from_ne_bytes(random) >> 4));
    Ok(PathBuf::from(name))
}

/// Creates a listening socket under another name, with its permissions, and moves it to `path`: no
/// client sees it unfinished, and a stale file is replaced.
fn create(
    path: &Path,
    mode: u32,
    group: Option<u32>,
) -> Result<(UnixListener, FileId), (&'static str, io::Error)> {
    if let Some(directory) =
        path.parent().filter(|directory| !directory.as_os_str().is_empty() && !directory.exists())
    {
        fs::create_dir(directory).map_err(|error| ("create its directory", error))?;
    }
    let new = random_name(path).map_err(|error| ("name", error))?;
    // Fails if the name exists, also as a link.
    let socket = UnixListener::bind(&new).map_err(|error| ("bind", error))?;
    let finish = || {
        socket.set_nonblocking(true).map_err(|error| ("configure", error))?;
        fs::set_permissions(&new, fs::Permissions::from_mode(mode))
            .map_err(|error| ("set its permissions", error))?;
        if let Some(group) = group {
            std::os::unix::fs::lchown(&new, None, Some(group))
                .map_err(|error| ("set its group", error))?;
        }
        let id = file_id(&new).map_err(|error| ("read its file", error))?;
        fs::rename(&new, path).map_err(|error| ("rename", error))?;
        Ok(id)
    };
    match finish() {
        Ok(id) => Ok((socket, id)),
        Err(error) => {
            let _ = fs::remove_file(&new);
            Err(error)
        }
    }
}

/// Leaves the real-time scheduling of the thread that started this one, and its CPUs if other ones are
/// left.
pub(crate) fn enter_background() {
    match ecan_host::leave_real_time() {
        Ok(true) => {}
        Ok(false) => return,
        Err(error) => return tracing::warn!("service: cannot leave real-time scheduling: {error}"),
    }
    // The real-time thread may be bound to CPUs of its own.
    let Ok(bound) = sched_getaffinity(None) else { return };
    let mut others = CpuSet::new();
    for cpu in 0..CpuSet::MAX_CPU {
        if !bound.is_set(cpu) {
            others.set(cpu);
        }
    }
    // Fails if there is no other CPU.
    let _ = sched_setaffinity(None, &others);
}

#[cfg(test)]
mod tests {
    use std::os::unix::net::UnixStream;

    use super::*;

    fn open(path: &Path) -> Result<Listener, ServiceError> {
        Listener::open(&mut ServiceConfig::new(path))
    }

    #[test]
    fn socket_has_its_mode_and_ends_with_the_listener() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("new/master0.sock");
        let listener = open(&path).unwrap();
        assert_eq!(fs::metadata(&path).unwrap().mode() & 0o777, 0o660);
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
        drop(listener);
        assert!(!path.exists());
    }

    /// Another user may have placed a file at a name that it predicts.
    #[test]
    fn predictable_names_are_not_touched() {
        let directory = tempfile::tempdir().unwrap();
        let at = |name: &str| directory.path().join(name);
        fs::write(at("victim"), "text").unwrap();
        let predicted = at(&format!("a.sock.{}", std::process::id()));
        std::os::unix::fs::symlink(at("victim"), &predicted).unwrap();
        let _listener = open(&at("a.sock")).unwrap();
        assert_eq!(fs::read_link(&predicted).unwrap(), at("victim"));
        assert_eq!(fs::read(at("victim")).unwrap(), b"text");
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 3);
    }

    #[test]
    fn live_socket_is_an_error_that_names_the_process() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.sock");
        let _first = open(&path).unwrap();
        let error = open(&path).unwrap_err().to_string();
        let expected = format!("is in use by process {}; stop that service", std::process::id());
        assert!(error.contains(&expected), "{error}");
    }

    #[test]
    fn stale_socket_is_replaced_and_other_files_stay() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.sock");
        drop(UnixListener::bind(&path).unwrap());
        assert!(path.exists(), "stale");
        let listener = open(&path).unwrap();
        UnixStream::connect(&path).unwrap();
        drop(listener);
        fs::write(&path, "text").unwrap();
        assert!(matches!(open(&path), Err(ServiceError::NotSocket { .. })));
        assert_eq!(fs::read(&path).unwrap(), b"text");
    }

    #[test]
    fn path_is_limited_to_what_a_socket_allows() {
        let directory = tempfile::tempdir().unwrap();
        let path = |length: usize| {
            let folder = directory.path().as_os_str().len() + 1;
            directory.path().join("s".repeat(length - folder))
        };
        open(&path(MAX_SOCKET_PATH)).unwrap();
        let error = open(&path(MAX_SOCKET_PATH + 1)).unwrap_err();
        assert!(matches!(error, ServiceError::PathTooLong { .. }), "{error:?}");
        assert!(error.to_string().contains("100 bytes is too long"), "{error}");
    }

    #[test]
    fn removed_socket_is_created_again() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.sock");
        let mut listener = open(&path).unwrap();
        assert!(!listener.restore().unwrap());
        fs::remove_file(&path).unwrap();
        assert!(listener.restore().unwrap());
        UnixStream::connect(&path).unwrap();
        assert!(!listener.restore().unwrap());
        // Another program took the path: it keeps it.
        fs::remove_file(&path).unwrap();
        let other = UnixListener::bind(&path).unwrap();
        assert!(matches!(listener.restore(), Err(ServiceError::InUse { .. })));
        drop(listener);
        assert!(path.exists());
        drop(other);
    }
}
