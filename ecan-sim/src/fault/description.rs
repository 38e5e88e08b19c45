//! The textual form of a fault: the table `[[fault]]` of scenario files, the parameters of the
//! service's `sim.fault`, and the options of `ecan sim fault`.

use ecan_protocol::mapping::CHANNELS;
use serde::{Deserialize, Serialize};

use self::DrawnValue::{Between, OneOf};
use super::schedule::When;
use super::table::{
    DriveFault, Fault, GatewayFault, LibraryCall, LossDirection, fault_keys, fault_table,
};
use crate::scenario::{NodeKind, NodeSpec, Scenario};

/// A key of a [`FaultDescription`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultKey {
    /// Name. A name that ends in `_ms` is a duration in milliseconds.
    pub name: &'static str,
    /// Type of its value.
    pub value: FaultValue,
    /// Meaning, in one line; with the default of an optional key.
    pub help: &'static str,
}

impl FaultKey {
    /// Returns whether the kinds with this key need it.
    pub fn is_required(&self) -> bool {
        !self.help.contains("[default: ")
    }
}

/// Type of the value of a [`FaultKey`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultValue {
    /// An integer.
    Number,
    /// A text.
    Text,
    /// A number or a name.
    NumberOrText,
}

/// Random values of a fault kind, for trials that inject faults. The place of the fault (gateway, channel, node)
/// is not part of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultDraw {
    /// Frequency of the kind, relative to those of the others.
    pub weight: u32,
    /// Keys with their values; the others have their defaults.
    pub values: &'static [(&'static str, DrawnValue)],
}

/// Random value of a [`FaultKey`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DrawnValue {
    /// An integer from the first one up to, but not including, the second one.
    Between(i64, i64),
    /// One of these values in TOML.
    OneOf(&'static [&'static str]),
}

trait KeyType {
    const VALUE: FaultValue;
}

macro_rules! key_types {
    ($($type:ty => $value:ident,)+) => {
        $( impl KeyType for $type { const VALUE: FaultValue = FaultValue::$value; } )+
    };
}

key_types! {
    u8 => Number, u16 => Number, u32 => Number, u64 => Number, usize => Number,
    i32 => Number, i64 => Number,
    String => Text, LossDirection => Text, LibraryCall => Text,
    toml::Value => NumberOrText,
}

