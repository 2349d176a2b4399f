//! How many points a separated pair needs: a proven bound of the error of Gauss rules, one direction at a time.
//!
//! Along one direction of one patch, all else fixed, x moves on a line. With its half length h, D the distance from its
//! middle to y, γ the angle between the line and the way to y, and σ = h/D, the kernel
//!
//! ```text
//! 1/|x − y|⁴ = D⁻⁴ (1 − 2σ s cos γ + σ² s²)⁻² = D⁻⁴ Σ C_k(cos γ) σᵏ sᵏ
//! ```
//!
//! is the generating function of the Gegenbauer polynomials C_k = C_k⁽²⁾. With U_n(cos γ) = sin((n + 1)γ)/sin γ,
//! C_k = ½ U'_{k+1}, so that
//!
//! ```text
//! |C_k(cos γ)| ≤ min{ (k + 1)(k + 2)(k + 3)/6,  ½ [(k + 2)/sin²γ + |cos γ|/|sin γ|³] }
//! ```
//!
//! of which the first is the value at γ = 0, and the second 6 to 30 times smaller where a patch is seen from the front. h_i(y)
//! does not depend on s; h_j and the Jacobian are linear in s, with slopes of at most g (per unit s) and κ (relative to
//! the mean). So the rule of q points errs by at most
//!
//! ```text
//! A_i A_j N_i / (π D⁴) · Σ_{k ≥ 2q, even} e_qk [ N_j |C_k| σᵏ + (g + κ N_j) |C_{k−1}| σᵏ⁻¹ + κ g |C_{k−2}| σᵏ⁻² ]
//! ```
//!
//! where e_qk ≥ 0 is the rule's error on the mean of sᵏ, and N_i, N_j are the largest h_i and h_j. Sums over k are power
//! series in σ² with positive terms, hence convex: the chord from σ = 0 to [`SIGMA_LIMIT`] lies above them. Weights are positive
//! and sum to the area, so the errors of the four directions add up to a bound of the whole.
//!
//! The range of γ over a pair: the way from a middle x₀ to y differs from that between the centres, R, by at most ρ, the
//! radius of one patch and the half width of the other, so its direction by at most ε with sin ε = ρ/R.

use pulp::Simd;

use super::gauss::MAX_ORDER;
use super::lanes::Lane;

/// Largest σ for which [`SERIES`] holds.
const SIGMA_LIMIT: f64 = 0.4;
/// Below this sin²γ the first bound of |C_k| is the smaller for every k that counts.
const LEAST_SINE: f64 = 1e-6;

/// One direction of a patch, as the bound sees it.
#[derive(Clone, Copy)]
pub(super) struct Line<S: Simd> {
    /// A_i A_j N_i / π.
    pub scale: Lane<S>,
    /// Half length h.
    pub half: Lane<S>,
    /// Least distance D of a middle from the partner.
    pub distance: Lane<S>,
    /// |cos γ| at the centres.
    pub cosine: Lane<S>,
    /// sin ε, and with it the largest turn of a line against the one through the centre.
    pub spread: Lane<S>,
    /// N_j.
    pub top: Lane<S>,
    /// g.
    pub slope: Lane<S>,
    /// κ.
    pub kappa: Lane<S>,
}

/// Orders of four directions (0 where none is high enough) and what they leave as error.
pub(super) struct Orders<S: Simd> {
    pub q: [Lane<S>; 4],
    pub bound: Lane<S>,
}

/// What [`Line`] amounts to, ready for one order after another.
#[derive(Clone, Copy)]
struct Series<S: Simd> {
    sigma: Lane<S>,
    z: Lane<S>,
    /// 1/(2 sin²γ) and |cot γ|, both at least what they are anywhere in the pair.
    envelope: (Lane<S>, Lane<S>),
    top: Lane<S>,
    slope: Lane<S>,
    /// κ g.
    twist: Lane<S>,
    /// Scale times σ^(2q − 2).
    power: Lane<S>,
}

