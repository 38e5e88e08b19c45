//! Tests of the mailbox services, byte by byte and by property.
