//! A Port on a master that the application owns and serves.

use std::time::Duration;

use crate::common::{Handles, SendData, classic, id};
use ecan_host::{Adapter, AdapterConfig, DcSync, Master, WcState};
use ecan_mcan_port::{Cycle, GatewayConfig, Port, PortConfig, Received};
use ecan_protocol::image::Schedule;
use ecan_sim::{ClockKind, Fault, IoSpec, Scenario, SimOptions};

/// Sync0 is in phase with the application time of the owner, here half a period behind the grid of
/// the Port: that a cycle ends behind the shift on its own grid says nothing.
#[test]
fn lateness_is_not_judged_by_a_grid_that_sync0_does_not_follow() {
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    // The pulses of the owner come close to the arrivals of this Port.
    let scenario = crate::common::without_sync0_window(ecan_sim::echo(1));
    let backend = ecan_sim::open_scenario(scenario, &options).unwrap();
    let simulation = backend.simulation.unwrap();
    let ecrt = backend.ecrt;
    let clock = ecrt.clock().clone();
    let mut owner = Master::request(&ecrt, 0).unwrap();
    // SAFETY: the owner outlives the Port below and is used from this thread only.
    let shared = unsafe { Master::from_raw(ecrt.clone(), owner.as_raw()) }.unwrap();
    let mut adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
    adapter.dc = Some(DcSync::new(Duration::from_millis(1), Duration::from_micros(100)));
    let config = PortConfig::uniform(1, GatewayConfig::on_channel(0, classic()));
    let startup = config.startup_plan(&adapter);
    let adapter = Adapter::attach(&ecrt, shared, adapter, startup).unwrap();
    let mut port = Port::new(adapter, config).unwrap();
    owner.set_send_interval(1_000).unwrap();
    owner.activate().unwrap();
    port.adapter_mut().owner_activated().unwrap();
    let mut cycle = |port: &mut Port, work: &mut dyn FnMut(&mut Cycle<'_>)| {
        port.wait_next_cycle();
        owner.application_time(port.adapter().cycle_start().deadline_ns + 500_000).unwrap();
        owner.receive().unwrap();
        let mut cycle = port.begin_cycle();
        cycle.received().for_each(drop);
        work(&mut cycle);
        assert_eq!(cycle.finish().error(), None);
        owner.sync_slave_clocks().unwrap();
        owner.send().unwrap();
    };
    let is_ready = (0..20_000).any(|_| {
        cycle(&mut port, &mut |_| ());
        port.is_ready()
    });
    assert!(is_ready);
    for _ in 0..50 {
        cycle(&mut port, &mut |cycle| {
            let at = Schedule { tag: 1, offset_ns: 50_000 };
            clock.sleep_until_ns(clock.now_ns() + 200_000);
            cycle.schedule_can(0, 0, id(1), &[], at).unwrap();
        });
    }
    for _ in 0..5 {
        cycle(&mut port, &mut |_| ());
    }
    let account = port.schedule_account(port.ch(0, 0));
    assert_eq!((account.scheduled, account.withdrawn, account.rejected_late), (50, 0, 0));
    let counters = simulation.with_world(|world| world.counters(0).unwrap());
    assert_eq!(counters.frames_released, 50);
}

/// Counts of a run with a digital I/O of another vendor, which the owner exchanges in its own domain.
struct Run {
    sent: u8,
    /// First bytes of the frames that returned, in order.
    received: Vec<u8>,
    /// Cycles in which the input showed the output.
    looped_back: u32,
    /// Cycles without the I/O, and without the gateway, after its loss of supply.
    io_missed: u32,
    gateway_missed: u32,
}

const CYCLES: u32 = 20_000;
const LOSS: u32 = 5_000;

