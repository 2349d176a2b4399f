//! Gauss–Legendre quadrature, plain and graded towards the ends.

use std::f64::consts::PI;

/// Nodes in (0, 1) and weights of the q-point Gauss–Legendre rule, exact for polynomials of degree 2q − 1.
///
/// Newton's method on the Legendre polynomial (W. H. Press et al., *Numerical Recipes*, section 4.6).
///
/// # Panics
///
/// If q is 0.
pub fn gauss(q: usize) -> Vec<(f64, f64)> {
    assert!(q > 0, "a rule needs a node");
    (0..q)
        .map(|k| {
            let mut x = (PI * (k as f64 + 0.75) / (q as f64 + 0.5)).cos();
            let mut slope = 1.0;
            // Quadratic convergence from a guess that is right to 1/q²: six steps reach rounding for any q.
            for _ in 0..6 {
                let (mut p, mut previous) = (1.0, 0.0);
                for j in 0..q {
                    let j = j as f64;
                    (p, previous) = (((2.0 * j + 1.0) * x * p - j * previous) / (j + 1.0), p);
                }
                slope = q as f64 * (x * p - previous) / (x * x - 1.0);
                x -= p / slope;
            }
            (0.5 * (1.0 - x), 1.0 / ((1.0 - x * x) * slope * slope))
        })
        .collect()
}

/// A rule on (0, 1) graded towards both ends by t³(10 − 15t + 6t²): for functions that are bounded but not smooth
/// there, such as an irradiance where three walls meet.
pub fn graded(q: usize) -> Vec<(f64, f64)> {
    let map = |(t, w): (f64, f64)| {
        let slope = 30.0 * (t * (1.0 - t)).powi(2);
        (t.powi(3) * (10.0 - 15.0 * t + 6.0 * t * t), w * slope)
    };
    gauss(q).into_iter().map(map).collect()
}

/// Mean over the rectangle `u` × `v` of a function, by the product of a rule with itself.
pub fn mean(rule: &[(f64, f64)], u: [f64; 2], v: [f64; 2], f: impl Fn(f64, f64) -> f64) -> f64 {
    let at = |[from, to]: [f64; 2], t: f64| from + (to - from) * t;
    let row = |v: f64| -> f64 { rule.iter().map(|&(t, w)| w * f(at(u, t), v)).sum() };
    rule.iter().map(|&(t, w)| w * row(at(v, t))).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn q_points_integrate_degree_2q_minus_1() {
        for q in [1, 2, 5, 16, 31] {
            let degree = 2 * q as i32 - 1;
            let integral: f64 = gauss(q).iter().map(|(x, w)| w * x.powi(degree)).sum();
            assert!((integral - 1.0 / (degree as f64 + 1.0)).abs() < 1e-15, "{q} points");
        }
    }

    #[test]
    fn a_graded_rule_integrates_a_root() {
        // √t becomes a smooth power near the end; a plain rule of 16 points is off by 1e-4.
        let integral: f64 = graded(16).iter().map(|(x, w)| w * x.sqrt()).sum();
        assert!((integral - 2.0 / 3.0).abs() < 1e-9);
    }
}
