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
//! `-z nodelete`, since a scenario's bridges have threads, which must not outlive their code. The
//! library must not be put where the loader looks by default: a machine with hardware must never
//! find it by itself.
//!
//! There is one world in a process. It comes to be when a master is first requested or opened, with
//! the scenario that the environment variable `ECAN_ECRT` names (`sim`, `sim:drives`,
//! `sim:FILE.toml`; everything else is `echo`), and says on stderr that it is simulated. Failed
//! calls say so there too, as those of the real library do.
#![deny(missing_docs)]

mod exports;
mod report;
mod values;
mod world;
