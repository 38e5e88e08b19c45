//! A program that calls the simulated library like a C program, on stepped time.

use std::ptr::null_mut;

use ecan_protocol::config::assignment_writes;
use ecan_protocol::image::PdoProfile;
use ecan_protocol::mapping::{Direction, data_object_index, pdo_map_index, sync_manager};
use ecan_protocol::object::{MAPPED_SUBINDEX, SdoWrite};
use ecan_sim::{
    ClockKind, Scenario, ScenarioChoice, SimOptions, Simulation, libethercat as c, open_scenario,
    simulate,
};
use ecrt_sys::{
    EC_DIR_INPUT, EC_DIR_OUTPUT, EC_WD_DEFAULT, ec_domain_t, ec_master_t, ec_pdo_entry_info_t,
    ec_pdo_entry_reg_t, ec_pdo_info_t, ec_slave_config_state_t, ec_slave_config_t, ec_slave_info_t,
    ec_sync_info_t,
};

/// Longest wait for OP in cycles.
const PATIENCE: usize = 3_000;

/// One gateway with one chunk in each direction, configured by lists.
pub struct CMaster {
    pub simulation: Simulation,
    pub master: *mut ec_master_t,
    pub config: *mut ec_slave_config_t,
    pub domain: *mut ec_domain_t,
    pub vendor_id: u32,
    pub product_code: u32,
}

/// The built-in scenario on stepped time.
pub fn stepped_echo() -> Simulation {
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    simulate(&ScenarioChoice::Suggested, &options).expect("the scenario is good")
}

impl CMaster {
    /// Requests the master and configures the slave at position 0.
    pub fn configured() -> Self {
        Self::on(stepped_echo())
    }

    /// The same in another world with one gateway.
    pub fn in_scenario(scenario: Scenario) -> Self {
        let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
        let backend = open_scenario(scenario, &options).expect("the scenario is good");
        Self::on(backend.simulation.expect("it is simulated"))
    }

    fn on(simulation: Simulation) -> Self {
        let master = c::request_master(&simulation, 0);
        assert!(!master.is_null());
        let mut info = ec_slave_info_t::default();
        // SAFETY: the handles are the library's, the places are there.
        let (config, domain) = unsafe {
            assert_eq!(c::master_get_slave(master, 0, &mut info), 0);
            let (vendor, product) = (info.vendor_id, info.product_code);
            (c::master_slave_config(master, 0, 0, vendor, product), c::master_create_domain(master))
        };
        assert!(!config.is_null() && !domain.is_null());
        let (vendor_id, product_code) = (info.vendor_id, info.product_code);
        let made = Self { simulation, master, config, domain, vendor_id, product_code };
        made.add_startup_sdos();
        made.set_pdos();
        made
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

    fn set_pdos(&self) {
        let directions = [(Direction::RxPdo, EC_DIR_OUTPUT), (Direction::TxPdo, EC_DIR_INPUT)];
        let lists = directions.map(|(direction, dir)| {
            let entries: Vec<_> = (0..8)
                .map(|unit| ec_pdo_entry_info_t {
                    index: data_object_index(direction, 0, unit),
                    subindex: MAPPED_SUBINDEX,
                    bit_length: 128,
                })
                .collect();
            ((direction, dir), entries)
        });
        for ((direction, dir), mut entries) in lists {
            let mut pdo = ec_pdo_info_t {
                index: pdo_map_index(direction, 0),
                n_entries: 8,
                entries: entries.as_mut_ptr(),
            };
            let sync = ec_sync_info_t {
                index: sync_manager(direction),
                dir,
                n_pdos: 1,
                pdos: &mut pdo,
                watchdog_mode: EC_WD_DEFAULT,
            };
            let end = ec_sync_info_t { index: 0xFF, ..sync };
            // SAFETY: the lists have the given lengths, and the second one is the end.
            let result =
                unsafe { c::slave_config_pdos(self.config, u32::MAX, [sync, end].as_ptr()) };
            assert_eq!(result, 0);
        }
    }

    /// Registers the first entries of both directions; returns their offsets.
    pub fn register_by_list(&self) -> (i32, [u32; 2]) {
        let mut offsets = [u32::MAX; 2];
        let [outputs, inputs] = &mut offsets;
        let entry = |index, offset: *mut u32| ec_pdo_entry_reg_t {
            alias: 0,
            position: 0,
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
        // SAFETY: the handles are the library's.
        unsafe {
            assert_eq!(c::master_receive(self.master), 0);
            assert_eq!(c::domain_process(self.domain), 0);
            assert_eq!(c::domain_queue(self.domain), 0);
            assert_eq!(c::master_send(self.master), 0);
        }
        self.simulation.pass_ns(1_000_000);
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
        let mut info = ec_slave_info_t::default();
        // SAFETY: the handle is the library's, the pointer is valid.
        assert_eq!(unsafe { c::master_get_slave(self.master, 0, &mut info) }, 0);
        (info.al_state, info.error_flag == 1)
    }

    pub fn log(&self) -> String {
        self.simulation.kernel_log().join("\n")
    }
}
