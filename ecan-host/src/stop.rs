//! Giving up a wait at the application's wish.

use std::fmt;

use crate::adapter::Adapter;

/// Asks the application whether it still wants to wait.
pub(crate) struct StopCheck(Box<dyn Fn() -> bool + Send>);

impl fmt::Debug for StopCheck {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("StopCheck")
    }
}

impl Adapter {
    /// Has calls that wait by running the cycle ask `stop` once in every cycle, and end with an error
    /// when it says true: a signal came, a button was pressed. `None` asks no more.
    ///
    /// The layers above ask the same. What ends axes in order is not given up.
    pub fn stop_waiting_when(&mut self, stop: Option<Box<dyn Fn() -> bool + Send>>) {
        self.stop = stop.map(StopCheck);
    }

    /// Whether the application wants calls that wait to end.
    pub fn should_stop(&self) -> bool {
        self.stop.as_ref().is_some_and(|stop| (stop.0)())
    }
}
