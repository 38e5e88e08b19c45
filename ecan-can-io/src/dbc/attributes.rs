//! Attributes with a meaning for frames.

use std::collections::HashMap;

use can_dbc::{AttributeDefinition, AttributeValueType};
use can_dbc_pest::{Pair, Rule};

use crate::dbc::syntax::{part, part_text, unquoted};

const FRAME_FORMAT: &str = "VFrameFormat";
const BIT_RATE_SWITCH: &str = "CANFD_BRS";
const START_VALUE: &str = "GenSigStartValue";

/// Values of attributes by message, or by message and signal, as texts.
#[derive(Debug, Default)]
pub struct Attributes<'a> {
    /// Values of attributes of kind ENUM.
    values: HashMap<String, Vec<String>>,
    defaults: HashMap<&'a str, &'a str>,
    messages: HashMap<(&'a str, &'a str), &'a str>,
    signals: HashMap<(&'a str, &'a str, &'a str), &'a str>,
}

impl<'a> Attributes<'a> {
    /// Takes an item that defines or sets an attribute.
    pub fn take(&mut self, item: &Pair<'a, Rule>) {
        let name = unquoted(part_text(item, Rule::attribute_name));
        match item.as_rule() {
            Rule::attr_def => {
                let definition = AttributeDefinition::try_from(item.clone());
                let Ok(AttributeDefinition::Message(name, AttributeValueType::Enum(values))) =
                    definition
                else {
                    return;
                };
                self.values.insert(name, values);
            }
            Rule::ba_def_def => {
                self.defaults.insert(name, value_of(item));
            }
            Rule::attr_value => {
                if let Some(object) = part(item, Rule::msg_var_val) {
                    let message = part_text(&object, Rule::message_id);
                    self.messages.insert((name, message), value_of(&object));
                } else if let Some(object) = part(item, Rule::signal_var) {
                    let message = part_text(&object, Rule::message_id);
                    let signal = part_text(&object, Rule::ident);
                    self.signals.insert((name, message, signal), value_of(&object));
                }
            }
            _ => {}
        }
    }

    /// Returns whether the frame format of a message is CAN FD; `None` if the file does not state it.
    pub fn is_fd(&self, message: &str) -> Option<bool> {
        self.message_text(FRAME_FORMAT, message).map(|format| format.ends_with("_FD"))
    }

    pub fn has_bit_rate_switch(&self, message: &str) -> Option<bool> {
        self.message_text(BIT_RATE_SWITCH, message).map(|value| value != "0")
    }

    /// Start value of a signal, as a raw value.
    pub fn start_value(&self, message: &str, signal: &str) -> Option<&'a str> {
        let value = self.signals.get(&(START_VALUE, message, signal));
        value.or_else(|| self.defaults.get(START_VALUE)).copied()
    }

    /// An attribute of kind ENUM has the text of its index or the text itself.
    fn message_text(&self, name: &str, message: &str) -> Option<&str> {
        let value = self.messages.get(&(name, message)).or_else(|| self.defaults.get(name))?;
        let values = self.values.get(name)?;
        let index = value.parse::<usize>().ok().filter(|_| !values.iter().any(|it| it == value));
        Some(index.and_then(|at| values.get(at)).map_or(value, String::as_str))
    }
}

/// The value of an attribute, the last part.
fn value_of<'a>(item: &Pair<'a, Rule>) -> &'a str {
    let value = item
        .clone()
        .into_inner()
        .filter(|it| matches!(it.as_rule(), Rule::number | Rule::quoted_str))
        .last();
    value.map_or("", |it| unquoted(it.as_str()))
}
