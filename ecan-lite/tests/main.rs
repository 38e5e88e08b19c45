//! Tests of the configuration file and of programs that use it.

mod config_file;
mod programs;