/// Runs the owner's cycle with the I/O at one position and the gateway at the other. The I/O loses its
/// supply for 300 ms.
fn run_with_io(io_position: u16) -> Run {
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    let io = IoSpec { outputs: 1, inputs: 1, ..IoSpec::at(io_position.into()) };
    let scenario = Scenario { ios: vec![io.clone()], ..ecan_sim::echo(1) };
    let backend = ecan_sim::open_scenario(scenario, &options).unwrap();
    let (ecrt, simulation) = (backend.ecrt, backend.simulation.unwrap());
    let mut owner = Master::request(&ecrt, 0).unwrap();
    let slave = owner.slave_config(0, io_position, io.vendor_id, io.product_code).unwrap();
    let domain = owner.create_domain().unwrap();
    let output = owner.config_reg_pdo_entry(slave, 0x7000, 1, domain).unwrap();
    let input = owner.config_reg_pdo_entry(slave, 0x6000, 1, domain).unwrap();

    // SAFETY: the owner outlives the Port below and is used from this thread only.
    let shared = unsafe { Master::from_raw(ecrt.clone(), owner.as_raw()) }.unwrap();
    let mut adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
    adapter.slaves[0].position = 1 - io_position;
    let config = PortConfig::uniform(1, GatewayConfig::on_channel(0, classic()));
    let startup = config.startup_plan(&adapter);
    let adapter = Adapter::attach(&ecrt, shared, adapter, startup).unwrap();
    let mut port = Port::new(adapter, config).unwrap();
    owner.set_send_interval(1_000).unwrap();
    owner.activate().unwrap();
    port.adapter_mut().owner_activated().unwrap();

    let (mut sent, mut received, mut looped_back) = (0_u8, Vec::new(), 0);
    let (mut io_missed, mut gateway_missed) = (0, 0);
    for cycle_number in 0..CYCLES {
        if cycle_number == LOSS {
            simulation.inject(Fault::IoPowerCycle { io: 0, off_ms: 300 });
        }
        port.wait_next_cycle();
        owner.receive().unwrap();
        owner.domain_process(domain).unwrap();
        let is_complete = owner.domain_state(domain).unwrap().wc_state == WcState::Complete;
        let is_ready = port.is_ready();
        if cycle_number > LOSS {
            io_missed += u32::from(!is_complete);
            gateway_missed += u32::from(!is_ready);
        }
        let mut cycle = port.begin_cycle();
        for item in cycle.received() {
            if let Received::Frame(frame) = item.to_owned() {
                received.push(frame.frame.data()[0]);
            }
        }
        if is_ready && cycle_number % 100 == 0 {
            sent = sent.wrapping_add(1);
            cycle.send_can(0, 0, id(0x123), &[sent]).unwrap();
        }
        assert_eq!(cycle.finish().error(), None);
        let data = owner.domain_data_mut(domain);
        looped_back += u32::from(is_complete && sent > 0 && data[input] == data[output]);
        data[output] = sent;
        owner.domain_queue(domain).unwrap();
        owner.send().unwrap();
    }
    assert!(port.is_ready(), "the gateway is ready at the end");
    let driven = |world: &mut ecan_sim::World| {
        let now = world.now_ns();
        world.io(0).unwrap().outputs(now).collect::<Vec<_>>()
    };
    assert_eq!(simulation.with_world(driven), [sent], "the I/O has returned");
    drop(port);
    assert!(owner.state().is_ok(), "the owner's handle is still valid");
    Run { sent, received, looped_back, io_missed, gateway_missed }
}

#[test]
fn gateway_carries_frames_next_to_the_owners_io() {
    let run = run_with_io(1);
    assert!(run.io_missed > 300 && run.looped_back > 10_000, "{} missed", run.io_missed);
    // The loss is followed by a scan of the bus, which does not touch the gateway.
    assert_eq!(run.gateway_missed, 0);
    assert!(run.sent > 150 && run.received.len() + 1 >= usize::from(run.sent));
    assert!(run.received.iter().copied().eq(1..=run.received.len() as u8), "{:?}", run.received);
}

/// The frames of the gateway pass the I/O.
#[test]
fn lost_io_upstream_interrupts_the_gateway_until_it_returns() {
    let run = run_with_io(0);
    assert!(run.io_missed > 300 && run.gateway_missed > 300, "{}", run.gateway_missed);
    assert!(run.looped_back > 10_000);
    assert!(run.sent > 100 && run.received.len() + 2 >= usize::from(run.sent));
    assert!(run.received.windows(2).all(|pair| pair[1] > pair[0]), "{:?}", run.received);
}
