//! An application that uses the C interface: the configuration by its setters, the cycle by its functions.

#![allow(unsafe_code)]

use std::ffi::{CStr, c_int};
use std::mem::MaybeUninit;
use std::ptr::null;

use ecan_c_boundary::frames::{
    IGH_MCAN_FLAG_BRS, IGH_MCAN_FLAG_ESI, IGH_MCAN_FLAG_EXT, IGH_MCAN_FLAG_FD, IGH_MCAN_FLAG_RTR,
    igh_mcan_rx_frame_t, igh_mcan_rx_kind_t, igh_mcan_tx_frame_t,
};
use ecan_c_boundary::result::ecan_result_t::{
    ECAN_ERR_CHANNEL, ECAN_ERR_FRAME, ECAN_ERR_MASTER, ECAN_ERR_NULL, ECAN_ERR_SCHEDULE,
    ECAN_ERR_SLAVE,
};
use ecan_igh_host::adapter::config::{
    ecan_igh_config_allow_large_pdos, ecan_igh_config_set_cycle_us, ecan_igh_config_set_dc_sync0,
    ecan_igh_config_set_slave_count, ecan_igh_config_set_slave_pdo_multipliers,
    ecan_igh_config_set_slave_position, ecan_igh_config_t, ecan_igh_default_config,
};
use ecan_igh_host::adapter::context::{
    ecan_igh_context_t, ecan_igh_deinit, ecan_igh_retry_startup, ecan_igh_startup_timeout_ms,
    ecan_igh_wait_op_timeout, init_on,
};
use ecan_igh_host::mcan_port::config::{
    igh_mcan_port_add_extended_filter, igh_mcan_port_apply_config, igh_mcan_port_config_t,
    igh_mcan_port_default_config, igh_mcan_port_set_budget, igh_mcan_port_set_canfd_channel,
    igh_mcan_port_set_classic_channel, igh_mcan_port_set_direction_masks,
    igh_mcan_port_set_encapsulation, igh_mcan_port_set_options, igh_mcan_port_set_paced,
    igh_mcan_port_set_traffic,
};
use ecan_igh_host::mcan_port::context::{
    igh_mcan_port_init, igh_mcan_port_is_ready, igh_mcan_port_reconfigure, igh_mcan_port_t,
};
use ecan_igh_host::mcan_port::cycle::{
    igh_mcan_port_cycle_begin, igh_mcan_port_cycle_end, igh_mcan_port_discard_pending,
    igh_mcan_port_exchange, igh_mcan_port_receive, igh_mcan_port_schedule_can,
    igh_mcan_port_schedule_canfd, igh_mcan_port_send, igh_mcan_port_send_batch,
    igh_mcan_port_send_can, igh_mcan_port_send_canfd, igh_mcan_port_wait_next_cycle,
};
use ecan_igh_host::mcan_port::state::{
    igh_mcan_channel_statistics_t, igh_mcan_port_get_channel_statistics,
    igh_mcan_port_get_session_text, igh_mcan_port_get_statistics, igh_mcan_statistics_t,
};
use ecan_mcan_host::common::{ecan_last_error, ecan_result_is_temporary};
use ecan_mcan_port::{
    AcceptanceFilter, ChannelFilter, ChannelStatistics, Config, PendingStep, SendOptions,
    SlaveStatistics,
};
use ecan_protocol::can::{CanFrame, CanId, Dlc, FrameError};
use ecan_protocol::image::Schedule;
use ecan_sim::Backend;
use fastrand::Rng;

/// `IGH_MCAN_MATCH_RANGE_UNMASKED` and `IGH_MCAN_FILTER_REJECT`.
const RANGE_UNMASKED: c_int = 3;
const REJECT: c_int = 3;

/// Calls a function of C and returns its code.
macro_rules! c {
    ($function:ident($($argument:expr),* $(,)?)) => {
        // SAFETY: each pointer is NULL, or that of a context, a configuration or an array of this thread that
        // lives during the call and has the given length.
        unsafe { $function($($argument),*) }
    };
}

