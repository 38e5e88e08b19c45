//! The simulated libethercat under the names of the real one.
//!
//! A C program that calls `ecrt_*` itself runs on the simulated bus if the loader finds this
//! library in place of IgH's: same soname, same functions, same symbol versions (1.6.2). `cc` links
//! the static library of this crate with the version script `libethercat.map`:
//!
//! ```text
//! cc -shared -o libethercat.so.1 -Wl,-soname,libethercat.so.1 \
//!    -Wl,--version-script=libethercat.map -Wl,-z,nodelete -Wl,-z,defs -Wl,--gc-sections \
//!    -Wl,--whole-archive libethercat_sim.a -Wl,--no-whole-archive -lgcc_s -lpthread -lm -ldl -lc
//! ```
//!
//! `-z nodelete` is needed because a scenario's bridges have threads, which must not outlive their
//! code. The library must not be installed where the loader searches by default: a machine with
//! hardware must never find it automatically.
//!
//! A process has one world. It is created when a master is first requested or opened, with the
//! scenario of the environment variable `ECAN_ECRT` (`sim`, `sim:drives`, `sim:FILE.toml`;
//! everything else is `echo`), and reports on stderr that it is simulated. Failed calls are also
//! reported there, as by the real library.
#![deny(missing_docs)]

mod exports;
mod world;
