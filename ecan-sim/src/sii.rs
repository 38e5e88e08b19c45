//! SII EEPROM: the factory contents of a gateway (ETG.2010; manual 5.3, 15.7), and what the master uses of it.

use ecan_protocol::mapping::{
    Direction, MAX_MULTIPLIER, UNIT_BYTES, UNITS_PER_CHUNK, data_object_index, pdo_map_index,
    sync_manager,
};

use crate::gateway::variant::{MappedSubindex, SdoInformation};
use crate::gateway::{DEVICE_NAME, MAILBOXES, SyncManagerConfig};
use crate::scenario::{GatewaySpec, IoSpec};

/// Words that the controller uses; the last one has their checksum.
pub(crate) const CONFIGURATION_WORDS: usize = 8;
/// Words of a sync manager: start, length, control and status byte, enable byte and type.
const SYNC_MANAGER_WORDS: usize = 4;
/// Words of the EEPROM: 2 KiB.
const WORDS: usize = 1024;
/// The same with the PDO categories: 4 KiB.
const WORDS_WITH_PDOS: usize = 2048;
const CATEGORIES: usize = 0x40;
const END: u16 = 0xFFFF;

mod word {
    pub(super) const PDI_CONTROL: usize = 0;
    pub(super) const SYNC_PULSE: usize = 2;
    pub(super) const ALIAS: usize = 4;
    pub(super) const CHECKSUM: usize = 7;
    pub(super) const VENDOR: usize = 0x08;
    pub(super) const PRODUCT: usize = 0x0A;
    pub(super) const REVISION: usize = 0x0C;
    pub(super) const SERIAL: usize = 0x0E;
    pub(super) const BOOT_MAILBOX: usize = 0x14;
    pub(super) const MAILBOX: usize = 0x18;
    pub(super) const PROTOCOLS: usize = 0x1C;
    pub(super) const SIZE: usize = 0x3E;
    pub(super) const VERSION: usize = 0x3F;
}

mod category {
    pub(super) const STRINGS: u16 = 10;
    pub(super) const GENERAL: u16 = 30;
    pub(super) const FMMU: u16 = 40;
    pub(super) const SYNC_MANAGER: u16 = 41;
    pub(super) const TX_PDO: u16 = 50;
    pub(super) const RX_PDO: u16 = 51;
    pub(super) const CLOCK: u16 = 60;
}

/// Process data interface: on the chip. Its configuration byte enables Sync0.
const PDI: u16 = 0x0E80;
/// Length of a Sync0 pulse in 10 ns.
const SYNC_PULSE: u16 = 1000;
const PROTOCOL_COE: u16 = 0x0004;
const PROTOCOL_FOE: u16 = 0x0008;
/// CoE details: SDO, SDO information; the scenario determines the others.
const COE_SDO: u8 = 0x01;
const COE_SDO_INFORMATION: u8 = 0x02;
const COE_COMPLETE_ACCESS: u8 = 0x20;
const COE_PDO_ASSIGN: u8 = 0x04;
const COE_PDO_CONFIGURATION: u8 = 0x08;
const FOE: u8 = 0x01;

const STRINGS: [&str; 4] =
    [DEVICE_NAME, "EtherCAT to CAN FD gateway, 4 channels", "FreeRun", "DC Sync0"];
const NAME: u8 = 1;
const GROUP: u8 = 2;
const FREE_RUN: u8 = 3;
const DC_SYNC0: u8 = 4;
/// Data type of a mapped unit.
const VISIBLE_STRING: u8 = 9;
/// AssignActivate of the operation mode with Sync0.
const ASSIGN_ACTIVATE: u16 = 0x0300;

