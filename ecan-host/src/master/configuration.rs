//! What is created from a master before activation: domains, slave configurations, requests, clocks.

use std::ptr::NonNull;

use ecrt_sys::{
    EC_DIR_INPUT, EC_DIR_OUTPUT, EC_WD_DEFAULT, EC_WD_DISABLE, EC_WD_ENABLE, Errno,
    ec_slave_config_state_t, status,
};
use libc::c_int;

use super::handle::{Domain, Master};
use super::raw::{Answer, DomainId, RegRequestId, SdoRequestId, SlaveConfigId};

/// Declares methods that pass their arguments to a function of the library, about a slave
/// configuration or about the master. `status`: a function that returns nothing in version 1.5.
macro_rules! library_calls {
    ($(
        $(#[$meta:meta])*
        $about:ident fn $name:ident($($argument:ident: $type:ty),*) = $kind:ident $function:ident;
    )+) => { $(
        library_calls!(@$about [$(#[$meta])*] $name($($argument: $type),*) $kind $function);
    )+ };
    (@config [$($meta:tt)*] $name:ident($($argument:ident: $type:ty),*) $kind:ident $f:ident) => {
        $($meta)*
        pub fn $name(&mut self, config: SlaveConfigId, $($argument: $type),*) -> Result<(), Errno> {
            let raw = self.slave_config_raw(config)?;
            // SAFETY: the configuration belongs to this master and is current, so it is valid.
            Errno::check(unsafe {
                library_calls!(@$kind self.ecrt.functions().$f, raw $(, $argument)*)
            })
        }
    };
    (@master [$($meta:tt)*] $name:ident($($argument:ident: $type:ty),*) $kind:ident $f:ident) => {
        $($meta)*
        pub fn $name(&mut self, $($argument: $type),*) -> Result<(), Errno> {
            // SAFETY: the master is valid as long as `self`.
            Errno::check(unsafe {
                library_calls!(@$kind self.ecrt.functions().$f, self.raw.as_ptr() $(, $argument)*)
            })
        }
    };
    (@status $function:expr, $($argument:expr),+) => { status!($function, $($argument),+) };
    (@direct $function:expr, $($argument:expr),+) => { ($function)($($argument),+) };
}

/// Direction of a sync manager, seen from the master.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SyncDirection {
    /// Master to slave.
    Output,
    /// Slave to master.
    Input,
}

/// Watchdog of a sync manager.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum WatchdogMode {
    /// As in the EEPROM.
    Default,
    /// Enabled.
    Enable,
    /// Disabled.
    Disable,
}

/// State of a configured slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlaveConfigState {
    /// The slave was found.
    pub online: bool,
    /// The slave reached OP with this configuration.
    pub operational: bool,
    /// AL state: 1 INIT, 2 PREOP, 4 SAFEOP, 8 OP.
    pub al_state: u8,
}

impl Master {
    /// Creates a domain. Before activation.
    pub fn create_domain(&mut self) -> Result<DomainId, Errno> {
        Errno::clear_last();
        // SAFETY: the master is valid as long as `self`.
        let raw = unsafe { (self.ecrt.functions().master_create_domain)(self.raw.as_ptr()) };
        let raw = NonNull::new(raw).ok_or_else(Errno::of_null)?;
        let id = DomainId { generation: self.generation, index: self.domains.len() };
        self.domains.push(Domain::new(raw));
        Ok(id)
    }

    /// Creates the configuration of the slave at `position` after `alias` (0: from the first
    /// slave on). Before activation.
    ///
    /// # Errors
    /// If that address was configured before with another identity.
    pub fn slave_config(
        &mut self,
        alias: u16,
        position: u16,
        vendor_id: u32,
        product_code: u32,
    ) -> Result<SlaveConfigId, Errno> {
        Errno::clear_last();
        // SAFETY: the master is valid as long as `self`.
        let raw = unsafe {
            (self.ecrt.functions().master_slave_config)(
                self.raw.as_ptr(),
                alias,
                position,
                vendor_id,
                product_code,
            )
        };
        let raw = NonNull::new(raw).ok_or_else(Errno::of_null)?;
        let id = SlaveConfigId { generation: self.generation, index: self.slave_configs.len() };
        self.slave_configs.push(raw);
        Ok(id)
    }

    /// Sets direction and watchdog of a sync manager.
    ///
    /// # Errors
    /// `ENOENT` for a sync manager above 15.
    pub fn config_sync_manager(
        &mut self,
        config: SlaveConfigId,
        sync: u8,
        direction: SyncDirection,
        watchdog: WatchdogMode,
    ) -> Result<(), Errno> {
        let raw = self.slave_config_raw(config)?;
        let direction = match direction {
            SyncDirection::Output => EC_DIR_OUTPUT,
            SyncDirection::Input => EC_DIR_INPUT,
        };
        let watchdog = match watchdog {
            WatchdogMode::Default => EC_WD_DEFAULT,
            WatchdogMode::Enable => EC_WD_ENABLE,
            WatchdogMode::Disable => EC_WD_DISABLE,
        };
        // SAFETY: the configuration belongs to this master and is current, so it is valid.
        Errno::check(unsafe {
            (self.ecrt.functions().slave_config_sync_manager)(raw, sync, direction, watchdog)
        })
    }

    library_calls! {
        /// Empties a sync manager's PDO assignment.
        config fn config_pdo_assign_clear(sync: u8) = status slave_config_pdo_assign_clear;

        /// Adds a PDO to a sync manager's assignment.
        ///
        /// # Errors
        /// `EEXIST` for a PDO assigned before.
        config fn config_pdo_assign_add(sync: u8, pdo_index: u16)
            = direct slave_config_pdo_assign_add;

        /// Empties a PDO's mapping.
        config fn config_pdo_mapping_clear(pdo_index: u16)
            = status slave_config_pdo_mapping_clear;

        /// Adds an entry to a PDO's mapping.
        ///
        /// # Errors
        /// `ENOENT` for a PDO that is not assigned.
        config fn config_pdo_mapping_add(
            pdo_index: u16, entry_index: u16, entry_subindex: u8, entry_bits: u8
        ) = direct slave_config_pdo_mapping_add;

        /// Sets divider and intervals of the slave's watchdog, in the units of its registers
        /// 0x0400 and 0x0420; 0 leaves the register alone.
        config fn config_watchdog(divider: u16, intervals: u16) = status slave_config_watchdog;

        /// Sets the slave's distributed clocks: the AssignActivate word, cycle and shift of Sync0
        /// and Sync1, ns.
        config fn config_dc(
            assign_activate: u16, sync0_cycle_ns: u32, sync0_shift_ns: i32,
            sync1_cycle_ns: u32, sync1_shift_ns: i32
        ) = status slave_config_dc;
    }

    /// Registers an object to be written at every start of the slave, in the order of these
    /// calls, before the master writes the PDO assignment.
    ///
    /// # Errors
    /// `EINVAL` for an empty value.
    pub fn config_sdo(
        &mut self,
        config: SlaveConfigId,
        index: u16,
        subindex: u8,
        data: &[u8],
    ) -> Result<(), Errno> {
        let raw = self.slave_config_raw(config)?;
        // SAFETY: as in `config_sync_manager`; data and its length belong together, and the
        // library copies them.
        Errno::check(unsafe {
            (self.ecrt.functions().slave_config_sdo)(
                raw,
                index,
                subindex,
                data.as_ptr(),
                data.len(),
            )
        })
    }

    /// Puts a PDO entry of the slave, and with it the whole sync manager, into a domain.
    /// Returns the entry's offset there, bytes.
    ///
    /// # Errors
    /// `ENOENT` for an entry that is not mapped, `ERANGE` (or what the library returns) for one
    /// that does not begin at a byte.
    pub fn config_reg_pdo_entry(
        &mut self,
        config: SlaveConfigId,
        entry_index: u16,
        entry_subindex: u8,
        domain: DomainId,
    ) -> Result<usize, Errno> {
        let raw = self.slave_config_raw(config)?;
        let domain = self.domain_raw(domain)?;
        // SAFETY: configuration and domain belong to this master and are current; a null bit
        // position restricts the library to entries at byte boundaries.
        let offset: c_int = unsafe {
            (self.ecrt.functions().slave_config_reg_pdo_entry)(
                raw,
                entry_index,
                entry_subindex,
                domain,
                std::ptr::null_mut(),
            )
        };
        Errno::check(offset)?;
        usize::try_from(offset).map_err(|_| Errno::ERANGE)
    }

    /// Sets the size of the queue of CoE emergencies of the slave. Before activation.
    ///
    /// # Errors
    /// `ENOSYS` if the library lacks the function.
    pub fn config_emergencies(&mut self, config: SlaveConfigId, count: usize) -> Result<(), Errno> {
        let function = self.ecrt.functions().slave_config_emerg_size.ok_or(Errno::ENOSYS)?;
        let raw = self.slave_config_raw(config)?;
        // SAFETY: as in `config_sync_manager`.
        Errno::check(unsafe { function(raw, count) })
    }

    /// Takes a CoE emergency that the master received with another mailbox response: error code, error register,
    /// data. Without one, the library also writes a line to stderr.
    ///
    /// # Errors
    /// `ENOENT` without one, `ENOSYS` if the library lacks the function.
    pub fn take_emergency(&mut self, config: SlaveConfigId) -> Result<[u8; 8], Errno> {
        let function = self.ecrt.functions().slave_config_emerg_pop.ok_or(Errno::ENOSYS)?;
        let raw = self.slave_config_raw(config)?;
        let mut message = [0; 8];
        // SAFETY: as in `config_sync_manager`; an emergency has 8 bytes.
        Errno::check(unsafe { function(raw, message.as_mut_ptr()) }).map(|()| message)
    }

    /// State of a slave configuration; lags the bus by seconds. Real-time safe.
    pub fn config_state(&self, config: SlaveConfigId) -> Result<SlaveConfigState, Errno> {
        let raw = self.slave_config_raw(config)?;
        let mut answer = Answer::<ec_slave_config_state_t>::new();
        // SAFETY: as in `config_sync_manager`; the target is writable.
        let status =
            unsafe { status!(self.ecrt.functions().slave_config_state, raw, answer.target()) };
        Errno::check(status)?;
        Ok(SlaveConfigState {
            online: answer.value.online() != 0,
            operational: answer.value.operational() != 0,
            al_state: answer.value.al_state() as u8,
        })
    }

    /// Creates a request for an object of `size` bytes. Before activation.
    ///
    /// A write always has the size that the request holds: the `size` given here, and after a
    /// read the size that was read. So make one request for each size that is to be written.
    pub fn create_sdo_request(
        &mut self,
        config: SlaveConfigId,
        index: u16,
        subindex: u8,
        size: usize,
    ) -> Result<SdoRequestId, Errno> {
        let config = self.slave_config_raw(config)?;
        Errno::clear_last();
        // SAFETY: the configuration belongs to this master and is current, so it is valid.
        let raw = unsafe {
            (self.ecrt.functions().slave_config_create_sdo_request)(config, index, subindex, size)
        };
        let raw = NonNull::new(raw).ok_or_else(Errno::of_null)?;
        let functions = self.ecrt.functions();
        // SAFETY: the request was just made.
        let (data, held) = unsafe {
            (
                (functions.sdo_request_data)(raw.as_ptr()),
                (functions.sdo_request_data_size)(raw.as_ptr()),
            )
        };
        if !data.is_null() {
            // SAFETY: the request holds `held` bytes there, which nobody uses yet. The library
            // leaves them as the allocator gave them; zeroed, they may be read.
            unsafe { std::ptr::write_bytes(data, 0, held) };
        }
        Ok(self.requests.add_sdo(self.generation, raw))
    }

    /// Creates a request for registers of the slave, up to `size` bytes. Before activation.
    pub fn create_reg_request(
        &mut self,
        config: SlaveConfigId,
        size: usize,
    ) -> Result<RegRequestId, Errno> {
        let raw_config = self.slave_config_raw(config)?;
        let functions = self.ecrt.functions();
        Errno::clear_last();
        // SAFETY: the configuration belongs to this master and is current, so it is valid.
        let raw = unsafe { (functions.slave_config_create_reg_request)(raw_config, size) };
        let raw = NonNull::new(raw).ok_or_else(Errno::of_null)?;
        // SAFETY: the request was just made.
        let data = unsafe { (functions.reg_request_data)(raw.as_ptr()) };
        if !data.is_null() {
            // SAFETY: the request holds `size` bytes there, which nobody uses yet. The library
            // leaves them as the allocator gave them; zeroed, they may be read.
            unsafe { std::ptr::write_bytes(data, 0, size) };
        }
        Ok(self.requests.add_register(self.generation, raw, raw_config, size))
    }

    /// Chooses the slave whose clock all others follow; `None` for the first that has one.
    /// Before activation.
    pub fn select_reference_clock(&mut self, config: Option<SlaveConfigId>) -> Result<(), Errno> {
        let config = match config {
            Some(id) => self.slave_config_raw(id)?,
            None => std::ptr::null_mut(),
        };
        // SAFETY: master and configuration are valid and belong together; null is allowed.
        Errno::check(unsafe {
            (self.ecrt.functions().master_select_reference_clock)(self.raw.as_ptr(), config)
        })
    }

    library_calls! {
        /// Sets the application time, ns since 2000-01-01; every cycle, before the clocks are
        /// synchronised. Real-time safe.
        master fn application_time(time_ns: u64) = status master_application_time;

        /// Queues the reference clock's correction to the application time. Real-time safe.
        ///
        /// # Errors
        /// `ENXIO` without a reference clock.
        master fn sync_reference_clock() = status master_sync_reference_clock;

        /// Queues the other clocks' correction to the reference clock. Real-time safe.
        master fn sync_slave_clocks() = status master_sync_slave_clocks;

        /// Queues the measurement of how far the clocks differ. Real-time safe.
        master fn sync_monitor_queue() = status master_sync_monitor_queue;
    }

    /// Queues the reference clock's correction to `time_ns`. Real-time safe.
    ///
    /// # Errors
    /// `ENOSYS` before 1.5.3.
    pub fn sync_reference_clock_to(&mut self, time_ns: u64) -> Result<(), Errno> {
        let function = self.ecrt.functions().master_sync_reference_clock_to;
        let function = function.ok_or(Errno::ENOSYS)?;
        // SAFETY: the master is valid as long as `self`.
        Errno::check(unsafe { status!(function, self.raw.as_ptr(), time_ns) })
    }

    /// Lower half of the reference clock's time at the last exchange, ns. Real-time safe, but only after
    /// an exchange that arrived: otherwise the library writes to stderr.
    ///
    /// # Errors
    /// `ENXIO` without a reference clock, `EIO` when the exchange was lost.
    pub fn reference_clock_time(&self) -> Result<u32, Errno> {
        let mut time_ns = 0;
        // SAFETY: the master is valid as long as `self`, the target is writable.
        let status = unsafe {
            (self.ecrt.functions().master_reference_clock_time)(self.raw.as_ptr(), &mut time_ns)
        };
        Errno::check(status)?;
        Ok(time_ns)
    }

    /// The largest difference of a clock to the reference clock, ns, as measured last. Real-time safe,
    /// but only after an exchange that arrived: otherwise the library writes to stderr.
    ///
    /// # Errors
    /// `EIO` when the measurement did not arrive.
    pub fn sync_monitor_process(&mut self) -> Result<u32, Errno> {
        // SAFETY: the master is valid as long as `self`.
        let difference =
            unsafe { (self.ecrt.functions().master_sync_monitor_process)(self.raw.as_ptr()) };
        match difference {
            u32::MAX => Err(Errno::EIO),
            difference => Ok(difference),
        }
    }
}
