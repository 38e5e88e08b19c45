//! Alternatives for what the manual leaves open, as the gateway shows them.

use ecan_protocol::config::{McanChannelConfig, NodeMode};
use ecan_protocol::image::PdoError;
use ecan_sim::variant::{GatewayVariant, NodeModes, RepeatedImage};
use ecan_sim::{GatewayModelConfig, StationMode};

use crate::fixture::{Fixture, chunks, standard};

/// In OP with one chunk per direction.
fn op(variant: GatewayVariant) -> Fixture {
    let config = GatewayModelConfig { variant, ..GatewayModelConfig::default() };
    let mut fixture = Fixture::configured_with(config, chunks(1), chunks(1));
    fixture.start();
    fixture
}

#[test]
fn repeated_image_is_no_op_or_error_10() {
    for (repeated_image, error, counted) in [
        (RepeatedImage::NoOp, PdoError::Ok, 0),
        (RepeatedImage::CountedAsError, PdoError::DuplicateSequence, 1),
    ] {
        let mut fixture = op(GatewayVariant { repeated_image, ..GatewayVariant::default() });
        fixture.push(0, standard(0x123, &[1]));
        assert!(fixture.write());
        assert!(fixture.write_again());
        assert_eq!(fixture.sent(0).len(), 1, "{repeated_image:?}");
        assert_eq!(fixture.upload(0x8011, 14), u32::from(error.raw()), "{repeated_image:?}");
        assert_eq!(fixture.upload(0x8011, 15), counted, "{repeated_image:?}");
    }
}

#[test]
fn node_modes_follow_the_numbers_of_the_variant() {
    use StationMode::{ExternalLoopback, InternalLoopback, Listen};
    for (node_modes, expected) in [
        (NodeModes::Manual, [Listen, InternalLoopback, ExternalLoopback]),
        (NodeModes::LoopbackFirst, [InternalLoopback, ExternalLoopback, Listen]),
    ] {
        let mut fixture = op(GatewayVariant { node_modes, ..GatewayVariant::default() });
        for (number, expected) in (1..).zip(expected) {
            let node_mode = NodeMode::from_raw(number).unwrap();
            let config = McanChannelConfig::classic(500_000);
            fixture.apply_channel(0, McanChannelConfig { node_mode, ..config });
            let station = fixture.gateway.station_config(0).unwrap();
            assert_eq!(station.mode, expected, "{node_modes:?} {number}");
        }
    }
}
