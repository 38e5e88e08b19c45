//! Compiles the C codec, optimised whatever the profile is.

fn main() {
    println!("cargo::rerun-if-changed=src/baseline/baseline.c");
    println!("cargo::rerun-if-changed=src/baseline/baseline.h");
    cc::Build::new()
        .file("src/baseline/baseline.c")
        .std("c11")
        .opt_level(3)
        .warnings(true)
        .extra_warnings(true)
        .compile("ecan_codec_baseline");
}
