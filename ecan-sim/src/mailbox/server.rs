//! Mailbox services of the firmware of one gateway: requests in, responses and emergencies out.

use ecan_protocol::device::AlState;

use super::coe;
use super::foe::FoeServer;
use super::messages::{
    Context, HEADER_BYTES, Header, MailboxError, MessageAddress, ResponseQueue, protocol,
};
use super::sdo_server::SdoServer;
use crate::gateway::Gateway;

/// Mailbox services of one gateway's firmware.
#[derive(Clone, Debug, Default)]
pub(crate) struct MailboxServer {
    sdo: SdoServer,
    foe: FoeServer,
    responses: ResponseQueue,
    /// Counter of the last request, 0 for none.
    last_counter: u8,
}

impl MailboxServer {
    /// The firmware takes a message from the write mailbox (SM0): `request` is the whole buffer, as
    /// long as the sync manager. `reply_bytes` is the length of the read mailbox (SM1). Does
    /// nothing while the mailbox does not respond.
    pub(crate) fn receive(
        &mut self,
        now: u64,
        request: &[u8],
        reply_bytes: usize,
        gateway: &mut Gateway,
    ) {
        gateway.advance(now);
        if !gateway.mailbox_answers(now) {
            return;
        }
        let ready = now.saturating_add(gateway.config().mailbox_delay_ns);
        let Some((header, rest)) = Header::parse(request) else {
            let to = MessageAddress { address: 0, protocol: protocol::ERROR };
            let message = MailboxError::SizeTooShort.message();
            self.responses.push(ready, to, vec![message], reply_bytes);
            return;
        };
        // the master did not see that the mailbox accepted the message, and wrote it again
        let is_repeated = header.counter != 0 && header.counter == self.last_counter;
        if is_repeated {
            return;
        }
        self.last_counter = header.counter;
        // an error is not answered with an error
        if header.protocol == protocol::ERROR {
            return;
        }
        let room = reply_bytes.saturating_sub(HEADER_BYTES);
        let answer = self.answer(header, rest, &mut Context { now, room, gateway });
        if gateway.parts().1.take_lost_response() {
            return;
        }
        let (protocol, messages) = match answer {
            Ok(messages) => (header.protocol, messages),
            Err(error) => (protocol::ERROR, vec![error.message()]),
        };
        let to = MessageAddress { address: header.address, protocol };
        self.responses.push(ready, to, messages, reply_bytes);
    }

    /// Returns whether [`receive`](Self::receive) has space for a response. Without it the request
    /// stays in SM0, which rejects further ones: an error message would be taken for the response
    /// to another request.
    pub(crate) fn has_space(&self) -> bool {
        !self.responses.is_full()
    }

    /// Returns whether [`send`](Self::send) has a message. Cheap: to be called whenever the read mailbox is
    /// empty.
    pub(crate) fn is_due(&self, now: u64, gateway: &Gateway) -> bool {
        let is_ready = self.responses.next_ready().is_some_and(|time| time <= now);
        let has_emergency = gateway.side().has_emergency() && gateway.al_state() != AlState::Boot;
        gateway.mailbox_answers(now) && (is_ready || has_emergency)
    }

    /// Copies the next message that is ready by `now` into `out` (the whole of SM1, padded with
    /// zeros), which must be empty; returns `false` if there is none.
    pub(crate) fn send(&mut self, now: u64, out: &mut [u8], gateway: &mut Gateway) -> bool {
        gateway.advance(now);
        if !gateway.mailbox_answers(now) {
            return false;
        }
        let speaks_coe = gateway.al_state() != AlState::Boot;
        while let Some(emergency) = gateway.parts().0.take_emergency().filter(|_| speaks_coe) {
            let to = MessageAddress { address: 0, protocol: protocol::COE };
            if self.responses.write(to, &coe::emergency_message(emergency), out) {
                return true;
            }
        }
        self.responses.send(now, out)
    }

    /// When the next response becomes ready.
    #[cfg(test)]
    pub(super) fn next_ready(&self) -> Option<u64> {
        self.responses.next_ready()
    }

    /// Response messages, without mailbox headers; `rest` is the request after its header.
    fn answer(
        &mut self,
        header: Header,
        rest: &[u8],
        context: &mut Context<'_>,
    ) -> Result<Vec<Vec<u8>>, MailboxError> {
        if header.channel != 0 {
            return Err(MailboxError::InvalidChannel);
        }
        let body = rest.get(..usize::from(header.length)).ok_or(MailboxError::InvalidSize)?;
        match header.protocol {
            // BOOT permits FoE only
            protocol::COE if context.gateway.al_state() != AlState::Boot => {
                coe::request(&mut self.sdo, body, context)
            }
            protocol::FOE => Ok(self.foe.request(body, context).into_iter().collect()),
            reserved if protocol::RESERVED.contains(&reserved) => Err(MailboxError::Syntax),
            _ => Err(MailboxError::UnsupportedProtocol),
        }
    }
}
