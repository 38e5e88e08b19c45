//! The frames per service of 0x8021..0x8024 against the traffic of a channel (manual 13.2.2).

use ecan_protocol::config::{DATA_PATH_BUDGET_MAX, DataPathConfig};

use super::finding::{PortPlanError, PortWarning};

/// Rejects what no budget could serve: more frames per cycle in the long run than 8 each way.
pub(crate) fn rejection(
    (slave, channel): (usize, u8),
    received: u32,
    sent: u32,
) -> Option<PortPlanError> {
    let most = u32::from(DATA_PATH_BUDGET_MAX);
    (received > most || sent > most).then_some(PortPlanError::Budget {
        slave,
        channel,
        received,
        sent,
    })
}

/// Warns of budgets that are set too small for the traffic, though larger ones would do.
pub(super) fn warning(
    (slave, channel): (usize, u8),
    received: u32,
    sent: u32,
    data_path: &DataPathConfig,
) -> Option<PortWarning> {
    let frames = |count: u32| u8::try_from(count).unwrap_or(u8::MAX);
    (!data_path.carries(frames(received), frames(sent))).then_some(PortWarning::Budget {
        slave,
        channel,
        received,
        sent,
        drain: data_path.rx_drain_max,
        serve: data_path.tx_budget_max,
    })
}
