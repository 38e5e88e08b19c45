//! Configuration
//!
//! Plain data: it may be copied and needs no end. igh_mcan_port_apply_config() hands it to the
//! Adapter's configuration, whose startup SDOs it then decides.

use std::ffi::c_int;

use ecan_mcan_host::boundary::{Call, Opaque, Sealed, call};
use ecan_mcan_host::common::constants::ECAN_MCAN_CHANNELS;
use ecan_mcan_host::common::result::ecan_result_t;
use ecan_mcan_port::{
    AcceptanceFilter, ChannelConfig, ChannelFilter, GatewayConfig, PortConfig, PortError,
    ScheduleConfig, Traffic,
};
use ecan_protocol::config::{DataPathConfig, List, McanChannelConfig};
use ecan_protocol::image::{BudgetPolicy, EncapsulationProfile, OptionFlags};

use crate::adapter::config::{ECAN_IGH_MAX_SLAVES, ecan_igh_config_t};
use crate::errors::{OrCode as _, no_slave};

/// Most filters of a configuration, of all channels together.
pub const IGH_MCAN_MAX_FILTERS: usize = 512;

/// What the Port is told about the gateways. About 40 kilobytes.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct igh_mcan_port_config_t {
    /// Not for the application.
    pub opaque: [u64; 5120],
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct ChannelPlain {
    pub(crate) can: McanChannelConfig,
    pub(crate) data_path: DataPathConfig,
    pub(crate) traffic: Traffic,
}

impl From<&ChannelConfig> for ChannelPlain {
    fn from(settings: &ChannelConfig) -> Self {
        let ChannelConfig { can, data_path, traffic } = *settings;
        Self { can, data_path, traffic }
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct GatewayPlain {
    pub(crate) channels: [Option<ChannelPlain>; ECAN_MCAN_CHANNELS],
    pub(crate) tx_encapsulation: EncapsulationProfile,
    pub(crate) rx_encapsulation: EncapsulationProfile,
    pub(crate) tx_budget: BudgetPolicy,
    pub(crate) rx_budget: BudgetPolicy,
    pub(crate) tx_options: OptionFlags,
    pub(crate) rx_options: OptionFlags,
    pub(crate) paced: bool,
    pub(crate) hold_limit: u16,
    pub(crate) input_limit: u16,
    pub(crate) schedule: ScheduleConfig,
    pub(crate) allow_diagnostic_tests: bool,
}

/// What is in an [`igh_mcan_port_config_t`].
#[derive(Clone, Copy)]
pub(crate) struct PortPlain {
    pub(crate) gateways: [GatewayPlain; ECAN_IGH_MAX_SLAVES],
    /// With slave and channel; in order.
    pub(crate) filters: [Option<(u16, u8, AcceptanceFilter)>; IGH_MCAN_MAX_FILTERS],
}

impl Opaque for igh_mcan_port_config_t {
    type Value = PortPlain;
    const SEAL: u64 = 0x6d63_616e_5f63_6667;
    const INIT: &'static str = "igh_mcan_port_default_config";
}

impl PortPlain {
    fn new() -> Self {
        let gateway = GatewayPlain::of(&GatewayConfig::default());
        Self { gateways: [gateway; ECAN_IGH_MAX_SLAVES], filters: [None; IGH_MCAN_MAX_FILTERS] }
    }

    /// What a Port's configuration says.
    ///
    /// # Errors
    /// More gateways or filters than there is room for.
    pub(crate) fn of(call: Call, config: &PortConfig) -> Result<Self, ecan_result_t> {
        let PortConfig { gateways, filters } = config;
        let mut plain = Self::new();
        let full = |what, count, most| {
            let text = format_args!("{count} {what}, {most} are the most");
            Err(call.fail(ecan_result_t::ECAN_ERR_FULL, text))
        };
        if gateways.len() > ECAN_IGH_MAX_SLAVES {
            return full("gateways", gateways.len(), ECAN_IGH_MAX_SLAVES);
        }
        for (place, gateway) in plain.gateways.iter_mut().zip(gateways) {
            *place = GatewayPlain::of(gateway);
        }
        if filters.len() > IGH_MCAN_MAX_FILTERS {
            return full("filters", filters.len(), IGH_MCAN_MAX_FILTERS);
        }
        for (place, filter) in plain.filters.iter_mut().zip(filters) {
            *place = Some((filter.slave as u16, filter.channel, filter.filter));
        }
        Ok(plain)
    }

    /// The configuration of C, to be changed.
    ///
    /// # Safety
    /// As for [`Sealed::change`].
    pub(crate) unsafe fn open<'a>(
        call: Call,
        config: *mut igh_mcan_port_config_t,
    ) -> Result<&'a mut Self, ecan_result_t> {
        // SAFETY: the caller's promise.
        unsafe { Sealed::change(call, "config", config) }
    }