/// Declares the keys. `[= value]` is a key with a default, `[required]` one without; the resolver has a method of
/// the key's name for each of them. The methods of other keys are written out.
macro_rules! keys {
    ($( $(#[doc = $help:literal])+ $key:ident: $type:ty [$($rule:tt)*], )+) => {
        /// A fault as text describes it: its kind, its keys and perhaps its time.
        ///
        /// Made by deserialisation, and checked against a scenario when it is used.
        #[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
        #[serde(deny_unknown_fields)]
        pub struct FaultDescription {
            kind: FaultKind,
            $( #[serde(skip_serializing_if = "Option::is_none")] $key: Option<$type>, )+
        }

        impl FaultDescription {
            /// The keys of the time. A description has at most one of them.
            pub const TIMES: [&str; 5] =
                ["cycle", "at_ms", "after_ms", "after_op_ms", "after_ready_ms"];
            /// The keys besides `kind`, those of the time first.
            pub const KEYS: &[FaultKey] =
                &[$( FaultKey {
                    name: stringify!($key),
                    value: <$type as KeyType>::VALUE,
                    help: concat!($($help),+).trim_ascii(),
                }, )+];
        }

        impl Resolver<'_> {
            $( key_method! { $key: $type [$($rule)*] } )+
        }
    };
}

macro_rules! key_method {
    ($key:ident: $type:ty []) => {};
    ($key:ident: $type:ty [required]) => {
        fn $key(&self) -> Result<$type, FaultError> {
            self.need(stringify!($key), self.raw.$key)
        }
    };
    ($key:ident: $type:ty [= $default:expr]) => {
        fn $key(&self) -> Result<$type, FaultError> {
            Ok(self.raw.$key.unwrap_or($default))
        }
    };
}

fault_keys!(keys);

/// Declares the kinds in the order of the table, and what each of them resolves to.
macro_rules! kinds {
    (
        line { $($line:tt)* }
        gateway { $($gateway:tt)* }
        bus { $($bus:tt)* }
        drive { $($drive:tt)* }
        library { $($library:tt)* }
    ) => {
        kinds! { @groups
            { Fault whole $($line)* }
            { GatewayFault in_gateway $($gateway)* }
            { Fault whole $($bus)* }
            { DriveFault in_drive $($drive)* }
            { Fault whole $($library)* }
        }
    };
    (@groups $( { $type:ident $wrap:ident $(
        $(#[$variant_meta:meta])*
        $variant:ident $fields:tt
        $( kind $kind:ident $name:literal ($($key:literal),*) $help:literal
            $( drawn ($weight:literal, $values:expr) )? )?
        text ($($text:tt)*);
    )* } )*) => {
        /// Kind of a fault in its textual form.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
        pub enum FaultKind {
            $( $( $( #[doc = $help] #[serde(rename = $name)] $kind, )? )* )*
        }

        impl FaultKind {
            /// All kinds.
            pub const ALL: &[Self] = &[$( $( $( Self::$kind, )? )* )*];

            /// Name in scenario files.
            pub fn name(self) -> &'static str {
                match self { $( $( $( Self::$kind => $name, )? )* )* }
            }

            /// The keys of this kind, besides those of the time.
            pub fn keys(self) -> &'static [&'static str] {
                match self { $( $( $( Self::$kind => &[$($key),*], )? )* )* }
            }

            /// Effect, in one line.
            pub fn help(self) -> &'static str {
                match self { $( $( $( Self::$kind => $help.trim_ascii(), )? )* )* }
            }

            /// Values in random trials; `None` for a kind that is not drawn.
            pub fn draw(self) -> Option<FaultDraw> {
                match self {
                    $( $( $( $( Self::$kind => Some(FaultDraw { weight: $weight, values: $values }), )? )? )* )*
                    _ => None,
                }
            }
        }

        impl Resolver<'_> {
            fn fault(&self) -> Result<Fault, FaultError> {
                match self.raw.kind { $( $( $(
                    FaultKind::$kind => self.$wrap(kinds! { @fields
                        $type $variant self $fields
                    }),
                )? )* )* }
            }
        }
    };
    (@fields $type:ident $variant:ident $this:ident { $(
        $(#[$meta:meta])* $field:ident: $field_type:ty = $source:ident,
    )* }) => {
        $type::$variant { $( $field: $this.$source()?, )* }
    };
}

fault_table!(kinds);

/// Reason why a [`FaultDescription`] does not describe a fault of a scenario.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FaultError {
    /// A scheduled fault has no time.
    #[error("a fault needs one of `{}`", FaultDescription::TIMES.join("`, `"))]
    NoTime,
    /// There are several times.
    #[error("a fault has only one of `{}`", FaultDescription::TIMES.join("`, `"))]
    SeveralTimes,
    /// A necessary key is missing.
    #[error("`{}` needs `{key}`", kind.name())]
    Missing {
        /// Kind.
        kind: FaultKind,
        /// Key.
        key: &'static str,
    },
    /// A key that selects one of several is missing.
    #[error("`{}` needs `{key}`; there are {count}", kind.name())]
    NotSelected {
        /// Kind.
        kind: FaultKind,
        /// Key.
        key: &'static str,
        /// Number of those that exist.
        count: usize,
    },
    /// A key belongs to other kinds.
    #[error("`{key}` does not belong to `{}`; allowed: {}", kind.name(), kind.keys().join(", "))]
    Foreign {
        /// Kind.
        kind: FaultKind,
        /// Key.
        key: String,
    },
    /// The scenario has no such gateway, I/O slave or channel.
    #[error("{what} {number} does not exist; there are {count}")]
    NoSuch {
        /// Noun.
        what: &'static str,
        /// Requested number.
        number: usize,
        /// Number of those that exist, from 0.
        count: usize,
    },
    /// The scenario has no node of this name.
    #[error("node \"{name}\" does not exist; there are: {known}")]
    NoSuchNode {
        /// The name.
        name: String,
        /// Names of those that exist.
        known: String,
    },
    /// The node is no drive.
    #[error("node \"{0}\" is not a drive")]
    NotADrive(String),
    /// The code is too large.
    #[error("`code` of `{}` is out of range; allowed: 0 to 0xFFFF", .0.name())]
    LongCode(FaultKind),
    /// The error number is invalid.
    #[error(
        "invalid `errno`; allowed: a number from 1 to {ERRNO_MAX}, or one of: {}",
        ERRNO_NAMES.map(|(name, _)| name).join(", ")
    )]
    Errno,
}

/// Error numbers that can be given by name.
const ERRNO_NAMES: [(&str, i32); 12] = [
    ("EPERM", libc::EPERM),
    ("ENOENT", libc::ENOENT),
    ("EINTR", libc::EINTR),
    ("EIO", libc::EIO),
    ("ENXIO", libc::ENXIO),
    ("EBADF", libc::EBADF),
    ("EAGAIN", libc::EAGAIN),
    ("ENOMEM", libc::ENOMEM),
    ("EBUSY", libc::EBUSY),
    ("ENODEV", libc::ENODEV),
    ("EINVAL", libc::EINVAL),
    ("ETIMEDOUT", libc::ETIMEDOUT),
];
/// Largest error number of Linux.
const ERRNO_MAX: i64 = 4095;

