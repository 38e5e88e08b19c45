//! DBC files: what is decoded with them can be encoded.
#![no_main]

use ecan_can_io::dbc::Database;
use ecan_protocol::can::CanFrame;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let database = match Database::parse(data) {
        Ok(database) => database,
        Err(faults) => return assert!(faults.0.iter().all(|fault| fault.line >= 1)),
    };
    // The end of the file is the data of a frame.
    let bytes = data.len().saturating_sub(64);
    for message in database.messages().iter().take(8) {
        let tail = data.get(bytes..).unwrap_or_default();
        let Some(data) = tail.get(..message.length) else { continue };
        let Ok(frame) = CanFrame::fd(message.id, data, false, false) else { continue };
        let decoded = database.decode(&frame).expect("a message of the file");
        assert_eq!(decoded.missing, 0);
        let values: Vec<_> = decoded
            .signals
            .iter()
            .map(|decoded| (decoded.signal.name.as_str(), decoded.value.to_string()))
            .collect();
        let values: Vec<_> = values.iter().map(|(name, value)| (*name, value.as_str())).collect();
        match message.encode(&values) {
            Ok(again) => assert_eq!(again.data().len(), message.length),
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    }
});
