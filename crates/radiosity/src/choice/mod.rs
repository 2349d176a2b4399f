//! Which procedure reaches a wanted error first.
//!
//! ```text
//! scene ─► pilot ─► expected time, memory, error of every candidate ─► the first within the budgets
//! ```
//!
//! A coarse solution (the [`Pilot`]) tells how smooth irradiance is and what pairs and rays take here, in counts; a [`Constants`] turns counts into seconds
//! ([`cost`](self)). A candidate is a whole procedure, which refines until its own a-posteriori estimate meets the tolerance: a wrong prediction costs time and
//! not accuracy (J. R. Rice, "The algorithm selection problem", Advances in Computers 15, 1976: features, algorithms, performance). The choice depends on counts and
//! constants alone, so that it is the same in every run and with any number of threads. What is *not* here: learning from runs.

mod candidates;
mod cost;
mod pilot;

use std::time::{Duration, Instant};

use radiosity_geometry::Scene;
use radiosity_geometry::mesh::MeshError;

use crate::{Bytes, RunError};

use candidates::candidates;
pub use candidates::{Candidate, Named, Reached, Refine, Steps, Target};
use cost::Model;
pub use cost::{Constants, Expected};
pub use pilot::Pilot;

/// Tolerances tried, coarsest first, where only time is given: powers of √2 down from this, so many.
const COARSEST: f64 = 0.1;
const TRIED: i32 = 16;

/// What is wanted of a solution.
#[derive(Clone, Debug, PartialEq)]
pub struct Wanted {
    /// rms error of irradiance over the report grid, relative to its mean; the best that the time allows if not given.
    pub tolerance: Option<f64>,
    /// Cells of the report grid along an edge of a face.
    pub report_grid: u32,
    /// Seconds that the run may take.
    pub time: Option<f64>,
    /// Bytes that the run may take.
    pub memory: Option<u64>,
    /// Elements beyond which nothing is refined.
    pub most_elements: usize,
    /// Seed of everything random.
    pub seed: u64,
    /// What was asked for by name.
    pub named: Named,
}

impl Wanted {
    /// A tolerance over 8 × 8 cells a face, without budgets.
    pub fn tolerance(tolerance: f64) -> Self {
        Self {
            tolerance: Some(tolerance),
            report_grid: 8,
            time: None,
            memory: None,
            most_elements: 40_000,
            seed: 1,
            named: Named::default(),
        }
    }
}

/// Why a candidate is not taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum WhyNot {
    /// Another is expected to be there sooner.
    Slower,
    /// It would take more memory than it may.
    Memory {
        /// Bytes allowed.
        limit: u64,
    },
    /// It would take longer than it may.
    Time {
        /// Seconds allowed.
        limit: f64,
    },
    /// Its first mesh would have more elements than it may have.
    Elements {
        /// Elements allowed.
        limit: usize,
    },
    /// It would not reach the tolerance with as many elements as it may have.
    Error {
        /// The tolerance.
        tolerance: f64,
    },
}

impl std::fmt::Display for WhyNot {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Slower => f.write_str("slower"),
            Self::Memory { limit } => write!(f, "more than the {} there are", Bytes(*limit)),
            Self::Time { limit } => write!(f, "longer than the {limit} s allowed"),
            Self::Elements { limit } => write!(f, "begins with more than {limit} elements"),
            Self::Error { tolerance } => write!(f, "does not reach {tolerance}"),
        }
    }
}

/// A candidate with what is expected of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Ranked {
    /// The procedure.
    pub candidate: Candidate,
    /// What it will take.
    pub expected: Expected,
    /// Why it is not the one; `None` of the chosen one alone.
    pub why_not: Option<WhyNot>,
}

/// A choice, with all that were to choose among.
#[derive(Clone, Debug)]
pub struct Choice {
    /// What the chosen procedure is to reach: the tolerance asked for, or the one that the time allows.
    pub target: Target,
    /// What the scene looks like.
    pub pilot: Pilot,
    /// All candidates: those within the budgets first, then the others; the sooner the earlier.
    pub ranking: Vec<Ranked>,
    /// Time that the choice took.
    pub time: Duration,
}

/// Why no candidate was chosen.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ChoiceError {
    /// Neither an error nor a time.
    #[error("a choice needs a tolerance, a time, or both")]
    NothingWanted,
    /// A budget that is none.
    #[error("the time is {value} s; it must be finite and positive")]
    Time {
        /// The value given.
        value: f64,
    },
    /// Nothing to choose among.
    #[error("no strategy that refines to a tolerance has the method, store and solver asked for")]
    NoneAgrees,
    /// No candidate fits the budgets.
    #[error("no strategy is expected to do that; nearest is '{nearest}', which takes about {:.2} s and {} to come to an error of {:.2e}, {why}", .expected.seconds, Bytes(.expected.peak_bytes), .expected.error)]
    NoneFits {
        /// The name of the nearest.
        nearest: &'static str,
        /// What it takes.
        expected: Box<Expected>,
        /// What it does not fit.
        why: WhyNot,
    },
    /// The pilot could not be run.
    #[error(transparent)]
    Run(#[from] RunError),
}

