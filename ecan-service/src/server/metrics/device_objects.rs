//! Objects of the gateways that metrics show, read by SDO transfers on a thread of their own.

use std::collections::BTreeSet;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use ecan_host::{Diagnostics, Ecrt, Error};

use super::sample::ObjectValues;
use crate::server::listener::enter_background;
use crate::server::shared::Shared;

/// Time that the end of the thread waits for a transfer. One that the bus does not answer ends later.
const END_WAIT: Duration = Duration::from_secs(2);

/// Reader of the objects. Dropping it ends its thread.
#[derive(Debug)]
pub(crate) struct DeviceObjects {
    values: Arc<Mutex<ObjectValues>>,
    end: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl DeviceObjects {
    /// Starts to read `objects`, indices of channel 0 and subindices.
    pub(crate) fn start(
        interval: Duration,
        objects: BTreeSet<(u16, u8)>,
        shared: &Arc<Shared>,
        ecrt: &Ecrt,
    ) -> std::io::Result<Self> {
        let values = Arc::<Mutex<ObjectValues>>::default();
        let (end, is_ended) = channel();
        let (shared, ecrt, written) = (shared.clone(), ecrt.clone(), values.clone());
        let run = move || {
            enter_background();
            loop {
                let found = read(&shared, &ecrt, &objects);
                *written.lock().unwrap_or_else(PoisonError::into_inner) = found;
                if is_ended.recv_timeout(interval) != Err(RecvTimeoutError::Timeout) {
                    return;
                }
            }
        };
        let thread = thread::Builder::new().name("ecan objects".into()).spawn(run)?;
        Ok(Self { values, end: Some(end), thread: Some(thread) })
    }

    /// The last values.
    pub(crate) fn values(&self) -> ObjectValues {
        self.values.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Drop for DeviceObjects {
    fn drop(&mut self) {
        self.end = None;
        let Some(thread) = self.thread.take() else { return };
        let end = Instant::now() + END_WAIT;
        while !thread.is_finished() && Instant::now() < end {
            thread::sleep(Duration::from_millis(1));
        }
        if thread.is_finished() {
            let _ = thread.join();
        }
    }
}

/// Reads the objects of the enabled channels. What does not answer is missing.
fn read(shared: &Shared, ecrt: &Ecrt, objects: &BTreeSet<(u16, u8)>) -> ObjectValues {
    let mut values = ObjectValues::new();
    let Some(sample) = shared.metrics_sample() else { return values };
    let (Some(adapter), Some(cycle)) = (sample.adapter, sample.cycle) else { return values };
    // The handle exists only during the transfers, as those of requests.
    let Ok(bus) = Diagnostics::open(ecrt, &adapter) else { return values };
    for (slave, found) in cycle.slaves.iter().enumerate() {
        let channels = (0..).zip(found.channels).filter(|(_, status)| status.is_some());
        let entries =
            channels.flat_map(|(channel, _)| objects.iter().map(move |object| (channel, *object)));
        for (channel, (index, subindex)) in entries {
            match bus.sdo_upload_u32(slave, index + u16::from(channel), subindex) {
                Ok(value) => {
                    values.insert((slave, channel, index, subindex), value);
                }
                // Firmware without this entry.
                Err(Error::Sdo { abort_code: Some(_), .. }) => {}
                // Each further transfer would wait as long.
                Err(_) => break,
            }
        }
    }
    values
}
