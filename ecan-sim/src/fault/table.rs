//! The faults and their keys, each declared once: place, fields, kind and keys in text, help, random values and
//! description.
//!
//! To add a fault, add an entry and its new keys here, and the injection: in [`World`](crate::World), in the gateway
//! or in the node. Scenario files, `ecan sim fault` with its help, and random trials follow.

use std::fmt::{self, Display, Formatter};

use serde::{Deserialize, Serialize};

/// Direction in which a frame is lost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum LossDirection {
    /// Before the first slave: no slave sees the frame.
    #[default]
    Outward,
    /// After the last slave: every slave has processed the frame, the master does not receive it.
    Return,
}

/// A call of libethercat that [`Fault::LibraryError`] makes fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LibraryCall {
    /// `ecrt_master_receive`: received frames remain for the next call.
    Receive,
    /// `ecrt_master_send`: queued datagrams remain queued.
    Send,
    /// `ecrt_domain_process`: the domain keeps its last working counter.
    DomainProcess,
    /// `ecrt_domain_queue`
    DomainQueue,
    /// `ecrt_domain_state`
    DomainState,
}

impl LibraryCall {
    /// All calls.
    pub const ALL: [Self; 5] =
        [Self::Receive, Self::Send, Self::DomainProcess, Self::DomainQueue, Self::DomainState];
}

