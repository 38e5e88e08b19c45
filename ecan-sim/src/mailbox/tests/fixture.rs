//! A gateway with its mailbox services, and a client that exchanges bytes.

use ecan_protocol::device::AlState;
use ecan_protocol::object::AbortCode;

use crate::gateway::variant::GatewayVariant;
use crate::gateway::{Gateway, GatewayModelConfig};
use crate::mailbox::MailboxServer;

pub(super) const MS: u64 = 1_000_000;
/// Length of both mailboxes in the manual's memory map.
pub(super) const MAILBOX: usize = 128;

pub(super) struct Fixture {
    pub(super) gateway: Gateway,
    pub(super) server: MailboxServer,
    pub(super) now: u64,
    pub(super) mailbox: usize,
}

impl Fixture {
    /// In PREOP, with mailboxes of 128 bytes.
    pub(super) fn preop() -> Self {
        Self::with_mailbox(MAILBOX)
    }

    pub(super) fn with_mailbox(mailbox: usize) -> Self {
        Self::new(mailbox, GatewayModelConfig::default())
    }

    pub(super) fn with_complete_access(mailbox: usize) -> Self {
        let config = GatewayModelConfig { complete_access: true, ..Default::default() };
        Self::new(mailbox, config)
    }

    pub(super) fn with_variant(variant: GatewayVariant) -> Self {
        Self::new(MAILBOX, GatewayModelConfig { variant, ..Default::default() })
    }

    fn new(mailbox: usize, config: GatewayModelConfig) -> Self {
        let mut gateway = Gateway::new(config, 1);
        let now = 1_000 * MS;
        gateway.power(0, true);
        gateway.advance(now);
        gateway.set_up_mailboxes();
        gateway.request_al_state(now, AlState::PreOp);
        assert_eq!(gateway.al_state(), AlState::PreOp);
        Self { gateway, server: MailboxServer::default(), now, mailbox }
    }

    /// Writes a whole mailbox that begins with these bytes.
    pub(super) fn write(&mut self, message: &[u8]) {
        let mut buffer = message.to_vec();
        buffer.resize(self.mailbox.max(message.len()), 0);
        self.server.receive(self.now, &buffer, self.mailbox, &mut self.gateway);
    }

    /// Reads the mailbox when a message is ready: the message without the zeros after it.
    pub(super) fn read(&mut self) -> Option<Vec<u8>> {
        self.now = self.now.max(self.server.next_ready()?);
        self.read_now()
    }

    pub(super) fn read_now(&mut self) -> Option<Vec<u8>> {
        let mut out = vec![0xAA; self.mailbox];
        self.server.send(self.now, &mut out, &mut self.gateway).then(|| trimmed(&out))
    }

    pub(super) fn exchange(&mut self, message: &[u8]) -> Vec<u8> {
        self.write(message);
        self.read().expect("an answer")
    }

    /// Sends the body of a CoE message; returns the body of the CoE response.
    pub(super) fn coe(&mut self, body: &[u8]) -> Vec<u8> {
        let answer = self.exchange(&coe(body));
        assert_eq!(answer[5] & 0x0F, 3, "not CoE: {answer:02X?}");
        answer[6..].to_vec()
    }

    /// Sends a CoE message that is aborted, and returns the abort code.
    pub(super) fn abort_of(&mut self, body: &[u8]) -> AbortCode {
        let answer = self.coe(body);
        abort_in(&answer).unwrap_or_else(|| panic!("no abort: {answer:02X?}"))
    }