pub(crate) fn image(spec: &GatewaySpec) -> Vec<u16> {
    let config = &spec.config;
    let size = if spec.sii_pdos { WORDS_WITH_PDOS } else { WORDS };
    let mut words = vec![0; CATEGORIES];
    let mut put = |at: usize, value: u16| words[at] = value;
    put(word::PDI_CONTROL, PDI);
    put(word::SYNC_PULSE, SYNC_PULSE);
    put(word::ALIAS, spec.alias);
    let numbers = [
        (word::VENDOR, config.vendor_id),
        (word::PRODUCT, config.product_code),
        (word::REVISION, config.revision),
        (word::SERIAL, config.serial as u32),
    ];
    for (at, value) in numbers {
        put(at, value as u16);
        put(at + 1, (value >> 16) as u16);
    }
    for at in [word::BOOT_MAILBOX, word::MAILBOX] {
        for (nth, mailbox) in MAILBOXES.into_iter().enumerate() {
            put(at + 2 * nth, mailbox.start);
            put(at + 2 * nth + 1, mailbox.length);
        }
    }
    put(word::PROTOCOLS, PROTOCOL_COE | PROTOCOL_FOE);
    put(word::SIZE, (size * 16 / 1024 - 1) as u16);
    put(word::VERSION, 1);
    words[word::CHECKSUM] = checksum(&words).into();
    add(&mut words, category::STRINGS, &strings());
    add(&mut words, category::GENERAL, &general(spec));
    // FMMU 0 for outputs, 1 for inputs, 2 for the state of the mailbox.
    add(&mut words, category::FMMU, &[1, 2, 3, 0]);
    add(&mut words, category::SYNC_MANAGER, &sync_managers(spec));
    if spec.sii_pdos {
        // a master looks up their sync managers, which therefore precede them
        add(
            &mut words,
            category::TX_PDO,
            &pdos(Direction::TxPdo, spec.config.variant.mapped_subindex),
        );
        add(
            &mut words,
            category::RX_PDO,
            &pdos(Direction::RxPdo, spec.config.variant.mapped_subindex),
        );
    }
    add(&mut words, category::CLOCK, &clocks());
    words.push(END);
    words.resize(size, 0xFFFF);
    words
}

fn add(words: &mut Vec<u16>, category: u16, bytes: &[u8]) {
    words.extend([category, bytes.len().div_ceil(2) as u16]);
    words.extend(bytes.chunks(2).map(|pair| {
        let [low, high] = [pair.first(), pair.get(1)].map(|byte| byte.copied().unwrap_or(0));
        u16::from_le_bytes([low, high])
    }));
}

fn strings() -> Vec<u8> {
    let mut bytes = vec![STRINGS.len() as u8];
    for text in STRINGS {
        bytes.push(text.len() as u8);
        bytes.extend(text.as_bytes());
    }
    bytes
}

fn general(spec: &GatewaySpec) -> [u8; 32] {
    let mut bytes = [0; 32];
    // Group, image, order number, name.
    bytes[..4].copy_from_slice(&[GROUP, 0, NAME, NAME]);
    let has_information = spec.config.variant.sdo_information == SdoInformation::Supported;
    bytes[5] = COE_SDO
        | if has_information { COE_SDO_INFORMATION } else { 0 }
        | if spec.pdo_assign { COE_PDO_ASSIGN } else { 0 }
        | if spec.pdo_configuration { COE_PDO_CONFIGURATION } else { 0 }
        | if spec.config.complete_access { COE_COMPLETE_ACCESS } else { 0 };
    bytes[6] = FOE;
    // Ports 0 and 1 are MII.
    bytes[16] = 0x11;
    bytes
}

fn sync_managers(spec: &GatewaySpec) -> Vec<u8> {
    let all = MAILBOXES.into_iter().chain(spec.sii_sync_managers).zip(1..);
    let entry = |(sm, kind): (SyncManagerConfig, u8)| {
        let ([s0, s1], [l0, l1]) = (sm.start.to_le_bytes(), sm.length.to_le_bytes());
        [s0, s1, l0, l1, sm.control, 0, 1, kind]
    };
    all.flat_map(entry).collect()
}

/// All chunks of a direction, assigned to its sync manager as after power-on.
fn pdos(direction: Direction, mapped: MappedSubindex) -> Vec<u8> {
    let mut bytes = Vec::new();
    for chunk in 0..MAX_MULTIPLIER {
        let [i0, i1] = pdo_map_index(direction, chunk).to_le_bytes();
        let entries = UNITS_PER_CHUNK as u8;
        bytes.extend([i0, i1, entries, sync_manager(direction), 0, 0, 0, 0]);
        for unit in 0..entries {
            let [e0, e1] = data_object_index(direction, chunk, unit).to_le_bytes();
            let bits = (UNIT_BYTES * 8) as u8;
            bytes.extend([e0, e1, mapped.number(), 0, VISIBLE_STRING, bits, 0, 0]);
        }
    }
    bytes
}

