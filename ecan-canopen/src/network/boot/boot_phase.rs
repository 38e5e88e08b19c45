//! Phase of the boot-up of a node.

ecan_protocol::text_enum! {
    /// Phase of the boot-up of a node.
    #[derive(Default)]
    pub enum BootPhase;
    /// Nodes that boot before are not booted yet.
    #[default]
    Waiting = "waiting for nodes that boot before";
    /// The node has not responded yet.
    Contact = "waiting for a response";
    /// Device type, identity and software are compared.
    Identity = "checking the identity";
    /// The default parameters are restored.
    Restore = "restoring the default parameters";
    /// Parameters are written and read back.
    Parameters = "writing parameters";
    /// The steps after the parameters, for example the PDO mapping.
    Steps = "mapping PDOs";
    /// The heartbeat is configured, and the node started.
    Start = "starting";
    /// The node has its parameters and runs as configured.
    Booted = "booted";
    /// The boot-up failed.
    Failed = "failed";
}
