//! CANopen and CiA 402: `igh_cia402_protocol.h`.
