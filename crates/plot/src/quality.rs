//! How far the points of a figure may be trusted.

/// How far a run may be trusted, from its outcome.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Quality {
    /// It reached what was asked: a filled mark.
    Good,
    /// It was stopped or stuck before, its value is real: a hollow mark.
    Limited,
    /// It gave nothing to rely on: a crossed mark.
    Failed,
}

impl Quality {
    /// Of the text in column `outcome`; no text counts as good, an unknown text as failed.
    pub fn of_outcome(outcome: &str) -> Self {
        match outcome {
            "" | "converged" | "done" | "exact" => Self::Good,
            "stagnated" | "step limit" | "time limit" | "memory limit" | "cancelled" => Self::Limited,
            _ => Self::Failed,
        }
    }
}
