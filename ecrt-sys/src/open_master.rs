use crate::bindings::ec_master_t;

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