impl Choice {
    /// Looks at `scene` and ranks all candidates for what is wanted.
    ///
    /// # Errors
    ///
    /// [`ChoiceError`] if nothing that could be wanted is, no candidate agrees with what is named or fits, or the pilot fails.
    pub fn new(scene: &Scene, wanted: &Wanted, constants: &Constants) -> Result<Self, ChoiceError> {
        let clock = Instant::now();
        if let Some(value) = wanted.time.filter(|time| !(time.is_finite() && *time > 0.0)) {
            return Err(ChoiceError::Time { value });
        }
        let tolerances = match (wanted.tolerance, wanted.time) {
            (Some(value), _) if !(value > 0.0 && value < 1.0) => return Err(RunError::Tolerance { value }.into()),
            (Some(tolerance), _) => vec![tolerance],
            (None, Some(_)) => (0..TRIED).map(|k| COARSEST * 0.5_f64.powf(0.5 * f64::from(k))).collect(),
            (None, None) => return Err(ChoiceError::NothingWanted),
        };
        let target =
            |tolerance| Target { tolerance, report_grid: wanted.report_grid, most_elements: wanted.most_elements };
        let pilot = Pilot::new(scene, wanted.report_grid, wanted.seed)?;
        let model = Model::new(&pilot, constants);
        let rank = |tolerance| rank(scene, &model, &target(tolerance), wanted);
        // The finest that fits; the coarsest tells what is nearest if none does.
        let mut best = (tolerances[0], rank(tolerances[0])?);
        for &tolerance in &tolerances[1..] {
            let next = rank(tolerance)?;
            if next[0].why_not.is_some() {
                break;
            }
            best = (tolerance, next);
        }
        let (tolerance, ranking) = best;
        if let Ranked { candidate, expected, why_not: Some(why) } = &ranking[0] {
            let expected = Box::new(*expected);
            return Err(ChoiceError::NoneFits { nearest: candidate.name, expected, why: *why });
        }
        Ok(Self { target: target(tolerance), pilot, ranking, time: clock.elapsed() })
    }

    /// The chosen candidate.
    pub fn chosen(&self) -> &Ranked {
        &self.ranking[0]
    }
}

/// All candidates with what is expected of them, the chosen one first; without those of which not even a mesh can be foreseen, if there are others.
fn rank(scene: &Scene, model: &Model<'_>, target: &Target, wanted: &Wanted) -> Result<Vec<Ranked>, ChoiceError> {
    let all = candidates(target, model.pilot().blocking, (wanted.seed, wanted.memory), &wanted.named);
    let mut ranking = Vec::with_capacity(all.len());
    let mut too_many = None;
    for candidate in all {
        let expected = match model.expect(scene, &candidate, target) {
            Ok(expected) => expected,
            Err(error @ RunError::Mesh(MeshError::TooMany { .. })) => {
                too_many = Some(error);
                continue;
            }
            Err(error) => return Err(error.into()),
        };
        let memory = wanted.memory.filter(|&limit| expected.peak_bytes > limit);
        let time = wanted.time.filter(|&limit| expected.seconds > limit);
        let why_not = match (memory, time) {
            _ if expected.elements > target.most_elements as u64 && expected.rounds == 1 => {
                Some(WhyNot::Elements { limit: target.most_elements })
            }
            _ if expected.error > target.tolerance => Some(WhyNot::Error { tolerance: target.tolerance }),
            (Some(limit), _) => Some(WhyNot::Memory { limit }),
            (_, Some(limit)) => Some(WhyNot::Time { limit }),
            (None, None) => None,
        };
        ranking.push(Ranked { candidate, expected, why_not });
    }
    if ranking.is_empty() {
        return Err(too_many.map_or(ChoiceError::NoneAgrees, ChoiceError::Run));
    }
    // Nearest of those that do not fit is first what reaches the error, then what takes least time.
    let order = |ranked: &Ranked| match ranked.why_not {
        None => 0,
        Some(WhyNot::Error { .. } | WhyNot::Elements { .. }) => 2,
        Some(_) => 1,
    };
    ranking.sort_by(|a, b| order(a).cmp(&order(b)).then(a.expected.seconds.total_cmp(&b.expected.seconds)));
    let fits = ranking[0].why_not.is_none();
    for ranked in ranking.iter_mut().skip(1).filter(|ranked| fits && ranked.why_not.is_none()) {
        ranked.why_not = Some(WhyNot::Slower);
    }
    Ok(ranking)
}
