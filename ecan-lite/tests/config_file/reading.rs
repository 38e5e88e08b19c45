//! Reading of files, and the locations of their faults.

use std::time::Duration;

use ecan_host::{ClockSource, DcSync, Expectation, StartupStep};
use ecan_lite::config::{
    ConfigFileError, EXAMPLE, FileFaults, ServiceSettings, load, load_service, parse,
};
use ecan_mcan_port::Config;
use ecan_protocol::config::{
    DataPathConfig, ExtendedMatch, FilterAction, MessageRamLayout, NodeMode,
};
use ecan_protocol::image::{EncapsulationProfile, OptionFlags};

fn read(text: &str) -> Result<Config, FileFaults> {
    parse(text.as_bytes())
}

#[test]
fn example_is_valid_and_shows_the_defaults() {
    let example = read(EXAMPLE).unwrap();
    let short = "
        cycle_us = 1000
        dc = { shift_us = 500, reference = 0 }
        [[gateway]]
        n = 8
        data_path = { compat_mode = 3 }
        system = { pin_rotation = 0 }
        diagnostic_test = {}
        tx_pdo = { channels = [\"can0\", \"can1\"] }
        rx_pdo = { channels = [\"can1\", \"can0\"] }
        can1 = { bitrate = 500_000 }
        [gateway.can0]
        bitrate = 1_000_000
        data_bitrate = 5_000_000
        sample_point = 87.5
        data_sample_point = 87.5
        [[gateway.can0.standard_filter]]
        match = \"range\"
        action = \"fifo0\"
        id1 = 0x180
        id2 = 0x5FF
        [[gateway.can0.standard_filter]]
        action = \"rx_buffer\"
        rx_buffer = 0
        id1 = 0x80
        [[gateway.can0.extended_filter]]
        match = \"masked\"
        action = \"fifo1\"
        id1 = 0x18FF_0000
        id2 = 0x1FFF_0000
    ";
    assert_eq!(read(short).unwrap(), example);
    assert_eq!(
        example.adapter.dc,
        Some(DcSync {
            reference: Some(0),
            ..DcSync::new(Duration::from_millis(1), Duration::from_micros(500))
        })
    );
    assert_eq!(example.port.gateways[0].channel_mask(), 0b11);
}

#[test]
fn n_has_a_default_by_the_kinds_of_can() {
    let sizes = |keys: &str| {
        let file = read(&format!("[[gateway]]\n{keys}\ncan0 = {{ bitrate = 500_000 }}\n")).unwrap();
        assert_eq!(file.adapter.cycle, Duration::from_millis(10));
        (file.adapter.slaves[0].rx_multiplier, file.adapter.slaves[0].tx_multiplier)
    };
    let fd = "can3 = { bitrate = 500_000, data_bitrate = 2_000_000 }";
    assert_eq!((sizes(""), sizes(fd)), ((3, 3), (8, 8)));
    assert_eq!(sizes("rx_pdo = { n = 2 }"), (2, 3));
    assert_eq!(
        sizes(&format!("rx_pdo = {{ budget = \"balanced\" }}\ntx_pdo = {{ n = 4 }}\n{fd}")),
        (8, 4)
    );
    assert_eq!(sizes(&format!("n = 3\ntx_pdo = {{ n = 4 }}\n{fd}")), (3, 4));
}

/// Every key of every table is in the example: the fault of an unknown key lists the known ones.
#[test]
fn example_has_every_key() {
    let tables = [
        ("", "nonsense = 1"),
        ("", "[dc]\nnonsense = 1"),
        ("", "[service]\nnonsense = 1"),
        ("", "[network]\nnonsense = 1"),
        ("[[gateway]]\n", "nonsense = 1"),
        ("[[gateway]]\n", "identity = { nonsense = 1 }"),
        ("[[gateway]]\n", "tx_pdo = { nonsense = 1 }"),
        ("[[gateway]]\n", "schedule = { nonsense = 1 }"),
        ("[[gateway]]\n", "data_path = { nonsense = 1 }"),
        ("[[gateway]]\n", "system = { nonsense = 1 }"),
        ("[[gateway]]\n", "diagnostic_test = { nonsense = 1 }"),
        ("[[gateway]]\n", "maintenance = { nonsense = 1 }"),
        ("[[gateway]]\n", "startup_sdo = [{ nonsense = 1 }]"),
        ("[[gateway]]\n", "can0 = { nonsense = 1 }"),
        ("[[gateway]]\n", "can0 = { ram = { nonsense = 1 } }"),
        ("[[gateway]]\n", "can0 = { data_path = { nonsense = 1 } }"),
        ("[[gateway]]\n", "can0 = { nominal_timing = { nonsense = 1 } }"),
        ("[[gateway]]\n", "can0 = { traffic = { nonsense = 1 } }"),
        ("[[gateway]]\n", "can0 = { standard_filter = [{ nonsense = 1 }] }"),
        ("[[axis]]\n", "nonsense = 1"),
        ("[[axis]]\n", "vl = { nonsense = 1 }"),
        ("[[axis]]\n", "feed_forward = { nonsense = 1 }"),
        ("[[node]]\n", "nonsense = 1"),
        ("[[node]]\n", "tpdo = [{ nonsense = 1 }]"),
        ("[[bus]]\n", "nonsense = 1"),
        (
            "[[gateway]]\n",
            "can0 = { extended_filter = [{ action = \"rx_buffer\", nonsense = 1 }] }",
        ),
    ];
    for (head, table) in tables {
        let faults = read(&format!("{head}{table}")).unwrap_err();
        let text = faults.to_string();
        let known = text.split("unknown key `nonsense`; known keys: ").nth(1).expect(&text);
        for key in known.lines().next().unwrap().split(", ") {
            let is_there = EXAMPLE.contains(&format!("{key} = "))
                || EXAMPLE.contains(&format!("[gateway.{key}]"))
                || EXAMPLE.contains(&format!("[[gateway.{key}]]"))
                || EXAMPLE.contains(&format!("[gateway.can0.{key}]"))
                || EXAMPLE.contains(&format!("[[gateway.can0.{key}]]"))
                || EXAMPLE.contains(&format!("[node.{key}]"))
                || ["dc", "service", "network", "gateway", "axis", "node", "bus", "can2", "can3"]
                    .contains(&key);
            assert!(is_there, "{key} of {table}");
        }
    }
}

/// By the plan of the gateways and the cycle, which may follow in the file.
#[test]
fn shift_of_sync0_is_planned_by_default() {
    let gateway = "[[gateway]]\nn = 3\ncan0 = { bitrate = 500_000 }\n";
    let file = read(&format!("[dc]\nsource = \"reference\"\n{gateway}{gateway}")).unwrap();
    let dc = DcSync::planned(file.adapter.cycle, &file.adapter);
    assert_eq!(file.adapter.dc, Some(DcSync { source: ClockSource::Reference, ..dc }));
    assert!(!dc.shift.is_zero());
}

#[test]
fn planned_shift_uses_the_times_of_the_gateways() {
    let shift = |schedule: &str| {
        let gateway = "[dc]\n[[gateway]]\nn = 3\ncan0 = { bitrate = 500_000 }\n";
        let text = format!("cycle_us = 1000\n{gateway}[gateway.schedule]\n{schedule}");
        read(&text).unwrap().adapter.dc.unwrap().shift
    };
    let later = shift("latest_send_us = 185\nprocessing_us = 90");
    assert_eq!(later, shift("") + Duration::from_micros(90), "half of the difference");
}

#[test]
fn values_reach_their_fields() {
    let file = read(
        r#"
        master = 1
        cycle_us = 250.5
        allow_large_pdos = true
        preop_timeout_ms = 500
        watchdog_us = 20_000
        [dc]
        cycle_us = 501
        shift_us = 100
        source = "reference"
        reference = 1
        monitor_every = 0
        [[gateway]]
        alias = 7
        rx_pdo = { n = 2, profile = 4, budget = "deterministic" }
        tx_pdo = { n = 3, profile = 5, options = ["tx_result", "align4"] }
        paced = false
        hold_limit = 3
        input_limit = 0
        schedule = { latest_send_us = 20, margin_check = "reject" }
        [gateway.can3]
        bitrate = 250_000
        sample_point = [80, 87.5]
        node_mode = "listen"
        non_match_extended = "reject"
        ram = { layout = "fd", rx_fifo0_size = 10, rx_fifo1_data_bytes = 12 }
        data_path = { rx_drain_max = 5, rx_cache_depth = 24, bus_off_recovery = "manual" }
        [[gateway.can3.extended_filter]]
        match = "range_unmasked"
        action = "priority_fifo1"
        id1 = 1
        id2 = 0x1FFF_FFFF
        sync = true
        [[gateway]]
        n = 1
        identity = { vendor_id = 1, product_code = 2 }
        can0 = { bitrate = 500_000, bit_timing = "manual", nominal_timing = { brp = 2, tseg1 = 63, tseg2 = 16, sjw = 16 } }
        "#,
    )
    .unwrap();
    let adapter = &file.adapter;
    assert_eq!((adapter.master_index, adapter.cycle_ns()), (1, 250_500));
    assert_eq!(
        (adapter.allow_large_pdos, adapter.preop_timeout),
        (true, Duration::from_millis(500))
    );
    assert_eq!(adapter.watchdog, Duration::from_millis(20));
    let dc = adapter.dc.unwrap();
    assert_eq!(
        (dc.cycle_ns(), dc.shift_ns(), dc.source),
        (501_000, 100_000, ClockSource::Reference)
    );
    assert_eq!((dc.reference, dc.monitor_every), (Some(1), 0));
    let [first, second] = &adapter.slaves[..] else { panic!("two") };
    assert_eq!(
        (first.alias, first.position, first.rx_multiplier, first.tx_multiplier),
        (7, 0, 2, 3)
    );
    assert_eq!((second.alias, second.position, second.identity.unwrap().product_code), (0, 1, 2));
    let gateway = &file.port.gateways[0];
    assert_eq!(gateway.rx_encapsulation, EncapsulationProfile::Window64);
    assert_eq!(gateway.tx_options, OptionFlags::TX_RESULT.with(OptionFlags::ALIGN4));
    assert_eq!((gateway.paced, gateway.hold_limit, gateway.input_limit), (false, 3, 0));
    assert_eq!(gateway.schedule.latest_send_ns, 20_000);
    let channel = gateway.channels[3].as_ref().unwrap();
    assert_eq!((channel.can.fd, channel.can.node_mode), (false, NodeMode::Listen));
    assert_eq!(
        (channel.can.nominal_sample_point.min, channel.can.nominal_sample_point.max),
        (800, 875)
    );
    assert_eq!(channel.can.ram.rx_fifo0.size, 10);
    assert_eq!(channel.can.ram.tx_data_size, MessageRamLayout::fd().tx_data_size);
    assert_eq!(channel.data_path.rx_drain_max, 5);
    assert_eq!(channel.data_path.tx_budget_max, DataPathConfig::for_traffic(8, 8).tx_budget_max);
    let filter = file.port.extended_filters(0, 3)[0];
    assert_eq!(
        (filter.matching, filter.action),
        (ExtendedMatch::RangeUnmasked, FilterAction::PriorityFifo1)
    );
    assert!(filter.sync);
    assert_eq!(file.port.gateways[1].channels[0].as_ref().unwrap().can.manual_nominal.tseg1, 63);
}

#[test]
fn all_faults_are_reported_with_lines() {
    let text = r#"cycle_us = "fast"
dc = { cycle_us = 10_000, shift_us = 20_000 }

[[gateway]]
n = 25
tx_pdo = { profile = 3 }
rx_pdo = { options = ["tx_result"] }
[gateway.can0]
bitrat = 500_000
sample_point = 101
[gateway.can1]
bitrate = 1_000_000
data_bitrate = 500_000
node_mode = "quiet"
[[gateway.can1.standard_filter]]
match = "range"
action = "fifo0"
id1 = 0x300
id2 = 0x200
[[gateway]]
n = 8
position = 0
can2 = { bitrate = 500_000, data_bitrate = 2_000_000, ram = { rx_fifo0_size = 64 } }
"#;
    let faults = read(text).unwrap_err().0;
    let found: Vec<_> =
        faults.iter().map(|fault| (fault.line, fault.column, fault.reason.as_str())).collect();
    let expected = [
        (1, 12, "`cycle_us` must be a number, not a string"),
        (2, 38, "Sync0 shift of 20000 us is not below its period of 10000 us"),
        (5, 5, "`n` = 25 is out of range; allowed: 1 to 24"),
        (6, 22, "`profile` = 3 is invalid; allowed: 0, 1, 4, 5"),
        (7, 22, "slave 0, RxPDO: option TX_RESULT has no meaning in RxPDO; set it for TxPDO"),
        (8, 1, "`bitrate` is missing: the nominal bit rate in bit/s"),
        (9, 1, "unknown key `bitrat`; did you mean `bitrate`?"),
        (10, 16, "`sample_point` = 101 is out of range; allowed: 0 to 100"),
        (
            13,
            16,
            "slave 0, channel 1: data bit rate 500000 bit/s is below the nominal 1000000 bit/s",
        ),
        (
            14,
            13,
            "`node_mode` = \"quiet\" is invalid; allowed: \"normal\", \"listen\", \"internal_loopback\", \"external_loopback\"",
        ),
        (19, 7, "slave 0, channel 1: standard filter 0: range 0x300..0x200 is empty"),
        (22, 12, "slaves 0 and 1 are the same: alias 0, position 0"),
        (23, 61, "slave 1, channel 2: Message RAM layout needs 9344 bytes, the channel has 8192"),
    ];
    assert_eq!(found, expected, "{found:#?}");
}

#[test]
fn keys_without_effect_are_faults() {
    // Other keys of the channel, the key, and why it has no effect; `None` if it has one.
    let manual =
        "bit_timing = \"manual\", nominal_timing = { brp = 2, tseg1 = 63, tseg2 = 16, sjw = 16 }";
    let (classic, fd) = ("", "data_bitrate = 2_000_000");
    let timing = "{ brp = 9, tseg1 = 1, tseg2 = 1, sjw = 1 }";
    let is_classic = Some("without `data_bitrate` the channel is classic CAN");
    let is_automatic = Some("it needs `bit_timing = \"manual\"`");
    let cases = [
        (classic, "nominal_timing", timing, is_automatic),
        (fd, "data_timing", timing, is_automatic),
        (classic, "data_timing", timing, is_classic),
        (manual, "sample_point", "80", Some("`bit_timing` is manual")),
        (classic, "data_sample_point", "80", is_classic),
        (classic, "tdc_offset", "5", is_classic),
        (classic, "tdc", "true", is_classic),
        (classic, "non_iso", "true", is_classic),
        ("data_bitrate = 2_000_000, tdc = false", "tdc_filter", "5", Some("`tdc` is off at this")),
        ("data_bitrate = 5_000_000", "tdc", "false", Some("from 5 Mbit/s on delay compensation")),
        (classic, "tsu_prescaler", "2", Some("`tsu` is off")),
        (classic, "timeout_period", "9", Some("`timeout` is off")),
        (fd, "data_sample_point", "80", None),
        (fd, "tdc", "false", None),
        (fd, "tdc_offset", "5", None),
        (classic, "tdc", "false", None),
        (classic, "sample_point", "80", None),
        ("tsu = true", "tsu_prescaler", "2", None),
        ("timeout = true", "timeout_period", "9", None),
        // If the key that decides is wrong, its fault is the only one.
        (
            "bit_timing = \"hand\"",
            "nominal_timing",
            "{ brp = 2, tseg1 = 3, tseg2 = 4, sjw = 4 }",
            None,
        ),
    ];
    for (others, key, value, why) in cases {
        let comma = if others.is_empty() { "" } else { ", " };
        let head =
            format!("[[gateway]]\nn = 3\ncan0 = {{ bitrate = 500_000{comma}{others}, {key} = ");
        let faults = match read(&format!("{head}{value} }}\n")) {
            Ok(_) => Vec::new(),
            Err(faults) => faults.0,
        };
        let reported: Vec<_> = faults
            .iter()
            .filter(|fault| fault.reason.starts_with(&format!("`{key}` has no effect: ")))
            .collect();
        match why {
            None => assert!(reported.is_empty(), "{others} {key}: {faults:?}"),
            Some(why) => {
                let [fault] = reported[..] else { panic!("{others} {key}: {faults:?}") };
                assert!(fault.reason.contains(why), "{fault}");
                let column = head.lines().last().unwrap().chars().count() + 1;
                assert_eq!((fault.line, fault.column), (3, column), "{fault}");
                assert_eq!(faults.len(), 1, "{faults:?}");
            }
        }
    }
}

#[test]
fn receive_buffer_filter_matches_one_can_id() {
    let head = "[[gateway]]\nn = 3\n[gateway.can0]\nbitrate = 500_000\n";
    for (table, matching) in [("standard_filter", "range"), ("extended_filter", "range_unmasked")] {
        let filter = format!(
            "{head}[[gateway.can0.{table}]]\naction = \"rx_buffer\"\nrx_buffer = 3\nid1 = 0x80\n"
        );
        let both = format!("{filter}match = \"{matching}\"\nid2 = 0x90\n");
        let faults = read(&both).unwrap_err().0;
        let found: Vec<_> =
            faults.iter().map(|fault| (fault.line, fault.reason.as_str())).collect();
        let why = "has no effect: a filter into a receive buffer matches the one CAN ID `id1`";
        assert_eq!(found, [(9, &*format!("`match` {why}")), (10, &*format!("`id2` {why}"))]);

        let file = read(&filter).unwrap();
        let steps = ecan_lite::config::startup(&file, 0);
        let values = |subindex| {
            let written = steps.iter().filter_map(|step| match step {
                StartupStep::Download(step)
                    if (step.index, step.subindex) == (0x8001, subindex) =>
                {
                    Some(step.value)
                }
                _ => None,
            });
            written.collect::<Vec<_>>()
        };
        // Type, action, sync, both CAN IDs: "two", not "disabled" or a range.
        let first = if table == "standard_filter" { 50 } else { 56 };
        let fields: Vec<_> = (first..first + 5).map(values).collect();
        assert_eq!(fields, [[1], [7], [0], [0x80], [3]]);
    }
}

#[test]
fn checks_that_every_value_passes_are_omitted() {
    let options = |options: &str| {
        let text = format!(
            "[[gateway]]\nn = 3\ncan0 = {{ bitrate = 500_000 }}\ntx_pdo = {{ options = [{options}] }}\n"
        );
        let steps = ecan_lite::config::startup(&read(&text).unwrap(), 0);
        let of_options = steps.iter().filter_map(|step| match *step {
            StartupStep::Expect { index: 0xF000, subindex: 15, expected } => Some(expected),
            _ => None,
        });
        of_options.collect::<Vec<_>>()
    };
    assert_eq!(options(""), []);
    assert_eq!(options("\"tx_result\""), [Expectation::HasBits(1)]);
}

#[test]
fn syntax_faults_do_not_hide_others() {
    let faults = read("cycle_us = \nmaster = \"x\"\n[[gateway]\nn = 3\n").unwrap_err().0;
    let lines: Vec<_> = faults.iter().map(|fault| fault.line).collect();
    assert_eq!(lines[..2], [1, 2], "{faults:?}");
    assert!(lines.contains(&3), "{faults:?}");
    assert!(read("").unwrap_err().to_string().contains("no slave is configured"));
}

#[test]
fn invalid_utf8_has_a_location_and_hides_nothing() {
    // A comment in Latin-1, and a fault after it.
    let text = b"cycle_us = 1000 # \xB5s\n[[gateway]]\nn = 25\ncan0 = { bitrate = 500_000 }\n";
    let faults = parse(text).unwrap_err().0;
    let found: Vec<_> =
        faults.iter().map(|fault| (fault.line, fault.column, fault.reason.as_str())).collect();
    assert_eq!(
        found,
        [(1, 19, "byte 0xB5 is not UTF-8"), (3, 5, "`n` = 25 is out of range; allowed: 1 to 24")],
        "{found:?}"
    );
    assert!(parse(b"\xFF\xFE").is_err());
    assert_eq!(parse(EXAMPLE.as_bytes()).unwrap(), read(EXAMPLE).unwrap());
}

#[test]
fn service_settings_are_read() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("cell.toml");
    let load = |service: &str| {
        let text = format!("{service}[[gateway]]\nn = 3\ncan0 = {{ bitrate = 500_000 }}\n");
        std::fs::write(&path, text).unwrap();
        load_service(&path)
    };
    assert_eq!(load("").unwrap(), ServiceSettings::default());
    let settings = load("[service]\ncontrol_group = \"ecan\"\nmax_clients = 7\n").unwrap();
    assert_eq!(settings.control_group.as_deref(), Some("ecan"));
    assert_eq!((settings.read_only, settings.max_clients), (None, Some(7)));
    let error = load("[service]\nread_only = true\ncontrol_group = \"a\"\nmax_clients = 0\n");
    let error = error.unwrap_err().to_string();
    assert!(error.contains("`control_group` and `read_only` exclude each other"), "{error}");
    assert!(error.contains("`max_clients` = 0 is out of range; allowed: 1 to 1000"), "{error}");
}

#[test]
fn unreadable_or_faulty_file_is_named() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("cell.toml");
    let error = load(&path).unwrap_err();
    assert!(matches!(error, ConfigFileError::Read { .. }));
    assert!(error.to_string().contains("cell.toml"), "{error}");
    std::fs::write(&path, "[[gateway]]\nn = 0\ncan0 = { bitrate = 500_000 }\n").unwrap();
    let error = load(&path).unwrap_err().to_string();
    assert!(error.contains("cell.toml: line 2, column 5: `n` = 0 is out of range"), "{error}");
    std::fs::write(&path, EXAMPLE).unwrap();
    assert_eq!(load(&path).unwrap(), read(EXAMPLE).unwrap());
    let endless = load("/dev/zero").unwrap_err().to_string();
    assert_eq!(endless, "cannot read /dev/zero: larger than 16 MiB; not a configuration file");
}

#[test]
fn wrong_numbers_and_words_are_reported() {
    let cases = [
        ("cycle_us = 99999999999999999999", "`cycle_us` is too large"),
        ("cycle_us = nan", "`cycle_us` = NaN is out of range; allowed: 0 to 4000000"),
        ("cycle_us = -1", "`cycle_us` = -1 is out of range"),
        ("master = 99999999999999999999", "`master` is too large"),
        ("master = -1", "`master` = -1 is out of range; allowed: 0 to 65535"),
        ("master = 1.5", "`master` must be an integer, not a float"),
        ("master = 1979-05-27", "not a date"),
        ("gateway = 1", "`gateway` must be an array of tables, [[gateway]]"),
        ("dc = [1]", "`dc` must be a table, not an array"),
        ("allow_large_pdos = \"yes\"", "`allow_large_pdos` must be true or false, not a string"),
        ("[[gateway]]\ncan4 = {}", "unknown key `can4`; did you mean `can0`?"),
        (
            "[[gateway]]\nn = 3\ncan0 = { bitrate = 5_000_000 }",
            "`bitrate` = 5000000 is out of range; allowed:",
        ),
    ];
    for (text, words) in cases {
        let faults = read(text).unwrap_err().to_string();
        assert!(faults.contains(words), "{text}: {faults}");
    }
    let text = "[[gateway]]\nn = 3\ntx_pdo = { options = [\"fast\", \"align4\", 7] }\n";
    let faults = read(text).unwrap_err().0;
    let columns: Vec<_> =
        faults.iter().filter(|fault| fault.line == 3).map(|fault| fault.column).collect();
    assert_eq!(columns, [23, 41], "{faults:?}");
    assert_eq!(
        read("cycle_us = 0x3E8\n[[gateway]]\nn = 3\ncan0 = { bitrate = 500_000 }")
            .unwrap()
            .adapter
            .cycle_ns(),
        1_000_000
    );
}

#[test]
fn truncated_file_faults_are_inside_its_lines() {
    let mut faulty = 0;
    for end in (0..EXAMPLE.len()).step_by(13).filter(|end| EXAMPLE.is_char_boundary(*end)) {
        let text = &EXAMPLE[..end];
        let lines = text.lines().count().max(1) + usize::from(text.ends_with('\n'));
        let Err(faults) = read(text) else { continue };
        faulty += 1;
        for fault in faults.0 {
            assert!((1..=lines).contains(&fault.line), "{end}: {fault}");
        }
    }
    assert!(faulty > 100, "{faulty}");
}
