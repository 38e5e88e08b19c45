//! Recognition of the ECAN-Lite gateways on a bus by 0xF000 (manual 13.8).

use ecan_protocol::device::{AlState, Capabilities, Recognition, assumed_value};
use ecan_protocol::object::AbortCode;
use ecrt_sys::Errno;

use super::diagnostics::Diagnostics;
use crate::config::{AdapterConfig, Identity, SlaveConfig};
use crate::error::Error;

/// Kind of a slave, by its responses. The manual gives no vendor ID and no product code, so that
/// a gateway is recognised by 0xF000 (manual 13.8).
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SlaveKind<E> {
    /// An ECAN-Lite.
    Gateway,
    /// Another device.
    Other,
    /// The slave cannot be queried, and its identity does not exclude an ECAN-Lite.
    Unknown(IdentificationError<E>),
}

/// Cause for which a slave cannot be identified.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum IdentificationError<E> {
    /// In this state a slave answers no SDO.
    #[error("it is in {0}, where a slave answers no SDO")]
    State(AlState),
    /// The master reports an invalid AL state.
    #[error("its AL state is not known")]
    NoState,
    /// The transfer failed.
    #[error("{0}")]
    Silent(E),
}

impl<E> SlaveKind<E> {
    /// Returns whether it is an ECAN-Lite for certain.
    pub fn is_gateway(&self) -> bool {
        matches!(self, Self::Gateway)
    }

    /// Returns whether it is an ECAN-Lite, or cannot be queried.
    pub fn may_be_gateway(&self) -> bool {
        !matches!(self, Self::Other)
    }
}

/// A way to ask the slaves of a bus, which are named by their positions.
pub trait SlaveQuery {
    /// Cause of a missing response.
    type Error;

    /// AL state of a slave; `None` for a value that is no state.
    fn al_state(&self, slave: usize) -> Result<Option<AlState>, Self::Error>;

    /// Identity in the slave's SII.
    fn identity(&self, slave: usize) -> Result<Identity, Self::Error>;

    /// A number of 0xF000.
    fn upload(&self, slave: usize, subindex: u8) -> Result<u32, Self::Error>;

    /// Returns whether the error is the slave's abort for an entry that its 0xF000 does not have.
    fn is_denial(&self, error: &Self::Error) -> bool;
}

/// Queries the kind of these slaves, in their order. A slave that cannot be queried counts as another
/// device only where some of the others are gateways, and it has none of their identities.
pub fn slave_kinds<I: SlaveQuery>(inquiry: &I, slaves: &[usize]) -> Vec<SlaveKind<I::Error>> {
    let mut kinds: Vec<_> = slaves.iter().map(|slave| ask(inquiry, *slave)).collect();
    let is_unknown = |kind: &SlaveKind<_>| matches!(kind, SlaveKind::Unknown(_));
    if !kinds.iter().any(is_unknown) {
        return kinds;
    }
    let of_gateways: Vec<_> = slaves
        .iter()
        .zip(&kinds)
        .filter(|(_, kind)| kind.is_gateway())
        .filter_map(|(slave, _)| inquiry.identity(*slave).ok())
        .collect();
    // Of a slave whose SII could not be read the master has zeros.
    let is_known = |identity: &Identity| (identity.vendor_id, identity.product_code) != (0, 0);
    for (slave, kind) in slaves.iter().zip(&mut kinds).filter(|(_, kind)| is_unknown(kind)) {
        let own = inquiry.identity(*slave).ok().filter(is_known);
        if own.is_some_and(|own| !of_gateways.is_empty() && !of_gateways.contains(&own)) {
            *kind = SlaveKind::Other;
        }
    }
    kinds
}

fn ask<I: SlaveQuery>(inquiry: &I, slave: usize) -> SlaveKind<I::Error> {
    match inquiry.al_state(slave) {
        Err(error) => return SlaveKind::Unknown(IdentificationError::Silent(error)),
        Ok(None) => return SlaveKind::Unknown(IdentificationError::NoState),
        Ok(Some(state)) if !state.has_mailbox() || state == AlState::Boot => {
            return SlaveKind::Unknown(IdentificationError::State(state));
        }
        Ok(Some(_)) => {}
    }
    let upload = |subindex| match inquiry.upload(slave, subindex) {
        Err(error) if inquiry.is_denial(&error) => {
            assumed_value(Capabilities::INDEX, subindex).ok_or(error)
        }
        value => value,
    };
    match Recognition::read(upload) {
        Ok(found) if found.looks_like_ecan_lite() => SlaveKind::Gateway,
        Ok(_) => SlaveKind::Other,
        Err(error) if inquiry.is_denial(&error) => SlaveKind::Other,
        Err(error) => SlaveKind::Unknown(IdentificationError::Silent(error)),
    }
}

