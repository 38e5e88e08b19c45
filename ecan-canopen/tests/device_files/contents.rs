//! A file that uses everything is read completely.

use ecan_canopen::{AccessType, Commissioning, DataType, DataValue, DeviceFile, ObjectType};

use super::{everything, node};

#[test]
fn correct_file_has_no_warning() {
    assert_eq!(everything().warnings(), []);
}

#[test]
fn device_and_commissioning_are_read() {
    let file = everything();
    assert!(file.is_dcf());
    assert_eq!(file.file_info.description, "Test of the device files");
    assert_eq!(file.file_info.last_eds, "everything.eds");
    let info = &file.device_info;
    assert_eq!(info.vendor_number, Some(0x1234_5678));
    assert_eq!(info.product_number, Some(42));
    assert_eq!(info.revision_number, Some(0x10002));
    assert!(info.bit_rates.contains(125_000) && info.bit_rates.contains(1_000_000));
    assert!(!info.bit_rates.contains(800_000));
    assert_eq!((info.granularity, info.lss_supported), (Some(8), Some(true)));
    assert_eq!((info.receive_pdos, info.transmit_pdos), (Some(1), Some(1)));
    let commissioning = file.commissioning.as_ref().unwrap();
    assert_eq!(file.node_id(), Some(node(16)));
    assert_eq!(commissioning.bit_rate_kbit, Some(500));
    assert_eq!(commissioning.node_name, "left wheel");
    assert_eq!(commissioning.lss_serial_number, Some(0xABCD));
    assert_eq!(file.comments, ["First line = a comment", "Second line; also one"]);
    assert_eq!(file.dummy_usage.iter().copied().collect::<Vec<_>>(), [5, 6, 7]);
    assert_eq!(file.connected_modules, [1, 1]);
    assert_eq!(file.tools[0].command, "edit $EDS");
    assert_eq!(file.other_sections[0].entries, [("Colour".to_owned(), "blue".to_owned())]);
}

#[test]
fn modules_are_read() {
    let file = everything();
    let module = &file.modules[&1];
    assert_eq!(module.info.order_code, "M-8");
    assert_eq!(module.comments, ["Plug it in"]);
    assert_eq!(module.fixed_objects[&0x6100].name, "State of modules");
    let extension = &module.extensions[&0x6000];
    assert_eq!(extension.count, "1");
    assert_eq!(extension.entry.data_type, DataType::Unsigned8);
    assert_eq!(extension.entry.access, AccessType::ReadWriteOutput);
    // The objects of a module are not those of the device.
    assert!(file.object(0x6100).is_none());
}

#[test]
fn values_of_all_types_are_read() {
    let file = everything();
    let default = |index| file.entry(index, 0).unwrap().default_value(node(5)).unwrap();
    let cases = [
        (0x2000, DataValue::Boolean(true)),
        (0x2001, DataValue::Signed(-5)),
        (0x2002, DataValue::Signed(-2)),
        (0x2003, DataValue::Signed(-0x80_0000)),
        (0x2004, DataValue::Signed(15)),
        (0x2005, DataValue::Signed(-(1 << 39))),
        (0x2006, DataValue::Signed(1)),
        (0x2007, DataValue::Signed(2)),
        (0x2008, DataValue::Signed(i64::MIN)),
        (0x2009, DataValue::Unsigned(0xFFFF)),
        (0x200A, DataValue::Unsigned(0xFF_FFFF)),
        (0x200B, DataValue::Unsigned(0x01_0203_0405)),
        (0x200C, DataValue::Unsigned(u64::MAX)),
        (0x200D, DataValue::Real32(0.25)),
        (0x200E, DataValue::Real64(-1.5e300)),
        (0x200F, DataValue::Text("hello = world".into())),
        (0x2010, DataValue::Bytes(vec![1, 2, 0xAB])),
        (0x2011, DataValue::Text("text".into())),
        (0x2012, DataValue::Time { days: 1, milliseconds: 5 }),
        (0x2013, DataValue::Time { days: 0, milliseconds: 5 }),
    ];
    for (index, value) in cases {
        assert_eq!(default(index), value, "{index:04X}");
    }
    let limits = file.entry(0x2004, 0).unwrap().limits(node(5));
    let signed = |value: i32| Some(DataValue::Signed(value.into()));
    assert_eq!(limits, (signed(i32::MIN), signed(i32::MAX)));
}

