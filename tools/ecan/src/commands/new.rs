//! `ecan new`: a project to start from.

use std::fs;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use ecan_protocol::text::Printable;

use crate::context::{Context, Failure, Result};

pub const EXAMPLES: &str = "\
Examples:
  ecan new robot                            frames, in Rust
  ecan new robot --for axes --lang cpp      CiA 402 axes, in C++

The project has a program, its configuration machine.toml, and a test on the simulator.";

#[derive(Debug, Args)]
pub struct NewArguments {
    /// Folder of the project, which must not exist; its name is that of the program
    #[arg(value_name = "NAME")]
    directory: PathBuf,
    /// Language
    #[arg(long, value_enum, default_value_t = Language::Rust)]
    lang: Language,
    /// What the program sends
    #[arg(long = "for", value_enum, default_value_t = Purpose::Frames)]
    purpose: Purpose,
    /// Source tree of the SDK, for Rust [default: that of this program, or the released version]
    #[arg(long, value_name = "DIRECTORY")]
    sdk: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Language {
    Rust,
    C,
    Cpp,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Purpose {
    Frames,
    Axes,
}

/// A file of `examples/starter`.
macro_rules! starter {
    ($path:literal) => {
        include_str!(concat!("../../../../examples/starter/", $path))
    };
}

/// A program of README.md.
macro_rules! program {
    ($name:literal) => {
        include_str!(concat!("../../../../ecan-lite/examples/", $name))
    };
}

/// Name of the program in the templates.
const TEMPLATE: &str = "starter";

/// Editors with Taplo: VS Code with Even Better TOML.
const EDITOR: &str = r#"{
  "evenBetterToml.schema.associations": { "machine\\.toml$": "./ecan-lite.schema.json" }
}
"#;

pub fn run(arguments: &NewArguments, context: &Context) -> Result {
    let NewArguments { directory, lang, purpose, .. } = arguments;
    context.global.without_service("it needs no bus")?;
    let name = name_of(directory)?;
    if directory.exists() {
        let path = Printable(directory.display());
        return Err(Failure::Usage(format!("{path} exists; choose a name that does not")));
    }
    let mut project = vec![("ecan-lite.schema.json", ecan_lite::config::schema())];
    for (path, text) in files(*lang, *purpose) {
        let text = text.replace(TEMPLATE, name);
        let is_manifest = path == "Cargo.toml";
        let sdk = arguments.sdk.as_deref();
        project.push((path, if is_manifest { with_sdk(&text, sdk)? } else { text }));
    }
    for (path, text) in &project {
        write(&directory.join(path), text)?;
    }
    let commands: &[&str] = match lang {
        Language::Rust => &["ECAN_ECRT=sim cargo run", "cargo test"],
        Language::C | Language::Cpp => &[
            "cmake -S . -B build && cmake --build build",
            "ECAN_ECRT=sim build/NAME",
            "ctest --test-dir build",
        ],
    };
    let commands: Vec<_> = commands.iter().map(|command| command.replace("NAME", name)).collect();
    context.output.data(
        &serde_json::json!({ "directory": directory, "commands": commands }),
        |out| {
            writeln!(out, "cd {}", Printable(directory.display()))?;
            commands.iter().try_for_each(|command| writeln!(out, "{command}"))
        },
    )
}

/// Name of the program, which is a name for Cargo and CMake, too.
fn name_of(directory: &Path) -> Result<&str> {
    let name = directory.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let is_name = name.starts_with(|first: char| first.is_ascii_alphabetic())
        && name.chars().all(|letter| letter.is_ascii_alphanumeric() || "-_".contains(letter));
    is_name.then_some(name).ok_or_else(|| {
        Failure::Usage(format!(
            "\"{}\" is no name of a program; allowed: a letter, then letters, digits, - and _",
            Printable(name)
        ))
    })
}

fn files(lang: Language, purpose: Purpose) -> Vec<(&'static str, &'static str)> {
    let [machine, scenario] = match purpose {
        Purpose::Frames => [starter!("frames/machine.toml"), starter!("frames/scenario.toml")],
        Purpose::Axes => [starter!("axes/machine.toml"), starter!("axes/scenario.toml")],
    };
    let mut files = vec![
        ("machine.toml", machine),
        ("scenario.toml", scenario),
        (".vscode/settings.json", EDITOR),
    ];
    files.extend(match (lang, purpose) {
        (Language::Rust, Purpose::Frames) => [("src/main.rs", program!("first_program.rs"))],
        (Language::Rust, Purpose::Axes) => [("src/main.rs", program!("first_axis.rs"))],
        (Language::C, Purpose::Frames) => [("main.c", starter!("c/frames.c"))],
        (Language::C, Purpose::Axes) => [("main.c", starter!("c/axes.c"))],
        (Language::Cpp, Purpose::Frames) => [("main.cpp", starter!("cpp/frames.cpp"))],
        (Language::Cpp, Purpose::Axes) => [("main.cpp", starter!("cpp/axes.cpp"))],
    });
    match lang {
        Language::Rust => files.extend([
            ("Cargo.toml", starter!("rust/Cargo.toml")),
            ("tests/simulator.rs", starter!("rust/tests/simulator.rs")),
            (".gitignore", "/target\n"),
        ]),
        Language::C => {
            files.extend([
                ("CMakeLists.txt", starter!("c/CMakeLists.txt")),
                (".gitignore", "/build\n"),
            ]);
        }
        Language::Cpp => {
            files.extend([
                ("CMakeLists.txt", starter!("cpp/CMakeLists.txt")),
                (".gitignore", "/build\n"),
            ]);
        }
    }
    files
}

/// Replaces the released version by a source tree: the given one, or that of which this program was built
/// if it is still there.
fn with_sdk(manifest: &str, sdk: Option<&Path>) -> Result<String> {
    let own = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
    let sdk = sdk.unwrap_or(own);
    let package = sdk.join("ecan-lite");
    match package.join("Cargo.toml").canonicalize() {
        Ok(found) => {
            let package = found.parent().unwrap_or(&package).display().to_string();
            Ok(manifest.replace("version = \"0.2\"", &format!("path = {package:?}")))
        }
        Err(_) if sdk == own => Ok(manifest.to_owned()),
        Err(error) => Err(Failure::file("find the SDK in", sdk, error)),
    }
}

fn write(path: &Path, text: &str) -> Result {
    let folder = path.parent().unwrap_or(Path::new(""));
    fs::create_dir_all(folder)
        .and_then(|()| fs::write(path, text))
        .map_err(|error| Failure::file("write", path, error))
}
