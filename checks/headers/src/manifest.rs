//! The sources of each header, and the headers of each library.

pub struct Header {
    /// Name in `include/`.
    pub name: &'static str,
    /// File name of the template in `checks/headers/templates`.
    pub template: &'static str,
    /// First line of the header; this and the next two fields are for the template of the layers.
    pub title: &'static str,
    /// Purpose of the header, line by line.
    pub intro: &'static [&'static str],
    /// The headers that it includes.
    pub includes: &'static [&'static str],
    /// Its sections, in order: sources in `capi/`, or one section `SOURCE: TITLE` of a source.
    pub sections: &'static [&'static str],
}

pub struct Library {
    /// Its name without `lib`; its version script is generated.
    pub name: &'static str,
    /// The headers whose functions it exports.
    pub headers: &'static [&'static str],
    /// Source in `capi/` with functions for the other library, which are in no header.
    pub private: Option<&'static str>,
}

pub const HEADERS: &[Header] = &[
    Header {
        name: "igh_ecan_common.h",
        template: "common.h",
        title: "",
        intro: &[],
        includes: &[],
        sections: &[
            "boundary/src/result.rs: Return values",
            "mcan-host/src/common.rs: Return values",
            "mcan-host/src/common.rs: The last error",
            "boundary/src/result.rs: Constants",
            "mcan-host/src/common.rs: Version of the library",
        ],
    },
    Header {
        name: "igh_mcan_pdo.h",
        template: "layer.h",
        title: "ECAN-Lite host SDK: the process data protocol (manual 5 to 12).",
        intro: &[
            "Writes frames into images and reads them, without an EtherCAT master. libecan_mcan_host contains",
            "this layer, libecan_igh_host the layers above it. For applications that exchange raw process data",
            "(manual 15.5.3); not necessary with igh_mcan_port.h.",
        ],
        includes: &["igh_ecan_common.h"],
        sections: &[
            "boundary/src/frames.rs",
            "mcan-host/src/writer.rs: Frames to send",
            "boundary/src/image.rs: PDO profiles",
            "mcan-host/src/writer.rs: PDO profiles",
            "mcan-host/src/writer.rs: Writing images",
            "boundary/src/image.rs: Faults of an image",
            "mcan-host/src/parser.rs: Faults of an image",
            "mcan-host/src/parser.rs: Reading images",
            "boundary/src/image.rs: Channel status",
            "mcan-host/src/parser.rs: Channel status",
            "mcan-host/src/parser.rs: Checksum and data lengths",
        ],
    },
    Header {
        name: "igh_adapter.h",
        template: "layer.h",
        title: "ECAN-Lite host SDK: the Adapter (manual 15.1, 15.5).",
        intro: &[
            "Master, slaves, one domain for each, startup SDOs, distributed clocks, the cycle and raw process",
            "data.",
        ],
        includes: &["igh_ecan_common.h"],
        sections: &[
            "igh-host/src/adapter/config.rs",
            "igh-host/src/adapter/context.rs: Life of a master",
            "igh-host/src/adapter/cycle.rs",
            "igh-host/src/adapter/bus_state.rs: State of the bus and its slaves",
            "igh-host/src/adapter/sdo.rs",
            "igh-host/src/adapter/bus_state.rs: Diagnosis from another thread",
        ],
    },
    Header {
        name: "igh_mcan_port.h",
        template: "layer.h",
        title: "ECAN-Lite host SDK: the MCAN Port (manual 15.1, 15.4, 15.5).",
        intro: &["CAN and CAN FD frames through ECAN-Lite gateways."],
        includes: &["igh_adapter.h", "igh_ecan_common.h", "igh_mcan_pdo.h"],
        sections: &[
            "igh-host/src/mcan_port/config.rs",
            "igh-host/src/mcan_port/config_file.rs",
            "igh-host/src/mcan_port/context.rs: Life of a Port",
            "igh-host/src/mcan_port/cycle.rs",
            "igh-host/src/mcan_port/context.rs: Service for other programs",
            "igh-host/src/mcan_port/schedule.rs",
            "igh-host/src/mcan_port/state.rs",
        ],
    },
    Header {
        name: "igh_cia402_protocol.h",
        template: "layer.h",
        title: "ECAN-Lite host SDK: CANopen and CiA 402 (manual 15.1, 15.4, 15.5.4).",
        intro: &["Motors on the gateways: startup, targets, states, SDO."],
        includes: &["igh_ecan_common.h", "igh_mcan_port.h"],
        sections: &[
            "igh-host/src/cia402/numbers.rs",
            "igh-host/src/cia402/axis.rs",
            "igh-host/src/cia402/context.rs: Settings of all axes together",
            "igh-host/src/cia402/context.rs: Life of the axes",
            "igh-host/src/cia402/commands.rs: Progress of the calls that wait",
            "igh-host/src/cia402/commands.rs: Startup and shutdown that wait",
            "igh-host/src/cia402/cycle.rs",
            "igh-host/src/cia402/commands.rs: Commands to axes",
            "igh-host/src/cia402/state.rs: Values of an axis' state",
            "igh-host/src/cia402/state.rs: State of the axes",
            "igh-host/src/cia402/drive_values.rs: Reaction of the drives to the loss of the host",
            "igh-host/src/cia402/drive_values.rs: Limits and units of drives",
            "igh-host/src/cia402/state.rs: Counters and bus load",
            "igh-host/src/cia402/sdo.rs",
        ],
    },
    Header {
        name: "igh_canopen.h",
        template: "layer.h",
        title: "ECAN-Lite host SDK: CANopen networks (CiA 301, CiA 302-2, CiA 305).",
        intro: &["Nodes from a configuration file, their boot-up, and services for any node."],
        includes: &["igh_cia402_protocol.h", "igh_ecan_common.h"],
        sections: &[
            "igh-host/src/canopen/node.rs: Nodes of a network",
            "igh-host/src/canopen/boot.rs",
            "igh-host/src/canopen/services.rs: SDO transfers with nodes in the cycle",
            "igh-host/src/canopen/services.rs: TIME, guarding, store and restore",
            "igh-host/src/canopen/node.rs: Errors of nodes",
            "igh-host/src/canopen/lss.rs",
            "igh-host/src/canopen/services.rs: Multiplexed PDOs (CiA 301, 7.2.2.4)",
        ],
    },
    Header {
        name: "igh_real_time.h",
        template: "layer.h",
        title: "ECAN-Lite host SDK: the real-time thread and the timing of its cycles (manual 13.9).",
        intro: &[
            "Priority, CPUs and locked memory of the cycle's thread; its waits and their statistics.",
        ],
        includes: &["igh_adapter.h", "igh_ecan_common.h"],
        sections: &["igh-host/src/adapter/real_time.rs"],
    },
    Header {
        name: "igh_plan.h",
        template: "layer.h",
        title: "ECAN-Lite host SDK: the plan of configurations before the first run.",
        intro: &[
            "Load of wire, CAN buses, images and mailboxes, with warnings and errors, without a bus.",
        ],
        includes: &["igh_cia402_protocol.h", "igh_mcan_port.h"],
        sections: &["igh-host/src/plan.rs"],
    },
    Header {
        name: "igh_observer.h",
        template: "layer.h",
        title: "ECAN-Lite host SDK: observation and commands from other threads.",
        intro: &["Snapshots of the last cycle, requests to stop and quick stops, without locks."],
        includes: &["igh_cia402_protocol.h", "igh_mcan_port.h"],
        sections: &["igh-host/src/observer.rs"],
    },
    Header {
        name: "igh_sim.h",
        template: "layer.h",
        title: "ECAN-Lite host SDK: the built-in simulator.",
        intro: &["Scenario, clock and seed of a simulated bus. Not necessary to use one."],
        includes: &["igh_adapter.h", "igh_ecan_common.h"],
        sections: &["igh-host/src/adapter/context.rs: Simulated bus"],
    },
];

pub const LIBRARIES: &[Library] = &[
    Library {
        name: "ecan_mcan_host",
        headers: &["igh_ecan_common.h", "igh_mcan_pdo.h"],
        private: Some("mcan-host/src/common.rs"),
    },
    Library {
        name: "ecan_igh_host",
        headers: &[
            "igh_adapter.h",
            "igh_mcan_port.h",
            "igh_cia402_protocol.h",
            "igh_canopen.h",
            "igh_real_time.h",
            "igh_plan.h",
            "igh_observer.h",
            "igh_sim.h",
        ],
        private: None,
    },
];
