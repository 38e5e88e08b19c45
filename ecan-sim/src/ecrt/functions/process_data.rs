//! Process data, exchange and clocks.

use super::{data_or_null, guarded, on_domain, on_master, store};
use crate::ecrt::calls::{Call, CallResult};
use crate::ecrt::datagram::{DatagramState, Queued};
use crate::ecrt::master::Phase;
use crate::ecrt::shared::State;
use crate::fault::LibraryCall;
use ecrt_sys::{
    EC_WC_COMPLETE, EC_WC_INCOMPLETE, EC_WC_ZERO, ec_domain_state_t, ec_domain_t, ec_master_t,
};
use libc::size_t;

pub unsafe extern "C" fn domain_size(domain: *const ec_domain_t) -> size_t {
    let size = guarded(|| {
        let call = on_domain(domain)?;
        call.with(|state| Ok(state.master.domain(call.object)?.size))
    });
    size.unwrap_or(size_t::MAX)
}

pub unsafe extern "C" fn domain_data(domain: *mut ec_domain_t) -> *mut u8 {
    data_or_null(|| {
        let call = on_domain(domain)?;
        call.with(|state| {
            let memory = &state.master.domain(call.object)?.memory;
            Ok(memory.as_ref().ok_or(libc::EAGAIN)?.as_ptr())
        })
    })
}

/// Queues a datagram of the clocks. Only the monitor's needs no reference clock.
fn queue_clock(call: &Call<()>, item: Queued, target: Option<u64>) -> CallResult {
    call.driving(|state| {
        if item != Queued::ClockMonitor && state.master.reference_clock().is_none() {
            return Err(libc::ENXIO);
        }
        let clocks = &mut state.master.clocks;
        if clocks.are_set {
            if item == Queued::ReferenceClock {
                clocks.reference_target = target.unwrap_or(clocks.app_time);
            }
            state.master.enqueue(item);
        }
        Ok(())
    })
}

pub unsafe extern "C" fn master_sync_monitor_process(master: *mut ec_master_t) -> u32 {
    let difference = guarded(|| {
        on_master(master)?.driving(|state| match state.master.clocks.monitor {
            DatagramState::Received => Ok(state.master.clocks.monitor_value),
            _ => {
                state.master.stderr_lines += 1;
                Ok(u32::MAX)
            }
        })
    });
    difference.unwrap_or(u32::MAX)
}

functions! {
    two_forms domain_process(domain: *mut ec_domain_t) {
        let call = on_domain(domain)?;
        call.driving(|State { world, master, .. }| {
            world.library_call(LibraryCall::DomainProcess)?;
            master.domain(call.object)?.process();
            Ok(())
        })
    }

    two_forms domain_queue(domain: *mut ec_domain_t) {
        let call = on_domain(domain)?;
        call.driving(|State { world, master, .. }| {
            world.library_call(LibraryCall::DomainQueue)?;
            for datagram in 0..master.domain(call.object)?.datagrams.len() {
                master.enqueue(Queued::Domain { domain: call.object, datagram });
            }
            Ok(())
        })
    }

    two_forms domain_state(domain: *const ec_domain_t, state: *mut ec_domain_state_t) {
        let call = on_domain(domain)?;
        let value = call.with(|State { world, master, .. }| {
            world.library_call(LibraryCall::DomainState)?;
            let domain = master.domain(call.object)?;
            let working_counter = domain.working_counter;
            let wc_state = match working_counter {
                0 => EC_WC_ZERO,
                counter if counter == domain.expected => EC_WC_COMPLETE,
                _ => EC_WC_INCOMPLETE,
            };
            Ok(ec_domain_state_t { working_counter, wc_state, redundancy_active: 0 })
        })?;
        // SAFETY: the caller passes a pointer for the state, or null.
        unsafe { store(state, value) }
    }

    two_forms master_send(master: *mut ec_master_t) {
        on_master(master)?.driving(|State { world, master, .. }| {
            world.library_call(LibraryCall::Send)?;
            master.send(world);
            if master.phase == Phase::Active
                && !master.blocked
                && master.advances_with_send(world.now_ns())
            {
                master.step(world);
            }
            Ok(())
        })
    }

    two_forms master_receive(master: *mut ec_master_t) {
        on_master(master)?.driving(|State { world, master, .. }| {
            world.library_call(LibraryCall::Receive)?;
            master.receive(world.now_ns());
            Ok(())
        })
    }

    two_forms master_application_time(master: *mut ec_master_t, time_ns: u64) {
        on_master(master)?.driving(|State { world, master, .. }| {
            master.clocks.application_time(time_ns, world.now_ns());
            Ok(())
        })
    }

    without_error master_sync_reference_clock(master: *mut ec_master_t) {
        queue_clock(&on_master(master)?, Queued::ReferenceClock, None)
    }

    one_form master_sync_reference_clock_to(master: *mut ec_master_t, time_ns: u64) {
        queue_clock(&on_master(master)?, Queued::ReferenceClock, Some(time_ns))
    }

    without_error master_sync_slave_clocks(master: *mut ec_master_t) {
        queue_clock(&on_master(master)?, Queued::SlaveClocks, None)
    }

    // like the real function, it writes each failure to stderr
    one_form master_reference_clock_time(master: *mut ec_master_t, time_ns: *mut u32) {
        let value = on_master(master)?.driving(|state| {
            let clocks = &state.master.clocks;
            let time = match (clocks.slaves, clocks.are_set) {
                _ if state.master.reference_clock().is_none() => Err(libc::ENXIO),
                (DatagramState::Received, true) => Ok(clocks.reference_value),
                (DatagramState::Received, false) => Err(libc::EAGAIN),
                _ => Err(libc::EIO),
            };
            state.master.stderr_lines += u64::from(time.is_err());
            time
        })?;
        // SAFETY: the caller passes a pointer for the time, or null.
        unsafe { store(time_ns, value) }
    }

    without_error master_sync_monitor_queue(master: *mut ec_master_t) {
        queue_clock(&on_master(master)?, Queued::ClockMonitor, None)
    }
}
