//! The ambient term: a guess of the light that is still unshot, for display only.
//!
//! While shooting goes on, a picture of x + r is too dark. The light still to come is guessed as if it were spread
//! evenly over the scene:
//!
//! ```text
//! ρ̄ = Σ A ρ / Σ A,      R = 1/(1 − ρ̄) = 1 + ρ̄ + ρ̄² + …,      H_ambient = R · Σ A r / Σ A
//! B_display = x + r + ρ H_ambient
//! ```
//!
//! in every band (M. F. Cohen, S. E. Chen, J. R. Wallace and D. P. Greenberg, "A progressive refinement approach to
//! fast radiosity image generation", SIGGRAPH 1988, section 5). Exact inside a sphere; anywhere else a guess, which
//! falls to 0 as the run converges. It is never part of B or of an error.

use radiosity_core::{BandValues, Bands, Iterate, System};

/// Irradiance H_ambient of every band that the unshot radiosity r would give if it were spread evenly.
///
/// # Panics
///
/// If r does not fit the system.
pub fn irradiance(system: &System<'_>, r: Bands<'_>) -> Vec<f64> {
    assert_eq!((r.count(), r.len()), (system.bands(), system.elements()), "ambient: lengths");
    let area: f64 = system.areas().iter().sum();
    (0..r.count())
        .map(|b| {
            let mean_reflectance = system.power(system.reflectance().band(b)) / area;
            system.power(r.band(b)) / area / (1.0 - mean_reflectance)
        })
        .collect()
}

/// Radiosity to display: x + r + ρ H_ambient; `None` if the method has no r at hand.
///
/// # Panics
///
/// If the iterate does not fit the system.
pub fn display(system: &System<'_>, iterate: &Iterate) -> Option<BandValues> {
    let r = iterate.residual.as_ref()?;
    let ambient = irradiance(system, r.view());
    let mut shown = iterate.shot.clone();
    for (b, h) in ambient.into_iter().enumerate() {
        let (r, rho) = (r.band(b), system.reflectance().band(b));
        shown.band_mut(b).iter_mut().enumerate().for_each(|(e, shown)| *shown += r[e] + rho[e] * h);
    }
    Some(shown)
}
