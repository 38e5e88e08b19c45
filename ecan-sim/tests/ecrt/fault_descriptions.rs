//! Faults by their textual form, on command and at a time; the log of those that took effect.

use std::path::Path;
use std::sync::mpsc::channel;

use ecan_sim::{
    DrawnValue, Fault, FaultDescription, FaultEffect, FaultKind, Scenario, Simulation, When,
};
use ecrt_sys::Clock as _;

use crate::ecrt_support::{Program, stepped, stepped_echo};

/// A gateway with all nodes that faults concern.
const CELL: &str = r#"
[[gateway]]
[[io]]
position = 1
[[node]]
kind = "drive"
bus = "0.0"
node_id = 1
name = "shoulder"
"#;

fn cell() -> Simulation {
    let scenario = Scenario::from_toml(CELL, "cell", Path::new(".")).unwrap();
    stepped(scenario).simulation.unwrap()
}

/// A value of each key; that of a number without a row is 1.
const VALUES: [(&str, &str); 18] = [
    ("gateway", "0"),
    ("io", "0"),
    ("channel", "0"),
    ("node", "'shoulder'"),
    ("way", "'return'"),
    ("cycles", "2"),
    ("offset", "-1"),
    ("off_ms", "5"),
    ("for_ms", "5"),
    ("index", "0x8010"),
    ("subindex", "1"),
    ("code", "0x1B"),
    ("register", "1"),
    ("times", "3"),
    ("call", "'send'"),
    ("errno", "'EINTR'"),
    ("ns", "-100"),
    ("value", "5"),
];

fn describe(text: &str) -> FaultDescription {
    toml::from_str(text).unwrap_or_else(|error| panic!("{text}: {error}"))
}

fn execute(simulation: &Simulation, text: &str) -> Result<FaultEffect, String> {
    simulation.execute(&describe(text)).map_err(|error| error.to_string())
}

fn logged(simulation: &Simulation) -> Vec<String> {
    simulation.with_world(|world| world.faults().map(ToString::to_string).collect())
}

#[test]
fn every_kind_takes_effect_with_its_keys() {
    let simulation = cell();
    for kind in FaultKind::ALL {
        let before = logged(&simulation).len();
        let row = |key: &str| VALUES.iter().find(|(name, _)| *name == key);
        let value = |key: &str| row(key).map_or("1", |(_, value)| value);
        let keys = kind.keys().iter().map(|key| format!("{key} = {}\n", value(key)));
        let text = format!("kind = '{}'\n{}", kind.name(), keys.collect::<String>());
        if *kind == FaultKind::PowerOn {
            execute(&simulation, "kind = 'power_off'\ngateway = 0").unwrap();
        }
        let effect = execute(&simulation, &text).unwrap();
        let log = logged(&simulation);
        assert!(log.len() > before, "{text}");
        assert!(matches!(effect, FaultEffect::Injected(_)), "{effect:?}");
        assert_eq!(log.last(), Some(&effect.to_string()));
    }
}

#[test]
fn random_values_of_every_kind_are_valid() {
    let simulation = cell();
    for (kind, draw) in FaultKind::ALL.iter().filter_map(|kind| Some((kind, kind.draw()?))) {
        let place = |key: &&str| ["gateway", "io", "channel", "node"].contains(key);
        let of_place = VALUES.iter().filter(|(key, _)| place(key) && kind.keys().contains(key));
        let mut table = format!("kind = '{}'\n", kind.name());
        table.extend(of_place.map(|(key, value)| format!("{key} = {value}\n")));
        let values = |value: &DrawnValue| match value {
            DrawnValue::Between(first, end) => vec![first.to_string(), (end - 1).to_string()],
            DrawnValue::OneOf(texts) => texts.iter().map(ToString::to_string).collect(),
        };
        let most = draw.values.iter().map(|(_, value)| values(value).len()).max().unwrap_or(1);
        for nth in 0..most {
            let with = draw.values.iter().map(|(key, value)| {
                let all = values(value);
                format!("{key} = {}\n", all[nth % all.len()])
            });
            let text = table.clone() + &with.collect::<String>();
            assert!(draw.weight > 0 && execute(&simulation, &text).is_ok(), "{text}");
        }
    }
}

#[test]
fn fault_that_concerns_nothing_is_rejected() {
    let simulation = stepped_echo(1).simulation.unwrap();
    for (text, reason) in [
        ("kind = 'power_off'\ngateway = 1", "gateway 1 does not exist; there are 1"),
        ("kind = 'bus_off'", "`bus_off` needs `channel`"),
        (
            "kind = 'link_loss'\ngateway = 0\nfor_ms = 1\ntimes = 2",
            "`times` does not belong to `link_loss`; allowed: gateway, for_ms",
        ),
        ("kind = 'drive_error'\nnode = 'echo 0.0'\ncode = 1", "node \"echo 0.0\" is not a drive"),
    ] {
        assert_eq!(execute(&simulation, text).unwrap_err(), reason);
    }
    let effect = execute(&simulation, "kind = 'power_on'\ngateway = 0").unwrap();
    assert_eq!(effect.to_string(), "no effect: gateway 0 supplied again");
    assert_eq!(logged(&simulation), [""; 0]);
}

