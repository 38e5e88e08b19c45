//! The methods: names, access, parameters, results.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::protocol::axes::Axes;
use crate::protocol::bus::{
    AssignedParams, AssignedPdo, BusState, Link, LinkParams, Slave, SlaveParams,
};
use crate::protocol::hello::{Access, Hello, HelloParams};
use crate::protocol::nmt::NmtParams;
use crate::protocol::sdo::{DownloadParams, Upload, UploadParams};
use crate::protocol::service_stats::ServiceStats;
use crate::protocol::state::{ActiveConfig, State};
use crate::protocol::subscription::{ImageSubscription, Subscription};

/// Parameters or result without members.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Empty {}

/// A method with the types of its parameters and result.
pub trait Method {
    /// Name in the request.
    const NAME: &'static str;
    /// Access that a client needs.
    const ACCESS: Access;
    /// Parameters.
    type Params: Serialize + DeserializeOwned;
    /// Result.
    type Result: Serialize + DeserializeOwned;
}

macro_rules! methods {
    ($( $(#[$doc:meta])* $type:ident = $name:literal, $access:ident, $params:ty => $result:ty; )+) => {
        /// Markers of the methods, as type parameters of a typed request.
        pub mod methods {
            use super::*;
            $(
                $(#[$doc])*
                #[derive(Debug, Clone, Copy)]
                pub struct $type;
                impl Method for $type {
                    const NAME: &'static str = $name;
                    const ACCESS: Access = Access::$access;
                    type Params = $params;
                    type Result = $result;
                }
            )+
        }
        /// Names of the methods of version 1, with the access that they need. Extensions have
        /// further ones.
        pub const METHODS: &[(&str, Access)] = &[$( ($name, Access::$access), )+];
    };
}

methods! {
    /// Introduces the client; the first request.
    SayHello = "hello", Read, HelloParams => Hello;
    /// State of the master and its links.
    ReadBusState = "bus.state", Read, Empty => BusState;
    /// State of one link.
    ReadLink = "bus.link", Read, LinkParams => Link;
    /// All slaves.
    ReadSlaves = "bus.slaves", Read, Empty => Vec<Slave>;
    /// One slave.
    ReadSlave = "bus.slave", Read, SlaveParams => Slave;
    /// Uploads an object.
    UploadSdo = "sdo.upload", Read, UploadParams => Upload;
    /// Downloads an object.
    DownloadSdo = "sdo.download", Control, DownloadParams => Empty;
    /// PDOs that a sync manager has assigned.
    ReadAssigned = "pdo.assigned", Read, AssignedParams => Vec<AssignedPdo>;
    /// The last cycle.
    ReadState = "state", Read, Empty => State;
    /// The axes in the last cycle.
    ReadAxes = "axes", Read, Empty => Axes;
    /// The active configuration.
    ReadConfig = "config", Read, Empty => ActiveConfig;
    /// Subscribes to frames.
    SubscribeFrames = "frames.subscribe", Read, Subscription => Empty;
    /// Ends the subscription to frames.
    UnsubscribeFrames = "frames.unsubscribe", Read, Empty => Empty;
    /// Subscribes to images.
    SubscribeImages = "images.subscribe", Read, ImageSubscription => Empty;
    /// Ends the subscription to images.
    UnsubscribeImages = "images.unsubscribe", Read, Empty => Empty;
    /// Counters of the service and its clients.
    ReadServiceStats = "service.stats", Read, Empty => ServiceStats;
    /// Sends an NMT command.
    SendNmt = "nmt", Control, NmtParams => Empty;
}
