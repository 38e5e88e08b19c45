//! Frames of delivered images, until it is proven that the gateway was in OP when it took them.

use ecan_protocol::mapping::CHANNELS;

/// Frames per channel in an image.
pub(crate) type Counts = [u8; CHANNELS];

/// Number of images that are stored one by one; older ones are proven together.
const DEPTH: usize = 16;

#[derive(Debug, Clone, Copy, Default)]
struct Image {
    /// 0 for none.
    number: u64,
    frames: [u64; CHANNELS],
}

impl Image {
    fn add(&mut self, other: &Self) {
        self.number = self.number.max(other.number);
        for (sum, frames) in self.frames.iter_mut().zip(other.frames) {
            *sum += frames;
        }
    }
}

/// Images are numbered in the order of their publication, from 1.
#[derive(Debug, Clone, Default)]
pub(crate) struct UnprovenFrames {
    images: [Image; DEPTH],
    next: usize,
    /// Sum of the images before these, with the number of the last one.
    older: Image,
    /// Last image that is proven.
    proven: u64,
}

impl UnprovenFrames {
    /// Adds a delivered image.
    #[inline]
    pub(crate) fn add(&mut self, number: u64, counts: &Counts) {
        if *counts == [0; CHANNELS] {
            return;
        }
        let frames = counts.map(u64::from);
        if let Some(image) = self.images.get_mut(self.next) {
            let replaced = std::mem::replace(image, Image { number, frames });
            if replaced.number != 0 {
                self.older.add(&replaced);
            }
        }
        self.next = (self.next + 1) % DEPTH;
    }

    /// Removes the frames of all images up to `number` and returns their numbers per channel.
    #[inline]
    pub(crate) fn prove(&mut self, number: u64) -> [u64; CHANNELS] {
        if number <= self.proven {
            return [0; CHANNELS];
        }
        self.proven = number;
        self.take(|image| image.number <= number)
    }

    /// Removes all frames and returns their numbers per channel.
    pub(crate) fn take_all(&mut self) -> [u64; CHANNELS] {
        self.take(|_| true)
    }

    /// Number of frames per channel.
    pub(crate) fn frames(&self) -> [u64; CHANNELS] {
        let mut sum = self.older;
        self.images.iter().for_each(|image| sum.add(image));
        sum.frames
    }

    fn take(&mut self, matches: impl Fn(&Image) -> bool) -> [u64; CHANNELS] {
        let mut sum = Image::default();
        for image in self.images.iter_mut().chain([&mut self.older]) {
            if matches(image) {
                sum.add(&std::mem::take(image));
            }
        }
        sum.frames
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_up_to_the_number_are_proven_once() {
        let mut unproven = UnprovenFrames::default();
        unproven.add(1, &[1, 0, 0, 0]);
        unproven.add(2, &[0; CHANNELS]);
        unproven.add(3, &[2, 5, 0, 0]);
        assert_eq!(unproven.prove(2), [1, 0, 0, 0]);
        assert_eq!(unproven.prove(2), [0; CHANNELS]);
        assert_eq!(unproven.frames(), [2, 5, 0, 0]);
        assert_eq!(unproven.prove(9), [2, 5, 0, 0]);
        assert_eq!(unproven.take_all(), [0; CHANNELS]);
    }

    #[test]
    fn old_images_are_proven_together() {
        let mut unproven = UnprovenFrames::default();
        for number in 1..=40 {
            unproven.add(number, &[1, 0, 0, 0]);
        }
        assert_eq!(unproven.frames()[0], 40);
        assert_eq!(unproven.prove(20)[0], 0, "24 images are one sum");
        assert_eq!(unproven.prove(30)[0], 30);
        assert_eq!(unproven.take_all()[0], 10);
    }
}
