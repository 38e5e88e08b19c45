//! A program that calls the simulated library like a C program, on stepped time.

use std::ptr::null_mut;

use crate::ecrt_support::stepped;
use ecan_protocol::config::assignment_writes;
use ecan_protocol::image::PdoProfile;
use ecan_protocol::mapping::{Direction, data_object_index, pdo_map_index, sync_manager};
use ecan_protocol::object::{MAPPED_SUBINDEX, SdoWrite};
use ecan_sim::{
    ClockKind, Scenario, ScenarioChoice, SimOptions, Simulation, libethercat as c, simulate,
};
use ecrt_sys::{
    EC_DIR_INPUT, EC_DIR_OUTPUT, EC_WD_DEFAULT, ec_domain_state_t, ec_domain_t, ec_master_t,
    ec_pdo_entry_info_t, ec_pdo_entry_reg_t, ec_pdo_info_t, ec_slave_config_state_t,
    ec_slave_config_t, ec_slave_info_t, ec_sync_info_t, ec_watchdog_mode_t,
};

/// Longest wait for OP in cycles.
pub const PATIENCE: usize = 3_000;

/// The owner of a master with one slave in one domain.
pub struct CMaster {
    pub simulation: Simulation,
    pub master: *mut ec_master_t,
    pub config: *mut ec_slave_config_t,
    pub domain: *mut ec_domain_t,
    pub position: u16,
    pub vendor_id: u32,
    pub product_code: u32,
}

/// A sync manager of a list: its number and watchdog, its only PDO and the entries of the PDO.
pub type SyncManager = (u8, ec_watchdog_mode_t, u16, Vec<ec_pdo_entry_info_t>);

pub fn slave_info(master: *mut ec_master_t, position: u16) -> (i32, ec_slave_info_t) {
    let mut info = ec_slave_info_t::default();
    // SAFETY: the handle is the library's, the place is there.
    (unsafe { c::master_get_slave(master, position, &mut info) }, info)
}

/// The built-in scenario on stepped time.
pub fn stepped_echo() -> Simulation {
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    simulate(&ScenarioChoice::Suggested, &options).expect("the scenario is good")
}

impl CMaster {
    /// One gateway with one chunk in each direction.
    pub fn configured() -> Self {
        Self::with_chunks(stepped_echo())
    }

    /// The same in another world with one gateway.
    pub fn in_scenario(scenario: Scenario) -> Self {
        Self::with_chunks(stepped(scenario).simulation.expect("it is simulated"))
    }

    fn with_chunks(simulation: Simulation) -> Self {
        let owner = Self::of_slave(simulation, 0);
        owner.add_startup_sdos();
        let pdos = [Direction::RxPdo, Direction::TxPdo].map(|direction| {
            let entry = |unit| ec_pdo_entry_info_t {
                index: data_object_index(direction, 0, unit),
                subindex: MAPPED_SUBINDEX,
                bit_length: 128,
            };
            let entries = (0..8).map(entry).collect();
            (sync_manager(direction), EC_WD_DEFAULT, pdo_map_index(direction, 0), entries)
        });
        owner.set_pdos(pdos);
        owner
    }

    /// Requests the master, and creates a domain and the configuration of a slave.
    pub fn of_slave(simulation: Simulation, position: u16) -> Self {
        let master = c::request_master(&simulation, 0);
        assert!(!master.is_null());
        let (result, info) = slave_info(master, position);
        assert_eq!(result, 0);
        let (vendor_id, product_code) = (info.vendor_id, info.product_code);
        // SAFETY: the handle is the library's.
        let (config, domain) = unsafe {
            let config = c::master_slave_config(master, 0, position, vendor_id, product_code);
            (config, c::master_create_domain(master))
        };
        assert!(!config.is_null() && !domain.is_null());
        Self { simulation, master, config, domain, position, vendor_id, product_code }
    }

    fn add_startup_sdos(&self) {
        let profile = PdoProfile { multiplier: 1, ..PdoProfile::default() };
        let mut list: Vec<SdoWrite> = Vec::new();
        for direction in [Direction::RxPdo, Direction::TxPdo] {
            list.extend(assignment_writes(direction, 1));
        }
        for direction in [Direction::RxPdo, Direction::TxPdo] {
            list.extend(profile.writes(direction));
            list.push(PdoProfile::apply_write(direction));
        }
        for SdoWrite { index, subindex, value, ty } in list {
            // SAFETY: the handle is the library's.
            let result = unsafe {
                match ty.size_bytes() {
                    Some(1) => c::slave_config_sdo8(self.config, index, subindex, value as u8),
                    Some(2) => c::slave_config_sdo16(self.config, index, subindex, value as u16),
                    _ => c::slave_config_sdo32(self.config, index, subindex, value),
                }
            };
            assert_eq!(result, 0, "0x{index:04X}:{subindex:02X}");
        }
    }

