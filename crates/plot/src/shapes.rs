//! What a laid-out figure consists of, in points (1/96 inch) from the upper left corner.

use crate::palette::{Marker, Rgb};

/// Where a text stands relative to its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Align {
    /// It begins there.
    Left,
    /// Its middle is there.
    Centre,
    /// It ends there.
    Right,
}

/// One thing to draw.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A line through points.
    Line {
        /// Its points.
        points: Vec<(f64, f64)>,
        /// Its width.
        width: f64,
        /// Its colour.
        colour: Rgb,
    },
    /// A filled polygon.
    Polygon {
        /// Its corners.
        points: Vec<(f64, f64)>,
        /// Its colour.
        colour: Rgb,
    },
    /// A data point.
    Mark {
        /// Its centre.
        at: (f64, f64),
        /// Its shape.
        marker: Marker,
        /// Its colour.
        colour: Rgb,
        /// White inside: a run that was stopped early.
        hollow: bool,
    },
    /// A tip between a mark and the edge its value lies beyond.
    Arrow {
        /// Centre of the mark.
        at: (f64, f64),
        /// Direction along x and y, each −1, 0 or 1.
        towards: (f64, f64),
        /// Its colour.
        colour: Rgb,
    },
    /// The cross over a failed run.
    Cross {
        /// Its centre.
        at: (f64, f64),
        /// Its colour.
        colour: Rgb,
    },
    /// A line of text.
    Text {
        /// On the baseline.
        at: (f64, f64),
        /// What it says.
        text: String,
        /// Size of the em square.
        size: f64,
        /// Its colour.
        colour: Rgb,
        /// Which part of it is at `at`.
        align: Align,
        /// Reads upwards.
        vertical: bool,
    },
}

/// A laid-out figure.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawing {
    /// Width in points.
    pub width: f64,
    /// Height in points.
    pub height: f64,
    /// In painting order.
    pub shapes: Vec<Shape>,
}

impl Shape {
    /// A horizontal text.
    pub(super) fn text(at: (f64, f64), text: impl Into<String>, size: f64, colour: Rgb, align: Align) -> Self {
        Self::Text { at, text: text.into(), size, colour, align, vertical: false }
    }

    /// A line between two points.
    pub(super) fn line(a: (f64, f64), b: (f64, f64), width: f64, colour: Rgb) -> Self {
        Self::Line { points: vec![a, b], width, colour }
    }

    /// A filled rectangle with corners `a` and `b`.
    pub(super) fn rectangle(a: (f64, f64), b: (f64, f64), colour: Rgb) -> Self {
        Self::Polygon { points: vec![a, (b.0, a.1), b, (a.0, b.1)], colour }
    }
}

/// Corners of a marker of about the area of a circle of radius `r`; none for the circle itself.
pub(super) fn corners(marker: Marker, r: f64) -> Vec<(f64, f64)> {
    // Corners on circles, the first at `start` turns from the top.
    let around = |radii: &[f64], corners: usize, start: f64| -> Vec<(f64, f64)> {
        let corner = |k: usize| {
            let angle = std::f64::consts::TAU * (k as f64 / corners as f64 + start);
            let radius = radii[k % radii.len()];
            (radius * angle.sin(), -radius * angle.cos())
        };
        (0..corners).map(corner).collect()
    };
    match marker {
        Marker::Circle => Vec::new(),
        Marker::Square => around(&[1.25 * r], 4, 0.125),
        Marker::Diamond => around(&[1.3 * r], 4, 0.0),
        Marker::Triangle => around(&[1.45 * r], 3, 0.0),
        Marker::Wedge => around(&[1.45 * r], 3, 0.5),
        Marker::Pentagon => around(&[1.2 * r], 5, 0.0),
        Marker::Star => around(&[1.55 * r, 0.68 * r], 10, 0.0),
        Marker::Plus => {
            let (a, b) = (1.3 * r, 0.45 * r);
            let arm = [(-b, -a), (b, -a), (b, -b)];
            let turned = |k: usize| {
                arm.iter().map(move |&(x, y)| match k {
                    0 => (x, y),
                    1 => (-y, x),
                    2 => (-x, -y),
                    _ => (y, -x),
                })
            };
            (0..4).flat_map(turned).collect()
        }
    }
}

