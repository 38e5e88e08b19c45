//! EtherCAT with ethercrab as the master: startup of manual 5.4.3, and cycles.

pub mod bring_up;

use std::future::Future;
use std::pin::pin;
use std::task::{Context, Poll, Waker};
use std::time::Duration;

use bring_up::configure;
use ecan_sim::{Scenario, Wire};
use ethercrab::error::Error;
use ethercrab::subdevice_group::{Op, PreOp, SubDeviceGroup};
use ethercrab::{MainDevice, MainDeviceConfig, PduRx, PduStorage, PduTx, RetryBehaviour, Timeouts};

pub const MS: u64 = 1_000_000;
/// Simulated time between two frames.
const FRAME_NS: u64 = 20_000;
const EPOCH_NS: u64 = 1_000 * MS;
/// Process data of three gateways with N = 24.
pub const MAX_PDI: usize = 3 * 2 * 3072;
pub const MAX_GATEWAYS: usize = 4;

pub type Group<State> = SubDeviceGroup<MAX_GATEWAYS, MAX_PDI, ethercrab::DefaultLock, State>;

/// A master and a wire, connected in memory. Simulated time passes with the frames and by
/// [`pass`](Self::pass).
pub struct Fixture {
    pub wire: Wire,
    pub now: u64,
    pub main_device: MainDevice<'static>,
    tx: PduTx<'static>,
    rx: PduRx<'static>,
    frame: Vec<u8>,
}

impl Fixture {
    pub fn new(scenario: &Scenario) -> Self {
        let storage: &'static PduStorage<64, { PduStorage::element_size(1486) }> =
            Box::leak(Box::new(PduStorage::new()));
        let (tx, rx, pdu_loop) = storage.try_split().unwrap();
        // wall-clock limits far beyond the times of a loaded machine
        let long = Duration::from_secs(60);
        let timeouts = Timeouts {
            state_transition: long,
            pdu: long,
            eeprom: long,
            wait_loop_delay: Duration::ZERO,
            mailbox_echo: long,
            mailbox_response: long,
        };
        let config = MainDeviceConfig {
            dc_static_sync_iterations: 2_000,
            retry_behaviour: RetryBehaviour::None,
        };
        let mut wire = Wire::new(scenario, EPOCH_NS).unwrap();
        let now = EPOCH_NS + 1_000 * MS;
        wire.advance(now);
        let main_device = MainDevice::new(pdu_loop, timeouts, config);
        Self { wire, now, main_device, tx, rx, frame: Vec::new() }
    }

    /// Runs a future of the master, with the frames that it sends.
    pub fn run<T>(
        &mut self,
        task: impl AsyncFnOnce(&MainDevice<'static>) -> Result<T, Error>,
    ) -> T {
        let Self { wire, now, main_device, tx, rx, frame } = self;
        let mut future = pin!(task(main_device));
        let mut context = Context::from_waker(Waker::noop());
        loop {
            if let Poll::Ready(result) = future.as_mut().poll(&mut context) {
                return result.unwrap_or_else(|error| panic!("{error}"));
            }
            while let Some(sendable) = tx.next_sendable_frame() {
                let copy = |bytes: &[u8]| {
                    frame.clear();
                    frame.extend_from_slice(bytes);
                    Ok(bytes.len())
                };
                sendable.send_blocking(copy).unwrap();
                *now += FRAME_NS;
                if wire.pass(*now, frame) {
                    rx.receive_frame(frame).unwrap();
                }
            }
        }
    }

    pub fn pass(&mut self, ns: u64) {
        self.now += ns;
        self.wire.advance(self.now);
    }
}

/// Runs a test on a stack large enough for the master's futures, which hold all process data.
pub fn on_a_deep_stack(test: impl FnOnce() + Send + 'static) {
    const BYTES: usize = 64 << 20;
    let thread = std::thread::Builder::new().stack_size(BYTES).spawn(test).unwrap();
    thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
}

/// Brings all gateways of the line to OP.
pub async fn into_op(
    main_device: &MainDevice<'_>,
    gateways: usize,
    chunks: u8,
) -> Result<Group<Op>, Error> {
    let group: Group<PreOp> = main_device.init_single_group::<MAX_GATEWAYS, MAX_PDI>(|| 0).await?;
    assert_eq!(group.len(), gateways);
    for gateway in group.iter(main_device) {
        configure(&gateway, chunks).await?;
    }
    group.into_op(main_device).await
}
