//! Configuration files: read, checked, and exported as startup lists.
#![no_main]

use ecan_lite::config::export::{Format, ProcessData, SlaveAddress, export};
use ecan_mcan_port::PortPlan;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    match ecan_lite::config::parse(text.as_bytes()) {
        Ok(file) => {
            for gateway in 0..file.port.gateways.len() {
                let steps = ecan_lite::config::startup(&file, gateway);
                let Some(data) = ProcessData::of(&file.adapter, gateway) else { continue };
                for format in
                    [Format::Csv, Format::TwinCat, Format::Codesys, Format::Ethercat, Format::Steps]
                {
                    assert!(!export(format, &steps, SlaveAddress::default(), &data).is_empty());
                }
            }
            let plan = PortPlan::of(&file.adapter, &file.port, &[]);
            assert!(plan.warnings.iter().all(|warning| !warning.to_string().is_empty()));
        }
        Err(faults) => {
            // Each fault is in a line of the text.
            let lines = text.matches('\n').count() + 1;
            assert!(!faults.0.is_empty());
            assert!(
                faults.0.iter().all(|fault| (1..=lines).contains(&fault.line) && fault.column > 0)
            );
        }
    }
});
