//! Channels of each direction: `channels` of `tx_pdo` and `rx_pdo`.

use ecan_host::StartupStep;
use ecan_lite::config::{parse, parse_axes, startup};
use ecan_protocol::mapping::Direction;

/// A gateway with three channels.
fn three(tx_pdo: &str, rx_pdo: &str) -> String {
    let channels = (0..3).map(|channel| format!("[gateway.can{channel}]\nbitrate = 500_000\n"));
    let head =
        format!("[[gateway]]\nn = 3\n[gateway.tx_pdo]\n{tx_pdo}\n[gateway.rx_pdo]\n{rx_pdo}\n");
    head + &channels.collect::<String>()
}

fn faults(text: &str) -> Vec<(usize, usize, String)> {
    let faults = parse_axes(text.as_bytes()).unwrap_err().0;
    faults.into_iter().map(|fault| (fault.line, fault.column, fault.reason)).collect()
}

#[test]
fn channels_of_a_direction_become_its_mask() {
    let text = three("channels = [\"can2\", \"can0\"]", "channels = [\"can1\", \"can2\"]");
    let config = parse(text.as_bytes()).unwrap();
    let gateway = &config.port.gateways[0];
    let masks = Direction::ALL.map(|direction| gateway.direction_mask(direction));
    assert_eq!((masks, gateway.channel_mask()), ([0b101, 0b110], 0b111));
    let masks: Vec<_> = startup(&config, 0)
        .iter()
        .filter_map(|step| match step {
            StartupStep::Download(write) if write.subindex == 4 => Some((write.index, write.value)),
            _ => None,
        })
        .filter(|(index, _)| matches!(index, 0x8010 | 0x8011))
        .collect();
    assert_eq!(masks, [(0x8010, 0b101), (0x8011, 0b110)]);
    let config = parse(three("", "").as_bytes()).unwrap();
    assert_eq!(config.port.gateways[0].tx_channel_mask, None);
    assert_eq!(config.port.gateways[0].direction_mask(Direction::TxPdo), 0b111);
}

#[test]
fn faults_of_channel_lists_have_a_location() {
    assert_eq!(
        faults(&three("channels = [\"can3\", \"can0\", \"can1\", \"can2\"]", "channels = []")),
        [
            (
                4,
                12,
                "slave 0, TxPDO: channel mask 0x0F has channels that are not enabled; allowed: the \
                 bits of 0x07; enable the channels, or leave them out"
                    .to_owned()
            ),
            (
                6,
                12,
                "slave 0, RxPDO: channel mask 0x00 is invalid; allowed: 0x01 to 0x0f, the channels \
                 0 to 3"
                    .to_owned()
            ),
        ]
    );
    let neither = "slave 0, channel 2: it is enabled, but in neither channel mask (0x8010:04, \
                   0x8011:04); add it to one of them, or do not enable it";
    let lists = ("channels = [\"can0\"]", "channels = [\"can1\"]");
    assert_eq!(faults(&three(lists.0, lists.1)), [(11, 1, neither.to_owned())]);
    let word = faults(&three("channels = [\"can0\", 1]", ""));
    let expected =
        "`channels` = an integer is invalid; allowed: \"can0\", \"can1\", \"can2\", \"can3\"";
    assert_eq!(word, [(4, 21, expected.to_owned())]);
}

#[test]
fn axis_needs_a_channel_of_both_directions() {
    let axis = "[[axis]]\ngateway = 0\nchannel = 1\nnode = 1\n";
    let all = "channels = [\"can0\", \"can1\", \"can2\"]";
    let some = "channels = [\"can0\", \"can2\"]";
    let text = |tx, rx| three(tx, rx) + axis;
    assert_eq!(parse_axes(text(all, all).as_bytes()).unwrap().len(), 1);
    for (text, pdo) in [(text(some, all), "TxPDO"), (text(all, some), "RxPDO")] {
        let expected = format!(
            "axis 0: channel 1 of gateway 0 is not among the `channels` of the {pdo}; an axis needs \
             both directions"
        );
        assert_eq!(faults(&text), [(15, 11, expected)]);
    }
}
