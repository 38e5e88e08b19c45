//! The gateways on the bus: N against what the master carries, and what only the SII tells.

use ecan_host::{Diagnostics, Ecrt, Error, MAX_PLAIN_MULTIPLIER};
use ecan_protocol::Recognition;

use crate::global::GlobalOptions;

use super::Check;

/// Two for the mailbox, SM2 and SM3 for process data.
const SYNC_MANAGERS: u8 = 4;

pub(super) fn checks(library: Option<Ecrt>, global: &GlobalOptions) -> Vec<Check> {
    const NAME: &str = "bus";
    let Some(ecrt) = library else {
        return vec![Check::skipped(NAME, "there is no library to look with")];
    };
    let diagnostics = match Diagnostics::of_bus(&ecrt, global.master) {
        Ok(diagnostics) => diagnostics,
        Err(error) => return vec![cannot_look(NAME, &error)],
    };
    let gateways: Vec<_> =
        (0..diagnostics.slave_count()).filter(|slave| is_gateway(&diagnostics, *slave)).collect();
    let count = diagnostics.slave_count();
    let slaves = if count == 1 { "slave" } else { "slaves" };
    let found = format!("{count} {slaves}, {} ECAN-Lite", gateways.len());
    if gateways.is_empty() {
        let remedy = "look at cable and supply, then at `ecan scan`";
        return vec![Check::bad(NAME, found, remedy)];
    }
    let mut checks = vec![Check::good(NAME, found)];
    checks.extend(gateways.iter().map(|slave| process_data(&diagnostics, *slave)));
    checks.extend(gateways.iter().map(|slave| sii_layout(&diagnostics, *slave)));
    checks
}

fn cannot_look(name: &'static str, error: &Error) -> Check {
    Check::bad(name, error.to_string(), "mend what is said above, then look at `ecan scan`")
}

fn is_gateway(diagnostics: &Diagnostics, slave: usize) -> bool {
    let upload = |subindex| diagnostics.sdo_upload_u32(slave, 0xF000, subindex);
    Recognition::read(upload).is_ok_and(|it| it.looks_like_ecan_lite())
}

/// The larger N of both directions, of the active profile or else of the requested one.
fn chunks(diagnostics: &Diagnostics, slave: usize) -> Result<(u32, bool), Error> {
    let value = |index, subindex| diagnostics.sdo_upload_u32(slave, index, subindex);
    let active = value(0x8010, 9)?.max(value(0x8011, 9)?) / 128;
    if active != 0 {
        return Ok((active, true));
    }
    Ok((value(0x8010, 3)?.max(value(0x8011, 3)?), false))
}

fn process_data(diagnostics: &Diagnostics, slave: usize) -> Check {
    const NAME: &str = "process data";
    match chunks(diagnostics, slave) {
        Ok((n, is_active)) => judge_chunks(NAME, slave, n, is_active),
        Err(error) => cannot_look(NAME, &error),
    }
}

/// The library tells how many sync managers the SII has, but not where they lie.
fn sii_layout(diagnostics: &Diagnostics, slave: usize) -> Check {
    const NAME: &str = "SII layout";
    match diagnostics.slave_info(slave) {
        Ok(info) => judge_sync_managers(NAME, slave, info.sync_count),
        Err(error) => cannot_look(NAME, &error),
    }
}

fn judge_sync_managers(name: &'static str, slave: usize, count: u8) -> Check {
    let script = format!("scripts/ecan_sii_sm_layout.sh check --position {slave}");
    if count >= SYNC_MANAGERS {
        let words = "the library does not show where SM2 and SM3 lie";
        return Check::skipped(
            name,
            format!("slave {slave}: {count} sync managers; {words}: {script}"),
        );
    }
    Check::bad(
        name,
        format!("slave {slave}: the SII has {count} sync managers instead of {SYNC_MANAGERS}"),
        &format!("{script}, then fix; SM2 is 0x1100, SM3 is 0x1D00, 3072 bytes each"),
    )
}

fn judge_chunks(name: &'static str, slave: usize, n: u32, is_active: bool) -> Check {
    let word = if is_active { "active" } else { "requested" };
    let max = u32::from(MAX_PLAIN_MULTIPLIER);
    let found = format!("slave {slave}: N = {n} {word}, a plain master carries {max}");
    if n <= max {
        return Check::good(name, found);
    }
    Check::warning(
        name,
        found,
        "choose a smaller N, or a master that splits process data over datagrams; an older one \
         stops sending altogether",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_sii_without_process_data_is_told() {
        assert!(!judge_sync_managers("SII layout", 0, 4).is_amiss());
        let short = judge_sync_managers("SII layout", 1, 2);
        assert_eq!(short.found, "slave 1: the SII has 2 sync managers instead of 4");
        assert!(short.remedy.contains("ecan_sii_sm_layout.sh check --position 1"));
    }

    #[test]
    fn n_is_compared_with_what_the_master_carries() {
        assert!(!judge_chunks("process data", 0, 11, true).is_amiss());
        let large = judge_chunks("process data", 2, 12, false);
        assert_eq!(large.found, "slave 2: N = 12 requested, a plain master carries 11");
        assert!(large.is_amiss());
    }
}
