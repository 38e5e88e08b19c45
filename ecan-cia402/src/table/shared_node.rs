//! Axes by their nodes: which axis a TPDO belongs to. A node with several axes is configured once, and stops one
//! axis at a time by SDO.

use ecan_canopen::{Network, NodeAddress};
use ecan_protocol::can::CanId;
use ecan_protocol::mapping::CHANNELS;

use crate::axis::axis::Axis;
use crate::axis::setup::{NodeShare, SetupState};
use crate::axis::status::AxisError;

/// A node with several axes in the table.
#[derive(Debug)]
pub(super) struct SharedNode {
    /// Indices in the table; the first one has the steps of the configuration.
    axes: Vec<usize>,
    turn: Turn,
}

/// The axis that may begin SDO transfers next: all in turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Turn {
    next: usize,
}

impl Turn {
    /// The axis that may use the SDO client in this cycle, of `count`: the one whose transfers run, else
    /// the next one.
    fn holder(&mut self, running: Option<usize>, count: usize) -> usize {
        let holder = running.unwrap_or(self.next);
        self.next = (holder + 1) % count.max(1);
        holder
    }
}

impl SharedNode {
    /// The nodes with several axes, and the part of each axis. Allocates.
    pub(super) fn find(axes: &mut [Axis]) -> Vec<Self> {
        let mut nodes = Vec::new();
        for index in 0..axes.len() {
            let Some(node) = axes.get(index).map(|axis| axis.plan.node) else { continue };
            let of_node =
                || axes.iter().filter(|axis| axis.plan.node == node).map(|axis| axis.plan.index);
            let members: Vec<usize> = of_node().collect();
            if members.len() < 2 {
                continue;
            }
            let is_first = members.first() == Some(&index);
            if let Some(axis) = axes.get_mut(index) {
                let count = members.len();
                let share = NodeShare::default();
                axis.setup.node_share = NodeShare { count, is_first, may_begin: false, ..share };
            }
            if is_first {
                nodes.push(Self { axes: members, turn: Turn::default() });
            }
        }
        nodes
    }

    fn members<'a>(&'a self, axes: &'a [Axis]) -> impl Iterator<Item = &'a Axis> {
        self.axes.iter().filter_map(|index| axes.get(*index))
    }

    pub(super) fn contains(&self, index: usize) -> bool {
        self.axes.contains(&index)
    }

    pub(super) fn for_each(&self, axes: &mut [Axis], mut action: impl FnMut(&mut Axis)) {
        for index in &self.axes {
            axes.get_mut(*index).into_iter().for_each(&mut action);
        }
    }

    /// Gives the SDO client to one of the axes, before their steps.
    pub(super) fn begin_cycle(&mut self, axes: &mut [Axis], now_ns: u64) {
        let is_heard = self.members(axes).any(|axis| axis.link.is_fresh(now_ns));
        let running = self.members(axes).position(|axis| axis.link.is_polling());
        let nth = self.turn.holder(running, self.axes.len());
        let holder = self.axes.get(nth).copied();
        self.for_each(axes, |axis| {
            axis.setup.node_share.may_poll = Some(axis.plan.index) == holder;
            axis.setup.node_share.is_heard = is_heard;
        });
    }

    /// Continues the configuration of the node, after the steps of its axes.
    pub(super) fn end_cycle(&self, axes: &mut [Axis], network: &mut Network, now_ns: u64) {
        if self.members(axes).any(|axis| axis.setup.node_share.is_setup_wanted) {
            let is_pending = self.members(axes).all(|axis| axis.setup.state().is_pending());
            self.for_each(axes, |axis| {
                axis.setup.node_share.is_setup_wanted = false;
                if !is_pending {
                    axis.request_setup(network, now_ns);
                }
            });
        }
        if self.members(axes).all(is_ready_for_setup) {
            return self.for_each(axes, |axis| axis.begin_setup(network, now_ns));
        }
        let failed =
            self.members(axes).find(|axis| matches!(axis.setup.state(), SetupState::Failed));
        if let Some(error) = failed.map(|axis| axis.report.error) {
            // One that could not be stopped keeps the others from their configuration.
            self.for_each(axes, |axis| axis.fail_requested_setup(error));
        }
        self.finish_steps(axes, network);
    }

