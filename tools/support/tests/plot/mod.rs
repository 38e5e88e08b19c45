//! Pictures.

mod pictures;
