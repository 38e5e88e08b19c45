//! LSS (CiA 305).

use std::time::Duration;

use ecan_canopen::{
    FastscanFilter, Lss, LssAddress, LssAddressRange, LssBitRate, LssCommand, LssConfig, LssFault,
    LssResult, LssStartError, NmtCommand, NodeConfig, NodeId, WaitError,
};

use super::bench::{Bench, drives, identity, node_id, open_port};

#[test]
fn fastscan_gives_node_ids_to_all_drives() {
    let mut bench = Bench::new(drives(3, |drive| drive.quirks.without_node_id = true));
    bench.pass(100);
    assert_eq!(bench.lss_ok(LssCommand::IdentifyNonConfigured), LssResult::Found);
    let scan = LssCommand::Fastscan(FastscanFilter::default());
    for serial in 1..=3 {
        // The lowest address first.
        let found = LssResult::Address(identity(serial));
        assert_eq!(bench.lss_ok(scan), found);
        assert_eq!(bench.lss_ok(LssCommand::InquireNodeId), LssResult::NodeId(None));
        let node = node_id(10 + serial as u8);
        assert_eq!(bench.lss_ok(LssCommand::ConfigureNodeId(Some(node))), LssResult::Done);
        assert_eq!(bench.lss_ok(LssCommand::Store), LssResult::Done);
        assert_eq!(
            bench.lss_ok(LssCommand::SwitchGlobal { configuration: false }),
            LssResult::Done
        );
    }
    assert_eq!(bench.lss_ok(scan), LssResult::NotFound);
    assert_eq!(bench.lss_ok(LssCommand::IdentifyNonConfigured), LssResult::NotFound);
    for serial in 1..=3 {
        let node = bench.add_node(10 + serial, NodeConfig::default());
        assert_eq!(bench.read(node, 0x1018, 4), u64::from(serial));
    }
    assert_eq!(bench.network.statistics().lss_strays, 0);
}

#[test]
fn known_vendor_and_product_shorten_the_scan() {
    let mut bench = Bench::new(drives(1, |drive| drive.quirks.without_node_id = true));
    bench.pass(100);
    let before = bench.network.statistics().lss_sent;
    let LssAddress { vendor, product, revision, .. } = identity(1);
    let filter = FastscanFilter {
        vendor: Some(vendor),
        product: Some(product),
        revision: Some(revision),
        serial: None,
    };
    let scan = LssCommand::Fastscan(filter);
    assert_eq!(bench.lss_ok(scan), LssResult::Address(identity(1)));
    assert_eq!(bench.network.statistics().lss_sent - before, 1 + 3 + 33);
    let other = FastscanFilter { product: Some(1), ..filter };
    bench.lss_ok(LssCommand::SwitchGlobal { configuration: false });
    assert_eq!(bench.lss_ok(LssCommand::Fastscan(other)), LssResult::NotFound);
}

#[test]
fn selected_drive_reports_identity_and_gets_another_node_id() {
    let mut bench = Bench::new(drives(2, |_| {}));
    bench.pass(100);
    let range = LssAddressRange::of_product(0x5349_4D00, 402);
    assert_eq!(bench.lss_ok(LssCommand::Identify(range)), LssResult::Found);
    let others = LssAddressRange { serial: (3, u32::MAX), ..range };
    assert_eq!(bench.lss_ok(LssCommand::Identify(others)), LssResult::NotFound);
    assert_eq!(bench.lss_ok(LssCommand::SwitchSelective(identity(2))), LssResult::Done);
    assert_eq!(bench.lss_ok(LssCommand::InquireAddress), LssResult::Address(identity(2)));
    let node = LssResult::NodeId(NodeId::from_raw(2));
    assert_eq!(bench.lss_ok(LssCommand::InquireNodeId), node);
    bench.lss_ok(LssCommand::ConfigureNodeId(NodeId::from_raw(20)));
    bench.lss_ok(LssCommand::SwitchGlobal { configuration: false });
    let old = bench.add_node(2, NodeConfig::default());
    let new = bench.add_node(20, NodeConfig::default());
    bench.network.nmt(old, NmtCommand::ResetCommunication).unwrap();
    bench.until("boot-up of node 20", |network| network.status(new).unwrap().boot_ups == 1);
    assert_eq!(bench.read(new, 0x1018, 4), 2);
    assert_eq!(bench.network.status(old).unwrap().boot_ups, 0);
}

