//! Generates the types of the binding when the feature `regenerate` asks for it.

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-env-changed=ECRT_INCLUDE_DIR");
    #[cfg(feature = "regenerate")]
    regenerate();
}

#[cfg(feature = "regenerate")]
fn regenerate() {
    use std::path::PathBuf;

    let header = match std::env::var_os("ECRT_INCLUDE_DIR") {
        Some(directory) => PathBuf::from(directory).join("ecrt.h"),
        None => PathBuf::from("ecrt-abi.h"),
    };
    println!("cargo:rerun-if-changed={}", header.display());
    assert!(
        header.is_file(),
        "{} does not exist: ECRT_INCLUDE_DIR must name the directory that holds IgH's ecrt.h",
        header.display()
    );

    // The output depends on the target version, so it is fixed, and no newer than the workspace's rust-version.
    let rust = bindgen::RustTarget::stable(88, 0)
        .unwrap_or_else(|error| panic!("bindgen does not know Rust 1.88: {error}"));
    let text = std::fs::read_to_string(&header)
        .unwrap_or_else(|error| panic!("cannot read {}: {error}", header.display()));
    let mut builder = bindgen::Builder::default()
        .header(header.display().to_string())
        .rust_target(rust)
        .raw_line("// Generated from ecrt-abi.h by scripts/regenerate-bindings.sh. Do not edit.")
        .allowlist_type("ec_.*")
        .allowlist_var("EC_MAX_.*")
        .ignore_functions()
        .prepend_enum_name(false)
        .derive_default(true)
        // The numbers stand in tests/abi.rs; without them here the file serves every word size.
        .layout_tests(false)
        .formatter(bindgen::Formatter::Prettyplease);
    if !text.contains("ec_master_scan_progress_t") {
        // Headers before 1.6 do not have it; the table names it all the same.
        builder = builder.raw_line(
            "#[repr(C)] #[derive(Debug, Default, Copy, Clone)] pub struct \
             ec_master_scan_progress_t { pub slave_count: u32, pub scan_index: u32 }",
        );
    }
    let bindings = builder
        .generate()
        .unwrap_or_else(|error| panic!("bindgen failed on {}: {error}", header.display()));
    // infallible: cargo sets OUT_DIR for every build script
    let target = PathBuf::from(std::env::var_os("OUT_DIR").unwrap()).join("bindings.rs");
    bindings
        .write_to_file(&target)
        .unwrap_or_else(|error| panic!("cannot write {}: {error}", target.display()));
}
