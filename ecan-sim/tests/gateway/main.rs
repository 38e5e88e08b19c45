//! Tests of the simulated gateway.

mod access_rules;
mod al_states;
mod bus_off;
mod channel_config;
mod eeprom;
mod example_image;
mod firmware_update;
mod fixture;
mod flash;
mod input_budget;
mod maintenance;
mod pdo_errors;
mod profile_status;
mod receive_path;
mod register_service;
mod repeats;
mod robustness;
mod schedule;
mod sync0_window;
mod sync_managers;
mod test_policies;
mod transmit_path;
mod tx_results;
mod variant_bit_timing;
mod variant_data_path;
mod variant_objects;
