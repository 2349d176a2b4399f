//! Bands that are solved once: those of a grey scene, and those of one colour of light.
//!
//! B is linear in E, so of two bands with the same reflectance on every surface
//!
//! ```text
//! E_b = k E_c on every surface  ⇒  B_b = k B_c and H_b = k H_c,      E_b = 0  ⇒  B_b = H_b = 0.
//! ```
//!
//! Reflectances are compared to the last bit. Ratios of emissions carry the rounding of one division: E_b and k E_c may differ by 2 ε of
//! themselves, and an answer by as much. The relative unshot power of both bands is the same in every step, so steps are too; a test sees that, and
//! both answers within 1e-12. What is *not* here: bands that differ in reflectance and have the same light.

/// How the solution of a band follows from the bands that are solved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Band {
    /// Nothing emits in it: all is 0.
    Dark,
    /// That many times the band at this place among the solved ones.
    Scaled {
        /// Place among the solved bands.
        of: usize,
        /// Factor; 1 for a band that is solved itself.
        by: f64,
    },
}

/// Which bands are solved, and how the others follow.
#[derive(Clone, Debug, PartialEq)]
pub struct BandPlan {
    /// Bands that are solved, ascending.
    pub solved: Vec<usize>,
    /// Every band of the scene.
    pub of: Vec<Band>,
}

/// Differences of emissions that rounding of one ratio may make, relative.
const ROUNDING: f64 = 2.0 * f64::EPSILON;

impl BandPlan {
    /// Every band solved.
    pub fn all(bands: usize) -> Self {
        Self { solved: (0..bands).collect(), of: (0..bands).map(|of| Band::Scaled { of, by: 1.0 }).collect() }
    }

    /// Whether a band is not solved.
    pub fn omits(&self) -> bool {
        self.solved.len() < self.of.len()
    }

    /// The plan for surfaces of which `data(band)` gives emission and reflectance, surface by surface.
    pub(super) fn new(bands: usize, data: impl Fn(usize) -> Vec<(f64, f64)>) -> Self {
        let mut known: Vec<(usize, Vec<(f64, f64)>)> = Vec::new();
        let mut of = Vec::with_capacity(bands);
        for band in 0..bands {
            let own = data(band);
            if own.iter().all(|(e, _)| *e == 0.0) {
                of.push(Band::Dark);
                continue;
            }
            let twin = known.iter().enumerate().find_map(|(k, (_, other))| Some((k, ratio(&own, other)?)));
            of.push(match twin {
                Some((of, by)) => Band::Scaled { of, by },
                None => {
                    known.push((band, own));
                    Band::Scaled { of: known.len() - 1, by: 1.0 }
                }
            });
        }
        Self { solved: known.into_iter().map(|(band, _)| band).collect(), of }
    }
}

/// k with E = k E' on all surfaces, if their reflectances are equal and there is one.
fn ratio(own: &[(f64, f64)], other: &[(f64, f64)]) -> Option<f64> {
    if own.iter().zip(other).any(|((_, rho), (_, other))| rho != other) {
        return None;
    }
    let (brightest, _) = (0..own.len()).map(|k| (k, other[k].0)).max_by(|a, b| a.1.total_cmp(&b.1))?;
    let k = own[brightest].0 / other[brightest].0;
    let follows = |((e, _), (other, _)): (&(f64, f64), &(f64, f64))| (e - k * other).abs() <= ROUNDING * e.abs();
    (k > 0.0 && k.is_finite() && own.iter().zip(other).all(follows)).then_some(k)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(bands: &[[(f64, f64); 3]]) -> BandPlan {
        BandPlan::new(bands.len(), |b| bands[b].to_vec())
    }

    #[test]
    fn bands_follow_from_one_another_where_light_is_proportional_and_reflectance_equal() {
        let first = [(0.0, 0.5), (3.0, 0.1), (7.0, 0.0)];
        let third = first.map(|(e, rho)| (e / 3.0, rho));
        let found = plan(&[first, [(0.0, 0.5), (0.0, 0.1), (0.0, 0.0)], third]);
        assert_eq!(found.solved, [0]);
        let [one, dark, Band::Scaled { of: 0, by }] = found.of[..] else { panic!("{found:?}") };
        assert_eq!((one, dark), (Band::Scaled { of: 0, by: 1.0 }, Band::Dark));
        assert!((by * 3.0 - 1.0).abs() <= f64::EPSILON);
    }

    #[test]
    fn bands_of_other_reflectance_or_other_light_are_solved() {
        let first = [(0.0, 0.5), (3.0, 0.1), (7.0, 0.0)];
        let (mut painted, mut lit) = (first, first);
        painted[0].1 = 0.5 + f64::EPSILON;
        lit[1].0 = 3.0 * (1.0 + 1e-14);
        assert_eq!(plan(&[first, painted, lit]).solved, [0, 1, 2]);
        // A band that has light where the other has none is no multiple of it, whichever comes first.
        let one = [(1.0, 0.5), (0.0, 0.5), (0.0, 0.5)];
        let two = [(1.0, 0.5), (1.0, 0.5), (0.0, 0.5)];
        assert_eq!(plan(&[one, two]).solved, [0, 1]);
        assert_eq!(plan(&[two, one]).solved, [0, 1]);
    }
}
