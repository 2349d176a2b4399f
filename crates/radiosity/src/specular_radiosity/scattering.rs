//! What a specular surface does to radiance, bin by bin.
//!
//! ```text
//! S_o = Σ_k M_ok L_k,      M_ok = X_ok / Ω⊥_o,      X_ok ≈ ∫_o ∫_k f(ω, ω′) cosθ cosθ′ dω′ dω
//! ```
//!
//! with Ω⊥ = ∫ cosθ dω over a bin. X is symmetric as f is, and its sums over k are what the bin reflects of equal light from everywhere,
//!
//! ```text
//! Σ_k X_ok = ∫_o a(ω) cosθ dω,      a the directional albedo of f.
//! ```
//!
//! **Energy.** f is evaluated in the middles of parts of bins, which for lobes narrower than a part makes far too much or too little of it. X is therefore scaled to D X D with
//! D > 0 so that all sums are the albedo's to rounding (as in [`radiosity_form_factors::repair`]): whatever light comes in from bin k, what leaves is a_k of it, and
//! reciprocity holds as well. What is left of the error is the blur of bins. Ideal mirrors need no quadrature: X joins a bin with the one opposite.
//!
//! **Size.** Surfaces are isotropic, so rows are kept of one bin in eight and turned. Entries below 10⁻⁴ of the mean of their row and their column are left out before
//! the scaling: 10⁻⁴ of a row in all.

use radiosity_render::brdf::Bsdf;
use rayon::prelude::*;

use super::bins::{DirectionBins, Turn};
use glam::DVec3;

/// Parts of all bins along an edge of the square at least, where f is evaluated.
const PARTS: u32 = 64;
/// Entries below this share of the mean of their row and column are left out.
const NEGLIGIBLE: f64 = 1e-4;
/// Steps of the scaling at most; it converges fastest where f is closest to a mirror.
const SCALINGS: usize = 200;
/// Heights at which the albedo is computed.
const HEIGHTS: usize = 128;

/// M of one material, in all bands.
pub(super) struct Scattering {
    bands: usize,
    /// The bins that have a row.
    rows: Vec<u32>,
    /// End of the entries of every row.
    ends: Vec<usize>,
    /// Bins k.
    columns: Vec<u32>,
    /// M_ok, the bands of an entry together.
    values: Vec<f64>,
    /// Σ_k M_ok of every row, the bands of a row together: the albedo of the bin.
    albedos: Vec<f64>,
}

/// Working space of [`Scattering::scatter`].
#[derive(Default)]
pub(super) struct Turned {
    /// Of every bin and turn, what the turned bin has.
    values: Vec<[f64; 8]>,
}

impl Scattering {
    /// Bytes of as many entries as there can be, and of the matrix they are picked from.
    pub fn most_bytes(bins: DirectionBins, bands: usize) -> u64 {
        let half = u64::from(bins.edge().div_ceil(2));
        let entries = half * (half + 1) / 2 * bins.count() as u64;
        entries * (size_of::<u32>() + 2 * size_of::<f64>() * bands) as u64
    }

    /// Of the function of a surface.
    pub fn new(bins: DirectionBins, f: &dyn Bsdf) -> Self {
        let bands = f.bands();
        let rows: Vec<u32> = (0..bins.count()).filter(|&k| bins.folded(k).0 == k).map(|k| k as u32).collect();
        let mut row_of = vec![0; bins.count()];
        rows.iter().enumerate().for_each(|(row, &k)| row_of[k as usize] = row);
        let row_of: Vec<u32> = (0..bins.count()).map(|k| row_of[bins.folded(k).0] as u32).collect();
        let parts = Parts::new(bins);
        let reflected = parts.albedos(f, &rows);
        let (ends, columns, mut values) = if is_ideal(f) {
            let opposite = rows.iter().map(|&o| bins.mirrored(o as usize) as u32).collect();
            ((1..=rows.len()).collect(), opposite, reflected.clone())
        } else {
            picked(&parts.exchange(f, &rows), &row_of, bins.count(), bands)
        };
        let mut scattering = Self { bands, rows, ends, columns, values: Vec::new(), albedos: Vec::new() };
        for band in 0..bands {
            scattering.scale(band, &mut values, &reflected, &row_of);
        }
        // X to M.
        let mut albedos = reflected;
        for row in 0..scattering.rows.len() {
            let projected = bins.projected(scattering.rows[row] as usize);
            values[bands * scattering.begin(row)..bands * scattering.end(row)].iter_mut().for_each(|x| *x /= projected);
            albedos[bands * row..bands * (row + 1)].iter_mut().for_each(|a| *a /= projected);
        }
        (scattering.values, scattering.albedos) = (values, albedos);
        scattering
    }

