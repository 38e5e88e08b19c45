//! Tests of the configuration file.

mod common;
mod network_files;

mod axis_names;
mod channel_masks;
mod device;
mod device_file_limits;
mod device_profile;
mod network_from_files;
mod reading;
mod reading_axes;
mod reading_bus_yml;
mod reading_nodes;
mod warnings;
