//! The SII and the script that repairs it.

use crate::bench::Bench;
use crate::bus::BusSpec;
use crate::need::Need;
use crate::step::{Group, Step};
use crate::stop::{Stop, check};

pub const GROUP: Group = Group {
    name: "sii",
    steps: &[
        Step {
            name: "check",
            proves: "`ecan_sii_sm_layout.sh check` accepts the layout of SM2 and SM3.",
            needs: &[Need::LastingBus, Need::EthercatTool],
            run: check_layout,
        },
        Step {
            name: "read",
            proves: "IgH's tool reads an SII with the identity that `ecan scan` reports.",
            needs: &[Need::LastingBus, Need::EthercatTool],
            run: read,
        },
        Step {
            name: "fix",
            proves: "A wrong layout is found and fixed, and a backup restores the earlier SII.",
            needs: &[Need::Wire, Need::EthercatTool],
            run: fix,
        },
    ],
};

fn layout(bench: &mut Bench, arguments: &[&str], code: i32) -> Result<(), Stop> {
    let tool = bench.arguments.ethercat.clone().unwrap_or_default();
    let mut command = bench.script("ecan_sii_sm_layout.sh", arguments);
    command.arg("--ethercat").arg(tool);
    command.arg("--master").arg(bench.arguments.master.to_string());
    bench.run(command)?.expect(code).map(drop)
}

fn check_layout(bench: &mut Bench) -> Result<(), Stop> {
    bench.bus(BusSpec::any(1))?;
    layout(bench, &["check"], 0)
}

/// Reads the SII of the first slave into a file.
fn read_to(bench: &mut Bench, name: &str) -> Result<Vec<u8>, Stop> {
    let path = bench.work.join(name);
    let read = bench.ethercat(["sii_read", "-p", "0"]);
    let text = crate::child::command_text(&read);
    // The tool writes the image to its standard output.
    let script = format!("{text} > {name}");
    let command = bench.system("sh", ["-c", &script]);
    bench.run(command)?.expect(0)?;
    std::fs::read(&path).map_err(|error| Stop::file(&path, &error))
}

fn read(bench: &mut Bench) -> Result<(), Stop> {
    bench.bus(BusSpec::any(1))?;
    let image = read_to(bench, "sii.bin")?;
    let word = |at: usize| {
        let bytes = image.get(2 * at..2 * at + 4).and_then(|bytes| bytes.try_into().ok());
        bytes.map(u32::from_le_bytes)
    };
    let scan = bench.ecan(["--json", "scan"]);
    let scan = bench.run(scan)?.expect(0)?.json()?;
    // ETG.1000: vendor ID at word 8, product code at word 10.
    let found = (word(8).map(u64::from), word(10).map(u64::from));
    let expected = (scan[0]["vendor_id"].as_u64(), scan[0]["product_code"].as_u64());
    check(found == expected && found.0.is_some(), || {
        format!("(vendor, product) in the SII {found:?}, by `ecan scan` {expected:?}")
    })
}

/// Offset of category 41 in an image: word 0x40, then type and length in words.
fn sync_managers(image: &[u8]) -> Option<usize> {
    let word = |at: usize| Some(u16::from_le_bytes(image.get(at..at + 2)?.try_into().ok()?));
    let mut at = 0x80;
    loop {
        match word(at)? {
            41 => return Some(at + 4),
            0xFFFF => return None,
            _ => at += 4 + 2 * usize::from(word(at + 2)?),
        }
    }
}

fn fix(bench: &mut Bench) -> Result<(), Stop> {
    bench.fresh_bus(BusSpec::any(1))?;
    let image = read_to(bench, "good.bin")?;
    let Some(category) = sync_managers(&image) else {
        return Err(Stop::failed("the SII has no category 41"));
    };
    let mut wrong = image.clone();
    // Low byte of the length of SM2, which has eight bytes like each sync manager.
    wrong[category + 2 * 8 + 2] ^= 0x80;
    let wrong = bench.write_file("wrong.bin", &wrong)?;
    let write = bench.ethercat(["sii_write", "-p", "0", &wrong]);
    bench.run(write)?.expect(0)?;
    let rescan = bench.ethercat(["rescan"]);
    bench.run(rescan)?.expect(0)?;
    bench.wait_for_slaves(1)?;
    layout(bench, &["check"], 1)?;
    let backup = bench.work.join("backup.bin").display().to_string();
    let _ = std::fs::remove_file(&backup);
    layout(bench, &["fix", "--yes", "--backup", &backup], 0)?;
    layout(bench, &["check"], 0)?;
    bench.wait_for_slaves(1)?;
    let fixed = read_to(bench, "fixed.bin")?;
    check(fixed == image, || "the fixed SII differs from the original one".to_owned())?;
    let second = bench.work.join("backup2.bin").display().to_string();
    let _ = std::fs::remove_file(&second);
    layout(bench, &["restore", &backup, "--yes", "--backup", &second], 0)?;
    layout(bench, &["check"], 1)?;
    layout(bench, &["fix", "--yes", "--backup", &format!("{second}.3")], 0)
}
