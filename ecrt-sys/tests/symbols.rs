//! Every function that is looked up is exported by the real library.

use std::collections::HashMap;
use std::path::Path;

/// Exported functions of libethercat 1.6.2 (`nm -D`), and the version each is tagged with.
fn exported() -> Option<HashMap<String, String>> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../shared/igh/libethercat-1.6.2-symbols.txt");
    let Ok(text) = std::fs::read_to_string(&path) else {
        println!("skipped: {} is not there", path.display());
        return None;
    };
    let exported = text
        .lines()
        .filter_map(|line| {
            let symbol = line.split_whitespace().nth(2)?;
            let (name, version) = symbol.split_once("@@")?;
            Some((name.to_owned(), version.to_owned()))
        })
        .collect();
    Some(exported)
}

#[test]
fn every_function_is_exported_by_1_6_2() {
    let Some(exported) = exported() else { return };
    let missing: Vec<_> = ecrt_sys::symbols()
        .map(|(symbol, _)| symbol)
        .filter(|&symbol| !exported.contains_key(symbol))
        .collect();
    assert!(missing.is_empty(), "not exported: {missing:?}");
}

/// Functions of 1.5.2 for single commands: a library without them is accepted.
const OPTIONAL_IN_1_5_2: [&str; 3] = [
    "ecrt_master_sdo_download_complete",
    "ecrt_slave_config_emerg_pop",
    "ecrt_slave_config_emerg_size",
];

#[test]
fn required_functions_exist_in_1_5_2() {
    let Some(exported) = exported() else { return };
    for (symbol, required) in ecrt_sys::symbols() {
        let since_1_5_2 = exported[symbol] == "LIBETHERCAT_1.5.2";
        let expected = since_1_5_2 && !OPTIONAL_IN_1_5_2.contains(&symbol);
        assert_eq!(required, expected, "{symbol}: {}", exported[symbol]);
    }
}

#[test]
fn no_function_is_looked_up_twice() {
    let mut symbols: Vec<_> = ecrt_sys::symbols().map(|(symbol, _)| symbol).collect();
    let all = symbols.len();
    symbols.sort_unstable();
    symbols.dedup();
    assert_eq!(symbols.len(), all);
}
