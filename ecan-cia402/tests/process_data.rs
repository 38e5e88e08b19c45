//! Further objects of process data: inputs with the status of the axis, digital outputs, touch
//! probes.
#![allow(missing_docs)]

use crate::axes::{Fixture, axis, scenario};
use ecan_canopen::{OperatingMode, Probe, ProbeSource, ProbeTrigger, object};
use ecan_cia402::{
    AxesSnapshot, AxisConfig, AxisFault, Cia402, CommandError, InputObject, Output, OutputObject,
    StopKind,
};
use ecan_sim::{DriveFault, Fault};

fn with_inputs(inputs: &[InputObject]) -> AxisConfig {
    let mut axis = axis(0, 0, 1).with_step_limit(400);
    axis.pdos.inputs = inputs.to_vec();
    axis
}

#[test]
fn inputs_arrive_with_the_status_and_the_snapshot() {
    use InputObject as I;
    let all =
        [I::Velocity, I::Torque, I::ErrorCode, I::DigitalInputs, I::ModeDisplay, I::FollowingError];
    let mut config = with_inputs(&all).with_target_step(200);
    config.ramp = 5;
    let mut fixture = Fixture::single(vec![config, axis(0, 0, 2)]).started();
    let observer = fixture.port.adapter().observer();
    let mut snapshot = observer.snapshot();
    fixture.steps(400);
    let inputs = fixture.axis(0).status().inputs;
    let (velocity, error) = fixture.drive(0, |drive| (drive.velocity(), drive.following_error()));
    assert!((f64::from(inputs.velocity().unwrap()) - velocity).abs() < 500.0, "{inputs:?}");
    assert!((velocity - 100_000.0).abs() < 1_000.0, "{velocity}");
    assert!(inputs.following_error().unwrap().abs_diff(error) < 10, "{inputs:?} {error}");
    assert_eq!((inputs.error_code(), inputs.mode_display()), (Some(0), Some(8)));
    // Friction of 5,000,000 of 200,000,000 increments/s^2 at 3000 thousandths.
    assert!((60..90).contains(&inputs.torque().unwrap()), "{inputs:?}");
    // The home switch is at 100,000 increments: bit 2.
    let at_home = fixture.axis(0).actual().unwrap() >= 100_000;
    assert_eq!(inputs.digital_inputs().unwrap() & 4 != 0, at_home);
    snapshot.update().unwrap();
    let axes = AxesSnapshot::of(&snapshot).unwrap();
    assert_eq!(axes.axis(0).unwrap().inputs, fixture.axis(0).status().inputs);
    assert_eq!(axes.axis(0).unwrap().inputs.velocity(), inputs.velocity());
    assert_eq!(axes.axis(1).unwrap().inputs.velocity(), None, "nothing mapped");
    fixture.strike(0, DriveFault::Error { code: 0x2310 });
    fixture.idle(100);
    assert_eq!(fixture.axis(0).status().inputs.error_code(), Some(0x2310));
}

#[test]
fn further_pdos_are_mapped_and_verified() {
    use InputObject as I;
    let mut config = with_inputs(&[I::Velocity, I::FollowingError, I::DigitalInputs]);
    config.pdos.outputs = vec![OutputObject::DigitalOutputs, OutputObject::Mode];
    let mut fixture = Fixture::single(vec![config]).started();
    let mapping = |fixture: &Fixture, index, subindex| {
        fixture.drive(0, |drive| drive.object(index, subindex).unwrap() as u32)
    };
    assert_eq!(mapping(&fixture, 0x1600, 3), 0x6060_0008);
    assert_eq!(mapping(&fixture, 0x1601, 1), 0x60FE_0120);
    assert_eq!(mapping(&fixture, 0x1A01, 1), 0x606C_0020);
    assert_eq!(mapping(&fixture, 0x1A01, 2), 0x60F4_0020);
    assert_eq!(mapping(&fixture, 0x1A02, 1), 0x60FD_0020);
    assert_eq!(mapping(&fixture, 0x1401, 1) & 0x8000_07FF, 0x301);
    assert_eq!(mapping(&fixture, 0x1802, 1) & 0x8000_07FF, 0x381, "in use");
    assert_eq!(mapping(&fixture, 0x1803, 1) >> 31, 1, "not in use");
    let silent = |for_ms| Fault::NodeSilent { node: "drive 0.0/1".to_owned(), for_ms };
    fixture.inject(silent(400));
    fixture.idle(600);
    assert!(fixture.axis(0).is_configured());
    fixture.axis_mut(0).enable().unwrap();
    fixture.until(2_000, Cia402::all_running);
    // Another master changes the third TPDO while the drive cannot be reached.
    let node = fixture.cia402.network().find(crate::axes::address(0, 0, 1)).unwrap();
    fixture.cia402.network_mut().start_download(node, 0x1802, 2, &[255]).unwrap();
    fixture.idle(50);
    assert_eq!(mapping(&fixture, 0x1802, 2), 255);
    fixture.inject(silent(400));
    fixture.idle(600);
    assert!(!fixture.axis(0).is_configured());
    assert_eq!(fixture.axis(0).status().inputs.velocity(), None, "of another configuration");
}

