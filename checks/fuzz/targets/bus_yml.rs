//! Buses in the form of ros2_canopen, with one small device file.
#![no_main]

use libfuzzer_sys::fuzz_target;

/// The objects of the seed.
const EDS: &[u8] = b"[MandatoryObjects]\nSupportedObjects=1\n1=0x1000\n\
[1000]\nParameterName=Device type\nObjectType=7\nDataType=7\nAccessType=ro\nDefaultValue=0x191\n\
[OptionalObjects]\nSupportedObjects=4\n1=0x1800\n2=0x1A00\n3=0x6041\n4=0x606C\n\
[1800]\nParameterName=TPDO 1\nObjectType=9\nSubNumber=3\n\
[1800sub0]\nParameterName=n\nDataType=5\nAccessType=ro\nDefaultValue=2\n\
[1800sub1]\nParameterName=COB-ID\nDataType=7\nAccessType=rw\nDefaultValue=$NODEID+0x180\n\
[1800sub2]\nParameterName=type\nDataType=5\nAccessType=rw\nDefaultValue=255\n\
[1A00]\nParameterName=mapping\nObjectType=8\nDataType=7\nAccessType=rw\nCompactSubObj=2\n\
[6041]\nParameterName=Statusword\nDataType=6\nAccessType=ro\nPDOMapping=1\n\
[606C]\nParameterName=Velocity\nDataType=4\nAccessType=ro\nPDOMapping=1\n\
[ManufacturerObjects]\nSupportedObjects=3\n1=0x2000\n2=0x2001\n3=0x2003\n\
[2000]\nParameterName=Grip force\nDataType=6\nAccessType=rww\nLowLimit=10\nHighLimit=400\nPDOMapping=1\n\
[2001]\nParameterName=Jaw position\nDataType=4\nAccessType=ro\nPDOMapping=1\n\
[2003]\nParameterName=Temperature\nDataType=8\nAccessType=ro\nPDOMapping=1\n";

fuzz_target!(|text: &str| {
    match ecan_lite::config::parse_bus_yml(text, (0, 1), |_| Ok(EDS.to_vec())) {
        Ok(nodes) => {
            for node in nodes {
                assert_eq!((node.address.slave, node.address.channel), (0, 1));
                // An invalid PDO is found by the check of the network.
                let _ = node.boot_config();
            }
        }
        Err(faults) => {
            let lines = text.matches('\n').count() + 1;
            assert!(!faults.0.is_empty());
            assert!(
                faults.0.iter().all(|fault| (1..=lines).contains(&fault.line) && fault.column > 0)
            );
        }
    }
});
