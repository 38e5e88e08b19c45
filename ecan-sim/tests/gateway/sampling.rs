//! Sample points and delay compensation of a channel on its bus, and the errors that its controller shows.

use super::fixture::{Fixture, chunks, fd, standard};
use ecan_protocol::can::{Phase, SamplePoint};
use ecan_protocol::config::McanChannelConfig;
use ecan_sim::{BusError, DelayCompensation, DetectedError, GatewayModelConfig, PhysicalLayer};

fn with(config: McanChannelConfig) -> Fixture {
    let model = GatewayModelConfig { transceiver_ns: 210, ..GatewayModelConfig::default() };
    let mut fixture = Fixture::preop_with(model);
    fixture.apply_channel(0, config);
    fixture
}

#[test]
fn sample_points_and_compensation_are_those_of_the_configuration() {
    let layer = |nominal, data, compensation| PhysicalLayer {
        compensation,
        transceiver_ns: 210,
        ..PhysicalLayer::new(SamplePoint(nominal), SamplePoint(data))
    };
    let automatic = Some(DelayCompensation::default());
    let rates = McanChannelConfig::fd(1_000_000, 4_000_000).sample_point(875, 800);
    assert_eq!(with(rates).gateway.physical_layer(0), Some(layer(8_750, 8_000, automatic)));
    assert_eq!(with(rates).gateway.physical_layer(1), None);
    let off = McanChannelConfig { tdc: false, ..rates };
    assert_eq!(with(off).gateway.physical_layer(0), Some(layer(8_750, 8_000, None)));
    // offset and filter count periods of 12.5 ns
    let manual = McanChannelConfig { tdc_offset: 16, tdc_filter: 20, ..rates };
    let compensation = Some(DelayCompensation { offset_ns: 200, filter_ns: 250 });
    assert_eq!(with(manual).gateway.physical_layer(0), Some(layer(8_750, 8_000, compensation)));
    // from 5 Mbit/s the firmware ignores "off"
    let forced = McanChannelConfig { tdc: false, ..McanChannelConfig::fd(1_000_000, 5_000_000) };
    let forced = with(forced.sample_point(875, 875));
    assert_eq!(forced.gateway.physical_layer(0), Some(layer(8_750, 8_750, automatic)));
}

/// 210 ns are 17 periods of 12.5 ns, the data sample point at 4 Mbit/s and 80 % is 16 periods.
#[test]
fn transmitter_delay_shows_after_the_first_switch() {
    let rates = McanChannelConfig::fd(1_000_000, 4_000_000).sample_point(875, 800);
    let delay = |config: McanChannelConfig, frame| {
        let model = GatewayModelConfig { transceiver_ns: 210, ..GatewayModelConfig::default() };
        let mut fixture = Fixture::preop_with(model);
        fixture.apply_profiles(chunks(16), chunks(16));
        fixture.apply_channel(0, config);
        fixture.start();
        let before = fixture.upload(0x9000, 2) >> 16;
        fixture.push(0, frame);
        fixture.cycle();
        assert_eq!(fixture.sent(0), [frame]);
        (before, fixture.upload(0x9000, 2) >> 16)
    };
    let manual = McanChannelConfig { tdc_offset: 5, ..rates };
    let off = McanChannelConfig { tdc: false, ..rates };
    assert_eq!(delay(rates, fd(1, &[1; 8])), (0, 17 + 16));
    assert_eq!(delay(manual, fd(1, &[1; 8])), (0, 17 + 5));
    assert_eq!(delay(off, fd(1, &[1; 8])), (0, 0));
    assert_eq!(delay(rates, standard(1, &[])), (0, 0));
}

/// LEC and DLEC, IR.PEA and PED, ECR.CEL of the M_CAN core.
#[test]
fn registers_show_errors_by_phase_until_they_are_read() {
    let mut fixture = with(McanChannelConfig::fd(1_000_000, 5_000_000));
    let codes = |fixture: &mut Fixture| {
        let value = fixture.upload(0x9000, 2);
        (value & 7, value >> 8 & 7)
    };
    let in_arbitration = 1 << 27;
    let in_data = 1 << 28;
    let note = |fixture: &mut Fixture, count, error, phase| {
        let now = fixture.now;
        fixture.gateway.bus_errors(now, 0, count, DetectedError { error, phase });
    };
    assert_eq!(codes(&mut fixture), (7, 7));
    note(&mut fixture, 3, BusError::Bit0, Phase::Data);
    assert_eq!(fixture.upload(0x9000, 1) >> 16, 3);
    assert_eq!(fixture.upload(0x9000, 1) >> 16, 0, "cleared by the first read");
    assert_eq!(fixture.upload(0x9000, 3) & (in_arbitration | in_data), in_data);
    assert_eq!(codes(&mut fixture), (7, 5));
    assert_eq!(codes(&mut fixture), (7, 7), "cleared by the first read");

    note(&mut fixture, 1, BusError::Ack, Phase::Nominal);
    note(&mut fixture, 1, BusError::Stuff, Phase::Data);
    assert_eq!(fixture.upload(0x9000, 3) & (in_arbitration | in_data), in_arbitration | in_data);
    fixture.deliver(0, standard(1, &[]));
    assert_eq!(codes(&mut fixture), (0, 1), "a classic frame has no data phase");
    note(&mut fixture, 1, BusError::Stuff, Phase::Data);
    fixture.deliver(0, fd(1, &[1; 8]));
    assert_eq!(codes(&mut fixture), (0, 0));
}