/// Passes the table of all faults to a macro. The groups are in the order of [`FaultKind::ALL`](super::FaultKind::ALL).
///
/// An entry is a variant with its fields, its kind in text with its name, keys and help, and the format of its
/// description. `field: type = source` is read from text by the method `source` of the resolver. An entry without a
/// kind cannot be given as text. `drawn` has the weight of a kind and the values of its keys in
/// [random trials](super::FaultKind::draw).
macro_rules! fault_table {
    ($callback:ident) => { $callback! {
        line {
            /// The frames of the next `cycles` sends with process data are lost, and those of other sends
            /// before the last one.
            LostFrame {
                /// Direction.
                direction: LossDirection = way,
                /// Number of sends with process data.
                cycles: u32 = cycles,
            }
            kind LostFrame "lost_frame" ("way", "cycles") " The frames of some cycles are lost"
            drawn (6, &[("way", OneOf(&["'outward'", "'return'"])), ("cycles", Between(1, 30))])
            text ("frames lost {} for {}", place(*direction), counted(*cycles, "cycle"));

            /// The working counter of every process data datagram of the next `cycles` sends is changed by
            /// `offset`, but not below 0.
            WorkingCounterOffset {
                /// Difference.
                offset: i32 = offset,
                /// Number of sends.
                cycles: u32 = cycles,
            }
            kind WorkingCounterOffset "working_counter_offset" ("offset", "cycles")
            " The working counters of some cycles are changed"
            // A smaller offset would show a read without the write that took place.
            drawn (2, &[("offset", OneOf(&["-3"])), ("cycles", Between(1, 15))])
            text ("working counters changed by {offset} for {}", counted(*cycles, "cycle"));

            /// The gateway loses its supply for `off_ms` milliseconds, then boots.
            PowerCycle {
                /// Index.
                gateway: usize = gateway,
                /// Time without supply, ms.
                off_ms: u32 = off_ms,
            }
            kind PowerCycle "power_cycle" ("gateway", "off_ms") " The gateway loses its supply, then boots"
            drawn (3, &[("off_ms", Between(1, 800))])
            text ("gateway {gateway} without supply for {off_ms} ms");

            /// The gateway loses its supply permanently.
            PowerOff {
                /// Index.
                gateway: usize = gateway,
            }
            kind PowerOff "power_off" ("gateway") " The gateway loses its supply"
            drawn (1, &[])
            text ("gateway {gateway} without supply");

            /// The supply of the gateway returns at once. No effect if the gateway has it.
            PowerOn {
                /// Index.
                gateway: usize = gateway,
            }
            kind PowerOn "power_on" ("gateway") " The gateway gets its supply back and boots"
            drawn (1, &[])
            text ("gateway {gateway} supplied again");

            /// The cable before the gateway is open for `for_ms` milliseconds: the gateway and those
            /// downstream keep their supply, but receive no frames. If it is the first slave, the master's own
            /// link is down.
            LinkLoss {
                /// Index.
                gateway: usize = gateway,
                /// Duration, ms.
                for_ms: u32 = for_ms,
            }
            kind LinkLoss "link_loss" ("gateway", "for_ms") " The cable before the gateway is open"
            drawn (3, &[("for_ms", Between(1, 500))])
            text ("link loss before gateway {gateway} for {for_ms} ms");

            /// An I/O slave loses its supply for `off_ms` milliseconds.
            IoPowerCycle {
                /// Index in [`Scenario::ios`](crate::Scenario::ios).
                io: usize = io,
                /// Time without supply, ms.
                off_ms: u32 = off_ms,
            }
            kind IoPowerCycle "io_power_cycle" ("io", "off_ms") " An I/O slave loses its supply, then boots"
            drawn (4, &[("off_ms", Between(1, 800))])
            text ("I/O {io} without supply for {off_ms} ms");

            /// A fault inside a gateway.
            Gateway {
                /// Index.
                gateway: usize,
                /// Fault.
                fault: GatewayFault,
            }
            text ("gateway {gateway}: {fault}");
        }

        gateway {
            /// The next `times` transfers of this object, upload or download, are aborted.
            SdoAbort {
                /// Object index.
                index: u16 = index,
                /// Subindex.
                subindex: u8 = subindex,
                /// Abort code that the master receives.
                code: u32 = code,
                /// Number of transfers.
                times: u32 = times,
            }
            kind SdoAbort "sdo_abort" ("gateway", "index", "subindex", "code", "times")
            " Transfers of an object are aborted"
            drawn (1, &[
                ("index", OneOf(&["0x8010", "0x8011", "0x8001", "0x8002", "0x8021", "0x1C12", "0xF000"])),
                ("subindex", Between(0, 8)),
                ("code", OneOf(&["0x05030000", "0x05040000", "0x06010002", "0x08000020"])),
                ("times", Between(1, 4)),
            ])
            text (
                "SDO transfer of {index:#06X}:{subindex:02} aborted {}: {code:#010X}",
                counted(*times, "time")
            );

            /// The next `times` transfers of this object are executed, but their response gets lost: the
            /// master reports no abort code.
            SdoResponseLost {
                /// Object index.
                index: u16 = index,
                /// Subindex.
                subindex: u8 = subindex,
                /// Number of transfers.
                times: u32 = times,
            }
            kind SdoResponseLost "sdo_response_lost" ("gateway", "index", "subindex", "times")
            " Transfers of an object are executed, but their response is lost"
            drawn (1, &[
                ("index", OneOf(&["0x8010", "0x8011", "0x8001", "0x8002", "0x8021", "0xF000"])),
                ("subindex", Between(0, 8)),
            ])
            text ("SDO response of {index:#06X}:{subindex:02} lost {}", counted(*times, "time"));

            /// The mailbox does not respond for this time.
            MailboxSilent {
                /// Duration in milliseconds from now.
                ms: u32 = for_ms,
            }
            kind MailboxTimeout "mailbox_timeout" ("gateway", "for_ms") " The mailbox does not respond"
            drawn (1, &[("for_ms", Between(1, 800))])
            text ("mailbox silent for {ms} ms");

            /// The next `images` TxPDO images are published with `seq_end` one less than
            /// `seq_begin`, as if read during an update.
            TornTxPdo {
                /// Number of images.
                images: u32 = times,
            }
            kind TornImage "torn_image" ("gateway", "times") " TxPDO images are torn: read during an update"
            drawn (2, &[("times", Between(1, 6))])
            text ("{} torn", counted(*images, "TxPDO image"));

            /// The next `images` TxPDO images carry a wrong payload CRC.
            CrcErrorTxPdo {
                /// Number of images.
                images: u32 = times,
            }
            kind CrcError "crc_error" ("gateway", "times") " TxPDO images carry a wrong CRC"
            drawn (2, &[("times", Between(1, 6))])
            text ("{} with a wrong CRC", counted(*images, "TxPDO image"));

            /// The slave falls back from OP to SAFEOP (a lower state is kept) and reports this AL status
            /// code with the error indication.
            AlError {
                /// AL status code.
                code: u16 = short_code,
            }
            kind AlError "al_error" ("gateway", "code") " The gateway leaves OP with an AL status code"
            drawn (2, &[("code", OneOf(&["0x1A", "0x1B", "0x2C", "0x11"]))])
            text ("AL error {code:#06X}");

            /// The firmware runs no data-path service for this time, as when its main loop is blocked:
            /// images are neither parsed nor published.
            ServiceStall {
                /// Duration in milliseconds from now.
                ms: u32 = for_ms,
            }
            kind ServiceStall "service_stall" ("gateway", "for_ms") " The data path of the firmware is blocked"
            drawn (2, &[("for_ms", Between(1, 60))])
            text ("data path stalled for {ms} ms");

            /// The next erasures or writes of the flash fail, of the saved configuration or of firmware.
            FlashFailure {
                /// Number of operations.
                times: u32 = times,
            }
            kind FlashFailure "flash_failure" ("gateway", "times") " Erasures or writes of the flash fail"
            drawn (1, &[])
            text ("flash fails in {}", counted(*times, "operation"));

            /// The distributed clock of the slave jumps.
            ClockJump {
                /// Size of the jump in nanoseconds.
                ns: i64 = ns,
            }
            kind ClockJump "clock_jump" ("gateway", "ns") " The distributed clock of the gateway jumps"
            drawn (1, &[("ns", Between(-3_000_000, 3_000_000))])
            text ("distributed clock jumps by {ns} ns");
        }

        bus {
            /// The CAN controller of this channel becomes bus-off.
            BusOff {
                /// Index.
                gateway: usize = gateway,
                /// Channel, 0 to 3.
                channel: usize = channel,
            }
            kind BusOff "bus_off" ("gateway", "channel") " The CAN controller of a channel becomes bus-off"
            drawn (2, &[])
            text ("gateway {gateway} channel {channel}: bus-off");

            /// The next `frames` transmissions of the gateway's channel end in error frames.
            ErrorFrames {
                /// Index.
                gateway: usize = gateway,
                /// Channel, 0 to 3.
                channel: usize = channel,
                /// Number of transmissions.
                frames: u32 = times,
            }
            kind ErrorFrames "error_frames" ("gateway", "channel", "times")
            " Transmissions of a channel end in error frames"
            drawn (1, &[("times", Between(1, 40))])
            text (
                "gateway {gateway} channel {channel}: error frames in {}",
                counted(*frames, "transmission")
            );

            /// The node sends nothing for `for_ms` milliseconds, but still acknowledges.
            NodeSilent {
                /// Name of the node.
                node: String = node,
                /// Duration, ms.
                for_ms: u32 = for_ms,
            }
            kind NodeSilent "node_silent" ("node", "for_ms") " A node sends nothing, but acknowledges"
            drawn (2, &[("for_ms", Between(1, 800))])
            text ("node \"{node}\" silent for {for_ms} ms");

            /// A fault in a drive. No effect if the node is not a drive.
            Drive {
                /// Name of the node.
                node: String,
                /// Fault.
                fault: DriveFault,
            }
            text ("drive \"{node}\": {fault}");
        }

        drive {
            /// The drive detects a fault: emergency message, fault reaction (0x605E), state Fault.
            Error {
                /// CiA 402 error code, for example 0x2310.
                code: u16 = short_code,
            }
            kind DriveError "drive_error" ("node", "code") " A drive detects a fault"
            drawn (1, &[("code", OneOf(&["0x2310", "0x8611", "0x4210"]))])
            text ("fault {code:#06X}");

            /// As [`Error`](Self::Error), of one axis of a drive with several.
            AxisError {
                /// Axis, from 0.
                axis: u8,
                /// CiA 402 error code.
                code: u16,
            }
            text ("fault {code:#06X} of axis {axis}");

            /// A temporary error: an emergency message without a change of state.
            Emcy {
                /// Error code.
                code: u16 = short_code,
                /// Error register in the message.
                register: u8 = register,
            }
            kind DriveEmcy "drive_emcy" ("node", "code", "register")
            " A drive sends an emergency message without a change of state"
            drawn (1, &[("code", OneOf(&["0x4210"])), ("register", OneOf(&["9"]))])
            text ("emergency {code:#06X}, error register {register:#04X}");

            /// The drive loses its supply for `off_ms` milliseconds, then boots. Its motor coasts.
            PowerCycle {
                /// Time without supply, ms.
                off_ms: u32 = off_ms,
            }
            kind DrivePowerCycle "drive_power_cycle" ("node", "off_ms") " A drive loses its supply, then boots"
            drawn (1, &[("off_ms", Between(1, 500))])
            text ("without supply for {off_ms} ms");

            /// The drive's CAN controller is bus-off for `for_ms` milliseconds, then recovers. The drive
            /// reacts as to a loss of the host (0x6007, 0x1029).
            BusOff {
                /// Duration, ms.
                for_ms: u32 = for_ms,
            }
            kind DriveBusOff "drive_bus_off" ("node", "for_ms") " The CAN controller of a drive is bus-off"
            drawn (1, &[("for_ms", Between(1, 500))])
            text ("bus-off for {for_ms} ms");

            /// The motor is blocked for `for_ms` milliseconds.
            Blocked {
                /// Duration, ms.
                for_ms: u32 = for_ms,
            }
            kind DriveBlocked "drive_blocked" ("node", "for_ms") " The motor of a drive is blocked"
            drawn (1, &[("for_ms", Between(1, 300))])
            text ("motor blocked for {for_ms} ms");

            /// An object gets a value, as the process of an I/O module changes an input. No effect if the
            /// object does not exist or is updated by the drive.
            Value {
                /// Index.
                index: u16 = index,
                /// Subindex.
                subindex: u8 = subindex,
                /// Value; excess bits are cut off.
                value: i64 = value,
            }
            kind DriveValue "drive_value" ("node", "index", "subindex", "value")
            " An object of a drive or an I/O node gets a value, as an input"
            text ("object {index:#06X}:{subindex:02X} becomes {value}");
        }

        library {
            /// The next `times` calls of this function fail without effect, as when a signal interrupts
            /// them (`EINTR`). In 1.5 they fail silently. If scheduled by cycle, it affects the calls after
            /// that cycle's send.
            LibraryError {
                /// Function.
                call: LibraryCall = call,
                /// Error number, positive.
                errno: i32 = errno,
                /// Number of calls.
                times: u32 = times,
            }
            kind LibraryError "library_error" ("call", "errno", "times")
            " Calls of a function of the library fail without effect"
            drawn (1, &[
                (
                    "call",
                    OneOf(&["'receive'", "'send'", "'domain_process'", "'domain_queue'", "'domain_state'"]),
                ),
                ("errno", OneOf(&["'EINTR'", "'EIO'"])),
                ("times", Between(1, 4)),
            ])
            text ("{call} fails {} with error number {errno}", counted(*times, "time"));

            /// The master starts no SDO or register request of a configuration for `for_ms` milliseconds,
            /// as when process data leave no bandwidth for its mailbox traffic. Requests stay busy,
            /// regardless of their timeout.
            RequestsHeld {
                /// Duration, ms.
                for_ms: u32 = for_ms,
            }
            kind RequestsHeld "requests_held" ("for_ms")
            " The master starts no SDO and register requests of the program"
            drawn (1, &[("for_ms", Between(1, 400))])
            text ("no request started for {for_ms} ms");
        }
    } };
}
pub(super) use fault_table;