    fn begin(&self, row: usize) -> usize {
        row.checked_sub(1).map_or(0, |before| self.ends[before])
    }

    fn end(&self, row: usize) -> usize {
        self.ends[row]
    }

    /// Scales X of one band so that its sums are those of `reflected`.
    fn scale(&self, band: usize, values: &mut [f64], reflected: &[f64], row_of: &[u32]) {
        let count = self.rows.len();
        let target = |row: usize| reflected[row * self.bands + band];
        let mut d = vec![1.0; count];
        let sum = |row: usize, d: &[f64], values: &[f64]| {
            let entries = self.begin(row)..self.end(row);
            d[row]
                * entries
                    .map(|e| values[e * self.bands + band] * d[row_of[self.columns[e] as usize] as usize])
                    .sum::<f64>()
        };
        for _ in 0..SCALINGS {
            let sums: Vec<f64> = (0..count).into_par_iter().map(|row| sum(row, &d, values)).collect();
            let worst = (0..count).map(|row| (sums[row] - target(row)).abs() / target(row).max(f64::MIN_POSITIVE));
            if worst.fold(0.0, f64::max) <= 8.0 * f64::EPSILON {
                break;
            }
            for (row, d) in d.iter_mut().enumerate() {
                *d = if target(row) > 0.0 { *d * (target(row) / sums[row]).sqrt() } else { 0.0 };
            }
        }
        for row in 0..count {
            for e in self.begin(row)..self.end(row) {
                values[e * self.bands + band] *= d[row] * d[row_of[self.columns[e] as usize] as usize];
            }
        }
    }

    /// Bytes held.
    pub fn stored_bytes(&self) -> u64 {
        let of = |len: usize, size: usize| (len * size) as u64;
        of(self.rows.len() + self.columns.len(), size_of::<u32>())
            + of(self.ends.len() + self.values.len() + self.albedos.len(), size_of::<f64>())
    }

    /// Entries that one use reads, turned rows counted apart.
    pub fn entries(&self) -> u64 {
        self.columns.len() as u64 * Turn::ALL.len() as u64
    }

    /// Largest share of light that a bin gives back, in any band.
    pub fn largest_albedo(&self) -> f64 {
        self.albedos.iter().copied().fold(0.0, f64::max)
    }

    /// Adds S of every bin to `outgoing`; radiance of both is that of bin 0 in all bands, then of bin 1 and so on.
    pub fn scatter(&self, turns: &TurnedBins, incoming: &[f64], outgoing: &mut [f64], space: &mut Turned) {
        let bands = self.bands;
        for band in 0..bands {
            space.values.clear();
            space.values.extend(turns.0.iter().map(|turned| turned.map(|k| incoming[k as usize * bands + band])));
            let mut begin = 0;
            for (&o, &end) in self.rows.iter().zip(&self.ends) {
                let entries = begin..end;
                begin = end;
                let mut sums = [0.0; 8];
                for (&k, m) in self.columns[entries.clone()]
                    .iter()
                    .zip(self.values[entries.start * bands + band..].iter().step_by(bands))
                {
                    let values = &space.values[k as usize];
                    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += m * value);
                }
                // Turns that lead to the same bin have the same sum.
                let turned = &turns.0[o as usize];
                for (g, &o) in turned.iter().enumerate() {
                    if !turned[..g].contains(&o) {
                        outgoing[o as usize * bands + band] += sums[g];
                    }
                }
            }
        }
    }
}

/// Where the eight turns take every bin.
pub(super) struct TurnedBins(Vec<[u32; 8]>);

impl TurnedBins {
    pub fn new(bins: DirectionBins) -> Self {
        Self((0..bins.count()).map(|k| Turn::ALL.map(|turn| bins.turned(k, turn) as u32)).collect())
    }
}

/// Whether all is carried by ideal directions.
fn is_ideal(f: &dyn Bsdf) -> bool {
    f.sample(DVec3::Z, [0.5; 3], &mut vec![1.0; f.bands()]).is_some_and(|sampled| sampled.density.is_none())
}

/// Points in which functions of bins are evaluated: the middles of parts, which mirror each other as bins do.
struct Parts {
    bins: DirectionBins,
    /// Points of a bin.
    each: usize,
    /// Bin after bin: middle and Ω⊥.
    points: Vec<(DVec3, f64)>,
}

impl Parts {
    fn new(bins: DirectionBins) -> Self {
        let times = PARTS.div_ceil(bins.edge());
        let fine = DirectionBins::new(bins.edge() * times);
        let points = bins.parts(times).map(|p| (fine.centre(p), fine.projected(p))).collect();
        Self { bins, each: (times * times) as usize, points }
    }

    fn of(&self, k: usize) -> &[(DVec3, f64)] {
        &self.points[k * self.each..(k + 1) * self.each]
    }

