//! Identity that a node must have (CiA 302-2, check of the node identity).

use ecan_protocol::sequence::Expectation;

use crate::network::node_action::Step;
use crate::object;

/// Accepted revision numbers of 0x1018:03: major revision in the upper half, minor in the lower.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RevisionCheck {
    /// Every one.
    #[default]
    Any,
    /// Exactly this one.
    Exactly(u32),
    /// The same major revision, and at least the minor one: a compatible node (CiA 301, 7.5.2.18).
    Compatible(u32),
}

/// Identity that a node must have; `None` accepts every value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct IdentityCheck {
    /// Device type 0x1000.
    pub device_type: Option<u32>,
    /// Vendor-ID 0x1018:01.
    pub vendor_id: Option<u32>,
    /// Product code 0x1018:02.
    pub product_code: Option<u32>,
    /// Revision number 0x1018:03.
    pub revision: RevisionCheck,
    /// Serial number 0x1018:04.
    pub serial_number: Option<u32>,
}

impl IdentityCheck {
    /// The steps that read and compare it, in the order of CiA 302-2.
    pub fn steps(&self) -> Vec<Step> {
        let mut steps = Vec::new();
        let mut expect = |index, subindex, name, expected| {
            steps.push(Step::expect_that(index, subindex, expected).named(name));
        };
        let equals = |value: u32| Expectation::Equals(value.into());
        if let Some(value) = self.device_type {
            expect(object::DEVICE_TYPE, 0, "device type", equals(value));
        }
        if let Some(value) = self.vendor_id {
            expect(object::IDENTITY, 1, "vendor-ID", equals(value));
        }
        if let Some(value) = self.product_code {
            expect(object::IDENTITY, 2, "product code", equals(value));
        }
        match self.revision {
            RevisionCheck::Any => {}
            RevisionCheck::Exactly(value) => {
                expect(object::IDENTITY, 3, "revision number", equals(value));
            }
            RevisionCheck::Compatible(least) => {
                let major =
                    Expectation::Masked { value: (least & 0xFFFF_0000).into(), mask: 0xFFFF_0000 };
                expect(object::IDENTITY, 3, "major revision", major);
                let least = Expectation::AtLeast(least.into());
                expect(object::IDENTITY, 3, "revision number", least);
            }
        }
        if let Some(value) = self.serial_number {
            expect(object::IDENTITY, 4, "serial number", equals(value));
        }
        steps
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ecan_protocol::sequence::Action;

    fn accepts(check: IdentityCheck, revision: u32) -> bool {
        check.steps().iter().all(|step| match step.action {
            Action::Expect { expected, .. } => expected.is_met_by(revision.into()),
            _ => false,
        })
    }

    #[test]
    fn compatible_revision_has_the_same_major_and_no_smaller_minor() {
        let revision = RevisionCheck::Compatible(0x0002_0003);
        let check = IdentityCheck { revision, ..IdentityCheck::default() };
        let revisions = [0x0002_0002, 0x0002_0003, 0x0002_FFFF, 0x0003_0003, 0x0001_0009];
        assert_eq!(revisions.map(|it| accepts(check, it)), [false, true, true, false, false]);
        let check = IdentityCheck { revision: RevisionCheck::Exactly(7), ..check };
        assert_eq!([6, 7, 8].map(|it| accepts(check, it)), [false, true, false]);
    }

    #[test]
    fn steps_have_the_order_of_the_standard() {
        let check = IdentityCheck {
            device_type: Some(1),
            vendor_id: Some(2),
            product_code: Some(3),
            revision: RevisionCheck::Exactly(4),
            serial_number: Some(5),
        };
        let texts: Vec<_> = check.steps().iter().map(ToString::to_string).collect();
        let names =
            ["device type", "vendor-ID", "product code", "revision number", "serial number"];
        assert_eq!(texts.len(), names.len());
        for (text, name) in texts.iter().zip(names) {
            assert!(text.starts_with(name), "{text}");
        }
        assert!(IdentityCheck::default().steps().is_empty());
    }
}