fn clocks() -> Vec<u8> {
    let mode = |assign_activate: u16, name: u8| {
        let mut bytes = [0; 24];
        bytes[14..16].copy_from_slice(&assign_activate.to_le_bytes());
        bytes[18] = name;
        bytes
    };
    [mode(0, FREE_RUN), mode(ASSIGN_ACTIVATE, DC_SYNC0)].concat()
}

/// The CRC-8 of ETG.2010.
const CRC: crc::Crc<u8> = crc::Crc::<u8>::new(&crc::Algorithm {
    width: 8,
    poly: 0x07,
    init: 0xFF,
    refin: false,
    refout: false,
    xorout: 0,
    check: 0xFB,
    residue: 0,
});

pub(crate) fn checksum(words: &[u16]) -> u8 {
    let mut digest = CRC.digest();
    for word in words.iter().take(CONFIGURATION_WORDS - 1) {
        digest.update(&word.to_le_bytes());
    }
    digest.finalize()
}

/// Sync manager that a master finds in the SII; `None` if the SII has none with this number.
pub(crate) fn sync_manager_config(words: &[u16], number: u8) -> Option<SyncManagerConfig> {
    let managers = find(words, category::SYNC_MANAGER)?;
    let entry = managers.chunks_exact(SYNC_MANAGER_WORDS).nth(number.into())?;
    let [start, length, control, _] = *entry else { return None };
    Some(SyncManagerConfig { start, length, control: control as u8 })
}

/// Words of a category.
fn find(words: &[u16], category: u16) -> Option<&[u16]> {
    let mut rest = words.get(CATEGORIES..)?;
    loop {
        let [kind, length, after @ ..] = rest else { return None };
        let length = usize::from(*length);
        match *kind {
            END => return None,
            kind if kind == category => return after.get(..length),
            _ => rest = after.get(length..)?,
        }
    }
}

/// Sync managers of a gateway: two mailboxes, outputs, inputs.
const GATEWAY_SYNC_MANAGERS: u8 = 4;
/// Sync managers of an I/O: outputs, inputs.
const IO_SYNC_MANAGERS: u8 = 2;

/// Contents of the SII that the master uses.
#[derive(Clone, Debug)]
pub(crate) struct SlaveDescription {
    pub(crate) name: String,
    pub(crate) alias: u16,
    pub(crate) vendor_id: u32,
    pub(crate) product_code: u32,
    pub(crate) revision: u32,
    pub(crate) serial: u32,
    pub(crate) sync_managers: u8,
    /// The master may write 0x1C12 and 0x1C13.
    pub(crate) pdo_assign: bool,
    /// The master may write the mapping objects.
    pub(crate) pdo_configuration: bool,
    /// The SII lists all PDOs.
    pub(crate) sii_pdos: bool,
    /// It has a mailbox with CoE.
    pub(crate) has_coe: bool,
    /// SDO information of CoE.
    pub(crate) has_information: bool,
    /// Distributed clocks.
    pub(crate) has_clock: bool,
}

impl SlaveDescription {
    pub(crate) fn of_gateway(spec: &GatewaySpec) -> Self {
        let config = &spec.config;
        Self {
            name: DEVICE_NAME.to_owned(),
            alias: spec.alias,
            vendor_id: config.vendor_id,
            product_code: config.product_code,
            revision: config.revision,
            serial: config.serial as u32,
            sync_managers: GATEWAY_SYNC_MANAGERS,
            pdo_assign: spec.pdo_assign,
            pdo_configuration: spec.pdo_configuration,
            sii_pdos: spec.sii_pdos,
            has_coe: true,
            has_information: config.variant.sdo_information == SdoInformation::Supported,
            has_clock: true,
        }
    }