    /// Sets the PDOs of outputs and inputs by one list.
    pub fn set_pdos(&self, mut pdos: [SyncManager; 2]) {
        let mut infos = pdos.each_mut().map(|(_, _, index, entries)| ec_pdo_info_t {
            index: *index,
            n_entries: entries.len() as u32,
            entries: entries.as_mut_ptr(),
        });
        let [outputs, inputs] = infos.each_mut().map(|info| &raw mut *info);
        let sync = |index, dir, pdos, watchdog_mode| ec_sync_info_t {
            index,
            dir,
            n_pdos: 1,
            pdos,
            watchdog_mode,
        };
        let syncs = [
            sync(pdos[0].0, EC_DIR_OUTPUT, outputs, pdos[0].1),
            sync(pdos[1].0, EC_DIR_INPUT, inputs, pdos[1].1),
            sync(0xFF, EC_DIR_INPUT, null_mut(), EC_WD_DEFAULT),
        ];
        // SAFETY: the handle is the library's, the lists have the given lengths and their end.
        let result = unsafe { c::slave_config_pdos(self.config, u32::MAX, syncs.as_ptr()) };
        assert_eq!(result, 0);
    }

    /// Registers the first entries of both directions; returns their offsets.
    pub fn register_by_list(&self) -> (i32, [u32; 2]) {
        let mut offsets = [u32::MAX; 2];
        let [outputs, inputs] = &mut offsets;
        let entry = |index, offset: *mut u32| ec_pdo_entry_reg_t {
            alias: 0,
            position: self.position,
            vendor_id: self.vendor_id,
            product_code: self.product_code,
            index,
            subindex: MAPPED_SUBINDEX,
            offset,
            bit_position: null_mut(),
        };
        let list = [entry(0x7000, outputs), entry(0x6000, inputs), entry(0, null_mut())];
        // SAFETY: the list ends with index 0, the places are there.
        let result = unsafe { c::domain_reg_pdo_entry_list(self.domain, list.as_ptr()) };
        (result, offsets)
    }

    pub fn activate(&self) {
        // SAFETY: the handle is the library's.
        assert_eq!(unsafe { c::master_activate(self.master) }, 0);
    }

    pub fn cycle(&self) {
        self.cycle_with(|| {});
    }

    /// One cycle, which writes outputs between receive and send.
    pub fn cycle_with(&self, write_outputs: impl FnOnce()) -> ec_domain_state_t {
        let mut state = ec_domain_state_t::default();
        // SAFETY: the handles are the library's, the place is there.
        unsafe {
            assert_eq!(c::master_receive(self.master), 0);
            assert_eq!(c::domain_process(self.domain), 0);
            assert_eq!(c::domain_state(self.domain, &mut state), 0);
            write_outputs();
            assert_eq!(c::domain_queue(self.domain), 0);
            assert_eq!(c::master_send(self.master), 0);
        }
        self.simulation.pass_ns(1_000_000);
        state
    }

    pub fn state(&self) -> ec_slave_config_state_t {
        let mut state = ec_slave_config_state_t::default();
        // SAFETY: the handle is the library's, the pointer is valid.
        assert_eq!(unsafe { c::slave_config_state(self.config, &mut state) }, 0);
        state
    }

    /// Runs cycles; returns whether the slave reaches OP.
    pub fn reaches_op(&self) -> bool {
        (0..PATIENCE).any(|_| {
            self.cycle();
            self.state().operational() == 1
        })
    }

    /// AL state and error flag of a slave that does not reach OP.
    pub fn ends_without_op(&self) -> (u8, bool) {
        assert!(!self.reaches_op());
        let (result, info) = slave_info(self.master, self.position);
        assert_eq!(result, 0);
        (info.al_state, info.error_flag == 1)
    }

    pub fn log(&self) -> String {
        self.simulation.kernel_log().join("\n")
    }
}
