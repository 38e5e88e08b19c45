//! Phase of an Adapter.

ecan_protocol::text_enum! {
    /// Phase of an [`Adapter`](crate::Adapter).
    pub enum Phase;
    /// Nothing is configured, because a reconfiguration failed. Call
    /// [`Adapter::reconfigure`](crate::Adapter::reconfigure) again, or drop the Adapter.
    Down = "down";
    /// Slaves, domains and startup SDOs are configured; requests can be created.
    Configured = "configured";
    /// The master runs cyclically; the process data exist.
    Active = "active";
}