    /// Uploads with the kind of transfer that the server chooses.
    pub(super) fn upload(
        &mut self,
        index: u16,
        subindex: u8,
        complete: bool,
    ) -> Result<Vec<u8>, AbortCode> {
        let [i0, i1] = index.to_le_bytes();
        let command = 0x40 | u8::from(complete) << 4;
        let answer = self.coe(&[0x00, 0x20, command, i0, i1, subindex, 0, 0, 0, 0]);
        if let Some(code) = abort_in(&answer) {
            return Err(code);
        }
        assert_eq!(answer[..2], [0x00, 0x30]);
        assert_eq!(answer[3..6], [i0, i1, subindex]);
        if answer[2] & 0x02 != 0 {
            let size = 4 - usize::from(answer[2] >> 2 & 3);
            assert_eq!(answer.len(), 10);
            return Ok(answer[6..6 + size].to_vec());
        }
        let size = u32::from_le_bytes(answer[6..10].try_into().unwrap()) as usize;
        let mut data = answer[10..].to_vec();
        let mut toggle = 0;
        while data.len() < size {
            let segment = self.coe(&[0x00, 0x20, 0x60 | toggle, 0, 0, 0, 0, 0, 0, 0]);
            if let Some(code) = abort_in(&segment) {
                return Err(code);
            }
            assert_eq!(segment[..2], [0x00, 0x30]);
            assert_eq!(segment[2] & 0xF0, toggle);
            let unused = if segment.len() == 10 { usize::from(segment[2] >> 1 & 7) } else { 0 };
            data.extend_from_slice(&segment[3..segment.len() - unused]);
            assert_eq!(segment[2] & 1 != 0, data.len() == size, "last segment");
            toggle ^= 0x10;
        }
        assert_eq!(data.len(), size);
        Ok(data)
    }

    /// Downloads with a normal transfer, in segments if the mailbox is too short.
    pub(super) fn download(
        &mut self,
        index: u16,
        subindex: u8,
        complete: bool,
        data: &[u8],
    ) -> Result<(), AbortCode> {
        let [i0, i1] = index.to_le_bytes();
        let command = 0x21 | u8::from(complete) << 4;
        let (first, mut rest) = data.split_at(data.len().min(self.mailbox - 16));
        let mut body = vec![0x00, 0x20, command, i0, i1, subindex];
        body.extend_from_slice(&(data.len() as u32).to_le_bytes());
        body.extend_from_slice(first);
        let answer = self.coe(&body);
        if let Some(code) = abort_in(&answer) {
            return Err(code);
        }
        assert_eq!(answer[2] & 0xE0, 0x60);
        assert_eq!(answer[3..6], [i0, i1, subindex]);
        let mut toggle = 0;
        while !rest.is_empty() {
            let (segment, remaining) = rest.split_at(rest.len().min(self.mailbox - 9));
            rest = remaining;
            let unused = 7_usize.saturating_sub(segment.len());
            let mut body = vec![0x00, 0x20];
            body.push(toggle | (unused as u8) << 1 | u8::from(rest.is_empty()));
            body.extend_from_slice(segment);
            body.resize(body.len() + unused, 0);
            let answer = self.coe(&body);
            if let Some(code) = abort_in(&answer) {
                return Err(code);
            }
            assert_eq!(answer[..3], [0x00, 0x30, 0x20 | toggle]);
            toggle ^= 0x10;
        }
        Ok(())
    }

    /// Value of the firmware, without the mailbox.
    pub(super) fn value(&mut self, index: u16, subindex: u8) -> Vec<u8> {
        let mut out = Vec::new();
        self.gateway.sdo_upload(self.now, index, subindex, &mut out).expect("readable");
        out
    }
}

/// A CoE message without counter.
pub(super) fn coe(body: &[u8]) -> Vec<u8> {
    message(3, 0, body)
}

pub(super) fn message(protocol: u8, counter: u8, body: &[u8]) -> Vec<u8> {
    let [l0, l1] = (body.len() as u16).to_le_bytes();
    let mut message = vec![l0, l1, 0, 0, 0, protocol | counter << 4];
    message.extend_from_slice(body);
    message
}

/// An SDO information request.
pub(super) fn info(opcode: u8, parameters: &[u8]) -> Vec<u8> {
    let mut body = vec![0x00, 0x80, opcode, 0, 0, 0];
    body.extend_from_slice(parameters);
    body
}

/// Abort code of a CoE body, if it is an abort.
pub(super) fn abort_in(body: &[u8]) -> Option<AbortCode> {
    match body {
        &[0x00, 0x20, 0x80, _, _, _, a, b, c, d] => {
            Some(AbortCode(u32::from_le_bytes([a, b, c, d])))
        }
        _ => None,
    }
}

/// A message without the padding of its mailbox.
pub(super) fn trimmed(mailbox: &[u8]) -> Vec<u8> {
    let length = 6 + usize::from(u16::from_le_bytes([mailbox[0], mailbox[1]]));
    assert!(mailbox[length..].iter().all(|&byte| byte == 0), "the rest is not zero");
    mailbox[..length].to_vec()
}
