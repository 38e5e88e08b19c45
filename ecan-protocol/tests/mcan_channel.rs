//! Channel configurations as SDO downloads, and their checks (manual 5.4.3 E, 13.4).

use crate::common::{Sent, all_sent, in_table};
use ecan_protocol::can::{BitTiming, Phase};
use ecan_protocol::config::{
    BitTimingMode, ChannelFault, ConfigObject, DataSize, FifoMode, McanChannelConfig,
    MessageRamLayout, NodeMode, NonMatch, RxFifo, TxMode,
};
use ecan_protocol::object::lookup;

/// E1..E30 of 5.4.3 and the apply command.
const PHASE_E: [Sent; 31] = [
    (0x8001, 7, 1, 0),
    (0x8001, 8, 1, 0),
    (0x8001, 9, 1, 0),
    (0x8001, 15, 1, 1),
    (0x8001, 16, 1, 1),
    (0x8001, 19, 4, 1_000_000),
    (0x8001, 20, 4, 5_000_000),
    (0x8001, 21, 2, 875),
    (0x8001, 22, 2, 875),
    (0x8001, 23, 2, 875),
    (0x8001, 24, 2, 875),
    (0x8001, 33, 1, 0),
    (0x8001, 34, 1, 0),
    (0x8001, 36, 1, 0),
    (0x8001, 37, 1, 0),
    (0x8001, 38, 1, 0),
    (0x8001, 39, 1, 0),
    (0x8001, 61, 1, 0),
    (0x8001, 62, 1, 48),
    (0x8001, 63, 1, 0),
    (0x8001, 64, 1, 12),
    (0x8001, 65, 1, 7),
    (0x8001, 66, 1, 7),
    (0x8001, 67, 1, 12),
    (0x8001, 68, 1, 7),
    (0x8001, 69, 1, 0),
    (0x8001, 70, 1, 32),
    (0x8001, 71, 1, 0),
    (0x8001, 72, 1, 7),
    (0x8001, 73, 1, 32),
    (0x8001, 1, 1, 1),
];

fn manual_channel() -> McanChannelConfig {
    McanChannelConfig::fd(1_000_000, 5_000_000).sample_point(875, 875)
}

#[test]
fn phase_e_golden() {
    let config = manual_channel();
    let apply = McanChannelConfig::apply_write(0);
    let writes: Vec<_> = config.needed_writes(0).chain([apply]).collect();
    let is_example = |write: &Sent| PHASE_E.iter().any(|example| example.1 == write.1);
    let sent: Vec<_> = all_sent(&writes).into_iter().filter(is_example).collect();
    assert_eq!(sent, PHASE_E);
    in_table(&writes);
    assert_eq!(faults(&config), []);
}

#[test]
fn whole_channel_configuration() {
    let config = manual_channel();
    let writes: Vec<_> = config.writes(2).collect();
    let all = all_sent(&writes);
    // 7..34, 36..40 and 61..87 without the two pads.
    let expected: Vec<u8> =
        (7..=34).chain(36..=40).chain(61..=79).chain(81..=85).chain([87]).collect();
    assert_eq!(all.iter().map(|w| w.1).collect::<Vec<_>>(), expected);
    in_table(&writes);
    // It contains the manual's example unchanged and in its order.
    let example: Vec<_> = all
        .iter()
        .filter(|w| PHASE_E.iter().any(|e| e.1 == w.1))
        .map(|&(_, subindex, size, value)| (0x8001, subindex, size, value))
        .collect();
    assert_eq!(example, PHASE_E[..30]);
    assert!(all.iter().all(|w| w.0 == 0x8003));
}

#[test]
fn default_channel_is_the_device_default() {
    let config = McanChannelConfig::default();
    for write in config.writes(0) {
        let (_, entry) = lookup(write.index, write.subindex).unwrap();
        assert_eq!(entry.default, Some(write.value), "{write}");
    }
    assert_eq!(faults(&config), []);
    assert_eq!(config.message_ram_bytes(), 8192);
}