/// As [`c`]; a code other than 0 is an error.
macro_rules! checked {
    ($function:ident($($argument:expr),* $(,)?)) => {
        check(c!($function($($argument),*)))
    };
}

/// The contexts of a C application. They never move.
pub struct CApplication {
    igh: Box<ecan_igh_context_t>,
    port: Box<igh_mcan_port_t>,
    rx: Vec<igh_mcan_rx_frame_t>,
    gateways: usize,
}

impl CApplication {
    pub fn open(backend: &Backend, config: &Config) -> Result<Self, String> {
        let mut configs = Configs::of(config)?;
        let mut this = Self {
            igh: Box::new(ecan_igh_context_t { opaque: [0; 4] }),
            port: Box::new(igh_mcan_port_t { opaque: [0; 4] }),
            rx: vec![igh_mcan_rx_frame_t::EMPTY; 64],
            gateways: config.port.gateways.len(),
        };
        let (igh, port) = (this.igh(), this.port());
        checked!(init_on(igh, configs.igh(), &backend.ecrt))?;
        checked!(igh_mcan_port_init(port, igh, configs.port()))?;
        Ok(this)
    }

    fn igh(&mut self) -> *mut ecan_igh_context_t {
        &mut *self.igh
    }

    fn port(&mut self) -> *mut igh_mcan_port_t {
        &mut *self.port
    }

    pub fn wait_ready(&mut self) -> Result<(), String> {
        let igh = self.igh();
        let timeout_ms = c!(ecan_igh_startup_timeout_ms(igh));
        checked!(ecan_igh_wait_op_timeout(igh, timeout_ms))
    }

    pub fn reconfigure(&mut self, config: &Config) -> Result<(), String> {
        let mut configs = Configs::of(config)?;
        checked!(igh_mcan_port_reconfigure(self.port(), configs.igh(), configs.port()))?;
        self.wait_ready()
    }

    pub fn is_ready(&mut self) -> bool {
        c!(igh_mcan_port_is_ready(self.port())) == 1
    }

    /// State of the gateways.
    pub fn status(&mut self) -> String {
        let states: Vec<_> = (0..self.gateways).map(|slave| self.session(slave)).collect();
        states.join("; ")
    }

    fn session(&mut self, slave: usize) -> String {
        let (mut text, mut needed) = ([0_u8; 512], 0);
        let port = self.port();
        let (start, size) = (text.as_mut_ptr().cast(), text.len());
        match checked!(igh_mcan_port_get_session_text(port, slave, start, size, &mut needed)) {
            Ok(()) => CStr::from_bytes_until_nul(&text)
                .map_or_else(|error| error.to_string(), |text| text.to_string_lossy().into_owned()),
            Err(error) => error,
        }
    }

    /// Returns whether a gateway waits for another attempt of its startup.
    pub fn waits_for_startup(&mut self) -> bool {
        self.status().contains(&format!("waits for {}", PendingStep::StartupRetry))
    }

    pub fn retry_startup(&mut self) {
        // One that fails is repeated by the caller.
        let _ = c!(ecan_igh_retry_startup(self.igh()));
    }

    pub fn discard_pending(&mut self, slave: usize) -> Result<(), String> {
        match c!(igh_mcan_port_discard_pending(self.port(), slave)) {
            0.. => Ok(()),
            code => check(code),
        }
    }

    /// Waits for the next cycle, and begins it.
    pub fn begin(&mut self) -> Result<(), String> {
        checked!(igh_mcan_port_wait_next_cycle(self.port()))?;
        check_cycle(c!(igh_mcan_port_cycle_begin(self.port())))
    }

    pub fn end(&mut self) -> Result<(), String> {
        check_cycle(c!(igh_mcan_port_cycle_end(self.port())))
    }

