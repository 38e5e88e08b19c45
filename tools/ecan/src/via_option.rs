//! The way to the bus: the master library, or the service of a program that holds the master.

use std::convert::Infallible;
use std::path::PathBuf;
use std::str::FromStr;

/// Argument of `--via`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Via {
    /// A service that responds at a default path, otherwise the library.
    #[default]
    Auto,
    Direct,
    Service(PathBuf),
}

impl FromStr for Via {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(match text {
            "auto" => Self::Auto,
            "direct" => Self::Direct,
            path => Self::Service(path.into()),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn way_is_parsed_from_text() {
        let parse = |text: &str| text.parse::<Via>().unwrap();
        assert_eq!((parse("auto"), parse("direct")), (Via::Auto, Via::Direct));
        assert_eq!(parse("/run/x.sock"), Via::Service("/run/x.sock".into()));
    }
}
