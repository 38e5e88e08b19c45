use ecan_mcan_port::{CpuCost, ImageFill, ImagePlan, PortPlan};
use serde::Serialize;

use super::advice::advice;

#[derive(Debug, Serialize)]
pub(super) struct Report {
    cycle_ns: u32,
    wire_ns: u64,
    wire_bytes: usize,
    /// Per cycle.
    wire_share: f64,
    /// Estimate for the images only.
    cpu_ns: f64,
    working_counter: WorkingCounter,
    mailbox: Mailbox,
    channels: Vec<Channel>,
    images: Vec<Image>,
    warnings: Vec<String>,
    /// For the host.
    notes: Vec<String>,
    faults: Vec<String>,
}

/// Expected working counter per release of IgH.
#[derive(Debug, Serialize)]
struct WorkingCounter {
    igh_1_6: u32,
    igh_1_5: u32,
}

#[derive(Debug, Serialize)]
struct Mailbox {
    available_bytes: usize,
    headroom_bytes: usize,
    transfers_per_cycle: usize,
}

#[derive(Debug, Serialize)]
struct Channel {
    slave: usize,
    channel: u8,
    sent_per_cycle: f64,
    received_per_cycle: f64,
    /// Frames per service of the gateway, from the bus and to the bus.
    rx_budget: u8,
    tx_budget: u8,
    least_load: f64,
    most_load: f64,
}

#[derive(Debug, Serialize)]
struct Image {
    slave: usize,
    direction: String,
    area_bytes: usize,
    mean: Fill,
    fullest: Fill,
}

#[derive(Debug, Serialize)]
struct Fill {
    packets: f64,
    bytes: f64,
}

impl Report {
    pub(super) fn new(plan: &PortPlan, faults: &[String]) -> Self {
        let wire = &plan.ethercat;
        let (igh_1_6, igh_1_5) =
            (wire.expected_working_counter((1, 6)), wire.expected_working_counter((1, 5)));
        let channels = plan.channels.iter().map(|it| Channel {
            slave: it.slave,
            channel: it.channel,
            sent_per_cycle: it.load.mean_sent,
            received_per_cycle: it.load.mean_received,
            rx_budget: it.drain,
            tx_budget: it.serve,
            least_load: it.load.least,
            most_load: it.load.most,
        });
        let gateways = plan.gateways.iter().enumerate();
        let images = gateways.flat_map(|(slave, gateway)| {
            [&gateway.rx, &gateway.tx].map(|image| Image::of(slave, image))
        });
        Self {
            cycle_ns: wire.cycle_ns,
            wire_ns: wire.wire_ns(),
            wire_bytes: wire.wire_bytes(),
            wire_share: wire.wire_share(),
            cpu_ns: plan.cpu_ns(CpuCost::MEASURED),
            working_counter: WorkingCounter { igh_1_6, igh_1_5 },
            mailbox: Mailbox {
                available_bytes: wire.mailbox.available_bytes,
                headroom_bytes: wire.mailbox.headroom_bytes(),
                transfers_per_cycle: wire.mailbox.transfers(),
            },
            channels: channels.collect(),
            images: images.collect(),
            warnings: plan.warnings.iter().map(ToString::to_string).collect(),
            notes: advice(plan),
            faults: faults.to_vec(),
        }
    }
}

impl Image {
    fn of(slave: usize, image: &ImagePlan) -> Self {
        let fill = |fill: &ImageFill| Fill { packets: fill.packets, bytes: fill.bytes };
        Self {
            slave,
            direction: image.direction.to_string(),
            area_bytes: image.area_bytes(),
            mean: fill(&image.mean),
            fullest: fill(&image.peak),
        }
    }
}