#[test]
fn node_id_is_inserted_for_each_node() {
    let file = everything();
    let cob_id = file.entry(0x1400, 1).unwrap();
    assert_eq!(cob_id.default_value(node(5)), Some(DataValue::Unsigned(0x205)));
    assert_eq!(cob_id.default_value(node(127)), Some(DataValue::Unsigned(0x27F)));
    assert_eq!(cob_id.parameter_value(node(5)), Some(DataValue::Unsigned(0x305)));
    assert_eq!(cob_id.configured_value(node(5)), Some(DataValue::Unsigned(0x305)));
    let sync = file.entry(0x1005, 0).unwrap();
    assert_eq!(sync.parameter_value(node(5)), None);
    assert_eq!(sync.configured_value(node(5)), Some(DataValue::Unsigned(0x80)));
}

#[test]
fn objects_and_properties_are_read() {
    let file = everything();
    let heartbeat = file.entry(0x1017, 0).unwrap();
    assert_eq!(heartbeat.denotation, "heartbeat of the left wheel");
    assert_eq!(heartbeat.reference, "-P1");
    let store = file.entry(0x1021, 0).unwrap();
    assert_eq!(store.object_type, ObjectType::Domain);
    assert_eq!((&*store.upload_file, &*store.download_file), ("upload.eds", "download.eds"));
    assert!(store.flags.refuses_write_on_download() && store.flags.refuses_read_on_scan());
    assert!(file.object(0x1018).unwrap().flags.refuses_write_on_download());
    assert_eq!(file.object(0x6000).unwrap().links, [0x6001, 0x2000]);
    assert_eq!(file.object(0x6001).unwrap().object_type, ObjectType::Null);
    assert_eq!(file.object(0x6001).unwrap().entries().count(), 0);
    let output = file.entry(0x6000, 1).unwrap();
    assert!(output.is_rpdo_mappable() && !output.is_tpdo_mappable());
    let sent = file.entry(0x2014, 2).unwrap();
    assert!(sent.is_tpdo_mappable() && !sent.is_rpdo_mappable());
}

#[test]
fn compact_objects_have_all_sub_objects() {
    let file = everything();
    let mapping = file.object(0x1600).unwrap();
    assert_eq!(mapping.entries().count(), 9);
    let count = mapping.entry(0).unwrap();
    assert_eq!(count.name, "NrOfObjects");
    assert_eq!(count.default_value(node(1)), Some(DataValue::Unsigned(8)));
    let second = mapping.entry(2).unwrap();
    assert_eq!((&*second.name, &*second.denotation), ("Second", "valves"));
    assert_eq!(second.parameter_value(node(1)), Some(DataValue::Unsigned(0x6000_0208)));
    assert_eq!(mapping.entry(3).unwrap().parameter_value(node(1)), None);
    assert_eq!(mapping.entry(1).unwrap().reference, "-M1");
    let concise = file.object(0x1F22).unwrap();
    assert_eq!(concise.entries().count(), 128);
    // The name of the object and the subindex, as no other is given.
    assert_eq!(concise.entry(127).unwrap().name, "Concise DCF127");
}

#[test]
fn same_file_is_equal_whatever_its_warnings() {
    let text = super::EVERYTHING.replace("SupportedObjects=9", "SupportedObjects=8");
    let file = DeviceFile::parse(text.as_bytes()).unwrap();
    assert_eq!(file.warnings().len(), 1);
    assert_eq!(file, everything());
}

#[test]
fn dcf_is_made_from_eds_and_values() {
    let mut eds = everything();
    eds.commissioning = None;
    let commissioning = Commissioning { node_id: Some(node(9)), ..Commissioning::default() };
    let mut dcf = eds.to_dcf(commissioning);
    assert!(dcf.is_dcf() && dcf.entries().all(|entry| entry.parameter.is_none()));
    assert_eq!(dcf.file_info.last_eds, "everything.dcf");
    // What a node returns is written, and only that.
    let parameters: Vec<_> = eds.parameters().map(|entry| (entry.index, entry.subindex)).collect();
    assert!(parameters.contains(&(0x1017, 0)) && parameters.contains(&(0x2014, 2)));
    for excluded in [(0x1000, 0), (0x1018, 1), (0x1021, 0), (0x1F22, 1), (0x2014, 1)] {
        assert!(!parameters.contains(&excluded), "{excluded:04X?}");
    }
    dcf.set_parameter(0x1017, 0, &[0xE8, 0x03]).unwrap();
    let text = dcf.write();
    assert_eq!(text.matches("ParameterValue=").count(), 1);
    assert!(text.contains("ParameterValue=0x03E8\n"), "{text}");
    assert!(text.contains("[DeviceComissioning]\nNodeID=9\n"));
}
