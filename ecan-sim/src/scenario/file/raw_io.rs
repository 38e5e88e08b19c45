use serde::Deserialize;

use crate::scenario::file::set;
use crate::scenario::io_spec::IoBehaviourName;
use crate::scenario::{IoBehaviour, IoSpec, Scenario};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawIo {
    position: usize,
    name: Option<String>,
    alias: Option<u16>,
    vendor_id: Option<u32>,
    product_code: Option<u32>,
    revision: Option<u32>,
    serial: Option<u32>,
    boot_ms: Option<u32>,
    outputs: Option<u8>,
    inputs: Option<u8>,
    #[serde(default)]
    behaviour: IoBehaviourName,
    values: Option<Vec<u8>>,
}

impl RawIo {
    /// Builds the slave of a scenario whose gateways are read; `slaves` is the number of all slaves.
    pub(super) fn build(self, scenario: &Scenario, slaves: usize) -> Result<IoSpec, String> {
        let position = self.position;
        if position >= slaves {
            return Err(format!(
                "`position` {position} is out of range; the line has {slaves} slave(s), {} of them \
                 gateways: allowed: 0 to {}",
                scenario.gateways.len(),
                slaves - 1
            ));
        }
        if scenario.ios.iter().any(|io| io.position == position) {
            return Err(format!("position {position} is used twice; each I/O has its own"));
        }
        let mut spec = IoSpec::at(position);
        set!(spec from self: name, alias, vendor_id, product_code, revision, serial, boot_ms);
        set!(spec from self: outputs, inputs);
        for (key, bytes) in [("outputs", spec.outputs), ("inputs", spec.inputs)] {
            if bytes > IoSpec::MAX_BYTES {
                return Err(format!(
                    "`{key}` is out of range; allowed: 0 to {} bytes",
                    IoSpec::MAX_BYTES
                ));
            }
        }
        if spec.outputs == 0 && spec.inputs == 0 {
            return Err("an I/O needs `outputs` or `inputs`; both are 0".to_owned());
        }
        spec.behaviour = behaviour(self.behaviour, self.values, spec.inputs)?;
        Ok(spec)
    }
}

fn behaviour(
    name: IoBehaviourName,
    values: Option<Vec<u8>>,
    inputs: u8,
) -> Result<IoBehaviour, String> {
    match (name, values) {
        (IoBehaviourName::Loopback, None) => Ok(IoBehaviour::Loopback),
        (IoBehaviourName::Counter, None) => Ok(IoBehaviour::Counter),
        (IoBehaviourName::Fixed, Some(values)) if values.len() > usize::from(inputs) => {
            Err(format!("`values` has {} bytes; `inputs` is {inputs}", values.len()))
        }
        (IoBehaviourName::Fixed, Some(values)) => Ok(IoBehaviour::Fixed(values)),
        (IoBehaviourName::Fixed, None) => {
            Err("behaviour \"fixed\" needs `values`, the input bytes".to_owned())
        }
        (_, Some(_)) => Err("`values` belongs to behaviour \"fixed\" only".to_owned()),
    }
}