    /// A cycle without sending, by one function.
    pub fn exchange(&mut self, take: impl FnMut(usize, u8, CanFrame)) -> Result<(), String> {
        checked!(igh_mcan_port_wait_next_cycle(self.port()))?;
        let (mut count, capacity) = (0, self.rx.len());
        let (port, rx) = (self.port(), self.rx.as_mut_ptr());
        let code = c!(igh_mcan_port_exchange(port, null(), 0, rx, capacity, &mut count));
        check_cycle(code)?;
        self.pass(count, take)
    }

    /// Takes at most this number of items, in arrays of any length.
    pub fn receive(
        &mut self,
        r: &mut Rng,
        most: usize,
        mut take: impl FnMut(usize, u8, CanFrame),
    ) -> Result<(), String> {
        let mut left = most;
        loop {
            let capacity = r.usize(1..=self.rx.len()).min(left);
            let mut count = 0;
            let (port, rx) = (self.port(), self.rx.as_mut_ptr());
            checked!(igh_mcan_port_receive(port, rx, capacity, &mut count))?;
            self.pass(count, &mut take)?;
            left -= count;
            if count < capacity || left == 0 {
                return Ok(());
            }
        }
    }

    /// Passes received frames on.
    fn pass(&self, count: usize, mut take: impl FnMut(usize, u8, CanFrame)) -> Result<(), String> {
        for item in &self.rx[..count] {
            if item.kind == igh_mcan_rx_kind_t::IGH_MCAN_RX_FRAME as u8 {
                let frame = frame_of(item).map_err(|error| format!("{error}: {item:?}"))?;
                take(item.slave.into(), item.channel, frame);
            }
        }
        Ok(())
    }

    /// Sends by one of the functions that can. Returns false if the frame was rejected for a reason that passes.
    pub fn send(
        &mut self,
        r: &mut Rng,
        slave: usize,
        channel: u8,
        frame: &CanFrame,
        options: SendOptions,
    ) -> Result<bool, String> {
        let mut tx = igh_mcan_tx_frame_t::from_frame(slave as u16, channel, frame.as_ref());
        tx.hint = options.hint as u8;
        let is_fd = tx.flags & IGH_MCAN_FLAG_FD != 0;
        let port = self.port();
        let (id, flags, len) = (tx.can_id, tx.flags & !IGH_MCAN_FLAG_FD, usize::from(tx.len));
        let data = tx.data.as_ptr();
        if r.u8(..50) == 0 {
            self.rejections(data)?;
        }
        let way = if options.hint as u8 == 0 { r.u8(..3) } else { r.u8(1..3) };
        let code = match (way, options.schedule) {
            (0, None) => {
                let send = if is_fd { igh_mcan_port_send_canfd } else { igh_mcan_port_send_can };
                c!(send(port, slave, channel, id, flags, data, len))
            }
            (0, Some(Schedule { offset_ns, tag })) => {
                let schedule =
                    if is_fd { igh_mcan_port_schedule_canfd } else { igh_mcan_port_schedule_can };
                c!(schedule(port, slave, channel, id, flags, data, len, offset_ns, tag))
            }
            (way, schedule) => {
                if let Some(Schedule { offset_ns, tag }) = schedule {
                    (tx.scheduled, tx.offset_ns, tx.tag) = (1, offset_ns, tag);
                }
                if way == 1 {
                    c!(igh_mcan_port_send(port, &tx))
                } else {
                    let mut sent = 0;
                    let code = c!(igh_mcan_port_send_batch(port, &tx, 1, &mut sent));
                    if (sent == 1) != (code == 0) {
                        return Err(format!("igh_mcan_port_send_batch: {sent} sent, code {code}"));
                    }
                    code
                }
            }
        };
        // A gateway may not support schedules, or the margin of the phase not suffice.
        let is_scheduled = options.schedule.is_some();
        match code {
            0 => Ok(true),
            code if ecan_result_is_temporary(code) == 1 => Ok(false),
            code if is_scheduled && code == ECAN_ERR_SCHEDULE.code() => Ok(false),
            code => check(code).map(|()| true),
        }
    }