#[test]
fn digital_outputs_are_set_in_every_state() {
    let mut config = axis(0, 0, 1);
    config.pdos.outputs = vec![OutputObject::DigitalOutputs];
    config.drive.output_mask = Some(0x00FF_0000);
    let mut fixture = Fixture::single(vec![config, axis(0, 0, 2)]).started();
    let output = |fixture: &Fixture, subindex| {
        fixture.drive(0, |drive| drive.object(object::DIGITAL_OUTPUTS, subindex).unwrap())
    };
    assert_eq!((output(&fixture, 1), output(&fixture, 2)), (0, 0x00FF_0000));
    fixture.axis_mut(0).set_output(Output::Digital(0x00A5_0000)).unwrap();
    fixture.idle(5);
    assert_eq!(output(&fixture, 1), 0x00A5_0000);
    fixture.axis_mut(0).stop(StopKind::Disable);
    fixture.idle(200);
    assert!(fixture.axis(0).is_stopped());
    fixture.axis_mut(0).set_output(Output::Digital(0x0001_0000)).unwrap();
    fixture.idle(5);
    assert_eq!(output(&fixture, 1), 0x0001_0000, "while the drive is off");
    // A change while the bus is lost arrives later.
    fixture.inject(Fault::BusOff { gateway: 0, channel: 0 });
    fixture.idle(2);
    fixture.axis_mut(0).set_output(Output::Digital(0x0002_0000)).unwrap();
    fixture.idle(1_000);
    assert_eq!(output(&fixture, 1), 0x0002_0000);
    let error = fixture.axis_mut(1).set_output(Output::Digital(1)).unwrap_err();
    assert!(matches!(error, CommandError::NotMapped { axis: 1, .. }), "{error}");
}

fn probing(source: ProbeSource) -> (Fixture, Probe) {
    use InputObject as I;
    let probe = if source == ProbeSource::Input { Probe::One } else { Probe::Two };
    let mut config = with_inputs(&[
        I::ProbeStatus,
        I::Probe1Positive,
        I::Probe1Negative,
        I::Probe2Positive,
        I::Probe2Negative,
    ])
    .with_target_step(100);
    config.pdos.outputs = vec![OutputObject::ProbeFunction];
    let scenario = scenario(1, |drive| {
        drive.motor.start_position = 60_000;
        drive.motor.probes = [64_321, 150_000];
    });
    (Fixture::with(scenario, vec![config]).started(), probe)
}

#[test]
fn touch_probe_stores_the_position_of_the_edge() {
    let (mut fixture, probe) = probing(ProbeSource::Input);
    fixture
        .axis_mut(0)
        .set_output(Output::Probe(probe, Some(ProbeTrigger::first_positive(ProbeSource::Input))))
        .unwrap();
    fixture.idle(20);
    let state = fixture.axis(0).probe(probe);
    assert!(state.is_armed && state.positive.is_none(), "{state:?}");
    let mut cycles = 0;
    while fixture.axis(0).probe(probe).positive.is_none() {
        fixture.step();
        cycles += 1;
        assert!(cycles < 1_000, "{:?}", fixture.axis(0).actual());
    }
    assert_eq!(fixture.axis(0).probe(probe).positive, Some(64_321));
    assert!(fixture.axis(0).actual().unwrap() > 64_321);
    // Back over the edge, armed again: the old position is never reported.
    let both = ProbeTrigger { negative: true, ..ProbeTrigger::first_positive(ProbeSource::Input) };
    fixture.axis_mut(0).set_output(Output::Probe(probe, Some(both))).unwrap();
    fixture.axis_mut(0).set_target_step(-100);
    for _ in 0..200 {
        fixture.step();
        assert_eq!(fixture.axis(0).probe(probe).positive, None);
    }
    assert_eq!(fixture.axis(0).probe(probe).negative, Some(64_321));
    fixture.axis_mut(0).set_output(Output::Probe(probe, None)).unwrap();
    fixture.steps(10);
    assert!(!fixture.axis(0).probe(probe).is_armed);
    fixture.check();
}

#[test]
fn touch_probe_stores_the_index_pulse() {
    let (mut fixture, probe) = probing(ProbeSource::IndexPulse);
    let trigger = ProbeTrigger::first_positive(ProbeSource::IndexPulse);
    fixture.axis_mut(0).set_output(Output::Probe(probe, Some(trigger))).unwrap();
    fixture.steps(400);
    assert_eq!(fixture.axis(0).probe(probe).positive, Some(65_536));
}

#[test]
fn invalid_process_data_is_rejected() {
    let faults = |axis: &AxisConfig| {
        let mut faults = Vec::new();
        axis.check(&mut |fault| faults.push(fault));
        faults
    };
    use InputObject as I;
    let mut config = with_inputs(&[I::Velocity, I::FollowingError, I::DigitalInputs]);
    assert_eq!(faults(&config), []);
    config.pdos.number = 3;
    assert_eq!(faults(&config), [AxisFault::PdoCount { first: 3, count: 3 }]);
    let mut config = with_inputs(&[]).with_mode(OperatingMode::ProfilePosition);
    config.pdos.outputs = vec![OutputObject::VelocityOffset, OutputObject::ProbeFunction];
    let texts: Vec<String> = faults(&config).iter().map(ToString::to_string).collect();
    assert_eq!(
        texts,
        [
            "velocity offset 0x60B1 has no effect in mode PP; remove it from the outputs",
            "the limits of velocity offset 0x60B1 are 0; must be at least 1; set them in feed_forward",
            "the touch probe function 0x60B8 is mapped without the status 0x60B9; add the status to \
             the inputs",
        ]
    );
}