/// Returns true if a device that rejects an upload with this code does not have the object in the form that
/// was asked for; other codes tell of its state, or of a fault.
pub const fn denies_object(code: AbortCode) -> bool {
    matches!(
        code,
        AbortCode::UNSUPPORTED_ACCESS
            | AbortCode::WRITE_ONLY
            | AbortCode::NO_OBJECT
            | AbortCode::NO_SUBINDEX
    )
}

impl SlaveQuery for Diagnostics {
    type Error = Error;

    fn al_state(&self, slave: usize) -> Result<Option<AlState>, Error> {
        Diagnostics::al_state(self, slave)
    }

    fn identity(&self, slave: usize) -> Result<Identity, Error> {
        let info = self.slave_info(slave)?;
        Ok(Identity { vendor_id: info.vendor_id, product_code: info.product_code })
    }

    fn upload(&self, slave: usize, subindex: u8) -> Result<u32, Error> {
        self.sdo_upload_u32(slave, Capabilities::INDEX, subindex)
    }

    fn is_denial(&self, error: &Error) -> bool {
        match error {
            Error::Sdo { abort_code: Some(code), .. } => denies_object(*code),
            // By its SII it has no CoE; or it has a longer object there.
            Error::Sdo { errno, .. } => {
                matches!(*errno, Errno::EPROTONOSUPPORT | Errno::EOVERFLOW)
            }
            _ => false,
        }
    }
}

impl Diagnostics {
    /// The kind of each slave of this handle. Queries all of them: a slave that does not answer
    /// takes as long as the master waits for a mailbox.
    pub fn slave_kinds(&self) -> Vec<SlaveKind<Error>> {
        slave_kinds(self, &(0..self.slave_count()).collect::<Vec<_>>())
    }
}

/// Verifies that every configured slave is on the bus, at a position of its own, in PREOP.
pub(crate) fn look_for_slaves(
    diagnostics: &Diagnostics,
    config: &AdapterConfig,
) -> Result<(), Error> {
    let mut positions = Vec::with_capacity(config.slaves.len());
    for slave in 0..config.slaves.len() {
        let position = diagnostics.ring_position(slave)?;
        if let Some(other) = positions.iter().position(|p| *p == position) {
            return Err(Error::SameSlave { first: other, second: slave, position });
        }
        positions.push(position);
        let found = diagnostics.slave_info(slave)?;
        if AlState::from_status(found.al_state.into()) != Some(AlState::PreOp) {
            return Err(Error::NotInPreop {
                slave,
                al_state: found.al_state,
                error_flag: found.error_flag,
                timeout: config.preop_timeout,
            });
        }
    }
    Ok(())
}

/// Values that are read of a gateway before it is configured.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Identified {
    pub(crate) identity: Identity,
    pub(crate) capabilities: CapabilityValues,
}

/// Verifies that a slave is an ECAN-Lite of the configured identity, and reads its 0xF000.
pub(crate) fn identify(
    diagnostics: &Diagnostics,
    slave: usize,
    settings: &SlaveConfig,
) -> Result<Identified, Error> {
    let info = diagnostics.slave_info(slave)?;
    let found = Identity { vendor_id: info.vendor_id, product_code: info.product_code };
    if let Some(expected) = settings.identity.filter(|expected| *expected != found) {
        return Err(Error::IdentityMismatch { slave, expected, found });
    }
    let mut capabilities = CapabilityValues::default();
    match Recognition::read(|subindex| capabilities.read(diagnostics, slave, subindex)) {
        Ok(found) if found.looks_like_ecan_lite() => {}
        Ok(found) => return Err(Error::NotAnEcanLite { slave, found }),
        Err(cause) => return Err(Error::Unrecognised { slave, cause: Box::new(cause) }),
    }
    capabilities.read_all(diagnostics, slave)?;
    for half in CapabilityValues::SERIAL {
        capabilities.read(diagnostics, slave, half)?;
    }
    Ok(Identified { identity: found, capabilities })
}

/// Subindices of 0xF000, the unused ones included.
const ENTRIES: usize = 31;

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum CapabilityValue {
    #[default]
    NotRead,
    Reported(u32),
    /// The gateway does not have the entry; the value is assumed.
    Assumed(u32),
}

#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct CapabilityValues([CapabilityValue; ENTRIES]);

impl CapabilityValues {
    /// Subindices of the serial number, low half first.
    pub(crate) const SERIAL: [u8; 2] = [7, 8];

    fn value(&self, subindex: u8) -> CapabilityValue {
        self.0.get(usize::from(subindex)).copied().unwrap_or_default()
    }

    /// The value of a subindex, uploaded unless it is known; the assumed value if the gateway does not
    /// have it.
    pub(crate) fn read(
        &mut self,
        diagnostics: &Diagnostics,
        slave: usize,
        subindex: u8,
    ) -> Result<u32, Error> {
        if let CapabilityValue::Reported(value) | CapabilityValue::Assumed(value) =
            self.value(subindex)
        {
            return Ok(value);
        }
        let uploaded = diagnostics.sdo_upload_u32(slave, Capabilities::INDEX, subindex);
        let is_reported = uploaded.is_ok();
        let value = Error::or_assumed(uploaded, Capabilities::INDEX, subindex)?;
        if let Some(entry) = self.0.get_mut(usize::from(subindex)) {
            *entry = match is_reported {
                true => CapabilityValue::Reported(value),
                false => CapabilityValue::Assumed(value),
            };
        }
        Ok(value)
    }