    /// ∫ a cosθ dω over every bin that has a row, the bands of a row together.
    fn albedos(&self, f: &dyn Bsdf, rows: &[u32]) -> Vec<f64> {
        let bands = f.bands();
        // The albedo depends on the height alone.
        let at = |h: usize| {
            let z = (h as f64 + 0.5) / HEIGHTS as f64;
            let mut a = vec![0.0; bands];
            f.albedo(DVec3::new((1.0 - z * z).sqrt(), 0.0, z), &mut a);
            a
        };
        let table: Vec<Vec<f64>> = (0..HEIGHTS).into_par_iter().map(at).collect();
        let albedo = |z: f64, band: usize| {
            let at = (z * HEIGHTS as f64 - 0.5).clamp(0.0, (HEIGHTS - 1) as f64);
            let h = (at as usize).min(HEIGHTS - 2);
            let t = at - h as f64;
            table[h][band] * (1.0 - t) + table[h + 1][band] * t
        };
        let mean = |&o: &u32| {
            (0..bands)
                .map(move |band| (o, band))
                .map(|(o, band)| self.of(o as usize).iter().map(|(d, weight)| weight * albedo(d.z, band)).sum::<f64>())
        };
        rows.iter().flat_map(mean).collect()
    }

    /// X of every bin that has a row, with all bins, the bands of an entry together.
    fn exchange(&self, f: &dyn Bsdf, rows: &[u32]) -> Vec<f64> {
        let (bands, count) = (f.bands(), self.bins.count());
        let mut x = vec![0.0; rows.len() * count * bands];
        x.par_chunks_mut(count * bands).zip(rows).for_each(|(row, &o)| {
            let mut value = vec![0.0; bands];
            for (k, x) in row.chunks_exact_mut(bands).enumerate() {
                for (d, weight) in self.of(o as usize) {
                    for (other, by) in self.of(k) {
                        f.evaluate(*d, *other, &mut value);
                        x.iter_mut().zip(&value).for_each(|(x, f)| *x += f * weight * by);
                    }
                }
            }
        });
        x
    }
}

/// The entries that count: ends of rows, columns and values.
fn picked(x: &[f64], row_of: &[u32], count: usize, bands: usize) -> (Vec<usize>, Vec<u32>, Vec<f64>) {
    let means: Vec<Vec<f64>> = x
        .chunks_exact(count * bands)
        .map(|row| (0..bands).map(|b| row[b..].iter().step_by(bands).sum::<f64>() / count as f64).collect())
        .collect();
    let (mut ends, mut columns, mut values) = (Vec::new(), Vec::new(), Vec::new());
    for (row, mean) in x.chunks_exact(count * bands).zip(&means) {
        for (k, x) in row.chunks_exact(bands).enumerate() {
            let other = &means[row_of[k] as usize];
            if (0..bands).any(|b| x[b] > NEGLIGIBLE * mean[b].min(other[b])) {
                columns.push(k as u32);
                values.extend_from_slice(x);
            }
        }
        ends.push(columns.len());
    }
    (ends, columns, values)
}

#[cfg(test)]
mod tests {
    use super::*;
    use radiosity_render::brdf::{Conductor, Mirror, Phong};

    fn functions() -> Vec<(&'static str, Box<dyn Bsdf>)> {
        vec![
            ("mirror", Box::new(Mirror::new(vec![0.8, 0.3]))),
            ("smooth metal", Box::new(Conductor::new(vec![0.2, 1.5], vec![3.0, 1.0], 0.0))),
            ("rough metal", Box::new(Conductor::new(vec![0.2, 1.5], vec![3.0, 1.0], 0.3))),
            ("fine metal", Box::new(Conductor::new(vec![0.2], vec![3.0], 0.02))),
            ("broad lobe", Box::new(Phong::new(vec![0.7, 0.0], 5.0))),
            ("narrow lobe", Box::new(Phong::new(vec![0.4], 3000.0))),
        ]
    }

    /// The matrix, column k being what light of 1 from bin k becomes.
    fn matrix(bins: DirectionBins, scattering: &Scattering, band: usize) -> Vec<Vec<f64>> {
        let bands = scattering.bands;
        let turns = TurnedBins::new(bins);
        let column = |k: usize| {
            let (mut incoming, mut outgoing) = (vec![0.0; bins.count() * bands], vec![0.0; bins.count() * bands]);
            incoming[k * bands + band] = 1.0;
            scattering.scatter(&turns, &incoming, &mut outgoing, &mut Turned::default());
            outgoing.iter().skip(band).step_by(bands).copied().collect()
        };
        (0..bins.count()).map(column).collect()
    }

