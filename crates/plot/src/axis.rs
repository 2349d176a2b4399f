//! Limits of an axis, places on it and its ticks.

use super::Scale;
use crate::numbers::{significant, superscript};

/// An axis with its limits settled: maps values to [0, 1].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Span {
    scale: Scale,
    /// Ends, as logarithms to base 10 on a logarithmic axis.
    low: f64,
    high: f64,
}

/// A tick; without a label it is a small one.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tick {
    pub value: f64,
    pub label: Option<String>,
}

/// Share of the length left free at each end.
const PADDING: f64 = 0.05;

impl Span {
    /// An axis that shows `values` (those it can show) with some room, or exactly from `limits.0` to `limits.1`.
    pub(super) fn new(scale: Scale, limits: Option<(f64, f64)>, zero: bool, values: impl Iterator<Item = f64>) -> Self {
        let forward = |v: f64| if scale == Scale::Log { v.log10() } else { v };
        if let Some((low, high)) = limits {
            return Self { scale, low: forward(low), high: forward(high) };
        }
        let (mut low, mut high) = values
            .map(forward)
            .filter(|v| v.is_finite())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        // Bars on a logarithmic axis need some length, and no end of it is zero: a power of ten below the least.
        match scale {
            Scale::Linear if zero => (low, high) = (low.min(0.0), high.max(0.0)),
            Scale::Log if zero => low = (low - 0.15).floor(),
            _ => {}
        }
        // One value, or nearly so, gets some room on both sides: a factor of 1.6, or a tenth of itself.
        let (least, wanted) = match scale {
            Scale::Log => (0.4, 0.4),
            Scale::Linear => {
                let size = low.abs().max(high.abs()).max(f64::MIN_POSITIVE);
                (1e-6 * size, 0.2 * size)
            }
        };
        if high - low < least {
            let middle = (low + high) / 2.0;
            (low, high) = (middle - wanted / 2.0, middle + wanted / 2.0);
        }
        let room = PADDING * (high - low);
        let pinned = zero && (scale == Scale::Log || low == 0.0);
        Self { scale, low: if pinned { low } else { low - room }, high: high + room }
    }

    /// Whether the axis can show `value` at all.
    pub(super) fn shows(&self, value: f64) -> bool {
        value.is_finite() && (self.scale == Scale::Linear || value > 0.0)
    }

    /// Place of `value`: 0 at the low end, 1 at the high end. Values the axis cannot show are at its ends: zero and below
    /// at the low end, infinite and missing ones at the high end.
    pub(super) fn place(&self, value: f64) -> f64 {
        if !self.shows(value) {
            return if value <= 0.0 { 0.0 } else { 1.0 };
        }
        let v = if self.scale == Scale::Log { value.log10() } else { value };
        (v - self.low) / (self.high - self.low)
    }

    /// Ends as values.
    pub(super) fn ends(&self) -> (f64, f64) {
        match self.scale {
            Scale::Log => (10f64.powf(self.low), 10f64.powf(self.high)),
            Scale::Linear => (self.low, self.high),
        }
    }

    pub(super) fn is_log(&self) -> bool {
        self.scale == Scale::Log
    }

    /// Ticks, about `most` of them labelled at most.
    pub(super) fn ticks(&self, most: usize) -> Vec<Tick> {
        match self.scale {
            Scale::Log => self.log_ticks(most),
            Scale::Linear => self.linear_ticks(most),
        }
    }