#[test]
fn raw_value_and_field_round_trip() {
    // Every field has another value than the default.
    let changed = McanChannelConfig {
        bit_timing_mode: BitTimingMode::Manual,
        node_mode: NodeMode::ExternalLoopback,
        non_iso: true,
        transmit_pause: true,
        edge_filter: true,
        protocol_exception_disable: true,
        wide_message_marker: true,
        external_timestamp: true,
        fd: false,
        tdc: false,
        restricted_mode_disable: true,
        disable_auto_retransmission: true,
        nominal_bitrate: 1,
        data_bitrate: 2,
        manual_nominal: BitTiming { brp: 3, tseg1: 4, tseg2: 5, sjw: 6 },
        manual_data: BitTiming { brp: 7, tseg1: 8, tseg2: 9, sjw: 10 },
        tdc_offset: 11,
        tdc_filter: 12,
        non_match_standard: NonMatch::Fifo1,
        non_match_extended: NonMatch::RejectToo,
        reject_remote_standard: true,
        reject_remote_extended: true,
        extended_id_mask: 13,
        ram: MessageRamLayout {
            rx_buffer_count: 14,
            tx_dedicated_count: 15,
            tx_fifo_size: 16,
            tx_event_size: 17,
            tx_mode: TxMode::Queue,
            rx_fifo0: RxFifo { mode: FifoMode::Overwrite, size: 18, data_size: DataSize::B12 },
            rx_fifo1: RxFifo { mode: FifoMode::Overwrite, size: 19, data_size: DataSize::B16 },
            rx_buffer_data_size: DataSize::B20,
            tx_data_size: DataSize::B24,
        },
        timestamp_selection: 2,
        timestamp_prescaler: 20,
        tsu: true,
        tsu_external_timebase: true,
        tsu_capture_sof: true,
        tsu_64_bit: true,
        tsu_prescaler: 21,
        tsu_timebase_source: 22,
        tsu_tbsel: 23,
        timeout: true,
        timeout_select: 3,
        timeout_period: 24,
        ..McanChannelConfig::default()
    }
    .sample_point(25, 26);
    let mut copy = McanChannelConfig::default();
    for write in changed.writes(0) {
        assert_ne!(copy.value(write.subindex), Some(write.value), "{write}");
        copy.set_value(write.subindex, write.value).unwrap();
    }
    assert_eq!(copy, changed);
    // A value that no field can hold is rejected, with the name of the field.
    let error = copy.set_value(8, 4).unwrap_err();
    assert_eq!(error.to_string(), "invalid value 4 for Node mode (subindex 8)");
    assert!(copy.set_value(15, 2).is_err());
    assert!(copy.set_value(62, 256).is_err());
    assert!(copy.set_value(35, 0).is_err());
    assert!(copy.set_value(1, 1).is_err());
    assert_eq!(copy, changed);
}

fn faults(config: &McanChannelConfig) -> Vec<ChannelFault> {
    let mut faults = Vec::new();
    config.check(&mut |fault| faults.push(fault));
    faults
}

#[test]
fn constructed_configurations_are_valid() {
    for bitrate in [10_000, 20_000, 50_000, 83_333, 125_000, 250_000, 500_000, 800_000, 1_000_000] {
        assert_eq!(faults(&McanChannelConfig::classic(bitrate)), [], "{bitrate}");
    }
    for data in [500_000, 1_000_000, 2_000_000, 4_000_000, 5_000_000, 8_000_000] {
        assert_eq!(faults(&McanChannelConfig::fd(500_000, data)), [], "{data}");
    }
    let classic = McanChannelConfig::classic(1_000_000);
    assert!(!classic.fd);
    assert!(classic.message_ram_bytes() <= 8192);
    for (subindex, value) in [(65, 0), (66, 0), (68, 0), (72, 0), (62, 64)] {
        assert_eq!(classic.value(subindex), Some(value));
    }
    // 160 periods at 500 kbit/s need a prescaler that the compensation cannot use.
    assert!(!McanChannelConfig::fd(500_000, 500_000).tdc);
    assert!(McanChannelConfig::fd(500_000, 2_000_000).tdc);
}