impl FaultDescription {
    /// The time, if one is given, `now_ns` after the start of the simulation.
    pub(crate) fn when(&self, now_ns: u64) -> Result<Option<When>, FaultError> {
        let ns = |ms: u64| ms.saturating_mul(1_000_000);
        let times = [
            self.cycle.map(When::Cycle),
            self.at_ms.map(|ms| When::At(ns(ms))),
            self.after_ms.map(|ms| When::At(now_ns.saturating_add(ns(ms)))),
            self.after_op_ms.map(|ms| When::AfterOp(ns(ms))),
            self.after_ready_ms.map(|ms| When::AfterReady(ns(ms))),
        ];
        let mut given = times.into_iter().flatten();
        match (given.next(), given.next()) {
            (_, Some(_)) => Err(FaultError::SeveralTimes),
            (when, None) => Ok(when),
        }
    }

    /// The fault, in a scenario that has its gateway or node.
    pub(crate) fn fault(&self, scenario: &Scenario) -> Result<Fault, FaultError> {
        self.check_keys()?;
        Resolver { raw: self, scenario }.fault()
    }

    /// Rejects keys that do not belong to the kind.
    fn check_keys(&self) -> Result<(), FaultError> {
        let kind = self.kind;
        let keys = toml::Table::try_from(self).unwrap_or_default();
        let is_own =
            |key: &str| key == "kind" || Self::TIMES.contains(&key) || kind.keys().contains(&key);
        match keys.into_iter().find(|(key, _)| !is_own(key)) {
            Some((key, _)) => Err(FaultError::Foreign { kind, key }),
            None => Ok(()),
        }
    }
}

struct Resolver<'a> {
    raw: &'a FaultDescription,
    scenario: &'a Scenario,
}

impl Resolver<'_> {
    fn whole(&self, fault: Fault) -> Result<Fault, FaultError> {
        Ok(fault)
    }

    fn in_gateway(&self, fault: GatewayFault) -> Result<Fault, FaultError> {
        Ok(Fault::Gateway { gateway: self.gateway()?, fault })
    }

    fn in_drive(&self, fault: DriveFault) -> Result<Fault, FaultError> {
        let node = self.node_spec()?;
        match node.kind {
            NodeKind::Drive(_) => Ok(Fault::Drive { node: node.name.clone(), fault }),
            _ => Err(FaultError::NotADrive(node.name.clone())),
        }
    }

    fn need<T>(&self, key: &'static str, value: Option<T>) -> Result<T, FaultError> {
        value.ok_or(FaultError::Missing { kind: self.raw.kind, key })
    }

    fn short_code(&self) -> Result<u16, FaultError> {
        u16::try_from(self.code()?).map_err(|_| FaultError::LongCode(self.raw.kind))
    }

    fn node(&self) -> Result<String, FaultError> {
        self.node_spec().map(|node| node.name.clone())
    }

    fn node_spec(&self) -> Result<&NodeSpec, FaultError> {
        let name = self.need("node", self.raw.node.as_ref())?;
        let node = self.scenario.nodes.iter().find(|known| known.name == *name);
        node.ok_or_else(|| {
            let known = self.scenario.nodes.iter().map(|node| node.name.as_str());
            FaultError::NoSuchNode {
                name: name.clone(),
                known: known.collect::<Vec<_>>().join(", "),
            }
        })
    }

    fn gateway(&self) -> Result<usize, FaultError> {
        self.one_of("gateway", "gateway", self.raw.gateway, self.scenario.gateways.len())
    }

    fn io(&self) -> Result<usize, FaultError> {
        self.one_of("I/O", "io", self.raw.io, self.scenario.ios.len())
    }

    /// The given one, or the only one.
    fn one_of(
        &self,
        what: &'static str,
        key: &'static str,
        given: Option<usize>,
        count: usize,
    ) -> Result<usize, FaultError> {
        match (given, count) {
            (Some(number), _) => existing(what, number, count),
            (None, 1) => Ok(0),
            (None, _) => Err(FaultError::NotSelected { kind: self.raw.kind, key, count }),
        }
    }

    /// The error number, given as number or name.
    fn errno(&self) -> Result<i32, FaultError> {
        let number = match self.need("errno", self.raw.errno.as_ref())? {
            toml::Value::Integer(number @ 1..=ERRNO_MAX) => i32::try_from(*number).ok(),
            toml::Value::String(name) => {
                ERRNO_NAMES.iter().find(|(known, _)| known == name).map(|(_, number)| *number)
            }
            _ => None,
        };
        number.ok_or(FaultError::Errno)
    }

    fn channel(&self) -> Result<usize, FaultError> {
        existing("channel", self.need("channel", self.raw.channel)?, CHANNELS)
    }
}

fn existing(what: &'static str, number: usize, count: usize) -> Result<usize, FaultError> {
    if number < count { Ok(number) } else { Err(FaultError::NoSuch { what, number, count }) }
}