    pub(crate) fn of_io(spec: &IoSpec) -> Self {
        Self {
            name: spec.name.clone(),
            alias: spec.alias,
            vendor_id: spec.vendor_id,
            product_code: spec.product_code,
            revision: spec.revision,
            serial: spec.serial,
            sync_managers: IO_SYNC_MANAGERS,
            pdo_assign: false,
            pdo_configuration: false,
            sii_pdos: true,
            has_coe: false,
            has_information: false,
            has_clock: false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn find(words: &[u16], category: u16) -> &[u16] {
        super::find(words, category).unwrap()
    }

    #[test]
    fn sync_managers_are_those_of_the_manual() {
        let words = image(&GatewaySpec::at(0));
        assert_eq!(words.len(), WORDS);
        let expected = [
            [0x1000, 0x0080, 0x0026, 0x0101],
            [0x1080, 0x0080, 0x0022, 0x0201],
            [0x1100, 3072, 0x0066, 0x0301],
            [0x1D00, 3072, 0x0022, 0x0401],
        ];
        assert_eq!(find(&words, category::SYNC_MANAGER), expected.concat());
        assert_eq!(words[0x18..0x1D], [0x1000, 0x80, 0x1080, 0x80, 0x0C]);
        assert_eq!(words[word::SIZE], 15, "16 Kibit");
    }

    #[test]
    fn wrong_layout_of_the_scenario_is_found_by_a_master() {
        let mut spec = GatewaySpec::at(0);
        spec.sii_sync_managers[1].start = 0x1E00;
        let words = image(&spec);
        let found = [2, 3, 4].map(|number| sync_manager_config(&words, number));
        let [outputs, inputs] = spec.sii_sync_managers.map(Some);
        assert_eq!(found, [outputs, inputs, None]);
        assert_eq!(sync_manager_config(&[], 2), None);
    }

    #[test]
    fn pdo_categories_list_all_chunks_if_the_scenario_has_them() {
        let spec = GatewaySpec { sii_pdos: true, ..GatewaySpec::at(0) };
        let words = image(&spec);
        assert_eq!((words.len(), words[word::SIZE]), (WORDS_WITH_PDOS, 31));
        for (category, first_pdo, first_unit, sync) in
            [(category::TX_PDO, 0x1A00, 0x6000, 3), (category::RX_PDO, 0x1600, 0x7000, 2)]
        {
            let pdos = find(&words, category);
            assert_eq!(pdos.len(), 24 * 36);
            for (number, pdo) in (0..).zip(pdos.chunks(36)) {
                assert_eq!(pdo[..2], [first_pdo + number, sync << 8 | 8]);
                assert_eq!(pdo[4..7], [first_unit + 128 * number, 1, 128 << 8 | 9]);
            }
        }
        assert_eq!(find(&words, category::CLOCK).len(), 24);
    }

    #[test]
    fn scenario_sets_identity_alias_and_assignment() {
        let mut spec = GatewaySpec::at(0);
        spec.alias = 0x1234;
        spec.config.vendor_id = 0xAABB_CCDD;
        (spec.pdo_assign, spec.pdo_configuration) = (false, true);
        spec.config.complete_access = true;
        let words = image(&spec);
        assert_eq!((words[4], words[8], words[9]), (0x1234, 0xCCDD, 0xAABB));
        assert_eq!(find(&words, category::GENERAL)[2] >> 8, 0x23 | 0x08);
        let plain = image(&GatewaySpec::at(0));
        let general = find(&plain, category::GENERAL);
        assert_eq!(general[2] >> 8, 0x03 | 0x04, "Complete Access is not the default");
        spec.config.variant.sdo_information = SdoInformation::Absent;
        assert_eq!(find(&image(&spec), category::GENERAL)[2] >> 8, 0x21 | 0x08);
        assert_eq!(general[1].to_le_bytes(), [1, 1], "order number and name are ECAN-Lite");
        let strings = find(&words, category::STRINGS);
        assert_eq!(strings[0].to_le_bytes(), [4, 9], "four strings, the first of nine bytes");
        assert_eq!(find(&words, category::CLOCK)[12 + 7], 0x0300);
    }
}
