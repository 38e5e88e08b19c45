//! CANopen frames in any order: to a simulated drive, from any server to the host's SDO client, and from any slave to
//! its LSS master. Each record of ten bytes is a choice, a delay in milliseconds and eight bytes of data.
#![no_main]

use ecan_canopen::{
    Emcy, FastscanFilter, GuardResponse, LssAddress, LssCommand, LssConfig, LssMaster, LssRequest,
    LssResponse, Mpdo, NodeId, SdoClient, SdoConfig, TimeOfDay,
};
use ecan_protocol::can::{CanFrame, CanId, Dlc};
use ecan_sim::{Drive, DriveConfig, Node, NodeOutput};
use libfuzzer_sys::fuzz_target;

/// CAN IDs that the drive with node-ID 5 receives: NMT, SYNC, TIME, RPDO 1, SDO, guarding, LSS.
const CAN_IDS: [u16; 8] = [0x000, 0x080, 0x100, 0x205, 0x605, 0x705, 0x7E5, 0x77F];

const MS: u64 = 1_000_000;

/// A drive with node-ID 5, or one that waits for its node-ID.
fn prepared(without_node_id: bool) -> Drive {
    let mut config = DriveConfig::new(NodeId::new(5).expect("a node-ID"));
    config.boot_ms = 1;
    config.quirks.without_node_id = without_node_id;
    Drive::new(&config)
}

thread_local! {
    static DRIVES: [Drive; 2] = [prepared(false), prepared(true)];
}

fuzz_target!(|data: &[u8]| {
    let choice = usize::from(data.len().is_multiple_of(2));
    let (mut drive, mut out) = (DRIVES.with(|drives| drives[choice].clone()), NodeOutput::new());
    let mut client =
        SdoClient::new(SdoConfig { buffer_bytes: 64, retries: 1, ..SdoConfig::default() });
    let mut master = LssMaster::new(LssConfig::default());
    let mut now = 0;
    drive.started(now, &mut out);
    for record in data.chunks_exact(10).take(200) {
        let [choice, delay, data @ ..] = record else { continue };
        run_to(&mut drive, &mut now, u64::from(*delay) * MS, &mut out);
        parse(data);
        let id = CAN_IDS.get(usize::from(choice & 7)).and_then(|id| CanId::standard(*id).ok());
        let length = usize::from(choice >> 4).min(data.len());
        let frame = match (id, data.get(..length)) {
            (Some(id), _) if choice & 8 != 0 => {
                Dlc::new(1).and_then(|dlc| CanFrame::remote(id, dlc)).ok()
            }
            (Some(id), Some(data)) => CanFrame::classic(id, data).ok(),
            _ => None,
        };
        if let Some(frame) = frame {
            drive.received(now, &frame, &mut out);
        }
        transfer(&mut client, *choice, data, now);
        configure(&mut master, *choice, data, now);
    }
});

/// Runs the drive; its frames are sent at once.
fn run_to(drive: &mut Drive, now: &mut u64, ns: u64, out: &mut NodeOutput) {
    let end = *now + ns;
    for _ in 0..1_000 {
        while let Some(frame) = out.pop() {
            drive.transmitted(*now, &frame, out);
        }
        match drive.next_event() {
            Some(at) if at <= end => {
                *now = at.max(*now);
                drive.advance(*now, out);
            }
            _ => break,
        }
    }
    *now = end;
}

fn parse(data: &[u8]) {
    if let Some(request) = LssRequest::parse(data) {
        assert_eq!(LssRequest::parse(&request.to_bytes()), Some(request));
    }
    if let Some(response) = LssResponse::parse(data) {
        assert_eq!(LssResponse::parse(&response.to_bytes()), Some(response));
    }
    if let Ok(mpdo) = Mpdo::parse(data) {
        assert_eq!(&mpdo.to_bytes()[..], data);
    }
    for length in [1, 6] {
        let data = data.get(..length).unwrap_or_default();
        let _ = GuardResponse::parse(data);
        if let Some(time) = TimeOfDay::parse(data) {
            assert_eq!(TimeOfDay::from_unix_ns(time.unix_ns()), Some(time));
        }
    }
    let _ = Emcy::parse(data);
}

/// Host and server take turns; a value never exceeds the buffer.
fn transfer(client: &mut SdoClient, choice: u8, data: &[u8], now: u64) {
    let _ = match choice % 5 {
        0 => client.start_upload(0x2000, 0),
        1 => client.start_block_upload(0x2000, 0),
        2 => client.start_download(0x2000, 0, &[choice; 30]),
        _ => Ok(()),
    };
    if client.frame().is_some() {
        client.sent(now);
    }
    if let Ok(frame) = data.try_into() {
        client.receive(frame, now);
    }
    client.tick(now);
    assert!(client.data().len() <= client.capacity());
}

fn configure(master: &mut LssMaster, choice: u8, data: &[u8], now: u64) {
    let command = match choice % 6 {
        0 => LssCommand::Fastscan(FastscanFilter::default()),
        1 => LssCommand::InquireAddress,
        2 => LssCommand::SwitchSelective(LssAddress::default()),
        3 => LssCommand::InquireNodeId,
        4 => LssCommand::ConfigureNodeId(NodeId::from_raw(choice)),
        _ => LssCommand::Store,
    };
    master.start(command);
    if master.frame().is_some() {
        master.sent(now);
    }
    master.receive(data);
    master.tick(now);
}
