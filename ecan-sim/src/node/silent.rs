use super::Node;

/// Sends nothing; its controller acknowledges frames.
#[derive(Clone, Copy, Debug, Default)]
pub struct SilentNode;

impl Node for SilentNode {
    fn try_clone(&self) -> Option<Box<dyn Node>> {
        Some(Box::new(*self))
    }
}
