//! CAN channels as an option.

use ecan_protocol::CHANNELS;

/// Reads the number of a channel, for clap.
pub fn parse(text: &str) -> Result<u8, String> {
    let number = text.strip_prefix("can").or_else(|| text.strip_prefix("CAN")).unwrap_or(text);
    match number.parse::<u8>() {
        Ok(channel) if usize::from(channel) < CHANNELS => Ok(channel),
        _ => Err(format!("expected 0 to {}", CHANNELS - 1)),
    }
}
