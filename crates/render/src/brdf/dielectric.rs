use glam::DVec3;

use super::microfacets::Facets;
use super::{Bsdf, Sampled, fresnel, mirrored};

/// The boundary between the outside, on the front, and a dielectric of index n behind it; it works on both sides.
///
/// A smooth one reflects the share F and refracts the rest. With microfacets (Walter et al. 2007), F at a facet m,
///
/// ```text
/// reflection     f = F D(m) G₂ / (4 |cosθ_o cosθ_i|),      m ∝ o + i
/// transmission   f = T (1 − F) D(m) G₂ n_i² |o·m| |i·m| / (|cosθ_o cosθ_i| (n_o o·m + n_i i·m)²),      m ∝ n_o o + n_i i
/// ```
///
/// m on the front, T the tint of what is transmitted, n_o and n_i the indices on the sides of o and i.
#[derive(Clone, Debug, PartialEq)]
pub struct Dielectric {
    index: f64,
    tint: Vec<f64>,
    facets: Option<Facets>,
}

/// Two directions and the facet between them, on the side of o: its z axis points there.
struct Meeting {
    o: DVec3,
    i: DVec3,
    m: DVec3,
    /// n_i / n_o.
    n: f64,
}

impl Dielectric {
    /// Of index n inside over outside, with `tint` what is left of transmitted light, one a band, and roughness α; 0 is smooth.
    ///
    /// # Panics
    ///
    /// If n is not finite and positive.
    pub fn new(index: f64, tint: Vec<f64>, roughness: f64) -> Self {
        assert!(index.is_finite() && index > 0.0, "an index of refraction must be finite and positive, got {index}");
        Self { index, tint, facets: Facets::new(roughness) }
    }

    /// The index beyond the boundary over that on the side of o.
    fn beyond(&self, o: DVec3) -> f64 {
        if o.z > 0.0 { self.index } else { 1.0 / self.index }
    }

    /// Both directions seen from the side of o; `None` where no facet joins them.
    fn meeting(&self, o: DVec3, i: DVec3) -> Option<Meeting> {
        if o.z == 0.0 || i.z == 0.0 {
            return None;
        }
        let side = o.z.signum();
        let n = if o.z * i.z > 0.0 { 1.0 } else { self.beyond(o) };
        let (o, i) = (o * side, i * side);
        let m = (o + i * n).try_normalize()?;
        let m = m * m.z.signum();
        // Both ends must see the side of the facet that is theirs.
        (o.dot(m) > 0.0 && i.dot(m) * i.z > 0.0).then_some(Meeting { o, i, m, n })
    }
}

impl Meeting {
    fn reflects(&self) -> bool {
        self.i.z > 0.0
    }

    /// |dω_m/dω_i|.
    fn stretch(&self) -> f64 {
        if self.reflects() {
            1.0 / (4.0 * self.o.dot(self.m))
        } else {
            let sum = self.o.dot(self.m) + self.n * self.i.dot(self.m);
            self.n * self.n * self.i.dot(self.m).abs() / (sum * sum)
        }
    }
}

impl Bsdf for Dielectric {
    fn bands(&self) -> usize {
        self.tint.len()
    }

    fn evaluate(&self, o: DVec3, i: DVec3, f: &mut [f64]) {
        let (Some(facets), Some(meeting)) = (self.facets, self.meeting(o, i)) else { return f.fill(0.0) };
        let cos = meeting.o.dot(meeting.m).min(1.0);
        let (reflected, _) = fresnel::dielectric(cos, self.beyond(o));
        let shape = facets.density(meeting.m) * facets.both(o, i) * cos * meeting.stretch() / (o.z * i.z).abs();
        if meeting.reflects() {
            f.fill(reflected * shape);
        } else {
            f.iter_mut().zip(&self.tint).for_each(|(f, tint)| *f = tint * (1.0 - reflected) * shape);
        }
    }

    fn sample(&self, o: DVec3, u: [f64; 3], weight: &mut [f64]) -> Option<Sampled> {
        if o.z == 0.0 {
            return None;
        }
        let (side, n) = (o.z.signum(), self.beyond(o));
        let above = o * side;
        let m = self.facets.map_or(DVec3::Z, |facets| facets.sample(above, [u[0], u[1]]));
        let cos = above.dot(m).clamp(0.0, 1.0);
        let (reflected, cos_t) = fresnel::dielectric(cos, n);
        let reflects = u[2] < reflected;
        let i = if reflects { mirrored(above, m) } else { m * (cos / n - cos_t) - above / n };
        if (i.z > 0.0) != reflects || i.z == 0.0 {
            return None;
        }
        let i = i.normalize() * side;
        let seen = self.facets.map_or(1.0, |facets| facets.seen(o, i));
        weight.iter_mut().for_each(|w| *w *= seen);
        if !reflects {
            weight.iter_mut().zip(&self.tint).for_each(|(w, tint)| *w *= tint);
        }
        Some(Sampled { direction: i, density: self.facets.map(|_| self.density(o, i)) })
    }

    fn density(&self, o: DVec3, i: DVec3) -> f64 {
        let (Some(facets), Some(meeting)) = (self.facets, self.meeting(o, i)) else { return 0.0 };
        let (reflected, _) = fresnel::dielectric(meeting.o.dot(meeting.m).min(1.0), self.beyond(o));
        let share = if meeting.reflects() { reflected } else { 1.0 - reflected };
        share * facets.visible_density(meeting.o, meeting.m) * meeting.stretch()
    }
}
