//! Power laws through measured points: the slope of a line in a log–log plot, with its interval.

use std::fmt;

/// y = c·xˢ, fitted by least squares of ln y on ln x.
///
/// ```text
/// s = Σ (u − ū)(v − v̄) / Σ (u − ū)²,   u = ln x, v = ln y
/// interval = t(0.975, n − 2) · √( Σ residual² / (n − 2) / Σ (u − ū)² )
/// ```
///
/// The interval is the half-width of the 95 % confidence interval of s, if the residuals of ln y are independent and
/// normal. Points of a deterministic count that bends away from a power law are neither: then it only says how
/// straight the points lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PowerLaw {
    /// Exponent s.
    pub slope: f64,
    /// Half-width of the 95 % interval of the slope; infinite with two points.
    pub interval: f64,
    /// ln c.
    pub log_factor: f64,
    /// Smallest and largest x that took part.
    pub range: (f64, f64),
    /// Points that took part.
    pub points: usize,
}

impl PowerLaw {
    /// Fits the points whose coordinates are finite and positive; `None` with fewer than two different x.
    pub fn through(points: impl IntoIterator<Item = (f64, f64)>) -> Option<Self> {
        let logs: Vec<(f64, f64)> = points
            .into_iter()
            .filter(|(x, y)| x.is_finite() && y.is_finite() && *x > 0.0 && *y > 0.0)
            .map(|(x, y)| (x.ln(), y.ln()))
            .collect();
        let n = logs.len() as f64;
        let (mean_u, mean_v) = logs.iter().fold((0.0, 0.0), |(a, b), (u, v)| (a + u / n, b + v / n));
        let s_uu: f64 = logs.iter().map(|(u, _)| (u - mean_u).powi(2)).sum();
        let s_uv: f64 = logs.iter().map(|(u, v)| (u - mean_u) * (v - mean_v)).sum();
        let (low, high) = logs.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), (u, _)| (a.min(*u), b.max(*u)));
        // Equal x leave only rounding in s_uu, and an empty set leaves low > high.
        if high <= low {
            return None;
        }
        let slope = s_uv / s_uu;
        let log_factor = mean_v - slope * mean_u;
        let freedom = logs.len() - 2;
        let interval = if freedom == 0 {
            f64::INFINITY
        } else {
            let squares: f64 = logs.iter().map(|(u, v)| (v - log_factor - slope * u).powi(2)).sum();
            student_quantile(freedom) * (squares / freedom as f64 / s_uu).sqrt()
        };
        Some(Self { slope, interval, log_factor, range: (low.exp(), high.exp()), points: logs.len() })
    }

    /// c·xˢ.
    pub fn at(&self, x: f64) -> f64 {
        (self.log_factor + self.slope * x.ln()).exp()
    }
}

impl fmt::Display for PowerLaw {
    /// `1.98 ± 0.04`: as many decimals as the interval deserves, two or three; `≈ 1.98` with two points.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = if !self.interval.is_finite() {
            format!("≈ {:.2}", self.slope)
        } else if self.interval < 5e-4 {
            format!("{:.3} ± <0.001", self.slope)
        } else {
            // One digit of the interval, two where the first is a 1.
            let power = self.interval.log10().floor();
            let digits = if self.interval / 10f64.powf(power) < 1.95 { 1.0 } else { 0.0 };
            let decimals = (digits - power).clamp(2.0, 3.0) as usize;
            format!("{:.decimals$} ± {:.decimals$}", self.slope, self.interval)
        };
        f.write_str(&text.replace('-', "−"))
    }
}

/// 0.975 quantile of Student's t distribution, within 0.001.
fn student_quantile(freedom: usize) -> f64 {
    const TABLE: [f64; 30] = [
        12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131,
        2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042,
    ];
    match freedom {
        0 => f64::INFINITY,
        1..=30 => TABLE[freedom - 1],
        // First two terms of the expansion about the normal quantile z (Cornish and Fisher).
        _ => {
            let (z, nu) = (1.959_964_f64, freedom as f64);
            z + (z.powi(3) + z) / (4.0 * nu) + (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / (96.0 * nu * nu)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Exact data leave rounding only: 1e-12 is 10⁴ times what 5 logarithms lose.
    #[test]
    fn an_exact_power_law_is_recovered() {
        let fit = PowerLaw::through([3.0, 10.0, 20.0, 70.0, 500.0].map(|x: f64| (x, 0.25 * x.powf(1.75)))).unwrap();
        assert!((fit.slope - 1.75).abs() < 1e-12, "{fit:?}");
        assert!(fit.interval < 1e-12, "{fit:?}");
        assert!((fit.at(50.0) - 0.25 * 50f64.powf(1.75)).abs() < 1e-9, "{fit:?}");
    }

    /// u = 0, 1, 2, 3 and v = 0, 1.1, 1.9, 3.2 (natural logarithms): s_uu = 5, s_uv = 5.2, Σ residual² = 0.042, worked by
    /// hand; so s = 1.04 and the interval is 4.303·√(0.021/5) = 0.27887, to the three decimals of the quantile.
    #[test]
    fn slope_and_interval_match_a_worked_example() {
        let points = [(0.0, 0.0), (1.0, 1.1), (2.0, 1.9), (3.0, 3.2)].map(|(u, v): (f64, f64)| (u.exp(), v.exp()));
        let fit = PowerLaw::through(points).unwrap();
        assert!((fit.slope - 1.04).abs() < 1e-12, "{fit:?}");
        assert!((fit.interval - 4.303 * (0.021f64 / 5.0).sqrt()).abs() < 1e-9, "{fit:?}");
        assert_eq!(fit.to_string(), "1.04 ± 0.28");
    }

    /// 95 % of the intervals hold the true slope; of 2,000 samples the share is within four standard errors (0.0195).
    #[test]
    fn the_interval_covers_the_true_slope_in_95_of_100_samples() {
        let mut state = 1_u64;
        // Twelve uniforms make a normal deviate well enough for a coverage of 95 %.
        let mut normal = || {
            let uniforms = (0..12).map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 11) as f64 / (1_u64 << 53) as f64
            });
            uniforms.sum::<f64>() - 6.0
        };
        let covered = (0..2000)
            .filter(|_| {
                let points = [1.0, 2.0, 4.0, 8.0, 16.0].map(|x: f64| (x, x.powf(-0.5) * (0.1 * normal()).exp()));
                let fit = PowerLaw::through(points).unwrap();
                (fit.slope + 0.5).abs() <= fit.interval
            })
            .count();
        assert!((covered as f64 / 2000.0 - 0.95).abs() < 0.0195, "{covered} of 2000");
    }

    #[test]
    fn two_points_have_a_slope_but_no_interval_and_one_point_has_neither() {
        let fit = PowerLaw::through([(1.0, 1.0), (10.0, 0.1), (0.0, 3.0), (5.0, f64::NAN)]).unwrap();
        assert_eq!((fit.points, fit.interval), (2, f64::INFINITY));
        assert_eq!(fit.to_string(), "≈ −1.00");
        assert_eq!(PowerLaw::through([(2.0, 1.0), (2.0, 3.0)]), None);
        assert_eq!(PowerLaw::through([]), None);
    }

    /// The expansion continues the table: t(0.975, 30) = 2.0423 from the expansion too, t(0.975, 100) = 1.9840.
    #[test]
    fn the_student_quantile_is_right_beyond_the_table() {
        assert!((student_quantile(100) - 1.9840).abs() < 1e-3);
        assert!((student_quantile(31) - 2.0395).abs() < 1e-3);
    }
}
