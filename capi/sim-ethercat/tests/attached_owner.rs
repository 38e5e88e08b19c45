//! An application in Rust that runs the master itself, through a binding of its own, and attaches the
//! SDK to it: under the simulated library both use one world.

use std::ffi::{OsString, c_int, c_uint, c_void};
use std::process::Command;

use ecan_lite::adapter::{Adapter, AdapterConfig, Error, Master, OpenFailure};
use ecan_lite::can::Port;
use ecan_lite::config::PortConfig;
use ecan_lite::prelude::*;
use libloading::os::unix::{Library, RTLD_GLOBAL, RTLD_LOCAL, RTLD_NOW};

use crate::toolchain::{SONAME, output_text, simulated_library};

/// In stepped time, so that no load of the machine disturbs the run.
const SCENARIO: &str = r#"
    clock = "stepped"
    [[gateway]]
    [[node]]
    kind = "echo"
    bus = "0.0"
"#;

#[test]
fn owner_and_sdk_share_the_world_of_the_scenario_file() {
    if !crate::toolchain::is_there() {
        return;
    }
    let library = simulated_library();
    let file = library.path().join("cell.toml");
    std::fs::write(&file, SCENARIO).expect("room for the scenario");
    let mut setting = OsString::from("sim:");
    setting.push(&file);
    for scope in ["linked", "loaded"] {
        let program = std::env::current_exe().expect("a test has a name");
        let mut command = Command::new(program);
        command.args(["--exact", "attached_owner::owner_program", "--ignored", "--nocapture"]);
        command.env("LD_LIBRARY_PATH", library.path()).env("ECAN_ECRT", &setting);
        let output = command.env("SCOPE", scope).output().expect("the program starts");
        let text = output_text(&output);
        assert!(output.status.success(), "{text}");
        assert!(text.contains("the frame is back"), "{text}");
        assert_eq!(text.matches("SIMULATED: ").count(), 1, "one world: {text}");
    }
}

/// The owner's own binding.
struct Owner {
    library: Library,
    master: *mut c_void,
}

impl Owner {
    /// `linked`: the functions are in the global scope, as those of a library that a program is
    /// linked to.
    fn request() -> Self {
        let is_linked = std::env::var("SCOPE").expect("the test sets it") == "linked";
        let scope = if is_linked { RTLD_GLOBAL } else { RTLD_LOCAL };
        // SAFETY: the simulated library; its initialisers do nothing.
        let library =
            unsafe { Library::open(Some(SONAME), RTLD_NOW | scope) }.expect("it is there");
        // SAFETY: the type of libethercat's function.
        let request: unsafe extern "C" fn(c_uint) -> *mut c_void =
            *unsafe { library.get(b"ecrt_request_master\0") }.expect("a function");
        // SAFETY: any index.
        let master = unsafe { request(0) };
        assert!(!master.is_null());
        Self { library, master }
    }

    fn call(&self, name: &str) {
        // SAFETY: libethercat's functions of one argument, the master.
        let result = unsafe {
            let call: unsafe extern "C" fn(*mut c_void) -> c_int =
                *self.library.get(name.as_bytes()).expect("a function");
            call(self.master)
        };
        assert_eq!(result, 0, "{name}");
    }
}

#[test]
#[ignore = "the program of the test above"]
fn owner_program() {
    let owner = Owner::request();
    let ecrt = Ecrt::open_loaded().expect("the loaded library");
    assert!(ecrt.is_simulated() && !ecrt.clock().is_free_running());

    // `open` finds the same world: its master is reserved.
    let opened = Ecrt::open().expect("the same library");
    let refused = Master::request(&opened, 0).expect_err("the owner has it");
    assert_eq!(refused.failure, OpenFailure::Busy);
    let other = Ecrt::open_setting("sim:drives").expect_err("a process has one world");
    assert!(other.to_string().contains("whose scenario is"), "{other}");

    // SAFETY: the owner outlives the Port and is used from this thread only.
    let shared = unsafe { Master::from_raw(ecrt.clone(), owner.master.cast()) }.expect("a master");
    let config =
        PortConfig::uniform(1, GatewayConfig::on_channel(0, ChannelConfig::classic(500_000)));
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
    let startup = config.startup_plan(&adapter);
    let adapter = Adapter::attach(&ecrt, shared, adapter, startup).expect("a gateway is there");
    assert!(adapter.ecrt().is_simulated());
    let mut port = Port::new(adapter, config).expect("it is not active");
    assert!(matches!(port.adapter_mut().activate(), Err(Error::Attached { .. })));
    owner.call("ecrt_master_activate\0");
    port.adapter_mut().owner_activated().expect("the owner has activated");

    let frame =
        CanFrame::classic(CanId::standard(0x123).expect("11 bits"), &[1, 2]).expect("2 bytes");
    let mut is_sent = false;
    for _ in 0..20_000 {
        port.wait_next_cycle();
        owner.call("ecrt_master_receive\0");
        let channel = port.channel(0, 0).expect("configured");
        let is_ready = port.is_ready();
        let mut cycle = port.begin_cycle();
        if cycle.received().any(|received| matches!(received, ReceivedView::Frame { .. })) {
            println!("the frame is back");
            return;
        }
        if is_ready && !is_sent {
            cycle.send(channel, &frame).expect("the gateway is ready");
            is_sent = true;
        }
        assert_eq!(cycle.finish().error(), None);
        owner.call("ecrt_master_send\0");
    }
    panic!("no frame came back; sent: {is_sent}");
}
