//! Changes of the filter lists in one gateway.

use ecan_sim::{Backend, ClockKind, SimOptions};

use super::channel_filters::{ChannelFilters, Kind, RawFilter};
use crate::bus::Bus;
use crate::failure::Failure;

fn simulated() -> (Backend, Bus) {
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    let backend = ecan_sim::open_scenario(ecan_sim::echo(1), &options).unwrap();
    let bus = Bus::over(&backend.ecrt);
    (backend, bus)
}

fn range(id1: u32, id2: u32) -> RawFilter {
    RawFilter { matching: 0, action: 1, sync: 0, id1, id2 }
}

#[test]
fn filters_are_added_and_removed_in_order() {
    let (_backend, bus) = simulated();
    let filters = ChannelFilters { bus: &bus, slave: 0, channel: 2 };
    let list: Vec<_> = (0..4).map(|n| range(n * 16, n * 16 + 1)).collect();
    for filter in &list {
        filters.append(Kind::Standard, *filter).unwrap();
    }
    filters.append(Kind::Extended, range(7, 8)).unwrap();
    assert_eq!(filters.read(Kind::Standard).unwrap(), list);
    filters.remove(Kind::Standard, 1).unwrap();
    assert_eq!(filters.read(Kind::Standard).unwrap(), [list[0], list[2], list[3]]);
    assert_eq!(filters.read(Kind::Extended).unwrap(), [range(7, 8)]);
    let message = filters.remove(Kind::Standard, 3).unwrap_err();
    assert_eq!(
        message.to_string(),
        "CAN2: invalid filter number; allowed for standard filters: 0 to 2"
    );
    filters.replace(Kind::Standard, &[]).unwrap();
    assert_eq!(filters.read(Kind::Standard).unwrap(), []);
    // Filters after the list are disabled: a larger count does not enable them.
    bus.write(0, 0x8003, 49, 4).unwrap();
    let unused = RawFilter { matching: 0, action: 0, sync: 0, id1: 0, id2: 0 };
    assert_eq!(filters.read(Kind::Standard).unwrap(), [unused; 4]);
    // The other channel has no filters.
    let other = ChannelFilters { bus: &bus, slave: 0, channel: 1 };
    assert_eq!(other.read(Kind::Standard).unwrap(), []);
}

#[test]
fn full_list_rejects_filters() {
    let (_backend, bus) = simulated();
    let filters = ChannelFilters { bus: &bus, slave: 0, channel: 0 };
    for n in 0..24 {
        filters.append(Kind::Extended, range(n, n)).unwrap();
    }
    let full = filters.append(Kind::Extended, range(1, 1)).unwrap_err();
    assert!(matches!(full, Failure::Usage(_)));
    assert_eq!(full.to_string(), "no free extended filter; 24 are in use");
}

#[test]
fn running_channel_is_applied() {
    let (backend, bus) = simulated();
    let filters = ChannelFilters { bus: &bus, slave: 0, channel: 0 };
    assert!(!filters.is_running().unwrap());
    filters.apply().unwrap();
    assert!(filters.is_running().unwrap());
    let simulation = backend.simulation.unwrap();
    let applied = || {
        let gateway = |world: &mut ecan_sim::World| world.gateway(0).unwrap().station_generation(0);
        simulation.with_world(gateway)
    };
    let before = applied();
    filters.append(Kind::Standard, range(1, 2)).unwrap();
    assert_eq!(applied(), before, "only the list changed");
    filters.apply().unwrap();
    assert_ne!(applied(), before, "the controller was restarted");
    // An invalid configuration is reported.
    bus.write(0, 0x8001, 62, 64).unwrap();
    let message = filters.apply().unwrap_err();
    assert!(
        message.to_string().starts_with("CAN0: configuration not applied, status 4"),
        "{message}"
    );
}