impl<S: Simd> Series<S> {
    #[inline(always)]
    fn new(line: &Line<S>) -> Self {
        let Line { distance, cosine, spread, .. } = *line;
        let one = distance.all(1.0);
        // sin²(γ − ε) ≥ sin²γ cos²ε − 2 cos γ sin ε, and cos(γ − ε) ≤ cos γ + sin ε.
        let sine2 = (one - cosine * cosine) * (one - spread * spread) - (cosine + cosine) * spread;
        let sine2 = sine2.max(one.all(LEAST_SINE));
        // Two quotients for one division.
        let inverse = one / (distance * sine2);
        let (near, g) = (inverse * sine2, inverse * distance);
        // 1/sin γ ≤ ½ (1 + 1/sin²γ).
        let cot = (cosine + spread).min(one) * (g + one) * one.all(0.5);
        let sigma = line.half * near;
        let near2 = near * near;
        Self {
            sigma,
            z: sigma * sigma,
            envelope: (g * one.all(0.5), cot),
            top: line.top,
            slope: line.kappa.fma(line.top, line.slope),
            twist: line.kappa * line.slope,
            power: line.scale * (near2 * near2),
        }
    }

    /// Bound of the rule whose constants are `series`.
    #[inline(always)]
    fn bound<const TWISTED: bool>(&self, series: &[[f64; 2]; 5]) -> Lane<S> {
        let linear = (self.top * self.sum(series, 0)).fma(self.sigma, self.slope * self.sum(series, 1));
        if TWISTED {
            linear.fma(self.sigma, self.twist * self.sum(series, 2)) * self.power
        } else {
            linear * self.sigma * self.power
        }
    }

    /// Σ e_qk |C_{k−l}| σ^{k−2q}, by the smaller of both bounds.
    #[inline(always)]
    fn sum(&self, series: &[[f64; 2]; 5], l: usize) -> Lane<S> {
        let (f, cot) = self.envelope;
        let [t, slope] = series[3];
        // (k + 2 − l)/sin²γ: the leading term of Σ e_qk σᵏ, here rounded down, is less than the sum.
        let t = t - l as f64 * 0.999_99 * series[4][0];
        self.chord(series[l]).min(cot.fma(self.chord(series[4]), self.chord([t, slope])) * f)
    }

    #[inline(always)]
    fn chord(&self, [at_zero, slope]: [f64; 2]) -> Lane<S> {
        self.z.fma(self.z.all(slope), self.z.all(at_zero))
    }
}

/// Least orders whose bounds are below `target` a direction; lanes in which `idle` is not 0 need none.
#[inline(always)]
pub(super) fn orders<S: Simd, const TWISTED: bool>(lines: &[Line<S>; 4], target: Lane<S>, idle: Lane<S>) -> Orders<S> {
    let (zero, one) = (target.all(0.0), target.all(1.0));
    let [a, b, c, d] = lines;
    let mut series = [Series::new(a), Series::new(b), Series::new(c), Series::new(d)];
    let mut found = Orders { q: [idle; 4], bound: zero };
    // One point is rarely enough: Σ e_qk |C_k| σᵏ is more than ⅔ σ² then, which costs less to look at.
    let mut easiest = target + target;
    for series in &series {
        easiest = easiest.min(series.top * series.z * series.power);
    }
    let hopeless = easiest.at_most(target * one.all(1.5)).select(idle, one).least() > 0.0;
    if hopeless {
        for series in &mut series {
            series.power = series.power * series.z;
        }
    }
    for (q, constants) in (1..=MAX_ORDER).zip(&SERIES).skip(usize::from(hopeless)) {
        let q = one.all(q as f64);
        let mut least = one;
        for (series, found_q) in series.iter_mut().zip(&mut found.q) {
            let bound = series.bound::<TWISTED>(constants);
            let reaches = bound
                .at_most(target)
                .and(found_q.at_most(zero))
                .and(series.z.at_most(one.all(SIGMA_LIMIT * SIGMA_LIMIT)));
            *found_q = reaches.select(q, *found_q);
            found.bound = found.bound + reaches.select(bound, zero);
            least = least.min(*found_q);
            series.power = series.power * series.z;
        }
        if least.least() > 0.0 {
            break;
        }
    }
    found
}

