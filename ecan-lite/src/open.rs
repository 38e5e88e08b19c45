//! Opens the EtherCAT master library that the setting `ecrt` selects, and a Port or axes on it.

use std::io::Write as _;
use std::path::PathBuf;

#[cfg(feature = "cia402")]
use ecan_canopen::NodeAddress;
#[cfg(feature = "cia402")]
use ecan_cia402::{AxisConfig, AxisOwner, Cia402, Cia402Config};
use ecan_host::{AdapterConfig, Ecrt, EcrtSetting};
use ecan_mcan_port::{Config, Port};

use crate::Result;

/// Opens the EtherCAT master library that the setting `ecrt` selects: empty for the installed
/// libethercat, a path, `sim`, or `sim:` with a scenario name or file. Nothing falls back to the
/// simulator. A simulation, and a release that was not tested, are named on standard error;
/// [`EcrtOptions::open`] leaves that to the program.
///
/// The simulator does not see the configuration here: a plain `sim` is one gateway with echo nodes.
/// [`open`](crate::open()) and `open_axes` give it what is configured.
pub trait OpenEcrt: Sized {
    /// Opens the library that the environment variable `ECAN_ECRT` selects.
    ///
    /// # Errors
    /// The library is missing or unusable, or the setting selects a simulator or a scenario that does
    /// not exist.
    fn open() -> Result<Self>;

    /// Opens the library of an explicit setting, regardless of the environment.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    fn open_setting(setting: &str) -> Result<Self>;

    /// The library that this process has loaded already, for
    /// [`Adapter::attach`](crate::adapter::Adapter::attach): an application that runs the master
    /// itself has linked or loaded it. With `sim` in the environment it must be the simulated
    /// libethercat.
    ///
    /// # Errors
    /// The process has loaded no libethercat, or another one than the environment selects.
    fn open_loaded() -> Result<Self>;
}

/// The setting `ecrt` with what a program adds to it. Rust, C and the programs resolve it here;
/// [`OpenEcrt`] has the defaults.
#[derive(Clone, Debug, Default)]
pub struct EcrtOptions {
    /// Setting of the program (API or `--ecrt`); `None` is that of the environment.
    pub setting: Option<String>,
    /// Library if there is no setting; `None` is the installed libethercat.
    pub default_library: Option<PathBuf>,
    /// Options of a simulated library, which has the bridges of its scenario in any case.
    #[cfg(feature = "sim")]
    pub simulation: ecan_sim::SimOptions,
}

/// A library that [`EcrtOptions::open`] has opened.
#[derive(Clone, Debug)]
pub struct OpenedEcrt {
    /// The library.
    pub ecrt: Ecrt,
    /// The simulation that was opened with it, to be announced to the user.
    #[cfg(feature = "sim")]
    pub simulation: Option<ecan_sim::Simulation>,
}

impl EcrtOptions {
    /// Options with which a plain `sim` has the gateways of a configuration, with echo nodes.
    pub fn for_gateways(adapter: &AdapterConfig) -> Self {
        #[cfg(feature = "sim")]
        {
            let simulation = ecan_sim::SimOptions {
                gateways: place(adapter).0,
                carries_large_pdos: adapter.allow_large_pdos.then_some(true),
                ..ecan_sim::SimOptions::default()
            };
            Self { simulation, ..Self::default() }
        }
        #[cfg(not(feature = "sim"))]
        {
            let _ = adapter;
            Self::default()
        }
    }

    /// Options with which a plain `sim` has the gateways of a configuration, and a drive for each node
    /// of an axis table. A channel without axes has an echo node.
    #[cfg(feature = "cia402")]
    pub fn for_axes(adapter: &AdapterConfig, axes: &[AxisConfig]) -> Self {
        let mut options = Self::for_gateways(adapter);
        for axis in axes {
            options.add_node(adapter, axis.address, axis.node_axis.saturating_add(1), None);
        }
        options
    }

    /// Adds a drive with this number of axes and this device file to a plain `sim`, or to the drive that
    /// is there.
    #[cfg(feature = "cia402")]
    pub(crate) fn add_node(
        &mut self,
        adapter: &AdapterConfig,
        NodeAddress { slave, channel, node }: NodeAddress,
        axes: u8,
        eds: Option<PathBuf>,
    ) {
        #[cfg(feature = "sim")]
        {
            let Some(&gateway) = place(adapter).1.get(slave) else { return };
            let drives = &mut self.simulation.drives;
            let address = (gateway, channel, node);
            let known = drives
                .iter_mut()
                .find(|drive| (drive.gateway, drive.channel, drive.node) == address);
            match known {
                Some(drive) => {
                    drive.axes = drive.axes.max(axes);
                    drive.eds = drive.eds.take().or(eds);
                }
                None => {
                    drives.push(ecan_sim::ConfiguredDrive { gateway, channel, node, axes, eds })
                }
            }
        }
        #[cfg(not(feature = "sim"))]
        let _ = (adapter, slave, channel, node, axes, eds);
    }

