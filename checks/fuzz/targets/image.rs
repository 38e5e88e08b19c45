//! PDO images in both directions: the first byte selects the profile, the rest is the image.
#![no_main]

use ecan_protocol::image::{ImageReader, PdoProfile};
use ecan_protocol::mapping::Direction;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let [choice, image @ ..] = data else { return };
    let profile = PdoProfile { multiplier: choice % 24 + 1, ..PdoProfile::default() };
    for direction in Direction::ALL {
        for has_crc in [false, true] {
            let reader = ImageReader::new(direction, profile).with_crc(has_crc);
            if let Ok(read) = reader.read(image) {
                // Each packet, or the error that ends the iteration.
                let packets = read.packets().take(256).count();
                assert!(packets <= 256);
            }
        }
    }
});