    fn log_ticks(&self, most: usize) -> Vec<Tick> {
        let (first, last) = (self.low.floor() as i32, self.high.floor() as i32);
        let inside = |v: f64| (self.low..=self.high).contains(&v.log10());
        let decades = (first..=last).filter(|&e| inside(10f64.powi(e))).count();
        // Which multiples of a power of ten are labelled, and every how many powers.
        let count = |multiples: &[i32]| {
            let all = (first..=last).flat_map(|e| multiples.iter().map(move |&k| f64::from(k) * 10f64.powi(e)));
            all.filter(|&v| inside(v)).count()
        };
        let sets: [&[i32]; 2] = [&[1, 2, 3, 4, 5, 6, 7, 8, 9], &[1, 2, 5]];
        let short = self.high - self.low < 0.7;
        let set = sets.into_iter().skip(usize::from(!short)).find(|set| count(set) <= most.max(3));
        let labelled = set.filter(|_| decades <= 2).unwrap_or(&[1]);
        let every = decades.div_ceil(most.max(2)).max(1) as i32;
        let wanted = |e: i32, k: i32| labelled.contains(&k) && e.rem_euclid(every) == 0;
        let all = (first..=last).flat_map(|e| (1..=9).map(move |k| (e, k)));
        let all: Vec<(i32, i32)> = all.filter(|&(e, k)| inside(f64::from(k) * 10f64.powi(e))).collect();
        // Plain numbers where all of them are short.
        let plain = all.iter().filter(|&&(e, k)| wanted(e, k)).all(|&(e, _)| (-3..=3).contains(&e));
        let minor = every == 1 || decades <= 14;
        all.into_iter()
            .filter(|&(e, k)| wanted(e, k) || (minor && (k == 1 || every == 1)))
            .map(|(e, k)| {
                let value = f64::from(k) * 10f64.powi(e);
                let label = match (plain, k) {
                    (true, _) => format!("{:.*}", (-e).max(0) as usize, value),
                    (false, 1) => format!("10{}", superscript(e)),
                    (false, _) => format!("{k}·10{}", superscript(e)),
                };
                Tick { value, label: wanted(e, k).then_some(label) }
            })
            .collect()
    }

    fn linear_ticks(&self, most: usize) -> Vec<Tick> {
        let rough = (self.high - self.low) / most.max(2) as f64;
        let power = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|k| k * power).into_iter().find(|s| *s >= rough).unwrap_or(10.0 * power);
        let decimals = (-step.log10().floor()).max(0.0) as usize;
        let (first, last) = ((self.low / step).ceil() as i64, (self.high / step).floor() as i64);
        let largest = self.low.abs().max(self.high.abs());
        (first..=last)
            .map(|k| {
                let value = k as f64 * step;
                let label = if (1e-3..1e5).contains(&largest) {
                    format!("{value:.decimals$}").replace('-', "−")
                } else {
                    significant(value, 2)
                };
                Tick { value, label: Some(label) }
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(scale: Scale, low: f64, high: f64) -> Vec<String> {
        Span::new(scale, Some((low, high)), false, std::iter::empty())
            .ticks(7)
            .into_iter()
            .filter_map(|t| t.label)
            .collect()
    }

    #[test]
    fn logarithmic_ticks_are_readable_at_every_span() {
        assert_eq!(labels(Scale::Log, 0.02, 300.0), ["0.1", "1", "10", "100"]);
        assert_eq!(labels(Scale::Log, 2e-7, 3e-4), ["10⁻⁶", "10⁻⁵", "10⁻⁴"]);
        assert_eq!(labels(Scale::Log, 30.0, 600.0), ["50", "100", "200", "500"]);
        assert_eq!(labels(Scale::Log, 1.5e-5, 4.4e-5), ["2·10⁻⁵", "3·10⁻⁵", "4·10⁻⁵"]);
        assert_eq!(labels(Scale::Log, 1e-15, 1.0), ["10⁻¹⁵", "10⁻¹²", "10⁻⁹", "10⁻⁶", "10⁻³", "10⁰"]);
    }

    #[test]
    fn linear_ticks_are_round_numbers() {
        assert_eq!(labels(Scale::Linear, -0.3, 1.1), ["−0.2", "0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(labels(Scale::Linear, 0.0, 512.0), ["0", "100", "200", "300", "400", "500"]);
        assert_eq!(labels(Scale::Linear, 0.0, 2.0e6), ["0", "5.0·10⁵", "1.0·10⁶", "1.5·10⁶", "2.0·10⁶"]);
    }

    #[test]
    fn values_an_axis_cannot_show_are_at_its_ends() {
        let span = Span::new(Scale::Log, None, false, [1.0, 100.0, f64::NAN, 0.0, f64::INFINITY].into_iter());
        assert_eq!([0.0, f64::NAN, f64::INFINITY].map(|v| span.place(v)), [0.0, 1.0, 1.0]);
        assert!((span.place(10.0) - 0.5).abs() < 1e-12, "the middle of 1 and 100 is 10");
    }
}
