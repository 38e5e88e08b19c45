//! Diagnostics through an access that is not a master of this process.

use std::sync::Mutex;

use ecan_host::{
    AssignedPdo, Clock, Diagnostics, Errno, Error, LinkState, MasterInfo, MasterState, PortInfo,
    PortKind, SdoDirection, SlaveAccess, SlaveInfo,
};

/// Time that passes only in sleeps.
#[derive(Debug, Default)]
struct SleepClock(Mutex<u64>);

impl Clock for SleepClock {
    fn now_ns(&self) -> u64 {
        *self.0.lock().unwrap()
    }

    fn sleep_until_ns(&self, deadline_ns: u64) {
        let mut now_ns = self.0.lock().unwrap();
        *now_ns = deadline_ns.max(*now_ns);
    }

    fn is_free_running(&self) -> bool {
        false
    }
}

/// A bus with two slaves; the first uploads fail.
#[derive(Debug)]
struct Access {
    clock: SleepClock,
    failures: Mutex<u32>,
}

fn no_answer(position: u16) -> Error {
    Error::Sdo {
        slave: position.into(),
        direction: SdoDirection::Upload,
        index: 0x1000,
        subindex: 0,
        errno: Errno::EIO,
        abort_code: None,
        attempts: 1,
    }
}

impl SlaveAccess for Access {
    fn clock(&self) -> &dyn Clock {
        &self.clock
    }

    fn master_info(&self) -> Result<MasterInfo, Error> {
        Ok(MasterInfo { slave_count: 2, link_up: true, scan_busy: false, app_time_ns: 0 })
    }

    fn master_state(&self) -> Result<MasterState, Error> {
        Ok(MasterState { slaves_responding: 2, al_states: 2, link_up: true })
    }

    fn link_state(&self, _: u32) -> Result<LinkState, Error> {
        Ok(LinkState { slaves_responding: 2, al_states: 2, link_up: true })
    }

    fn slave_info(&self, position: u16) -> Result<SlaveInfo, Error> {
        let port = PortInfo {
            kind: PortKind::Mii,
            link_up: true,
            loop_closed: false,
            signal_detected: true,
            receive_time_ns: 0,
            next_slave: None,
            delay_to_next_dc_ns: 0,
        };
        Ok(SlaveInfo {
            position,
            vendor_id: 1,
            product_code: 2,
            revision_number: 3,
            serial_number: 4,
            alias: 0,
            current_on_ebus_ma: 0,
            al_state: 2,
            error_flag: false,
            sync_count: 4,
            sdo_count: 0,
            name: String::new(),
            ports: [port; 4],
        })
    }

    fn assigned_pdos(&self, _: u16, _: u8) -> Result<Vec<AssignedPdo>, Error> {
        Ok(Vec::new())
    }

    fn sdo_upload(&self, position: u16, _: u16, _: u8, data: &mut [u8]) -> Result<usize, Error> {
        let mut failures = self.failures.lock().unwrap();
        if *failures > 0 {
            *failures -= 1;
            return Err(no_answer(position));
        }
        data.fill(7);
        Ok(data.len())
    }

    fn sdo_download(&self, _: u16, _: u16, _: u8, _: &[u8]) -> Result<(), Error> {
        Err(Error::NotPermitted { reason: "read-only".to_owned() })
    }

    fn sdo_download_complete(&self, _: u16, _: u16, _: &[u8]) -> Result<(), Error> {
        Err(Error::Disconnected { reason: "the service ended".to_owned() })
    }
}

fn diagnostics(failures: u32) -> Diagnostics {
    let access = Access { clock: SleepClock::default(), failures: Mutex::new(failures) };
    Diagnostics::of_access(Box::new(access)).unwrap()
}

#[test]
fn unanswered_transfer_is_repeated_through_any_access() {
    let bus = diagnostics(3);
    assert_eq!(bus.slave_count(), 2);
    assert_eq!(bus.sdo_upload_u32(1, 0x1000, 0).unwrap(), 0x0707_0707);
    let error = diagnostics(u32::MAX).sdo_upload_u32(1, 0x1000, 0).unwrap_err();
    let Error::Sdo { slave: 1, attempts, errno: Errno::EIO, .. } = error else {
        panic!("{error}");
    };
    assert!(attempts > 3, "{attempts}");
}

#[test]
fn rejection_by_the_access_is_not_repeated() {
    let bus = diagnostics(0);
    let error = bus.sdo_download(0, 0x8000, 1, &[1]).unwrap_err();
    assert!(matches!(&error, Error::NotPermitted { .. }) && error.to_string() == "read-only");
    let error = bus.sdo_download_complete(0, 0x8000, &[1]).unwrap_err();
    assert!(matches!(error, Error::Disconnected { .. }) && !error.is_temporary());
    assert_eq!(bus.clock().now_ns(), 0, "no pause");
}