    /// The configuration of C.
    ///
    /// # Safety
    /// As for [`Sealed::read`].
    pub(crate) unsafe fn read<'a>(
        call: Call,
        config: *const igh_mcan_port_config_t,
    ) -> Result<&'a Self, ecan_result_t> {
        // SAFETY: the caller's promise.
        unsafe { Sealed::read(call, "config", config) }
    }

    /// A gateway that a configuration may have.
    pub(crate) fn gateway(
        &mut self,
        call: Call,
        slave: usize,
    ) -> Result<&mut GatewayPlain, ecan_result_t> {
        let gateway = self.gateways.get_mut(slave);
        gateway.ok_or_else(|| no_slave(call, slave, ECAN_IGH_MAX_SLAVES))
    }

    /// A gateway that a configuration may have, to be looked at.
    pub(crate) fn gateway_of(
        &self,
        call: Call,
        slave: usize,
    ) -> Result<&GatewayPlain, ecan_result_t> {
        let gateway = self.gateways.get(slave);
        gateway.ok_or_else(|| no_slave(call, slave, ECAN_IGH_MAX_SLAVES))
    }

    /// A channel that is enabled, to be looked at.
    pub(crate) fn channel_of(
        &self,
        call: Call,
        slave: usize,
        channel: u8,
    ) -> Result<&ChannelPlain, ecan_result_t> {
        let gateway = self.gateway_of(call, slave)?;
        let place = gateway.channels.get(usize::from(channel)).and_then(Option::as_ref);
        place.ok_or_else(|| not_enabled(call, slave, channel))
    }

    /// A channel that is enabled.
    pub(crate) fn channel(
        &mut self,
        call: Call,
        slave: usize,
        channel: u8,
    ) -> Result<&mut ChannelPlain, ecan_result_t> {
        let place = self.gateway(call, slave)?.place(call, channel)?;
        place.as_mut().ok_or_else(|| not_enabled(call, slave, channel))
    }

    /// As the Port takes it, of the first `count` gateways.
    pub(crate) fn settings(&self, count: usize) -> PortConfig {
        let gateways = self.gateways.iter().take(count).map(GatewayPlain::settings);
        let filters = self.filters.iter().flatten().map(|(slave, channel, filter)| ChannelFilter {
            slave: usize::from(*slave),
            channel: *channel,
            filter: *filter,
        });
        // infallible: the capacities are the same
        PortConfig {
            gateways: List::collect(gateways).unwrap_or_default(),
            filters: List::collect(filters).unwrap_or_default(),
        }
    }
}

#[cold]
fn not_enabled(call: Call, slave: usize, channel: u8) -> ecan_result_t {
    let text = format_args!("channel {channel} of slave {slave} is not enabled");
    call.fail(ecan_result_t::ECAN_ERR_CHANNEL, text)
}

impl GatewayPlain {
    /// Without the filters.
    fn of(config: &GatewayConfig) -> Self {
        let GatewayConfig {
            ref channels,
            tx_encapsulation,
            rx_encapsulation,
            tx_budget,
            rx_budget,
            tx_options,
            rx_options,
            paced,
            hold_limit,
            input_limit,
            schedule,
            allow_diagnostic_tests,
        } = *config;
        Self {
            channels: channels.each_ref().map(|channel| channel.as_ref().map(ChannelPlain::from)),
            tx_encapsulation,
            rx_encapsulation,
            tx_budget,
            rx_budget,
            tx_options,
            rx_options,
            paced,
            hold_limit,
            input_limit,
            schedule,
            allow_diagnostic_tests,
        }
    }

