//! EtherCAT with ethercrab as the master: the way of manual 5.4.3 into service, and cycles.
#![allow(dead_code, missing_docs)]

use std::future::Future;
use std::pin::pin;
use std::task::{Context, Poll, Waker};
use std::time::Duration;

use ecan_sim::{Scenario, Wire};
use ethercrab::error::Error;
use ethercrab::subdevice_group::{Op, PreOp, SubDeviceGroup};
use ethercrab::{
    MainDevice, MainDeviceConfig, PduRx, PduStorage, PduTx, RetryBehaviour, SubDeviceRef, Timeouts,
};

pub const MS: u64 = 1_000_000;
/// Simulated time between two frames.
const FRAME_NS: u64 = 20_000;
const EPOCH_NS: u64 = 1_000 * MS;
/// Process data of three gateways with N = 24.
pub const MAX_PDI: usize = 3 * 2 * 3072;
pub const MAX_GATEWAYS: usize = 4;

pub type Group<State> = SubDeviceGroup<MAX_GATEWAYS, MAX_PDI, ethercrab::DefaultLock, State>;

/// A master and a wire, joined in memory. Simulated time passes with the frames, and as
/// [`pass`](Self::pass) says.
pub struct Bench {
    pub wire: Wire,
    pub now: u64,
    pub main_device: MainDevice<'static>,
    tx: PduTx<'static>,
    rx: PduRx<'static>,
    frame: Vec<u8>,
}

impl Bench {
    pub fn new(scenario: &Scenario) -> Self {
        let storage: &'static PduStorage<64, { PduStorage::element_size(1486) }> =
            Box::leak(Box::new(PduStorage::new()));
        let (tx, rx, pdu_loop) = storage.try_split().unwrap();
        // Wall-clock limits far beyond what a loaded machine takes.
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

/// Runs a test on a stack that holds the master's futures, which carry all process data.
pub fn on_a_deep_stack(test: impl FnOnce() + Send + 'static) {
    const BYTES: usize = 64 << 20;
    let thread = std::thread::Builder::new().stack_size(BYTES).spawn(test).unwrap();
    thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
}

/// What shall run.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    pub chunks: u8,
    pub channel_mask: u8,
}

/// Manual 5.4.3, phases A to E, on one gateway in PREOP; classic CAN at 500 kbit/s.
pub async fn configure<T>(gateway: &SubDeviceRef<'_, T>, plan: Plan) -> Result<(), Error>
where
    T: std::ops::Deref<Target = ethercrab::SubDevice>,
{
    let Plan { chunks, channel_mask } = plan;
    // A
    assert!(gateway.sdo_read::<u8>(0xF000, 2).await? >= 4);
    assert!(gateway.sdo_read::<u8>(0xF000, 10).await? <= chunks);
    assert!(gateway.sdo_read::<u8>(0xF000, 11).await? >= chunks);
    assert_eq!(gateway.sdo_read::<u32>(0xF000, 12).await? & 1, 1);
    assert_eq!(gateway.sdo_read::<u16>(0xF000, 17).await?, 128);
    assert_eq!(gateway.sdo_read::<u16>(0xF000, 18).await?, 24);
    // B
    for (assignment, first) in [(0x1C12, 0x1600_u16), (0x1C13, 0x1A00)] {
        gateway.sdo_write(assignment, 0, 0_u8).await?;
        for chunk in 0..chunks {
            gateway.sdo_write(assignment, chunk + 1, first + u16::from(chunk)).await?;
        }
        gateway.sdo_write(assignment, 0, chunks).await?;
    }
    // C, D
    for profile in [0x8010, 0x8011] {
        gateway.sdo_write(profile, 3, chunks).await?;
        gateway.sdo_write(profile, 4, channel_mask).await?;
        gateway.sdo_write(profile, 5, 0_u8).await?;
        gateway.sdo_write(profile, 6, 0_u8).await?;
        gateway.sdo_write(profile, 7, 0_u8).await?;
        gateway.sdo_write(profile, 1, 1_u8).await?;
    }
    for profile in [0x8010, 0x8011] {
        assert_eq!(gateway.sdo_read::<u8>(profile, 2).await?, 0, "{profile:#06x}");
        let bytes = 128 * u16::from(chunks);
        assert_eq!(gateway.sdo_read::<u16>(profile, 9).await?, bytes);
        assert_eq!(gateway.sdo_read::<u16>(profile, 10).await?, bytes - 24);
        let word = u32::from(chunks) - 1 | u32::from(channel_mask) << 5;
        assert_eq!(gateway.sdo_read::<u32>(profile, 12).await?, word);
    }
    // E
    for channel in (0..4).filter(|channel| channel_mask >> channel & 1 == 1) {
        let index = 0x8001 + channel;
        gateway.sdo_write(index, 15, 0_u8).await?;
        gateway.sdo_write(index, 19, 500_000_u32).await?;
        gateway.sdo_write(index, 1, 1_u8).await?;
        assert_eq!(gateway.sdo_read::<u8>(index, 2).await?, 0, "channel {channel}");
    }
    Ok(())
}

/// All gateways of the line into OP.
pub async fn into_op(
    main_device: &MainDevice<'_>,
    gateways: usize,
    plan: Plan,
) -> Result<Group<Op>, Error> {
    let group: Group<PreOp> = main_device.init_single_group::<MAX_GATEWAYS, MAX_PDI>(|| 0).await?;
    assert_eq!(group.len(), gateways);
    for gateway in group.iter(main_device) {
        configure(&gateway, plan).await?;
    }
    group.into_op(main_device).await
}