#[test]
fn lss_faults_are_typed_and_explained() {
    let mut bench = Bench::new(drives(1, |drive| drive.quirks.no_lss_store = true));
    bench.pass(100);
    let waited = |fault| match fault {
        LssFault::TimedOut { waited } | LssFault::NotSelected { waited } => waited.as_millis(),
        other => panic!("{other}"),
    };
    assert!((500..510).contains(&waited(bench.fault(LssCommand::InquireNodeId))));
    let fault = bench.fault(LssCommand::SwitchSelective(identity(7)));
    assert!(matches!(fault, LssFault::NotSelected { .. }), "{fault}");
    bench.lss_ok(LssCommand::SwitchSelective(identity(1)));
    assert_eq!(bench.fault(LssCommand::Store), LssFault::StoreNotSupported);
    let rejected = bench.lss(LssCommand::ConfigureBitRate(LssBitRate::Automatic)).unwrap_err();
    assert_eq!(
        rejected.to_string(),
        "LSS on slave 0 channel 0, configure bit rate automatic: the slave does not support automatic"
    );
    assert!(matches!(bench.network.lss_state(0, 0), Lss::Failed(_)));

    // Rejections before the start
    bench.network.start_lss(0, 0, LssCommand::Store).unwrap();
    let busy = LssStartError::Busy { slave: 0, channel: 0 };
    assert_eq!(bench.network.start_lss(0, 0, LssCommand::Store), Err(busy));
    bench.network.cancel_lss(0, 0);
    assert_eq!(bench.network.lss_failure(0, 0).unwrap().fault, LssFault::Cancelled);
    let unknown = LssStartError::UnknownChannel { slave: 0, channel: 1 };
    assert_eq!(bench.network.start_lss(0, 1, LssCommand::Store), Err(unknown));
}

#[test]
fn too_short_scan_time_is_detected() {
    let mut bench = Bench::new(drives(1, |drive| drive.quirks.without_node_id = true));
    bench.pass(100);
    let scan_time = Duration::from_micros(10);
    bench.network.set_lss_config(0, 0, LssConfig { scan_time, ..LssConfig::default() });
    match bench.lss(LssCommand::Fastscan(FastscanFilter::default())) {
        // No response in time at all, or some of them.
        Ok(LssResult::NotFound) => {}
        Err(WaitError::Lss(failure)) => {
            assert!(matches!(failure.fault, LssFault::Inconsistent { .. }), "{failure}");
        }
        other => panic!("{other:?}"),
    }
    bench.pass(10);
    assert!(bench.network.statistics().lss_strays > 0, "the responses were late");
}

#[test]
fn bit_rate_of_a_bus_changes_with_the_gateway() {
    let mut bench = Bench::new(drives(2, |_| {}));
    bench.pass(100);
    bench.lss_ok(LssCommand::SwitchGlobal { configuration: true });
    // Both drives respond to the configuration.
    bench.lss_ok(LssCommand::ConfigureBitRate(LssBitRate::Rate250k));
    bench.pass(10);
    bench.lss_ok(LssCommand::Store);
    bench.pass(10);
    bench.lss_ok(LssCommand::ActivateBitRate { delay_ms: 50 });
    drop(bench.port);
    bench.port = open_port(&bench.backend, 250_000);
    bench.lss_ok(LssCommand::SwitchGlobal { configuration: false });
    for id in [1, 2] {
        let node = bench.add_node(id, NodeConfig::default());
        assert_eq!(bench.read(node, 0x1018, 4), u64::from(id));
    }
    bench.network.nmt_channel(0, 0, NmtCommand::ResetNode).unwrap();
    bench.pass(100);
    let node = bench.network.handles().next().unwrap();
    assert_eq!(bench.read(node, 0x1018, 4), 1, "stored");
}
