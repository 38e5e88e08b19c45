//! Filters through the editing window (manual 13.4).

use crate::common::{all_sent, in_table};
use ecan_protocol::config::{
    ExtendedFilter, ExtendedMatch, FilterAction, FilterFault, McanChannelConfig, StandardFilter,
    StandardMatch, check_filters, filter_writes,
};

const FILTER_A: StandardFilter = StandardFilter {
    matching: StandardMatch::Range,
    action: FilterAction::Fifo1,
    sync: false,
    id1: 0x180,
    id2: 0x1FF,
};

const FILTER_B: StandardFilter = StandardFilter {
    matching: StandardMatch::Two,
    action: FilterAction::RxBuffer(3),
    sync: true,
    id1: 0x80,
    id2: 0x7FF,
};

const FILTER_X: ExtendedFilter = ExtendedFilter {
    matching: ExtendedMatch::Masked,
    action: FilterAction::Reject,
    sync: false,
    id1: 0x1234_5678,
    id2: 0x1FFF_0000,
};

#[test]
fn filters_are_written_through_the_window() {
    let writes: Vec<_> = filter_writes(1, &[FILTER_A, FILTER_B], &[FILTER_X]).collect();
    assert_eq!(
        all_sent(&writes),
        [
            (0x8002, 49, 1, 2),
            (0x8002, 43, 1, 0),
            (0x8002, 50, 1, 0),
            (0x8002, 51, 1, 2),
            (0x8002, 52, 1, 0),
            (0x8002, 53, 4, 0x180),
            (0x8002, 54, 4, 0x1FF),
            (0x8002, 45, 1, 2),
            (0x8002, 43, 1, 1),
            (0x8002, 50, 1, 1),
            (0x8002, 51, 1, 7),
            (0x8002, 52, 1, 1),
            (0x8002, 53, 4, 0x80),
            (0x8002, 54, 4, 3),
            (0x8002, 45, 1, 2),
            (0x8002, 55, 1, 1),
            (0x8002, 44, 1, 0),
            (0x8002, 56, 1, 2),
            (0x8002, 57, 1, 3),
            (0x8002, 58, 1, 0),
            (0x8002, 59, 4, 0x1234_5678),
            (0x8002, 60, 4, 0x1FFF_0000),
            (0x8002, 46, 1, 2),
        ]
    );
    in_table(&writes);
    let none: Vec<_> = filter_writes(0, &[], &[]).collect();
    assert_eq!(all_sent(&none), [(0x8001, 49, 1, 0), (0x8001, 55, 1, 0)]);
    // Longer lists than those of the device end at its last element.
    let many: Vec<_> = filter_writes(0, &[FILTER_A; 70], &[FILTER_X; 30]).collect();
    assert_eq!(many.len(), 1 + 64 * 7 + 1 + 24 * 7);
    in_table(&many);
}

#[test]
fn filter_faults_name_their_index() {
    let mut config = McanChannelConfig::default();
    let mut found = Vec::new();
    let mut collect = |fault: FilterFault| found.push(fault.to_string());
    check_filters(&config, &[FILTER_A, FILTER_B], &[FILTER_X], &mut collect);
    config.ram.rx_buffer_count = 3;
    config.ram.rx_fifo1.size = 0;
    let reversed = StandardFilter { id1: 2, id2: 1, action: FilterAction::Fifo0, ..FILTER_A };
    let wide = ExtendedFilter { id1: 0x2000_0000, ..FILTER_X };
    check_filters(&config, &[FILTER_A, FILTER_B, reversed], &[wide; 25], &mut collect);
    assert_eq!(
        found[..5],
        [
            "standard filter 0: RX FIFO1 has no elements",
            "standard filter 1: RX buffer 3 does not exist; the layout has 3",
            "standard filter 2: range 0x2..0x1 is empty",
            "25 extended filters; allowed: at most 24",
            "extended filter 0: CAN ID 0x20000000 is out of range; allowed: 0 to 0x1FFFFFFF",
        ]
    );
    assert_eq!(found.len(), 4 + 25);
}