/// Passes the keys of all faults to a macro: name, help, type and default of each, see [`FaultKey`](super::FaultKey).
macro_rules! fault_keys {
    ($callback:ident) => {
        $callback! {
            /// Time: the n-th send with process data since the start of the simulation, from 1
            cycle: u64 [],
            /// Time since the start of the simulation
            at_ms: u64 [],
            /// Time from now; in a scenario file from the start of the simulation
            after_ms: u64 [],
            /// Time since all gateways are in OP for the first time
            after_op_ms: u64 [],
            /// Time since the program has all gateways ready for the first time
            after_ready_ms: u64 [],
            /// Index of the gateway [default: the only one]
            gateway: usize [],
            /// Index of the I/O slave [default: the only one]
            io: usize [],
            /// Channel, 0 to 3
            channel: usize [],
            /// Name of the node
            node: String [],
            /// Lost before the first slave (outward) or after the last one (return) [default: outward]
            way: LossDirection [= LossDirection::default()],
            /// Number of sends with process data [default: 1]
            cycles: u32 [= 1],
            /// Difference of the working counter
            offset: i32 [required],
            /// Time without supply [default: 1000 ms]
            off_ms: u32 [= 1000],
            /// Duration
            for_ms: u32 [required],
            /// Index of the object
            index: u16 [required],
            /// Subindex of the object [default: 0]
            subindex: u8 [= 0],
            /// SDO abort code, AL status code or CiA 402 error code
            code: u32 [required],
            /// Error register of the emergency message [default: 1]
            register: u8 [= 1],
            /// Number of times [default: 1]
            times: u32 [= 1],
            /// Function: receive, send, domain_process, domain_queue or domain_state
            call: LibraryCall [required],
            /// Error number, or its name such as EINTR
            errno: toml::Value [],
            /// Jump, in ns
            ns: i64 [required],
            /// Value of the object; excess bits are cut off
            value: i64 [required],
        }
    };
}
pub(super) use fault_keys;