    /// The steps of the first axis are complete, or have failed: so are those of the others.
    fn finish_steps(&self, axes: &mut [Axis], network: &mut Network) {
        let Some((first, others)) = self.axes.split_first() else { return };
        let Some(first) = axes.get_mut(*first) else { return };
        let (setup, error) = (*first.setup.state(), first.report.error);
        if matches!(setup, SetupState::Configuring | SetupState::Requested { .. }) {
            return;
        }
        let configurator = first.setup.take_configurator();
        for other in others {
            let Some(axis) = axes.get_mut(*other) else { continue };
            if !matches!(axis.setup.state(), SetupState::Configuring) {
                continue;
            }
            match (setup, error) {
                (SetupState::SettingMode(_) | SetupState::Complete, _) => {
                    axis.finish_steps(network, &configurator);
                }
                (SetupState::Failed, Some(AxisError::Setup(failure))) => axis.fail_setup(failure),
                _ => axis.setup.end(),
            }
        }
        if let Some(first) = self.axes.first().and_then(|first| axes.get_mut(*first)) {
            first.setup.return_configurator(configurator);
        }
    }
}

/// Returns whether an axis is ready for the configuration of its node.
fn is_ready_for_setup(axis: &Axis) -> bool {
    matches!(axis.setup.state(), SetupState::Requested { .. })
        && axis.link.contact().is_done()
        && !axis.task.is_stopping()
}

/// CAN IDs of 11 bits.
const CAN_IDS: usize = 0x800;

/// By CAN ID: the axis, and which of its TPDOs it is.
type Tpdos = Vec<Option<(u16, u8)>>;

/// Axis of a TPDO by slave, channel and CAN ID. A channel without axes has no entries.
#[derive(Debug)]
pub(super) struct AxisLookup {
    slaves: Vec<[Tpdos; CHANNELS]>,
}

impl AxisLookup {
    pub(super) fn new(slaves: usize) -> Self {
        Self { slaves: (0..slaves).map(|_| Default::default()).collect() }
    }

    /// Adds the TPDOs of an axis in their order.
    pub(super) fn insert(
        &mut self,
        address: NodeAddress,
        ids: impl Iterator<Item = CanId>,
        axis: u16,
    ) {
        let channels = self.slaves.get_mut(address.slave);
        let tpdos = channels.and_then(|of_slave| of_slave.get_mut(usize::from(address.channel)));
        let Some(tpdos) = tpdos else { return };
        tpdos.resize(CAN_IDS, None);
        for (nth, id) in (0..).zip(ids) {
            if let Some(slot) = tpdos.get_mut(id.raw() as usize) {
                *slot = Some((axis, nth));
            }
        }
    }

    /// The axis of a TPDO, and which of its TPDOs it is.
    pub(super) fn tpdo(&self, slave: usize, channel: u8, id: CanId) -> Option<(usize, usize)> {
        if id.is_extended() {
            return None;
        }
        let tpdos = self.slaves.get(slave)?.get(usize::from(channel))?;
        let (axis, nth) = (*tpdos.get(id.raw() as usize)?)?;
        Some((usize::from(axis), usize::from(nth)))
    }
}

#[cfg(test)]
mod tests {
    use ecan_canopen::NodeId;

    use super::*;

    #[test]
    fn axes_take_turns_whatever_their_transfers_take() {
        for cycles in 1..6 {
            let (mut turn, mut begun) = (Turn::default(), [0; 3]);
            for _ in 0..30 {
                let holder = turn.holder(None, 3);
                begun[holder] += 1;
                for _ in 0..cycles {
                    assert_eq!(turn.holder(Some(holder), 3), holder);
                }
            }
            assert_eq!(begun, [10; 3], "{cycles}");
        }
    }

    #[test]
    fn only_mapped_tpdos_are_found() {
        let node = NodeId::new(5).unwrap();
        let id = |raw| CanId::standard(raw).unwrap();
        let mut lookup = AxisLookup::new(2);
        let address = NodeAddress { slave: 1, channel: 3, node };
        lookup.insert(address, [id(0x285), id(0x385)].into_iter(), 7);
        lookup.insert(address, [id(0x1A0)].into_iter(), 8);
        assert_eq!(lookup.tpdo(1, 3, id(0x285)), Some((7, 0)));
        assert_eq!(lookup.tpdo(1, 3, id(0x385)), Some((7, 1)));
        assert_eq!(lookup.tpdo(1, 3, id(0x1A0)), Some((8, 0)));
        for (slave, channel, raw) in [
            (1, 3, 0x185),
            (1, 3, 0x305),
            (1, 3, 0x7FF),
            (1, 3, 0x286),
            (0, 3, 0x285),
            (1, 2, 0x285),
            (9, 3, 0x285),
        ] {
            assert_eq!(lookup.tpdo(slave, channel, id(raw)), None);
        }
        assert_eq!(lookup.tpdo(1, 3, CanId::extended(0x285).unwrap()), None);
    }
}
