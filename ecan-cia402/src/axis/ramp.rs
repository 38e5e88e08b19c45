//! Targets that the host makes itself: constant steps with a ramp at both ends.

/// A step per cycle that changes only so fast.
///
/// Drives [`send_target_step`](super::Cia402::send_target_step), halt and shutdown. Integers all
/// the path: no drift, the same on every machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Ramp {
    step: i64,
    change: u32,
}

impl Ramp {
    /// At rest. `change` is how much the step may change from cycle to cycle; 0 counts as 1.
    pub fn new(change: u32) -> Self {
        Self { step: 0, change: change.max(1) }
    }

    /// The present step.
    pub fn step(&self) -> i64 {
        self.step
    }

    /// The step of the next cycle on the way to `goal`. The ramp only moves on with
    /// [`accept`](Self::accept), when the target went out.
    pub fn next(&self, goal: i64) -> i64 {
        let change = i64::from(self.change);
        let difference = goal.saturating_sub(self.step).clamp(-change, change);
        self.step.saturating_add(difference)
    }

    /// A step was made, by the ramp or by someone else.
    pub fn accept(&mut self, step: i64) {
        self.step = step;
    }

    /// Nothing moves any more.
    pub fn stop(&mut self) {
        self.step = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(ramp: &mut Ramp, goal: i64, cycles: usize) -> Vec<i64> {
        (0..cycles)
            .map(|_| {
                let step = ramp.next(goal);
                ramp.accept(step);
                step
            })
            .collect()
    }

    #[test]
    fn ramp_rises_and_falls_by_its_change() {
        let mut ramp = Ramp::new(30);
        assert_eq!(run(&mut ramp, 100, 5), [30, 60, 90, 100, 100]);
        assert_eq!(run(&mut ramp, 0, 5), [70, 40, 10, 0, 0]);
        assert_eq!(run(&mut ramp, -40, 3), [-30, -40, -40]);
    }

    #[test]
    fn unsent_step_does_not_advance_the_ramp() {
        let mut ramp = Ramp::new(10);
        assert_eq!([ramp.next(100), ramp.next(100)], [10, 10]);
        ramp.accept(10);
        assert_eq!(ramp.next(100), 20);
        ramp.stop();
        assert_eq!(ramp.next(0), 0);
    }

    #[test]
    fn ramp_saturates_at_any_goal() {
        let mut ramp = Ramp::new(u32::MAX);
        ramp.accept(i64::MAX);
        assert!(ramp.next(i64::MIN) < i64::MAX);
        ramp.accept(i64::MIN);
        assert!(ramp.next(i64::MAX) > i64::MIN);
    }
}