    /// Opens the library.
    ///
    /// # Errors
    /// The library is missing or unusable, or the setting selects a simulator or a scenario that does
    /// not exist.
    pub fn open(self) -> Result<OpenedEcrt> {
        let setting = match EcrtSetting::resolve(self.setting.as_deref())? {
            EcrtSetting::Library(None) if self.setting.is_none() => {
                EcrtSetting::Library(self.default_library)
            }
            setting => setting,
        };
        #[cfg(feature = "sim")]
        {
            let bridges = Some(ecan_sim::bridge::make as ecan_sim::BridgeFactory);
            let options = ecan_sim::SimOptions { bridges, ..self.simulation };
            let ecan_sim::Backend { ecrt, simulation } = ecan_sim::open(&setting, &options)?;
            Ok(OpenedEcrt { ecrt, simulation })
        }
        #[cfg(not(feature = "sim"))]
        Ok(OpenedEcrt { ecrt: setting.load()? })
    }

    /// The library that this process has loaded already, see [`OpenEcrt::open_loaded`].
    ///
    /// # Errors
    /// The process has loaded no libethercat, or another one than the setting selects.
    pub fn find_loaded(&self) -> Result<Ecrt> {
        Ok(EcrtSetting::resolve(self.setting.as_deref())?.find_loaded()?)
    }
}

impl OpenEcrt for Ecrt {
    fn open() -> Result<Self> {
        announce(EcrtOptions::default())
    }

    fn open_setting(setting: &str) -> Result<Self> {
        announce(EcrtOptions { setting: Some(setting.to_owned()), ..EcrtOptions::default() })
    }

    fn open_loaded() -> Result<Self> {
        let ecrt = EcrtOptions::default().find_loaded()?;
        warn_of_release(&ecrt);
        Ok(ecrt)
    }
}

/// Opens the Port of a configuration on the library that the environment variable `ECAN_ECRT` selects.
/// A plain `sim` has the gateways that are configured, with echo nodes.
///
/// # Errors
/// As [`OpenEcrt::open`] and [`Port::open`].
pub fn open(config: impl Into<Config>) -> Result<Port> {
    let config = config.into();
    let ecrt = announce(EcrtOptions::for_gateways(&config.adapter))?;
    Ok(Port::open(&ecrt, config)?)
}

/// As [`open`], waits until all gateways are ready, and adds an axis table. A plain `sim` has a drive for
/// each axis. Blocks for seconds.
///
/// # Errors
/// As [`open`], [`Port::wait_ready`] and [`Cia402::new`].
#[cfg(feature = "cia402")]
pub fn open_axes(
    config: impl Into<Config>,
    axes: Vec<AxisConfig>,
    table: Cia402Config,
) -> Result<AxisOwner> {
    let config = config.into();
    let ecrt = announce(EcrtOptions::for_axes(&config.adapter, &axes))?;
    let mut port = Port::open(&ecrt, config)?;
    port.wait_ready()?;
    let axes = Cia402::new(&port, axes, table)?;
    Ok(AxisOwner::new(port, axes))
}

/// Opens a library, and names a simulation and a release that was not tested.
fn announce(options: EcrtOptions) -> Result<Ecrt> {
    let opened = options.open()?;
    #[cfg(feature = "sim")]
    if let Some(simulation) = &opened.simulation {
        print_line(&simulation.banner());
    }
    warn_of_release(&opened.ecrt);
    Ok(opened.ecrt)
}

fn warn_of_release(ecrt: &Ecrt) {
    if let Some(warning) = ecrt.release_warning() {
        print_line(&warning);
    }
}

/// Prints a line that the user must see, which the log is not for. A closed standard error is no failure
/// of the program.
fn print_line(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// Station aliases of the gateways of a bus that a configuration describes, and the place of each configured
/// one among them. Positions after an alias follow the gateways without alias.
#[cfg(feature = "sim")]
fn place(adapter: &AdapterConfig) -> (Vec<u16>, Vec<usize>) {
    let mut heads: Vec<u16> = adapter.slaves.iter().map(|slave| slave.alias).collect();
    heads.sort_unstable();
    heads.dedup();
    let mut aliases = Vec::new();
    let mut places = vec![0; adapter.slaves.len()];
    for head in heads {
        let first = aliases.len();
        for (slave, place) in adapter.slaves.iter().zip(&mut places) {
            if slave.alias == head {
                *place = first + usize::from(slave.position);
                aliases.resize(aliases.len().max(*place + 1), 0);
            }
        }
        if let Some(alias) = aliases.get_mut(first) {
            *alias = head;
        }
    }
    (aliases, places)
}

#[cfg(all(test, feature = "sim"))]
mod tests {
    use ecan_host::SlaveConfig;

    use super::*;

    #[test]
    fn gateways_are_placed_by_alias_and_position() {
        let mut adapter = AdapterConfig::new(0);
        for (alias, position) in [(7, 1), (0, 2), (5, 0), (7, 0)] {
            let slave = SlaveConfig { alias, ..SlaveConfig::at(position, 3) };
            adapter.slaves.push(slave).unwrap();
        }
        assert_eq!(place(&adapter), (vec![0, 0, 0, 5, 7, 0], vec![5, 2, 3, 4]));
    }
}