    /// Calls that are rejected, and change nothing.
    fn rejections(&mut self, data: *const u8) -> Result<(), String> {
        let (port, absent) = (self.port(), self.gateways);
        let expected = [
            (c!(igh_mcan_port_send_can(port, 0, 0, 1, 0, null(), 8)), ECAN_ERR_NULL),
            (c!(igh_mcan_port_send_can(port, absent, 0, 1, 0, data, 8)), ECAN_ERR_SLAVE),
            (c!(igh_mcan_port_send_can(port, 0, 4, 1, 0, data, 8)), ECAN_ERR_CHANNEL),
            (c!(igh_mcan_port_send_can(port, 0, 0, 1, 0, data, 9)), ECAN_ERR_FRAME),
            (c!(igh_mcan_port_send_can(port, 0, 0, 0x800, 0, data, 8)), ECAN_ERR_FRAME),
        ];
        match expected.iter().find(|(code, expected)| *code != expected.code()) {
            Some((code, expected)) => Err(format!("code {code} in place of {expected:?}")),
            None => Ok(()),
        }
    }

    pub fn statistics(&mut self, slave: usize) -> Result<SlaveStatistics, String> {
        let port = self.port();
        let mut of_slave = igh_mcan_statistics_t::default();
        checked!(igh_mcan_port_get_statistics(port, slave, &mut of_slave))?;
        let mut statistics = SlaveStatistics {
            txpdo_lost: of_slave.txpdo_lost,
            txpdo_unknown: of_slave.txpdo_unknown,
            txpdo_discarded: of_slave.txpdo_discarded,
            parse_errors: of_slave.parse_errors,
            ..SlaveStatistics::default()
        };
        for (channel, of) in (0_u8..).zip(&mut statistics.channels) {
            let mut columns = igh_mcan_channel_statistics_t::default();
            // Of a channel that is not configured all are 0.
            checked!(igh_mcan_port_get_channel_statistics(port, slave, channel, &mut columns))?;
            *of = ChannelStatistics {
                frames_accepted: columns.frames_accepted,
                frames_sent: columns.frames_sent,
                frames_confirmed: columns.frames_confirmed,
                frames_delivered: columns.frames_delivered,
                frames_lost: columns.frames_lost,
                frames_discarded: columns.frames_discarded,
                frames_unknown: columns.frames_unknown,
                frames_pending: columns.frames_pending,
                frames_received: columns.frames_received,
                frames_not_taken: columns.frames_not_taken,
                ..ChannelStatistics::default()
            };
        }
        Ok(statistics)
    }
}

impl Drop for CApplication {
    fn drop(&mut self) {
        c!(ecan_igh_deinit(self.igh()));
    }
}

/// A configuration that the setters of C have made.
struct Configs {
    igh: Box<MaybeUninit<ecan_igh_config_t>>,
    port: Box<MaybeUninit<igh_mcan_port_config_t>>,
}

