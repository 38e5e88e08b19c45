//! From a configuration to a configured bus, and every way in which that fails.

use std::path::Path;
use std::time::Duration;

use crate::common::{open, raw_config, simulated};
use ecan_host::{
    Adapter, AdapterConfig, Diagnostics, Error, Identity, Phase, StartupPlan, StartupStep,
};
use ecan_protocol::object::{ObjectType, SdoWrite};
use ecan_sim::Scenario;

#[test]
fn identity_is_taken_from_the_bus() {
    let adapter = open(ecan_sim::echo(2), AdapterConfig::new(2)).unwrap();
    let settings = ecan_sim::GatewayModelConfig::default();
    let found = adapter.slave(1).unwrap().identity();
    assert_eq!((found.vendor_id, found.product_code), (settings.vendor_id, settings.product_code));
    assert_eq!(adapter.phase(), Phase::Configured);
    assert!(adapter.ecrt().is_simulated());
}

#[test]
fn identity_mismatch_is_rejected() {
    let mut config = AdapterConfig::new(1);
    config.slaves[0].identity = Some(Identity { vendor_id: 0xBEEF, product_code: 1 });
    let error = open(ecan_sim::echo(1), config).unwrap_err();
    assert!(matches!(error, Error::IdentityMismatch { slave: 0, .. }));
    assert!(error.to_string().contains("vendor 0x0000BEEF"), "{error}");
}

#[test]
fn device_that_is_no_ecan_lite_is_rejected_by_its_objects() {
    let mut scenario = ecan_sim::echo(1);
    let abort = ecan_sim::GatewayFault::SdoAbort {
        index: 0xF000,
        subindex: 17,
        code: 0x0609_0011,
        times: 1,
    };
    scenario.faults.push(ecan_sim::ScriptedFault {
        when: ecan_sim::When::At(0),
        fault: ecan_sim::Fault::Gateway { gateway: 0, fault: abort },
    });
    let error = open(scenario, AdapterConfig::new(1)).unwrap_err();
    let text = error.to_string();
    assert!(text.contains("cannot be identified") && text.contains("0xF000:17"), "{text}");
}

#[test]
fn slaves_are_found_by_alias() {
    let mut scenario = ecan_sim::echo(3);
    scenario.gateways[1].alias = 77;
    let mut config = AdapterConfig::new(1);
    config.slaves[0].alias = 77;
    config.slaves[0].position = 1;
    let adapter = open(scenario.clone(), config).unwrap();
    let serial = adapter.diagnostics().sdo_upload_u32(0, 0xF000, 7).unwrap();
    assert_eq!(u64::from(serial), scenario.gateways[2].config.serial & 0xFFFF_FFFF);
    config.slaves[0].alias = 78;
    config.preop_timeout = Duration::from_millis(300);
    let error = open(scenario, config).unwrap_err();
    assert!(matches!(error, Error::NoSuchSlave { alias: 78, .. }), "{error}");
}

#[test]
fn first_chunks_are_assigned_and_the_domain_is_continuous() {
    let mut config = AdapterConfig::new(1);
    config.slaves[0].rx_multiplier = 2;
    config.slaves[0].tx_multiplier = 4;
    let mut adapter = open(ecan_sim::echo(1), config).unwrap();
    assert!(adapter.rx_pdo(0).is_empty(), "no image before activation");
    // Its profiles have 8 chunks, so that it stays in PREOP, with the assignment.
    adapter.wait_op(Duration::from_secs(20)).unwrap_err();
    let cycle = |adapter: &mut Adapter| adapter.receive().and_then(|()| adapter.send());
    let assigned = adapter.diagnose(cycle, |diagnostics| {
        let upload = |index, subindex| diagnostics.sdo_upload_u32(0, index, subindex).unwrap();
        [0x1C12, 0x1C13].map(|object| {
            (1..=upload(object, 0)).map(|entry| upload(object, entry as u8)).collect::<Vec<u32>>()
        })
    });
    let expected = [vec![0x1600, 0x1601], vec![0x1A00, 0x1A01, 0x1A02, 0x1A03]];
    assert_eq!(assigned.unwrap(), expected);
    assert_eq!((adapter.rx_pdo(0).len(), adapter.tx_pdo(0).len()), (256, 512));
    assert_eq!(adapter.rx_pdo_mut(0).len(), 256);
    assert!(adapter.rx_pdo(1).is_empty() && adapter.tx_pdo(1).is_empty());
}

/// `ecan scan` uses `require_link` and `require_slaves`, applications open an Adapter.
#[test]
fn open_cable_is_named_before_missing_slaves() {
    let (ecrt, simulation) = simulated(ecan_sim::echo(1));
    simulation.inject(ecan_sim::Fault::LinkLoss { gateway: 0, for_ms: 60_000 });
    simulation.pass_ns(1_000_000_000);
    let diagnostics = Diagnostics::of_bus(&ecrt, 0).unwrap();
    for result in [diagnostics.require_link(), diagnostics.require_slaves()] {
        assert!(matches!(result, Err(Error::NoLink)), "{result:?}");
    }
    let mut config = AdapterConfig::new(1);
    config.preop_timeout = Duration::from_millis(300);
    let error = Adapter::open(&ecrt, config, StartupPlan::default()).unwrap_err();
    assert!(matches!(error, Error::NoLink), "{error}");
    assert!(error.is_temporary());
}

