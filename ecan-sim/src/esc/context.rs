use crate::gateway::Gateway;

pub(super) struct Context<'a> {
    pub(super) gateway: &'a mut Gateway,
    pub(super) now: u64,
    /// Time of the frame from the first slave to this one, ns.
    pub(super) delay_ns: u64,
    /// Time until the frame returns from the next slave; `None` without one.
    pub(super) return_ns: Option<u64>,
}