#[test]
fn only_gateway_and_io_are_the_default() {
    let simulation = cell();
    let text = |text| execute(&simulation, text).unwrap().to_string();
    assert!(text("kind = 'link_loss'\nfor_ms = 1").ends_with("before gateway 0 for 1 ms"));
    assert!(text("kind = 'io_power_cycle'").ends_with("I/O 0 without supply for 1000 ms"));
    let error = execute(&stepped_echo(2).simulation.unwrap(), "kind = 'power_off'").unwrap_err();
    assert_eq!(error, "`power_off` needs `gateway`; there are 2");
}

#[test]
fn scheduled_faults_are_pending_until_their_time() {
    let simulation = stepped_echo(1).simulation.unwrap();
    let pending = || simulation.with_world(|world| world.pending_faults().collect::<Vec<_>>());
    simulation.pass_ns(2_000_000);
    let now_ns = simulation.with_world(|world| world.now_ns() - world.start_ns());
    for (time, text) in [
        ("after_op_ms = 1500", "1.500 s after OP: gateway 0 without supply".to_owned()),
        ("after_ready_ms = 4", "0.004 s after ready: gateway 0 without supply".to_owned()),
        ("cycle = 7", "at cycle 7: gateway 0 without supply".to_owned()),
        ("at_ms = 60000", "at 60.000 s: gateway 0 without supply".to_owned()),
        (
            "after_ms = 3",
            format!("at {:.3} s: gateway 0 without supply", (now_ns + 3_000_000) as f64 / 1e9),
        ),
    ] {
        let effect = execute(&simulation, &format!("kind = 'power_off'\n{time}")).unwrap();
        assert_eq!(effect.to_string(), text);
    }
    let times: Vec<_> = pending().into_iter().map(|fault| fault.when).collect();
    let after = When::At(now_ns + 3_000_000);
    let others = [
        When::At(60_000_000_000),
        When::Cycle(7),
        When::AfterOp(1_500_000_000),
        When::AfterReady(4_000_000),
    ];
    assert_eq!(times, [&[after], &others[..]].concat());
    simulation.pass_ns(4_000_000);
    assert_eq!((pending().len(), logged(&simulation).len()), (4, 1));
    simulation.clock().gateways_ready();
    let ready_ns = simulation.with_world(|world| world.ready_ns()).unwrap();
    assert_eq!(pending()[0].when, When::At(ready_ns + 4_000_000));
    simulation.pass_ns(4_000_000);
    assert_eq!((pending().len(), logged(&simulation).len()), (3, 2));
}

#[test]
fn supply_is_switched_on_command() {
    let mut program = Program::new(stepped_echo(1), &[3]).into_op();
    let simulation = program.simulation().clone();
    execute(&simulation, "kind = 'power_off'\ngateway = 0").unwrap();
    program.cycles(1_500);
    let is_powered = || simulation.with_world(|world| world.gateway(0).unwrap().is_powered());
    assert!(!is_powered());
    execute(&simulation, "kind = 'power_on'\ngateway = 0").unwrap();
    assert!(is_powered());
    assert!(program.reaches_op());
    let log = logged(&simulation);
    assert!(log[0].ends_with(" s: fault: gateway 0 without supply"), "{log:?}");
    assert!(log[1].ends_with(" s: fault: gateway 0 supplied again"), "{log:?}");
}

#[test]
fn scripted_fault_counts_from_op_and_is_observed() {
    let text = "[[gateway]]\n[[gateway]]\n[[fault]]\nkind = 'link_loss'\nafter_op_ms = 100\n\
                gateway = 1\nfor_ms = 20\n";
    let scenario = Scenario::from_toml(text, "cell", Path::new(".")).unwrap();
    let mut program = Program::new(stepped(scenario), &[1, 1]);
    let (sender, observed) = channel();
    program.simulation().observe_faults(move |record| sender.send(record.clone()).unwrap());
    program = program.into_op();
    assert!(observed.try_recv().is_err());
    let op_ns = program.simulation().with_world(|world| world.now_ns() - world.start_ns());
    program.cycles(110);
    let record = observed.try_recv().unwrap();
    let expected = Fault::LinkLoss { gateway: 1, for_ms: 20 };
    assert_eq!(record.fault, expected);
    // The program sees OP with the master's next poll.
    let op_before = record.time_ns - 100_000_000;
    assert!(op_before <= op_ns && op_ns - op_before < 100_000_000, "{op_before} {op_ns}");
    assert_eq!(
        record.to_string(),
        format!(
            "{:.3} s: fault: link loss before gateway 1 for 20 ms",
            record.time_ns as f64 / 1e9
        )
    );
    // Now the time of OP is known.
    execute(program.simulation(), "kind = 'lost_frame'\nafter_op_ms = 0").unwrap();
    program.cycles(2);
    assert!(matches!(observed.try_recv().unwrap().fault, Fault::LostFrame { .. }));
}
