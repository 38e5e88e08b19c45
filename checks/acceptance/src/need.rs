//! Conditions of a step.

use nix::unistd::Uid;

use crate::bench::{Bench, Kind};

/// Condition without which a step does not apply.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Need {
    /// A bus that outlives a program: a real master.
    LastingBus,
    /// Simulated gateways on the other end of the master's cable.
    Wire,
    /// Simulated gateways, on the wire or in the library.
    Simulated,
    /// A node on each channel that returns every frame.
    EchoNodes,
    /// Permission to write and erase the Flash of a gateway.
    WriteFlash,
    /// IgH's tool.
    EthercatTool,
    /// The rights of root.
    Root,
    /// At least this number of gateways.
    Gateways(u16),
    /// A program of the SDK, or a C program built from it.
    Program(&'static str),
    /// A program of the system.
    System(&'static str),
    /// Not in the short list.
    Full,
}

impl Need {
    /// The reason for which a step with this condition does not apply; `None` if it applies.
    pub fn missing(self, bench: &Bench) -> Option<String> {
        let (kind, arguments) = (bench.kind, &bench.arguments);
        let is_missing = match self {
            Self::LastingBus => kind == Kind::Library,
            Self::Wire => kind != Kind::Wire,
            Self::Simulated => kind == Kind::Device,
            Self::EchoNodes => kind == Kind::Device && !arguments.echo_nodes,
            Self::WriteFlash => kind == Kind::Device && !arguments.write_flash,
            Self::EthercatTool => arguments.ethercat.is_none(),
            Self::Root => !Uid::effective().is_root(),
            Self::Gateways(count) => kind != Kind::Library && arguments.gateways < count,
            Self::Program(name) => bench.program(name).is_none(),
            Self::System(name) => !is_on_path(name),
            Self::Full => arguments.quick,
        };
        is_missing.then(|| self.text())
    }

    fn text(self) -> String {
        match self {
            Self::LastingBus => "the bus of a simulated library lasts for one program".to_owned(),
            Self::Wire => "needs simulated gateways on the wire".to_owned(),
            Self::Simulated => "needs simulated gateways".to_owned(),
            Self::EchoNodes => "needs nodes that return every frame (--echo-nodes)".to_owned(),
            Self::WriteFlash => "would replace the saved configuration (--write-flash)".to_owned(),
            Self::EthercatTool => "needs IgH's tool (--ethercat)".to_owned(),
            Self::Root => "needs root".to_owned(),
            Self::Gateways(count) => format!("needs {count} gateways (--gateways)"),
            Self::Program(name) => format!("no program {name} (--bin)"),
            Self::System(name) => format!("no program {name} on this system"),
            Self::Full => "not in the short list (--quick)".to_owned(),
        }
    }
}

fn is_on_path(name: &str) -> bool {
    let paths = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&paths).any(|directory| directory.join(name).is_file())
}
