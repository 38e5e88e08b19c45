//! Counters of a Port, per slave and channel. They only grow, except `frames_pending`, and wrap at
//! 2^64.
//!
//! # Accounts
//!
//! Each accepted frame is in exactly one of these columns of its channel:
//!
//! ```text
//! frames_accepted = frames_delivered + frames_lost + frames_discarded + frames_unknown + frames_pending
//! ```
//!
//! A complete working counter shows that the slave controller took an image, not that the gateway
//! parsed it: in SAFEOP it discards its images. Delivered frames therefore stay pending until a
//! transmit result (manual 10) of their image or a later one arrives, or until the gateway is found
//! in OP after it took the following image: the Port reads the register AL status every 10 ms. If
//! the session is lost before, they are unknown, as are the frames of an image whose delivery
//! is not known.
//!
//! The TxPDO header numbers the images (manual 6), so that those of the receive path are counted from
//! the first time that a gateway is ready:
//!
//! ```text
//! images read from the gateway = txpdo_received + txpdo_lost + txpdo_discarded + at most txpdo_unknown
//! ```
//!
//! The frames that the gateway put into images are `frames_received + frames_not_taken`, and those of
//! the images of `txpdo_lost` and `txpdo_unknown`. Their number cannot be known: the gateway counts
//! frames that it drops before it packs them (0x9000:13, 0x9020:05), but not those that it packs.

use ecan_protocol::image::{ChannelState, ChannelStatus};
use ecan_protocol::mapping::CHANNELS;

/// A counter of [`ChannelStatistics`] or [`SlaveStatistics`].
#[derive(Debug, Clone, Copy)]
pub struct Counter<T> {
    /// Name of the field.
    pub name: &'static str,
    /// Name of the metric that the service serves.
    pub metric: &'static str,
    /// Text of the metric: one sentence.
    pub help: &'static str,
    /// Returns the value.
    pub value: fn(&T) -> u64,
}

