//! Gateways that prevented the start of a test.

use ecan_host::Error;
use ecan_mcan_port::PortError;

/// A gateway that did not start.
#[derive(Debug)]
pub(super) struct StartFailure {
    /// Index in the configuration.
    pub(super) gateway: usize,
    pub(super) reason: String,
    /// The cause may pass, so that another attempt is sensible.
    pub(super) is_temporary: bool,
}

/// Failures in ascending order of the gateways, at least one; all `count` gateways if the error names
/// none.
pub(super) fn start_failures(error: &PortError, count: usize) -> Vec<StartFailure> {
    let named = named_failures(error);
    if !named.is_empty() {
        return named;
    }
    let failure = |gateway| StartFailure { gateway, reason: error.to_string(), is_temporary: true };
    (0..count).map(failure).collect()
}

fn named_failures(error: &PortError) -> Vec<StartFailure> {
    let one = |gateway, is_temporary| {
        vec![StartFailure { gateway, reason: error.to_string(), is_temporary }]
    };
    match error {
        PortError::NotReady { slave, .. } => one(*slave, error.is_temporary()),
        PortError::Adapter(Error::NotOperational(report)) => {
            let failures = report.slaves.iter().map(|slave| StartFailure {
                gateway: slave.slave,
                reason: slave.to_string(),
                is_temporary: slave.cause.as_ref().is_none_or(|cause| cause.is_temporary()),
            });
            failures.collect()
        }
        PortError::Adapter(
            Error::NoSuchSlave { slave, .. }
            | Error::IdentityMismatch { slave, .. }
            | Error::NotAnEcanLite { slave, .. }
            | Error::Unrecognised { slave, .. }
            | Error::Mapping { slave, .. }
            | Error::MappingCount { slave, .. }
            | Error::Layout { slave, .. }
            | Error::NotInPreop { slave, .. }
            | Error::Sdo { slave, .. }
            | Error::Readback { slave, .. },
        ) => one(*slave, error.is_temporary()),
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use ecan_host::NotOperational;

    use super::*;

    #[test]
    fn error_without_gateway_concerns_all() {
        let empty = NotOperational { waited_ms: 1, slaves: Vec::new() };
        let error = PortError::Adapter(Error::NotOperational(Box::new(empty)));
        let gateways: Vec<_> = start_failures(&error, 2).iter().map(|it| it.gateway).collect();
        assert_eq!(gateways, [0, 1]);
    }
}
