//! Connection of a service to the cycle of a Port.

use std::time::SystemTime;

use ecan_host::{AdapterConfig, Clock};
use ecan_mcan_port::{GatewayConfig, Port};
use ecan_protocol::image::OptionFlags;
use ecan_protocol::mapping::Direction;

use crate::protocol::{ActiveConfig, Channel, Gateway};
use crate::server::bus_view::{BusView, nanoseconds};
use crate::server::frame_feed::FrameFeed;

/// Parts of a service that belong to one configuration of a Port.
#[derive(Debug)]
pub(crate) struct Attachment {
    pub(crate) feed: FrameFeed,
    pub(crate) view: BusView,
    pub(crate) cycle_ns: u64,
    pub(crate) gateways: Vec<Gateway>,
    pub(crate) config: ActiveConfig,
    pub(crate) adapter: AdapterConfig,
}

impl Attachment {
    pub(crate) fn new(port: &mut Port, ring_bytes: usize, queue_depth: usize) -> Self {
        let stream = port.image_stream(ring_bytes);
        let queues = port.transmit_queues(queue_depth);
        let since_1970_ns = since_1970_ns(port.adapter().clock());
        let gateways = gateways(port.adapter().config(), &port.config().gateways);
        let has_results = gateways.iter().map(|gateway| gateway.has_results);
        let feed = FrameFeed::new(stream, queues, has_results, since_1970_ns);
        let view = BusView::new(&port.adapter().observer(), since_1970_ns);
        // infallible: plain data
        let config = ActiveConfig {
            adapter: serde_json::to_value(port.adapter().config()).unwrap_or_default(),
            port: serde_json::to_value(port.config()).unwrap_or_default(),
        };
        let cycle_ns = nanoseconds(port.adapter().config().cycle);
        let adapter = *port.adapter().config();
        Self { feed, view, cycle_ns, gateways, config, adapter }
    }
}

/// Offset of a clock to the time since 1970; 0 for stepped time.
fn since_1970_ns(clock: &dyn Clock) -> u64 {
    if !clock.is_free_running() {
        return 0;
    }
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    nanoseconds(since).wrapping_sub(clock.now_ns())
}

fn gateways<'a>(
    adapter: &AdapterConfig,
    gateways: impl IntoIterator<Item = &'a GatewayConfig>,
) -> Vec<Gateway> {
    let gateway = |(slave, config): (&ecan_host::SlaveConfig, &GatewayConfig)| Gateway {
        alias: slave.alias,
        position: slave.position,
        has_results: config.tx_options.contains(OptionFlags::TX_RESULT),
        channels: (0_u8..)
            .zip(&config.channels)
            .filter_map(|(channel, found)| {
                let can = &found.as_ref()?.can;
                Some(Channel {
                    channel,
                    bitrate: can.nominal_bitrate,
                    data_bitrate: can.fd.then_some(can.data_bitrate),
                    receives: config.carries(Direction::TxPdo, channel),
                    sends: config.carries(Direction::RxPdo, channel),
                })
            })
            .collect(),
    };
    adapter.slaves.iter().zip(gateways).map(gateway).collect()
}