/// Declares a struct of counters, with their metrics and their words in a snapshot.
///
/// A `frequent` counter changes in most cycles: its word is always written. A `rare` one is written only
/// if the sum of the rare ones has changed, since they only grow. A `derived` value is no counter: it has
/// neither a word nor a metric, as the field after the last counter.
macro_rules! counters {
    (
        $(#[$meta:meta])* $name:ident, $prefix:literal;
        $( $(#[$doc:meta])* $kind:ident $field:ident $($help:literal)?; )+
        $(; $(#[$other_doc:meta])* $other:ident: $other_type:ty )?
    ) => {
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
        #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
        pub struct $name {
            $( $(#[$doc])* pub $field: u64, )+
            $( $(#[$other_doc])* pub $other: $other_type, )?
        }

        impl $name {
            /// The counters, in the order of the fields.
            pub const COUNTERS: &'static [Counter<Self>] = &[$( $( Counter {
                name: stringify!($field),
                metric: concat!($prefix, stringify!($field), "_total"),
                help: $help,
                value: |counters| counters.$field,
            }, )? )+];
        }

        counter_words! { $name [] [] [$($other)?]; $($kind $field)+ }
    };
}

/// Sorts the counters of a struct by their kind, and converts them to words and back.
macro_rules! counter_words {
    ($name:ident [$($f:ident)*] $rare:tt $other:tt; frequent $next:ident $($rest:tt)*) => {
        counter_words! { $name [$($f)* $next] $rare $other; $($rest)* }
    };
    ($name:ident $frequent:tt [$($r:ident)*] $other:tt; rare $next:ident $($rest:tt)*) => {
        counter_words! { $name $frequent [$($r)* $next] $other; $($rest)* }
    };
    ($name:ident $frequent:tt $rare:tt [$($o:ident)*]; derived $next:ident $($rest:tt)*) => {
        counter_words! { $name $frequent $rare [$($o)* $next]; $($rest)* }
    };
    ($name:ident [$($frequent:ident)*] [$($rare:ident)*] [$($other:ident)*];) => {
        impl $name {
            /// Numbers of words.
            pub(crate) const FREQUENT: usize = [$(stringify!($frequent)),*].len();
            pub(crate) const RARE: usize = [$(stringify!($rare)),*].len();

            #[inline(always)]
            pub(crate) fn frequent(&self) -> [u64; $name::FREQUENT] {
                [$(self.$frequent),*]
            }

            #[inline(always)]
            pub(crate) fn rare(&self) -> [u64; $name::RARE] {
                [$(self.$rare),*]
            }

            #[inline(always)]
            pub(crate) fn rare_sum(&self) -> u64 {
                0_u64 $(.wrapping_add(self.$rare))*
            }

            pub(crate) fn of_words(
                [$($frequent),*]: [u64; $name::FREQUENT],
                [$($rare),*]: [u64; $name::RARE],
            ) -> Self {
                Self { $($frequent,)* $($rare,)* $($other: Default::default(),)* }
            }
        }
    };
}

counters! {
    /// Counters of one channel.
    ChannelStatistics, "ecan_channel_";
    /// Frames that a send accepted.
    frequent frames_accepted "Frames that a send accepted.";
    /// Frames of RxPDO images that were published.
    frequent frames_sent "Frames of RxPDO images that were published.";
    /// Frames of images that the slave controller took, by the working counter: of those that are
    /// delivered, pending or unknown.
    frequent frames_confirmed "Frames of images that the slave controller took.";
    /// Frames that the gateway took in OP. It may have dropped some of them afterwards, see
    /// `results_failed`.
    frequent frames_delivered "Frames that the gateway took in OP.";
    /// Frames of published images that the gateway certainly did not take.
    rare frames_lost "Frames of published images that the gateway certainly did not take.";
    /// Frames that never left the host: discarded by the application or after a lost session, or
    /// withdrawn because their phase had passed.
    rare frames_discarded "Frames that never left the host.";
    /// Frames that the gateway may have taken: of images whose delivery is not known, or that it may
    /// have taken outside OP.
    rare frames_unknown "Frames that the gateway may have taken.";
    /// Frames without a known result so far; not a counter.
    derived frames_pending;
    /// Frames taken out of TxPDO images.
    frequent frames_received "Frames taken out of TxPDO images.";
    /// Frames that arrived and that the application did not take: left in their cycle, or while the
    /// gateway was not ready.
    rare frames_not_taken "Frames that arrived and that the application did not take.";
    /// Frames rejected because the image was full.
    rare rejected_image_full "Frames rejected because the image was full.";
    /// Frames rejected because the gateway's transmit queue might not hold them.
    rare rejected_queue_full
        "Frames rejected because the transmit queue of the gateway might not hold them.";
    /// Frames rejected because the channel is bus-off.
    rare rejected_bus_off "Frames rejected because the channel was bus-off.";
    /// Transmit results that reported success: code 0 or 1 (manual 10).
    frequent results_ok "Transmit results that reported success.";
    /// Transmit results that reported a failure. Results that no part of the application took are
    /// counted, too.
    rare results_failed "Transmit results that reported a failure.";
    /// TxPDO images that reported the channel as bus-off.
    rare bus_off_images "TxPDO images that reported the channel as bus-off.";
    /// TxPDO images that reported the channel as not running, without bus-off.
    rare not_running_images
        "TxPDO images that reported the channel as not running, without bus-off.";
}

counters! {
    /// Counters of one gateway.
    SlaveStatistics, "ecan_slave_";
    /// Cycles since the gateway was ready for the first time.
    frequent cycles "Cycles since the gateway was ready for the first time.";
    /// Cycles among them whose working counter was not complete.
    rare incomplete_cycles
        "Those of ecan_slave_cycles_total whose working counter was not complete.";
    /// RxPDO images published with a new sequence.
    frequent rxpdo_published "RxPDO images published with a new sequence.";
    /// Cycles in which an unconfirmed image was sent again.
    rare rxpdo_repeated "Cycles in which an unconfirmed image was sent again.";
    /// RxPDO images with frames that were withdrawn before their delivery was confirmed.
    rare rxpdo_discarded
        "RxPDO images with frames that were withdrawn before their delivery was confirmed.";
    /// TxPDO images with new content.
    frequent txpdo_received "TxPDO images with new content.";
    /// Cycles without a new TxPDO image.
    rare txpdo_repeated "Cycles without a new TxPDO image.";
    /// TxPDO images that did not arrive, or damaged, by the gaps in the sequence.
    rare txpdo_lost "TxPDO images that did not arrive, or damaged.";
    /// TxPDO images that arrived while the gateway was not ready. Their frames are not handed out
    /// and count as `frames_not_taken`.
    rare txpdo_discarded "TxPDO images that arrived while the gateway was not ready.";
    /// Most TxPDO images that can have been lost in outages after which the gateway started its
    /// sequence again.
    rare txpdo_unknown "Most TxPDO images that can have been lost in outages.";
    /// TxPDO images that were being written while they were read.
    rare txpdo_torn "TxPDO images that were being written while they were read.";
    /// TxPDO images that the gateway marked as incomplete: frames were left out or lost.
    rare txpdo_incomplete "TxPDO images that the gateway marked as incomplete.";
    /// TxPDO images with another layout than the configured one.
    rare txpdo_layout_changes "TxPDO images with another layout than the configured one.";
    /// TxPDO images or packets with a fault: bad CRC, bad header, bad packet.
    rare parse_errors "TxPDO images or packets with a fault: bad CRC, bad header, bad packet.";
    /// Transmit results that match no send.
    rare unmatched_results "Transmit results that match no send.";
    /// Times that the gateway became ready.
    rare sessions "Times that the gateway became ready.";
    /// Times that the gateway was lost while it was ready; a loss during its verification is none.
    rare sessions_lost "Times that the gateway was lost while it was ready.";
    /// Verifications that failed.
    rare verification_failures "Verifications of the gateway that failed.";
    /// Requests of another startup because the gateway stayed in one state below OP.
    rare startup_requests
        "Requests of another startup because the gateway stayed in a state below OP.";
    ;
    /// Per channel.
    channels: [ChannelStatistics; CHANNELS]
}

impl ChannelStatistics {
    /// Status of the channel in a new image; returns whether it is counted.
    pub(crate) fn count_status(&mut self, status: ChannelStatus) -> bool {
        let is_bus_off = status.bus_off() || status.state() == ChannelState::BusOff;
        self.bus_off_images += u64::from(is_bus_off);
        let is_running = is_bus_off || status.state() == ChannelState::Run;
        self.not_running_images += u64::from(!is_running);
        is_bus_off || !is_running
    }
}

impl SlaveStatistics {
    /// The packet codec has checked the channel number.
    pub(crate) fn channel(&mut self, channel: u8) -> &mut ChannelStatistics {
        &mut self.channels[usize::from(channel) % CHANNELS]
    }
}
