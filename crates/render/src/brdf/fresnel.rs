//! Exact Fresnel equations for unpolarised light.

/// Reflectance of a smooth boundary, and the cosine of the refracted direction.
///
/// With θ the angle of the ray and n the index beyond the boundary over that before it, sinθ_t = sinθ/n,
///
/// ```text
/// F = ½ [ ((cosθ − n cosθ_t)/(cosθ + n cosθ_t))² + ((cosθ_t − n cosθ)/(cosθ_t + n cosθ))² ]
/// ```
///
/// and (1, 0) at total internal reflection. `cos` lies in [0, 1], `n` is positive.
pub fn dielectric(cos: f64, n: f64) -> (f64, f64) {
    let cos_t_squared = 1.0 - (1.0 - cos * cos) / (n * n);
    if cos_t_squared <= 0.0 {
        return (1.0, 0.0);
    }
    let cos_t = cos_t_squared.sqrt();
    let (s, p) = ((cos - n * cos_t) / (cos + n * cos_t), (cos_t - n * cos) / (cos_t + n * cos));
    (0.5 * (s * s + p * p), cos_t)
}

/// Reflectance of a conductor of index η + iκ towards the outside, for unpolarised light at the angle of cosine `cos`.
///
/// ```text
/// a² + b² = √((η² − κ² − sin²θ)² + 4η²κ²),      a = √(½ (a² + b² + η² − κ² − sin²θ)),
/// R_s = (a² + b² − 2a cosθ + cos²θ) / (a² + b² + 2a cosθ + cos²θ),
/// R_p = R_s · (cos²θ (a² + b²) − 2a cosθ sin²θ + sin⁴θ) / (cos²θ (a² + b²) + 2a cosθ sin²θ + sin⁴θ),      F = ½ (R_s + R_p)
/// ```
///
/// (Born and Wolf 1999, section 14.2).
pub fn conductor(cos: f64, eta: f64, kappa: f64) -> f64 {
    let (c2, s2) = (cos * cos, (1.0 - cos * cos).max(0.0));
    let t = eta * eta - kappa * kappa - s2;
    let sum = t.hypot(2.0 * eta * kappa);
    let a = (0.5 * (sum + t)).max(0.0).sqrt();
    let r_s = (sum + c2 - 2.0 * a * cos) / (sum + c2 + 2.0 * a * cos);
    let (x, y) = (c2 * sum + s2 * s2, 2.0 * a * cos * s2);
    let r_p = r_s * (x - y) / (x + y);
    // At grazing angles both are 1, and a = cos = 0 makes no number of them.
    if r_p.is_nan() { 1.0 } else { 0.5 * (r_s + r_p) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// ((n − 1)/(n + 1))² at normal incidence; at Brewster's angle, tanθ = n, all that is reflected is polarised: F = ½ ((n² − 1)/(n² + 1))².
    #[test]
    fn dielectrics_have_their_normal_reflectance_and_brewsters() {
        for n in [1.33, 1.5, 2.4, 1.0 / 1.5] {
            assert!((dielectric(1.0, n).0 - ((n - 1.0) / (n + 1.0)).powi(2)).abs() < 1e-15);
            let (brewster, _) = dielectric(1.0 / n.hypot(1.0), n);
            assert!((brewster - 0.5 * ((n * n - 1.0) / (n * n + 1.0)).powi(2)).abs() < 1e-14, "{n}");
            assert!((dielectric(1e-9, n).0 - 1.0).abs() < 1e-7);
        }
    }

    #[test]
    fn light_is_reflected_totally_beyond_the_critical_angle_alone() {
        let critical = (1.0 - 1.0 / (1.5_f64 * 1.5)).sqrt();
        assert_eq!(dielectric(critical - 1e-6, 1.0 / 1.5).0, 1.0);
        assert!(dielectric(critical + 1e-6, 1.0 / 1.5).0 < 0.99);
    }

    /// The same path both ways: F(θ, n) = F(θ_t, 1/n).
    #[test]
    fn a_boundary_reflects_as_much_from_either_side() {
        for cos in [0.05, 0.4, 0.9] {
            let (there, cos_t) = dielectric(cos, 1.5);
            assert!((there - dielectric(cos_t, 1.0 / 1.5).0).abs() < 1e-14);
        }
    }

    #[test]
    fn a_conductor_that_does_not_absorb_is_a_dielectric() {
        for cos in [0.01, 0.3, 0.7, 1.0] {
            assert!((conductor(cos, 1.5, 0.0) - dielectric(cos, 1.5).0).abs() < 1e-14, "{cos}");
        }
        // ((η − 1)² + κ²) / ((η + 1)² + κ²): gold near 600 nm.
        let (eta, kappa) = (0.25_f64, 3.07_f64);
        let normal = ((eta - 1.0).powi(2) + kappa * kappa) / ((eta + 1.0).powi(2) + kappa * kappa);
        assert!((conductor(1.0, eta, kappa) - normal).abs() < 1e-15);
        assert_eq!(conductor(0.0, eta, kappa), 1.0);
        assert_eq!(conductor(0.0, 1.0, 0.0), 1.0);
    }
}