#[test]
fn empty_bus_is_named_with_the_missing_slave() {
    let (ecrt, _simulation) = simulated(ecan_sim::echo(0));
    let diagnostics = Diagnostics::of_bus(&ecrt, 0).unwrap();
    diagnostics.require_link().unwrap();
    assert!(matches!(diagnostics.require_slaves(), Err(Error::NoSlaves)));
    let mut config = AdapterConfig::new(1);
    config.preop_timeout = Duration::from_millis(300);
    let error = Adapter::open(&ecrt, config, StartupPlan::default()).unwrap_err();
    assert!(error.to_string().contains(&Error::NoSlaves.to_string()), "{error}");
}

#[test]
fn readback_mismatch_is_described() {
    let mut config = AdapterConfig::new(1);
    // N = 8 in the profile, N = 3 in the assignment: the apply command answers 5 (manual 14.2).
    for (subindex, value) in [(3, 8), (1, 1)] {
        let write = SdoWrite { index: 0x8010, subindex, value, ty: ObjectType::U8 };
        config.add_startup(0, StartupStep::Download(write)).unwrap();
    }
    config.add_startup(0, StartupStep::expect(0x8010, 2, 0)).unwrap();
    let error = open(ecan_sim::echo(1), config).unwrap_err();
    let Error::Readback { slave: 0, index: 0x8010, subindex: 2, found: 5, .. } = error else {
        panic!("{error}")
    };
    let text = error.to_string();
    assert!(text.contains("reload") && text.contains("OK"), "{text}");
}

/// The write of an optional object is left out for firmware without it, and only then.
#[test]
fn optional_object_is_left_out_where_it_is_missing() {
    let written = |variant: &str, abort_code| {
        let text = format!("[[gateway]]\n[gateway.variant]\n{variant}\n");
        let scenario = Scenario::from_toml(&text, "test", Path::new(".")).unwrap();
        let (ecrt, simulation) = simulated(scenario);
        if let Some(code) = abort_code {
            let abort =
                ecan_sim::GatewayFault::SdoAbort { index: 0x8021, subindex: 1, code, times: 1 };
            simulation.inject(ecan_sim::Fault::Gateway { gateway: 0, fault: abort });
        }
        let write = SdoWrite { index: 0x8021, subindex: 8, value: 0, ty: ObjectType::U8 };
        let plan = StartupPlan::from_iter([vec![StartupStep::Download(write)]]);
        let mut adapter = Adapter::open(&ecrt, raw_config().0, plan).unwrap();
        adapter.wait_op(Duration::from_secs(20)).unwrap();
        drop(adapter);
        let diagnostics = Diagnostics::open(&ecrt, &AdapterConfig::new(1)).unwrap();
        diagnostics.sdo_upload_u32(0, 0x8021, 8)
    };
    assert_eq!(written("", None).unwrap(), 0);
    let missing = written("missing_entries = [\"0x8021\"]", None).unwrap_err();
    assert!(missing.is_missing_object(), "{missing}");
    assert_eq!(written("", Some(0x0800_0022)).unwrap(), 0, "it cannot be read now");
}

#[test]
fn master_is_released_after_every_error() {
    let (ecrt, _simulation) = simulated(ecan_sim::echo(1));
    let mut absent = AdapterConfig::new(2);
    absent.preop_timeout = Duration::from_millis(100);
    assert!(Adapter::open(&ecrt, absent, StartupPlan::default()).is_err());
    let adapter = Adapter::open(&ecrt, AdapterConfig::new(1), StartupPlan::default()).unwrap();
    let busy = Adapter::open(&ecrt, AdapterConfig::new(1), StartupPlan::default()).unwrap_err();
    assert!(matches!(busy, Error::Open(_)), "{busy}");
    drop(adapter);
    let mut adapter = Adapter::open(&ecrt, raw_config().0, StartupPlan::default()).unwrap();
    adapter.wait_op(Duration::from_secs(20)).unwrap();
    drop(adapter);
    assert!(Adapter::open(&ecrt, AdapterConfig::new(1), StartupPlan::default()).is_ok());
}

#[test]
fn call_in_a_wrong_phase_is_rejected_by_name() {
    let mut adapter = open(ecan_sim::echo(1), AdapterConfig::new(1)).unwrap();
    assert!(adapter.receive().unwrap_err().to_string().contains("not active"));
    assert!(adapter.send().is_err());
    adapter.activate().unwrap();
    let again = adapter.activate().unwrap_err().to_string();
    assert!(again.contains("activate") && again.contains("configured"), "{again}");
    let late = adapter.requests().create_sdo(0, 4).unwrap_err();
    assert!(matches!(late, Error::Phase { is: Phase::Active, .. }), "{late}");
    assert!(matches!(adapter.slave(3), Err(Error::SlaveIndex { slave: 3, count: 1 })));
}