#[test]
fn delay_compensation_is_forced_from_5_megabit_on() {
    let mut config = McanChannelConfig::fd(1_000_000, 5_000_000);
    config.tdc = false;
    assert!(config.tdc_runs());
    config.data_bitrate = 4_000_000;
    assert!(!config.tdc_runs());
    let slow = McanChannelConfig { tdc: true, ..McanChannelConfig::fd(250_000, 500_000) };
    assert_eq!(faults(&slow), [ChannelFault::TdcPrescaler { brp: 5 }]);
}

#[test]
fn every_fault_is_reported() {
    let mut config = McanChannelConfig::fd(2_000_000, 5_000_000).sample_point(800, 800);
    config.tdc_offset = 128;
    config.tsu_prescaler = 0;
    config.timeout_select = 4;
    config.timestamp_selection = 3;
    config.extended_id_mask = 0x2000_0000;
    config.ram.rx_fifo0.size = 65;
    config.ram.tx_dedicated_count = 1;
    config.ram.rx_fifo1.size = 0;
    config.non_match_extended = NonMatch::Fifo1;
    let found = faults(&config);
    let out_of_range: Vec<u8> = found
        .iter()
        .filter_map(|fault| match fault {
            ChannelFault::Range(fault) => Some(fault.subindex),
            _ => None,
        })
        .collect();
    assert_eq!(out_of_range, [19, 33, 40, 62, 74, 81, 85]);
    assert!(found.iter().any(|f| matches!(f, ChannelFault::Timing { phase: Phase::Data, .. })));
    assert!(found.contains(&ChannelFault::TransmitElements { fifo: 32, dedicated: 1 }));
    assert!(found.contains(&ChannelFault::NonMatchWithoutFifo { fifo: 1 }));
    assert!(found.contains(&ChannelFault::MessageRam { bytes: 8192 + 17 * 72 - 12 * 72 + 72 }));
    assert_eq!(found.len(), 11);
    let texts: Vec<String> = found.iter().map(ToString::to_string).collect();
    assert_eq!(
        texts[0],
        "Nominal bitrate (subindex 19) = 2000000 is out of range; allowed: 1 to 1000000"
    );
    assert!(texts.iter().any(|t| t.contains("nearest are 75 % and 81.25 %")), "{texts:#?}");
}

#[test]
fn manual_timing_fits_registers_and_bit_rate() {
    let mut config = manual_channel();
    config.bit_timing_mode = BitTimingMode::Manual;
    config.manual_nominal = BitTiming { brp: 1, tseg1: 69, tseg2: 10, sjw: 10 };
    config.manual_data = BitTiming { brp: 1, tseg1: 13, tseg2: 2, sjw: 2 };
    assert_eq!(faults(&config), []);
    config.manual_nominal.brp = 2;
    config.manual_data.sjw = 3;
    assert_eq!(
        faults(&config),
        [
            ChannelFault::ManualBitrate {
                phase: Phase::Nominal,
                configured: 1_000_000,
                actual: 500_000
            },
            ChannelFault::ManualTiming { phase: Phase::Data, timing: config.manual_data },
        ]
    );
    // TSEG1 is one byte, although the register could hold 256.
    config.manual_data.sjw = 2;
    config.nominal_bitrate = 250_000;
    config.manual_nominal = BitTiming { brp: 1, tseg1: 256, tseg2: 63, sjw: 1 };
    assert_eq!(
        faults(&config),
        [ChannelFault::ManualTiming { phase: Phase::Nominal, timing: config.manual_nominal }]
    );
    // Unset timing, as it is in automatic mode.
    config.manual_nominal = BitTiming::default();
    assert_eq!(faults(&config).len(), 1);
}

#[test]
fn listen_mode_needs_no_transmit_elements() {
    let mut config = McanChannelConfig::default();
    config.ram.tx_fifo_size = 0;
    assert_eq!(faults(&config), [ChannelFault::NoTransmitFifo]);
    config.node_mode = NodeMode::Listen;
    assert_eq!(faults(&config), []);
    config.data_bitrate = 250_000;
    assert!(
        faults(&config)
            .contains(&ChannelFault::DataBelowNominal { nominal: 500_000, data: 250_000 })
    );
}
