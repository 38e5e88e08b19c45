//! Stored parameters and error history.

use std::time::Duration;

use ecan_canopen::{
    Configurator, ErrorHistory, HistoryEntry, NmtCommand, NodeAction, NodeConfig, ParameterGroup,
    Step,
};

use super::bench::{Bench, LONG, drives, run_steps};

#[test]
fn parameter_groups_are_stored_and_restored_one_by_one() {
    let mut bench = Bench::new(drives(1, |_| {}));
    let node = bench.add_node(1, NodeConfig::default());
    bench.pass(100);
    let default = bench.read(node, 0x6083, 0);
    let change = |bench: &mut Bench| {
        bench.write(node, (0x1015, 0), &77u16.to_le_bytes());
        bench.write(node, (0x6083, 0), &1_111u32.to_le_bytes());
    };
    let reset = [
        Step::device(NodeAction::Nmt(NmtCommand::ResetNode)),
        Step::device(NodeAction::AwaitBootUp { timeout: Duration::from_secs(1) }),
    ];
    let values = |bench: &mut Bench| (bench.read(node, 0x1015, 0), bench.read(node, 0x6083, 0));
    let (communication, application) = (ParameterGroup::Communication, ParameterGroup::Application);

    change(&mut bench);
    run_steps(&mut bench, node, &communication.store_steps()).unwrap();
    run_steps(&mut bench, node, &reset).unwrap();
    assert_eq!(values(&mut bench), (77, default));
    change(&mut bench);
    run_steps(&mut bench, node, &application.store_steps()).unwrap();
    run_steps(&mut bench, node, &reset).unwrap();
    assert_eq!(values(&mut bench), (77, 1_111));
    run_steps(&mut bench, node, &communication.restore_and_reset_steps(LONG)).unwrap();
    assert_eq!(values(&mut bench), (0, 1_111));
    run_steps(&mut bench, node, &ParameterGroup::All.restore_and_reset_steps(LONG)).unwrap();
    assert_eq!(values(&mut bench), (0, default));
    // A group that the drive does not have
    let error = run_steps(&mut bench, node, &ParameterGroup::Manufacturer(9).store_steps());
    assert_eq!(
        error.unwrap_err().to_string(),
        "node 1 (slave 0, channel 0), step 1 of 2, stores on command (check 0x1010:09): aborted by the node: \
         0x06090011 subindex does not exist"
    );
}

#[test]
fn error_history_is_read_newest_first_and_cleared() {
    let mut bench = Bench::new(drives(1, |_| {}));
    let node = bench.add_node(1, NodeConfig::default());
    bench.pass(100);
    for code in [0x4210, 0x2310] {
        let fault = ecan_sim::DriveFault::Emcy { code, register: 1 };
        bench.simulation().inject(ecan_sim::Fault::Drive { node: "1".to_owned(), fault });
        bench.pass(10);
    }
    let expected = [0x2310, 0x4210].map(|code| HistoryEntry { code, additional: 0 });
    let Bench { network, port, .. } = &mut bench;
    assert_eq!(network.blocking(port, LONG).error_history(node).unwrap(), expected);

    let mut configurator = Configurator::new();
    assert_eq!(ErrorHistory::uploaded(&configurator, node), None);
    configurator.add(network, node, ErrorHistory::steps(4));
    network.blocking(port, LONG).configure(&mut configurator, |_| {}).unwrap();
    assert_eq!(ErrorHistory::uploaded(&configurator, node).unwrap(), expected);
    configurator.clear(network);
    configurator.add(network, node, [ErrorHistory::clearing_step()]);
    configurator.add(network, node, ErrorHistory::steps(4));
    network.blocking(port, LONG).configure(&mut configurator, |_| {}).unwrap();
    assert_eq!(ErrorHistory::uploaded(&configurator, node).unwrap(), []);
}
