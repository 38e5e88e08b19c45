//! The programs `ecan` and `ecan-sim` run as a user runs them, on simulated buses.
#![allow(missing_docs, clippy::disallowed_macros, clippy::disallowed_methods)]

mod support;

mod axis;
mod axis_of_file;
mod axis_terminal;
mod bridge;
mod bus_symptoms;
mod capture;
mod config;
mod config_schema;
mod crowd;
mod diagnosis;
mod dump;
#[path = "../ecan_sim/mod.rs"]
mod ecan_sim;
mod every_command;
mod fake_ethercat;
mod firmware;
mod frames_config;
mod frames_end;
mod frames_files;
mod host;
mod hostile_names;
mod maintenance;
mod metrics;
mod monitor;
mod monitor_service;
mod monitor_terminal;
mod new;
mod node;
mod node_lss;
mod node_objects;
mod node_params;
mod node_python;
mod node_service;
mod objects;
mod other_slaves;
mod probe;
mod python_can;
mod python_recordings;
mod reconfigure;
mod screens;
mod selftest;
mod selftest_service;
mod send;
mod serve;
mod serve_daemon;
mod service_failures;
mod setup_host;
mod signals;
mod sii_sm_layout;
mod sim;
mod socketcan;
mod timed_reader;
mod via;
#[cfg(feature = "zenoh")]
mod zenoh;
