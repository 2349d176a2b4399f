//! Observers: a trace of every step, and snapshots at geometric steps.

use std::ops::ControlFlow;
use std::time::Duration;

use crate::{BandValues, Cost, Observer, Step};

/// One point of a [`Trace`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TracePoint {
    /// Steps done.
    pub step: u64,
    /// Time in the method so far.
    pub time: Duration,
    /// Spent so far.
    pub cost: Cost,
    /// η where known.
    pub unshot: Option<f64>,
}

/// Records every step.
#[derive(Clone, Debug, Default)]
pub struct Trace {
    /// The points, in order.
    pub points: Vec<TracePoint>,
}

impl Observer for Trace {
    fn observe(&mut self, step: &Step<'_>) -> ControlFlow<()> {
        self.points.push(TracePoint { step: step.number, time: step.time, cost: step.cost, unshot: step.unshot });
        ControlFlow::Continue(())
    }
}

/// The state of a run at one step, kept so that errors can be computed after the run.
#[derive(Clone, Debug)]
pub struct Snapshot {
    /// When and at what cost.
    pub at: TracePoint,
    /// x.
    pub shot: BandValues,
    /// r where the method had it.
    pub residual: Option<BandValues>,
}

/// Keeps a snapshot at step 0, 1 and then whenever the step number has grown by `ratio`.
#[derive(Clone, Debug)]
pub struct Snapshots {
    ratio: f64,
    next: f64,
    /// The snapshots, in order.
    pub taken: Vec<Snapshot>,
}

impl Snapshots {
    /// Snapshots at steps that grow by `ratio`.
    ///
    /// # Panics
    ///
    /// If `ratio` is not above 1.
    pub fn every(ratio: f64) -> Self {
        assert!(ratio > 1.0, "the ratio of steps must be above 1, got {ratio}");
        Self { ratio, next: 0.0, taken: Vec::new() }
    }
}

impl Observer for Snapshots {
    fn observe(&mut self, step: &Step<'_>) -> ControlFlow<()> {
        if step.number as f64 >= self.next {
            self.next = (step.number as f64 * self.ratio).max(step.number as f64 + 1.0).floor();
            self.taken.push(Snapshot {
                at: TracePoint { step: step.number, time: step.time, cost: step.cost, unshot: step.unshot },
                shot: step.iterate.shot.clone(),
                residual: step.iterate.residual.clone(),
            });
        }
        ControlFlow::Continue(())
    }
}