    /// Reads the fields of [`Capabilities`]. One that the gateway rejects stays unknown: its error
    /// is for the code that needs it.
    pub(crate) fn read_all(
        &mut self,
        diagnostics: &Diagnostics,
        slave: usize,
    ) -> Result<(), Error> {
        for subindex in Capabilities::fields() {
            let read = self.read(diagnostics, slave, *subindex);
            if let Err(error @ Error::Sdo { abort_code: None, .. }) = read {
                return Err(error);
            }
        }
        Ok(())
    }

    /// Returns whether the entry was read and the gateway has it.
    pub(crate) fn is_reported(&self, subindex: u8) -> bool {
        matches!(self.value(subindex), CapabilityValue::Reported(_))
    }

    /// The two halves of the serial number, which the identification has read; 0 if it is not reported.
    pub(crate) fn serial(&self) -> [u32; 2] {
        Self::SERIAL.map(|half| match self.value(half) {
            CapabilityValue::Reported(value) => value,
            _ => 0,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    enum PrivilegeError {
        NoObject,
        Silence,
    }

    #[derive(Clone, Copy)]
    struct Slave {
        state: Option<AlState>,
        product_code: u32,
        answer: Result<[u32; 3], PrivilegeError>,
    }

    struct Bus(Vec<Slave>);

    impl SlaveQuery for Bus {
        type Error = PrivilegeError;

        fn al_state(&self, slave: usize) -> Result<Option<AlState>, PrivilegeError> {
            Ok(self.0[slave].state)
        }

        fn identity(&self, slave: usize) -> Result<Identity, PrivilegeError> {
            match self.0[slave].product_code {
                0 => Ok(Identity { vendor_id: 0, product_code: 0 }),
                product_code => Ok(Identity { vendor_id: 1, product_code }),
            }
        }

        fn upload(&self, slave: usize, subindex: u8) -> Result<u32, PrivilegeError> {
            let at = Recognition::SUBINDICES.iter().position(|known| *known == subindex).unwrap();
            self.0[slave].answer.map(|values| values[at])
        }

        fn is_denial(&self, error: &PrivilegeError) -> bool {
            *error == PrivilegeError::NoObject
        }
    }

    const OURS: Slave =
        Slave { state: Some(AlState::PreOp), product_code: 7, answer: Ok([2, 128, 24]) };

    fn kinds(slaves: &[Slave]) -> Vec<SlaveKind<PrivilegeError>> {
        slave_kinds(&Bus(slaves.to_vec()), &(0..slaves.len()).collect::<Vec<_>>())
    }

    const SILENT: SlaveKind<PrivilegeError> =
        SlaveKind::Unknown(IdentificationError::Silent(PrivilegeError::Silence));

    #[test]
    fn slave_is_recognised_by_its_responses() {
        let other = Slave { answer: Ok([2, 8, 24]), ..OURS };
        let without = Slave { answer: Err(PrivilegeError::NoObject), ..OURS };
        assert_eq!(
            kinds(&[OURS, other, without]),
            [SlaveKind::Gateway, SlaveKind::Other, SlaveKind::Other]
        );
    }

    #[test]
    fn slave_without_response_is_unknown() {
        let silent = Slave { answer: Err(PrivilegeError::Silence), ..OURS };
        let of = |state| Slave { state, ..OURS };
        let found = kinds(&[silent, of(Some(AlState::Init)), of(Some(AlState::Boot)), of(None)]);
        let state = |state| SlaveKind::Unknown(IdentificationError::State(state));
        let expected = [
            SILENT,
            state(AlState::Init),
            state(AlState::Boot),
            SlaveKind::Unknown(IdentificationError::NoState),
        ];
        assert_eq!(found, expected);
        assert!(found.iter().all(|kind| kind.may_be_gateway() && !kind.is_gateway()));
    }

    #[test]
    fn identity_excludes_a_silent_slave_only_beside_known_gateways() {
        let silent =
            |product_code| Slave { answer: Err(PrivilegeError::Silence), product_code, ..OURS };
        assert_eq!(kinds(&[silent(8), OURS]), [SlaveKind::Other, SlaveKind::Gateway]);
        assert_eq!(kinds(&[silent(7), OURS]), [SILENT, SlaveKind::Gateway]);
        // The master could not read its SII.
        assert_eq!(kinds(&[silent(0), OURS]), [SILENT, SlaveKind::Gateway]);
        assert_eq!(kinds(&[silent(8)]), [SILENT]);
    }
}
