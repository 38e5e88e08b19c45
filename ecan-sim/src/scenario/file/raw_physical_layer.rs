//! Sample points and delays of a node.

use ecan_protocol::can::SamplePoint;

use crate::bus::{DelayCompensation, PhysicalLayer};

const SAMPLE_POINTS: std::ops::RangeInclusive<f64> = 50.0..=95.0;
const CABLE_MAX_NS: u32 = 10_000;
const TRANSCEIVER_MAX_NS: u32 = 1_000;
const OFFSET_MAX_NS: u32 = 10_000;

/// Keys of a node.
#[derive(Clone, Copy)]
pub(super) struct RawPhysicalLayer {
    pub(super) sample_point: Option<f64>,
    pub(super) data_sample_point: Option<f64>,
    pub(super) tdc: Option<bool>,
    pub(super) tdc_offset_ns: Option<u32>,
    pub(super) cable_ns: Option<u32>,
    pub(super) transceiver_ns: Option<u32>,
}

impl RawPhysicalLayer {
    pub(super) fn build(self) -> Result<Option<PhysicalLayer>, String> {
        let Some(nominal) = self.sample_point else {
            let keys = [
                ("data_sample_point", self.data_sample_point.is_some()),
                ("tdc", self.tdc.is_some()),
                ("tdc_offset_ns", self.tdc_offset_ns.is_some()),
                ("cable_ns", self.cable_ns.is_some()),
                ("transceiver_ns", self.transceiver_ns.is_some()),
            ];
            let stray = keys.into_iter().find(|(_, is_given)| *is_given);
            return stray.map_or(Ok(None), |(key, _)| Err(format!("`{key}` needs `sample_point`")));
        };
        let data = self.data_sample_point.unwrap_or(nominal);
        let mut layer =
            PhysicalLayer::new(point("sample_point", nominal)?, point("data_sample_point", data)?);
        let offset_ns = self.tdc_offset_ns.unwrap_or(0);
        if self.tdc == Some(false) && self.tdc_offset_ns.is_some() {
            return Err("`tdc_offset_ns` needs `tdc`".to_owned());
        }
        check("tdc_offset_ns", offset_ns, OFFSET_MAX_NS)?;
        layer.compensation = match self.tdc {
            Some(false) => None,
            _ => Some(DelayCompensation { offset_ns, filter_ns: 0 }),
        };
        layer.cable_ns = self.cable_ns.unwrap_or(layer.cable_ns);
        check("cable_ns", layer.cable_ns, CABLE_MAX_NS)?;
        layer.transceiver_ns = self.transceiver_ns.unwrap_or(layer.transceiver_ns);
        check_transceiver(layer.transceiver_ns)?;
        Ok(Some(layer))
    }
}

pub(super) fn check_transceiver(ns: u32) -> Result<(), String> {
    check("transceiver_ns", ns, TRANSCEIVER_MAX_NS)
}

fn check(key: &str, value: u32, max: u32) -> Result<(), String> {
    if value > max {
        return Err(format!("`{key}` {value} is out of range; allowed: 0 to {max}"));
    }
    Ok(())
}

/// A sample point in percent.
fn point(key: &str, percent: f64) -> Result<SamplePoint, String> {
    if !SAMPLE_POINTS.contains(&percent) {
        let (min, max) = (SAMPLE_POINTS.start(), SAMPLE_POINTS.end());
        return Err(format!("`{key}` {percent} is out of range; allowed: {min} to {max}"));
    }
    Ok(SamplePoint((percent * 100.0).round() as u16))
}