    /// The place of a channel.
    pub(crate) fn place(
        &mut self,
        call: Call,
        channel: u8,
    ) -> Result<&mut Option<ChannelPlain>, ecan_result_t> {
        self.channels.get_mut(usize::from(channel)).ok_or_else(|| {
            let text = format_args!("channel {channel} is not 0 to {}", ECAN_MCAN_CHANNELS - 1);
            call.fail(ecan_result_t::ECAN_ERR_CHANNEL, text)
        })
    }

    fn settings(&self) -> GatewayConfig {
        let channel = |plain: Option<ChannelPlain>| {
            plain.map(|ChannelPlain { can, data_path, traffic }| ChannelConfig {
                can,
                data_path,
                traffic,
            })
        };
        GatewayConfig {
            channels: self.channels.map(channel),
            tx_encapsulation: self.tx_encapsulation,
            rx_encapsulation: self.rx_encapsulation,
            tx_budget: self.tx_budget,
            rx_budget: self.rx_budget,
            tx_options: self.tx_options,
            rx_options: self.rx_options,
            paced: self.paced,
            hold_limit: self.hold_limit,
            input_limit: self.input_limit,
            schedule: self.schedule,
            allow_diagnostic_tests: self.allow_diagnostic_tests,
        }
    }
}

/// Fills a configuration: no channel enabled, encapsulation 0, no options, frames paced.
///
/// @param config  Is overwritten, whatever it holds.
///
/// @usage   not rt, any thread, any time
/// @return  ECAN_OK or ECAN_ERR_NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_default_config(
    config: *mut igh_mcan_port_config_t,
) -> c_int {
    call("igh_mcan_port_default_config", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        unsafe { Sealed::init(call, "config", config, PortPlain::new()) }
    })
}

/// Hands a configuration to the Adapter's: ecan_igh_init() then writes PDO profiles, channel masks,
/// bit rates, filters and budgets as startup SDOs (manual 15.5.2, step 4). Is copied; call it again
/// after changing something. The gateways of the first slave_count slaves are taken.
///
/// Without this call the gateways keep what they were told last; a Port then verifies that it is
/// what its own configuration says.
///
/// @usage   not rt, any thread, before ecan_igh_init
/// @return  ECAN_OK; ECAN_ERR_CONFIG with every fault in ecan_last_error(); ECAN_ERR_NULL,
///          ECAN_ERR_NOT_INITIALISED.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_apply_config(
    igh_config: *mut ecan_igh_config_t,
    config: *const igh_mcan_port_config_t,
) -> c_int {
    call("igh_mcan_port_apply_config", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (adapter, port) = unsafe {
            (Sealed::change(call, "config", igh_config)?, PortPlain::read(call, config)?)
        };
        let slaves = adapter.slave_count;
        let checked = port.settings(slaves).check(&adapter.to_rust());
        checked.map_err(PortError::from).or_code(call)?;
        adapter.port = Some(*port);
        Ok(())
    })
}

/// Checks a configuration as a whole against that of the Adapter. igh_mcan_port_apply_config() and
/// igh_mcan_port_init() do it, too.
///
/// @usage   not rt, any thread, any time
/// @return  As igh_mcan_port_apply_config().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_check_config(
    igh_config: *const ecan_igh_config_t,
    config: *const igh_mcan_port_config_t,
) -> c_int {
    call("igh_mcan_port_check_config", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (adapter, port) =
            unsafe { (Sealed::read(call, "config", igh_config)?, PortPlain::read(call, config)?) };
        let checked = port.settings(adapter.slave_count).check(&adapter.to_rust());
        checked.map_err(PortError::from).or_code(call)
    })
}