/// A line cut into dashes of length `on` with gaps of length `off`.
pub(super) fn dashes(points: &[(f64, f64)], on: f64, off: f64) -> Vec<Vec<(f64, f64)>> {
    let mut pieces = Vec::new();
    let mut piece: Vec<(f64, f64)> = points.first().copied().into_iter().collect();
    let (mut drawing, mut left) = (true, on);
    for pair in points.windows(2) {
        let ((x0, y0), (x1, y1)) = (pair[0], pair[1]);
        let length = (x1 - x0).hypot(y1 - y0);
        let mut done = 0.0;
        while length - done > left {
            done += left;
            let at = (x0 + (x1 - x0) * done / length, y0 + (y1 - y0) * done / length);
            if drawing {
                piece.push(at);
                pieces.push(std::mem::take(&mut piece));
            } else {
                piece = vec![at];
            }
            drawing = !drawing;
            left = if drawing { on } else { off };
        }
        left -= length - done;
        if drawing {
            piece.push((x1, y1));
        }
    }
    if drawing && piece.len() > 1 {
        pieces.push(piece);
    }
    pieces
}

/// The parts of a line inside the rectangle from `low` to `high` (Liang and Barsky, segment by segment).
pub(super) fn clip(points: &[(f64, f64)], low: (f64, f64), high: (f64, f64)) -> Vec<Vec<(f64, f64)>> {
    let mut pieces: Vec<Vec<(f64, f64)>> = Vec::new();
    for pair in points.windows(2) {
        let ((x0, y0), (x1, y1)) = (pair[0], pair[1]);
        let (dx, dy) = (x1 - x0, y1 - y0);
        let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
        for (p, q) in [(-dx, x0 - low.0), (dx, high.0 - x0), (-dy, y0 - low.1), (dy, high.1 - y0)] {
            match p {
                _ if p < 0.0 => enter = enter.max(q / p),
                _ if p > 0.0 => leave = leave.min(q / p),
                _ if q < 0.0 => leave = f64::NEG_INFINITY,
                _ => {}
            }
        }
        if enter > leave {
            continue;
        }
        let (a, b) = ((x0 + enter * dx, y0 + enter * dy), (x0 + leave * dx, y0 + leave * dy));
        match pieces.last_mut() {
            Some(piece) if enter == 0.0 && piece.last() == Some(&a) => piece.push(b),
            _ => pieces.push(vec![a, b]),
        }
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lengths are sums of a few numbers of size 10: 1e-12 is rounding.
    #[test]
    fn dashes_cover_their_share_of_a_bent_line() {
        let pieces = dashes(&[(0.0, 0.0), (7.0, 0.0), (7.0, 9.0)], 3.0, 2.0);
        let length = |piece: &Vec<(f64, f64)>| -> f64 {
            piece.windows(2).map(|p| (p[1].0 - p[0].0).hypot(p[1].1 - p[0].1)).sum()
        };
        assert_eq!(pieces.len(), 4);
        assert!((pieces.iter().map(length).sum::<f64>() - 10.0).abs() < 1e-12, "16 = 3 · (3 + 2) + 1");
        assert_eq!(pieces[1], [(5.0, 0.0), (7.0, 0.0), (7.0, 1.0)]);
    }

    #[test]
    fn a_line_that_leaves_and_returns_is_cut_in_two() {
        let pieces = clip(&[(1.0, 1.0), (1.0, 5.0), (3.0, 5.0), (3.0, 1.0)], (0.0, 0.0), (4.0, 3.0));
        assert_eq!(pieces, [vec![(1.0, 1.0), (1.0, 3.0)], vec![(3.0, 3.0), (3.0, 1.0)]]);
        assert!(clip(&[(-1.0, 5.0), (9.0, 5.0)], (0.0, 0.0), (4.0, 3.0)).is_empty());
    }
}
