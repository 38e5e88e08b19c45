use std::fmt::{self, Display, Formatter};

use crate::fault::{
    DriveFault, Fault, FaultEffect, LibraryCall, LossDirection, ScriptedFault, When,
};
use crate::gateway::GatewayFault;

impl Display for Fault {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::LostFrame { direction, cycles } => {
                let at = match direction {
                    LossDirection::Outward => "before the first slave",
                    LossDirection::Return => "after the last slave",
                };
                write!(f, "frames lost {at} for {}", counted(*cycles, "cycle"))
            }
            Self::WorkingCounterOffset { offset, cycles } => {
                let cycles = counted(*cycles, "cycle");
                write!(f, "working counters changed by {offset} for {cycles}")
            }
            Self::PowerCycle { gateway, off_ms } => {
                write!(f, "gateway {gateway} without supply for {off_ms} ms")
            }
            Self::PowerOff { gateway } => write!(f, "gateway {gateway} without supply"),
            Self::PowerOn { gateway } => write!(f, "gateway {gateway} supplied again"),
            Self::LinkLoss { gateway, for_ms } => {
                write!(f, "link loss before gateway {gateway} for {for_ms} ms")
            }
            Self::IoPowerCycle { io, off_ms } => {
                write!(f, "I/O {io} without supply for {off_ms} ms")
            }
            Self::Gateway { gateway, fault } => write!(f, "gateway {gateway}: {fault}"),
            Self::BusOff { gateway, channel } => {
                write!(f, "gateway {gateway} channel {channel}: bus-off")
            }
            Self::ErrorFrames { gateway, channel, frames } => {
                let frames = counted(*frames, "transmission");
                write!(f, "gateway {gateway} channel {channel}: error frames in {frames}")
            }
            Self::NodeSilent { node, for_ms } => {
                write!(f, "node \"{node}\" silent for {for_ms} ms")
            }
            Self::LibraryError { call, errno, times } => {
                let times = counted(*times, "time");
                write!(f, "{call} fails {times} with error number {errno}")
            }
            Self::RequestsHeld { for_ms } => write!(f, "no request started for {for_ms} ms"),
            Self::Drive { node, fault } => write!(f, "drive \"{node}\": {fault}"),
        }
    }
}

impl Display for GatewayFault {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match *self {
            Self::SdoAbort { index, subindex, code, times } => {
                let times = counted(times, "time");
                write!(
                    f,
                    "SDO transfer of {index:#06X}:{subindex:02} aborted {times}: {code:#010X}"
                )
            }
            Self::SdoResponseLost { index, subindex, times } => {
                let times = counted(times, "time");
                write!(f, "SDO response of {index:#06X}:{subindex:02} lost {times}")
            }
            Self::TornTxPdo { images } => write!(f, "{} torn", counted(images, "TxPDO image")),
            Self::CrcErrorTxPdo { images } => {
                write!(f, "{} with a wrong CRC", counted(images, "TxPDO image"))
            }
            Self::AlError { code } => write!(f, "AL error {code:#06X}"),
            Self::ClockJump { ns } => write!(f, "distributed clock jumps by {ns} ns"),
            Self::MailboxSilent { ms } => write!(f, "mailbox silent for {ms} ms"),
            Self::ServiceStall { ms } => write!(f, "data path stalled for {ms} ms"),
            Self::FlashFailure { times } => {
                write!(f, "flash fails in {}", counted(times, "operation"))
            }
        }
    }
}

impl Display for DriveFault {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Error { code } => write!(f, "fault {code:#06X}"),
            Self::AxisError { axis, code } => write!(f, "fault {code:#06X} of axis {axis}"),
            Self::Emcy { code, register } => {
                write!(f, "emergency {code:#06X}, error register {register:#04X}")
            }
            Self::PowerCycle { off_ms } => write!(f, "without supply for {off_ms} ms"),
            Self::BusOff { for_ms } => write!(f, "bus-off for {for_ms} ms"),
            Self::Value { index, subindex, value } => {
                write!(f, "object {index:#06X}:{subindex:02X} becomes {value}")
            }
            Self::Blocked { for_ms } => write!(f, "motor blocked for {for_ms} ms"),
        }
    }
}

impl Display for LibraryCall {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Receive => "ecrt_master_receive",
            Self::Send => "ecrt_master_send",
            Self::DomainProcess => "ecrt_domain_process",
            Self::DomainQueue => "ecrt_domain_queue",
            Self::DomainState => "ecrt_domain_state",
        })
    }
}

impl Display for When {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let seconds = |ns: u64| ns as f64 / 1e9;
        match *self {
            Self::Cycle(cycle) => write!(f, "at cycle {cycle}"),
            Self::At(ns) => write!(f, "at {:.3} s", seconds(ns)),
            Self::AfterOp(ns) => write!(f, "{:.3} s after OP", seconds(ns)),
            Self::AfterReady(ns) => write!(f, "{:.3} s after ready", seconds(ns)),
        }
    }
}

impl Display for ScriptedFault {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.when, self.fault)
    }
}

/// The line that programs print: that of the record, or of the fault with its time.
impl Display for FaultEffect {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Injected(record) => record.fmt(f),
            Self::Scheduled(fault) => fault.fmt(f),
            Self::Nothing(fault) => write!(f, "no effect: {fault}"),
        }
    }
}

fn counted(count: u32, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}