impl Configs {
    fn of(config: &Config) -> Result<Self, String> {
        let mut this = Self { igh: Box::new_uninit(), port: Box::new_uninit() };
        let (igh, port) = (this.igh(), this.port());
        checked!(ecan_igh_default_config(igh))?;
        checked!(igh_mcan_port_default_config(port))?;
        let adapter = &config.adapter;
        let cycle_us = adapter.cycle_ns() / 1_000;
        checked!(ecan_igh_config_set_slave_count(igh, adapter.slaves.len()))?;
        checked!(ecan_igh_config_set_cycle_us(igh, cycle_us))?;
        checked!(ecan_igh_config_allow_large_pdos(igh, adapter.allow_large_pdos.into()))?;
        if let Some(dc) = &adapter.dc {
            let shift_us = dc.shift.as_micros() as u32;
            checked!(ecan_igh_config_set_dc_sync0(igh, cycle_us, shift_us))?;
        }
        for (slave, it) in adapter.slaves.iter().enumerate() {
            let (rx, tx) = (it.rx_multiplier.into(), it.tx_multiplier.into());
            checked!(ecan_igh_config_set_slave_pdo_multipliers(igh, slave, rx, tx))?;
            checked!(ecan_igh_config_set_slave_position(igh, slave, it.alias, it.position))?;
        }
        for (slave, it) in config.port.gateways.iter().enumerate() {
            for (channel, config) in (0_u8..).zip(&it.channels) {
                let Some(config) = config else { continue };
                let bitrate = config.can.nominal_bitrate;
                if config.can.fd {
                    let data = config.can.data_bitrate;
                    checked!(igh_mcan_port_set_canfd_channel(port, slave, channel, bitrate, data))?;
                } else {
                    checked!(igh_mcan_port_set_classic_channel(port, slave, channel, bitrate))?;
                }
                let (received, sent) = (config.traffic.received, config.traffic.sent);
                checked!(igh_mcan_port_set_traffic(port, slave, channel, received, sent))?;
            }
            if let (Some(tx), Some(rx)) = (it.tx_channel_mask, it.rx_channel_mask) {
                checked!(igh_mcan_port_set_direction_masks(port, slave, tx, rx))?;
            }
            let (tx, rx) = (it.tx_encapsulation as c_int, it.rx_encapsulation as c_int);
            checked!(igh_mcan_port_set_encapsulation(port, slave, tx, rx))?;
            let (tx, rx) = (it.tx_options.bits(), it.rx_options.bits());
            checked!(igh_mcan_port_set_options(port, slave, tx, rx))?;
            let (tx, rx) = (it.tx_budget as c_int, it.rx_budget as c_int);
            checked!(igh_mcan_port_set_budget(port, slave, tx, rx))?;
            checked!(igh_mcan_port_set_paced(port, slave, it.paced.into()))?;
        }
        for ChannelFilter { slave, channel, filter } in &config.port.filters {
            let AcceptanceFilter::Extended(filter) = filter else { continue };
            checked!(igh_mcan_port_add_extended_filter(
                port,
                *slave,
                *channel,
                RANGE_UNMASKED,
                REJECT,
                filter.id1,
                filter.id2
            ))?;
        }
        checked!(igh_mcan_port_apply_config(igh, port))?;
        Ok(this)
    }

    fn igh(&mut self) -> *mut ecan_igh_config_t {
        self.igh.as_mut_ptr()
    }

    fn port(&mut self) -> *mut igh_mcan_port_config_t {
        self.port.as_mut_ptr()
    }
}

fn frame_of(item: &igh_mcan_rx_frame_t) -> Result<CanFrame, FrameError> {
    let has = |flag| item.flags & flag != 0;
    let id = CanId::new(item.can_id, has(IGH_MCAN_FLAG_EXT))?;
    let data = item.data.get(..item.len.into()).unwrap_or_default();
    if has(IGH_MCAN_FLAG_FD) {
        CanFrame::fd(id, data, has(IGH_MCAN_FLAG_BRS), has(IGH_MCAN_FLAG_ESI))
    } else if has(IGH_MCAN_FLAG_RTR) {
        let dlc = Dlc::from_raw(item.len).ok_or(FrameError::RemoteDlc { dlc: item.len })?;
        CanFrame::remote(id, dlc)
    } else {
        CanFrame::classic(id, data)
    }
}

/// As [`check`]; calls of the library may fail.
fn check_cycle(code: c_int) -> Result<(), String> {
    if code == ECAN_ERR_MASTER.code() { Ok(()) } else { check(code) }
}

/// The text of the error names the function.
fn check(code: c_int) -> Result<(), String> {
    if code == 0 {
        return Ok(());
    }
    // SAFETY: the text is that of this thread, and is not changed before it is copied.
    let text = unsafe { CStr::from_ptr(ecan_last_error()) }.to_string_lossy();
    Err(format!("code {code}: {text}"))
}
