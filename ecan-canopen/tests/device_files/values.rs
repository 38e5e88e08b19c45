//! Values as bytes and as text.

use ecan_canopen::{DataType, DataValue, DeviceFile, DeviceObject, FileValue, ObjectEntry};
use proptest::prelude::*;

use super::{everything, node};

const TYPES: [DataType; 26] = [
    DataType::Boolean,
    DataType::Integer8,
    DataType::Integer16,
    DataType::Integer24,
    DataType::Integer32,
    DataType::Integer40,
    DataType::Integer48,
    DataType::Integer56,
    DataType::Integer64,
    DataType::Unsigned8,
    DataType::Unsigned16,
    DataType::Unsigned24,
    DataType::Unsigned32,
    DataType::Unsigned40,
    DataType::Unsigned48,
    DataType::Unsigned56,
    DataType::Unsigned64,
    DataType::Real32,
    DataType::Real64,
    DataType::VisibleString,
    DataType::OctetString,
    DataType::UnicodeString,
    DataType::TimeOfDay,
    DataType::TimeDifference,
    DataType::Domain,
    DataType::Other(0x40),
];

/// A type and bytes of one of its values.
fn value_bytes() -> impl Strategy<Value = (DataType, Vec<u8>)> {
    (prop::sample::select(&TYPES[..]), prop::collection::vec(any::<u8>(), 9)).prop_map(
        |(data_type, mut bytes)| {
            match data_type {
                DataType::Boolean => bytes = vec![bytes[0] & 1],
                DataType::TimeOfDay | DataType::TimeDifference => {
                    bytes.truncate(6);
                    // the reserved bits
                    bytes[3] &= 0x0F;
                }
                // Letters, since a file can hold no line breaks.
                DataType::VisibleString => {
                    bytes.iter_mut().for_each(|byte| *byte = b'A' + *byte % 26)
                }
                DataType::UnicodeString => {
                    let text: String =
                        bytes.iter().map(|byte| char::from(b'a' + byte % 26)).collect();
                    bytes = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
                }
                _ => bytes.truncate(data_type.size().unwrap_or(9)),
            }
            (data_type, bytes)
        },
    )
}

proptest! {
    #[test]
    fn decoded_value_is_encoded_to_the_same_bytes((data_type, bytes) in value_bytes()) {
        let value = data_type.decode(&bytes).unwrap();
        prop_assert_eq!(data_type.encode(&value), Ok(bytes));
    }

    #[test]
    fn displayed_value_is_parsed((data_type, bytes) in value_bytes()) {
        let value = data_type.decode(&bytes).unwrap();
        // A real that is not a number has several sets of bits.
        let is_exact = match value {
            DataValue::Real32(real) => real.is_finite(),
            DataValue::Real64(real) => real.is_finite(),
            _ => true,
        };
        prop_assume!(is_exact);
        prop_assert_eq!(data_type.parse(&value.to_string()), Ok(value.clone()));
        prop_assert_eq!(data_type.parse(&format!("{value:#}")), Ok(value));
    }

    #[test]
    fn any_bytes_are_decoded_or_rejected(
        data_type in prop::sample::select(&TYPES[..]),
        bytes in prop::collection::vec(any::<u8>(), 0..20),
    ) {
        match data_type.decode(&bytes) {
            Ok(value) => prop_assert!(data_type.encode(&value).is_ok()),
            Err(error) => prop_assert!(error.to_string().contains(&data_type.to_string())),
        }
    }

    #[test]
    fn any_text_is_parsed_or_rejected(
        data_type in prop::sample::select(&TYPES[..]),
        text in "[-+0-9a-fxA-F$.NODEIDé ]{0,12}",
    ) {
        if let Ok(value) = data_type.parse(&text) {
            let bytes = data_type.encode(&value).unwrap();
            prop_assert_eq!(data_type.decode(&bytes), Ok(value));
        }
    }

}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    /// A file of an application: values of all types, as a node returned them.
    #[test]
    fn file_with_values_is_written_and_read(
        values in prop::collection::vec((value_bytes(), any::<bool>()), 1..20),
    ) {
        let mut file = everything();
        for (index, ((data_type, bytes), is_default)) in (0x3000..).zip(values) {
            let value = FileValue::Fixed(data_type.decode(&bytes).unwrap());
            let mut entry = ObjectEntry::new(index, 0, "value", data_type);
            if is_default {
                entry.default = Some(value);
            } else {
                entry.parameter = Some(value);
            }
            file.insert(DeviceObject::variable(entry));
        }
        let again = DeviceFile::parse(file.write().as_bytes());
        prop_assert_eq!(again.as_ref(), Ok(&file));
    }

    #[test]
    fn node_id_is_added(offset in -1i64..0xFFFF_FF00, id in 1u8..=127) {
        let mut entry = ObjectEntry::new(0x2000, 0, "COB-ID", DataType::Unsigned32);
        entry.default = Some(FileValue::NodeId { offset });
        let value = entry.default_value(node(id));
        prop_assert_eq!(value, Some(DataValue::Unsigned((offset + i64::from(id)) as u64)));
        let mut file = everything();
        file.insert(DeviceObject::variable(entry));
        let again = DeviceFile::parse(file.write().as_bytes());
        prop_assert_eq!(again.as_ref(), Ok(&file));
    }
}

/// The format holds one line for each value: other texts change, but never the entries around them.
#[test]
fn line_breaks_of_node_stay_in_their_entry() {
    let mut file = everything();
    file.set_parameter(0x200F, 0, b"a\r\n[1000]\nParameterValue=1 ").unwrap();
    let again = DeviceFile::parse(file.write().as_bytes()).unwrap();
    let value = again.entry(0x200F, 0).unwrap().parameter_value(node(1));
    assert_eq!(value, Some(DataValue::Text("a  [1000] ParameterValue=1".into())));
    assert_eq!(again.entry(0x1000, 0), file.entry(0x1000, 0));
}
