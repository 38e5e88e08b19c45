//! Services of CANopen over a simulated gateway, with simulated drives.

mod bench;
mod guarding;
mod lss;
mod mpdo;
mod parameters;
mod pdo;
mod time;