    /// The share of light from bin k that is given back, in every band.
    fn albedo(bins: DirectionBins, scattering: &Scattering, k: usize) -> Vec<f64> {
        let row = scattering.rows.iter().position(|&row| row as usize == bins.folded(k).0).unwrap();
        scattering.albedos[row * scattering.bands..][..scattering.bands].to_vec()
    }

    /// Bin-wise energy (what leaves of light from one bin is the albedo of that bin), the white furnace (equal light from everywhere leaves as the albedo), and
    /// reciprocity, of whole matrices. Rounding of up to a hundred scalings is 10⁻¹³.
    #[test]
    fn light_of_every_bin_is_given_back_as_its_albedo_and_bins_are_reciprocal() {
        for edge in [3, 8] {
            let bins = DirectionBins::new(edge);
            for (name, f) in functions() {
                let scattering = Scattering::new(bins, &*f);
                for band in 0..f.bands() {
                    let m = matrix(bins, &scattering, band);
                    for k in 0..bins.count() {
                        let leaving: f64 = (0..bins.count()).map(|o| m[k][o] * bins.projected(o)).sum();
                        let albedo = albedo(bins, &scattering, k)[band];
                        assert!((leaving / bins.projected(k) - albedo).abs() < 1e-12, "{name}, bin {k}: {leaving}");
                        let furnace: f64 = m.iter().map(|column| column[k]).sum();
                        assert!((furnace - albedo).abs() < 1e-12, "{name}, bin {k}: {furnace}, {albedo}");
                        for (o, column) in m[..k].iter().enumerate() {
                            let (there, back) = (m[k][o] * bins.projected(o), column[k] * bins.projected(k));
                            assert!((there - back).abs() <= 1e-12 * there.max(back), "{name}: {there}, {back}");
                        }
                    }
                }
            }
        }
    }

    /// Against the mean of `Bsdf::albedo` over 40 × 40 directions of the bin by cosine, which errs by a few 10⁻³ as the albedos themselves do.
    #[test]
    fn albedos_of_bins_are_those_of_the_function() {
        let bins = DirectionBins::new(4);
        for (name, f) in functions() {
            let scattering = Scattering::new(bins, &*f);
            for k in [0, 1, 5] {
                let (mut sum, mut weight) = (vec![0.0; f.bands()], 0.0);
                for p in 0..40 * 4 {
                    let d = bins.direction(k, (f64::from(p % 40) + 0.5) / 40.0, (f64::from(p / 40) + 0.5) / 4.0);
                    let mut a = vec![0.0; f.bands()];
                    f.albedo(d, &mut a);
                    sum.iter_mut().zip(a).for_each(|(sum, a)| *sum += a * d.z);
                    weight += d.z;
                }
                for (sum, albedo) in sum.iter().zip(albedo(bins, &scattering, k)) {
                    assert!((sum / weight - albedo).abs() < 0.01, "{name}, bin {k}: {}, {albedo}", sum / weight);
                }
            }
        }
    }

    /// A broad lobe needs hardly any scaling: entries are integrals of f over pairs of bins, against 10⁵ random pairs of directions.
    #[test]
    fn entries_are_integrals_over_pairs_of_bins() {
        let (bins, f) = (DirectionBins::new(4), Phong::new(vec![0.7], 5.0));
        let m = matrix(bins, &Scattering::new(bins, &f), 0);
        for (k, o) in [(5, 10), (5, 9), (0, 15), (3, 8)] {
            let (mut sum, count) = (0.0, 100_000);
            for s in 0..count {
                let u = [0, 1, 2, 3].map(|c| radiosity_core::uniform(s * 4 + c));
                let (d, other) = (bins.direction(o, u[0], u[1]), bins.direction(k, u[2], u[3]));
                let mut value = [0.0];
                f.evaluate(d, other, &mut value);
                sum += value[0] * d.z * other.z / count as f64;
            }
            let expected = sum * bins.solid_angle().powi(2) / bins.projected(o);
            assert!((m[k][o] - expected).abs() < 0.02 * expected, "{k} to {o}: {}, {expected}", m[k][o]);
        }
    }

    #[test]
    fn narrow_lobes_take_few_entries_and_mirrors_one_a_row() {
        let bins = DirectionBins::new(16);
        let entries = |f: &dyn Bsdf| Scattering::new(bins, f).entries();
        let rows = 8 * 9 / 2 * 8;
        assert_eq!(entries(&Mirror::new(vec![1.0])), rows);
        let narrow = entries(&Phong::new(vec![1.0], 3000.0));
        assert!(narrow < 10 * rows, "{narrow}");
        let broad = entries(&Phong::new(vec![1.0], 1.0));
        assert!(broad > rows * 128 && broad <= rows * 256, "{broad}");
    }
}