/// Declares the three types of faults, which the groups of the table make up.
macro_rules! fault_types {
    (
        line { $($line:tt)* }
        gateway { $($gateway:tt)* }
        bus { $($bus:tt)* }
        drive { $($drive:tt)* }
        library { $($library:tt)* }
    ) => {
        fault_type! {
            /// A fault of the library, on the line, in a gateway, on a bus or in a node.
            ///
            /// `gateway` is the index of a gateway in the order of the EtherCAT line, from 0; if it does not
            /// exist, the fault has no effect.
            #[derive(Clone, Debug, PartialEq, Eq)]
            Fault { $($line)* $($bus)* $($library)* }
        }
        fault_type! {
            /// A fault of a gateway.
            #[derive(Clone, Copy, Debug, PartialEq, Eq)]
            GatewayFault { $($gateway)* }
        }
        fault_type! {
            /// A fault in a simulated drive.
            #[derive(Clone, Copy, Debug, PartialEq, Eq)]
            DriveFault { $($drive)* }
        }
    };
}

macro_rules! fault_type {
    ($(#[$meta:meta])* $name:ident { $(
        $(#[$variant_meta:meta])*
        $variant:ident { $( $(#[$field_meta:meta])* $field:ident: $type:ty $(= $source:ident)?, )* }
        $( kind $kind:ident $kind_name:literal ($($key:literal),*) $help:literal $(drawn $drawn:tt)? )?
        text ($($text:tt)*);
    )* }) => {
        $(#[$meta])*
        pub enum $name {
            $( $(#[$variant_meta])* $variant { $( $(#[$field_meta])* $field: $type, )* }, )*
        }

        impl Display for $name {
            fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
                match self { $( Self::$variant { $($field),* } => write!(f, $($text)*), )* }
            }
        }
    };
}

fault_table!(fault_types);

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

fn place(direction: LossDirection) -> &'static str {
    match direction {
        LossDirection::Outward => "before the first slave",
        LossDirection::Return => "after the last slave",
    }
}

fn counted(count: u32, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}