/// For q = 1..=8 the sums over even k ≥ 2q of e_qk σ^{k−2q} c_k, c_{k−1}, c_{k−2}, k + 2 and 1: value at σ = 0, and slope in σ² of
/// the chord to [`SIGMA_LIMIT`]; c_k = (k + 1)(k + 2)(k + 3)/6. Six digits, rounded up.
#[rustfmt::skip]
static SERIES: [[[f64; 2]; 5]; MAX_ORDER] = [
    [[3.33334, 9.52471], [1.33334, 5.72653], [0.333334, 3.11882], [1.33334, 1.41661], [0.333334, 0.226133]],
    [[3.11112, 12.3095], [1.77778, 8.45426], [0.888889, 5.51123], [0.533334, 1.03641], [0.0888889, 0.124205]],
    [[1.92001, 9.41258], [1.28001, 6.99872], [0.800001, 5.04161], [0.182858, 0.505044], [0.0228572, 0.0482979]],
    [[0.957824, 5.62924], [0.696599, 4.40616], [0.48762, 3.37601], [0.0580499, 0.209626], [0.00580499, 0.016686]],
    [[0.419251, 2.90596], [0.322501, 2.35822], [0.241876, 1.88457], [0.0175909, 0.0795051], [0.00146591, 0.00541988]],
    [[0.167913, 1.35679], [0.134331, 1.131], [0.105546, 0.931926], [0.00516656, 0.028421], [0.00036904, 0.00169405]],
    [[0.0630585, 0.58857], [0.0519305, 0.500898], [0.0421935, 0.422451], [0.00148373, 0.00974033], [9.2733e-05, 0.000515722]],
    [[0.0225527, 0.241333], [0.0189918, 0.208802], [0.0158265, 0.179351], [0.000418935, 0.00323426], [2.32742e-05, 0.000154021]],
];

#[cfg(test)]
mod tests {
    use super::super::gauss::gauss;
    use super::*;

    /// C_k⁽²⁾(x) by the recurrence k C_k = 2 (k + 1) x C_{k−1} − (k + 2) C_{k−2}.
    fn gegenbauer(x: f64, count: usize) -> Vec<f64> {
        let mut c = vec![1.0, 4.0 * x];
        for k in 2..count {
            c.push((2.0 * (k as f64 + 1.0) * x * c[k - 1] - (k as f64 + 2.0) * c[k - 2]) / k as f64);
        }
        c
    }

    /// Both bounds of |C_k|, and that the second is reached within a third for some angle of every k: 1e-12 for the recurrence.
    #[test]
    fn gegenbauer_polynomials_keep_their_bounds() {
        let mut closest = [0.0_f64; 24];
        for step in 1..1000 {
            let gamma = f64::from(step) * std::f64::consts::PI / 1000.0;
            let (s, c) = gamma.sin_cos();
            for (k, value) in gegenbauer(c, 24).into_iter().enumerate() {
                let k_f = k as f64;
                let largest = (k_f + 1.0) * (k_f + 2.0) * (k_f + 3.0) / 6.0;
                let envelope = 0.5 * ((k_f + 2.0) / (s * s) + c.abs() / s.powi(3));
                assert!(value.abs() <= largest.min(envelope) * (1.0 + 1e-12), "k = {k}, angle {gamma}");
                closest[k] = closest[k].max(value.abs() / envelope);
            }
        }
        assert!(closest.iter().all(|ratio| *ratio > 0.67), "{closest:?}");
    }

    /// The chords against the sums by their definition, from σ = 0 to the limit: above, and at both ends within 1e-4 (six
    /// digits of the value at 0 and of the slope).
    #[test]
    fn series_constants_lie_above_the_sums_they_stand_for() {
        let c = |k: i32| if k < 0 { 0.0 } else { f64::from((k + 1) * (k + 2) * (k + 3)) / 6.0 };
        for q in 1..=MAX_ORDER {
            let (x, w) = gauss(q);
            for step in 0..=8 {
                let sigma = SIGMA_LIMIT * f64::from(step) / 8.0;
                let mut sums = [0.0; 5];
                for k in (2 * q as i32..160).step_by(2) {
                    let rule: f64 = x.iter().zip(w).map(|(x, w)| w * x.powi(k)).sum();
                    let e = (1.0 / f64::from(k + 1) - rule) * sigma.powi(k - 2 * q as i32);
                    let factors = [c(k), c(k - 1), c(k - 2), f64::from(k + 2), 1.0];
                    sums.iter_mut().zip(factors).for_each(|(sum, factor)| *sum += e * factor);
                }
                for (l, (sum, [at_zero, slope])) in sums.iter().zip(SERIES[q - 1]).enumerate() {
                    let chord = at_zero + slope * sigma * sigma;
                    assert!(chord >= sum * (1.0 - 1e-9), "order {q}, {l}, σ = {sigma}: {chord} {sum}");
                    assert!(step % 8 != 0 || chord <= sum * (1.0 + 1e-4), "order {q}, {l}, σ = {sigma}: {chord} {sum}");
                }
            }
        }
    }
}
