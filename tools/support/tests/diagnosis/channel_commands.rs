//! Configurations of a channel that were not applied, saved or loaded (manual 13.4).

use crate::diagnosis::common::{only, with, with_all};

#[test]
fn each_apply_status_has_its_causes() {
    let causes = |status| with(0x8001, 2, status).causes;
    assert_eq!(with(0x8001, 2, 3).id, "apply-failed");
    // The manual says no more than "fail".
    assert!(causes(1)[0].contains("not specified by the gateway"), "{:#?}", causes(1));
    // The configuration could not be converted.
    assert!(causes(3)[0].contains("no bit timing matches"), "{:#?}", causes(3));
    assert!(causes(3)[1].contains("0x8001 is out of range"), "{:#?}", causes(3));
    // The controller was not restarted, or its driver failed.
    assert!(causes(4)[0].contains("did not restart"), "{:#?}", causes(4));
    let what = with(0x8001, 2, 4).what;
    assert!(what.contains("the CAN controller could not be restarted with it"), "{what}");
    assert!(causes(77)[0].contains("not specified by the gateway"), "{:#?}", causes(77));
    // An exceeded Message RAM may be any of them.
    for status in [1, 3, 4] {
        let causes = causes(status);
        assert!(causes.iter().any(|cause| cause.contains("Message RAM")), "{causes:#?}");
        assert_eq!(causes.iter().any(|cause| cause.contains("did not restart")), status == 4);
    }
    assert!(with(0x8001, 2, 3).next.contains("read 0x8001:02 again"));
}

#[test]
fn invalid_values_are_the_first_cause() {
    // 80 MHz and 5 Mbit/s are 16 quanta: 80.0 % is none of their sample points.
    let found = only(|snapshot| {
        for (subindex, value) in [(2, 3), (7, 0), (20, 5_000_000), (23, 800), (24, 800)] {
            snapshot.set(0x8003, subindex, value);
        }
    });
    assert!(found.causes[0].starts_with("data bit timing: "), "{found:#?}");
    assert!(found.causes[0].contains("81.25 %"), "{found:#?}");
    assert!(!found.causes.iter().any(|cause| cause.contains("Message RAM")), "{found:#?}");
    // 64 elements of 72 bytes in RX FIFO0, by either status.
    for status in [3, 4] {
        let found = with_all(&[(0x8002, 2, status), (0x8002, 62, 64)]);
        let first = "Message RAM layout needs 9344 bytes, the channel has 8192";
        assert_eq!(found.causes[0], first, "{found:#?}");
    }
    let found = with_all(&[(0x8004, 2, 3), (0x8004, 65, 9)]);
    assert_eq!(found.causes[0], "invalid value 9 of 0x8004:65");
    // Manual bit timing, read and not read.
    let manual = |timing: &[(u8, u32)]| {
        only(|snapshot| {
            for (subindex, value) in [(2, 3), (7, 1)].iter().chain(timing) {
                snapshot.set(0x8001, *subindex, *value);
            }
        })
    };
    let found = manual(&[(15, 0), (25, 2), (26, 63), (27, 16), (28, 20)]);
    assert!(found.causes[0].starts_with("manual nominal bit timing BRP 2 TSEG1 63"), "{found:#?}");
    assert!(manual(&[]).causes[0].starts_with("no bit timing matches"));
}

#[test]
fn failed_flash_command_has_a_finding() {
    let found = with(0x8004, 4, 1);
    assert_eq!(found.id, "flash-failed");
    assert!(found.causes[0].contains("no saved configuration"), "{found:#?}");
    assert!(found.next.contains("0x8004:03 = 1"), "{found:#?}");
    assert!(with(0x8004, 4, 3).causes[0].contains("another firmware"));
    assert!(with(0x8004, 4, 4).causes[0].contains("did not restart"));
}
