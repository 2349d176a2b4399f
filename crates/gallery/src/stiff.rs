//! Systems that are hard, each in one way, with answers in twice the working precision.
//!
//! | family | what is hard |
//! |---|---|
//! | bright rooms and ducts | 1/(1 − ρ): light that hardly fades, and in a duct has far to go |
//! | joined rooms | one slow mode for every nearly isolated room |
//! | plates, slivers, size ratios | exchange areas over many decades |
//! | emission over 12 decades | an answer of which an average tells little |
//! | leaky sums | row sums above 1: what contracts and what does not |
//! | reducible | isolated groups, all black, nothing emitting, one patch |
//! | near underflow | products that leave the range of numbers |
//!
//! A case is added in [`stiff`], and nowhere else.

use glam::DVec3;
use radiosity_core::FormFactors;
use radiosity_form_factors::analytic::Analytic;
use radiosity_form_factors::stores::DenseFormFactors;
use radiosity_form_factors::{PairwiseRows, repair};
use radiosity_geometry::mesh::{Mesh, MeshSettings, Subdivision};
use radiosity_geometry::{Facets, Occluders, Polygon};
use rayon::prelude::*;

use crate::RandomEnclosure;
use crate::boxes::{empty_box, material};
use crate::double_double::{DoubleDouble, solve};

/// A system that is hard in one way.
#[derive(Clone, Debug)]
pub struct StiffCase {
    /// Short name for tables.
    pub name: String,
    /// What is hard about it.
    pub why: &'static str,
    /// Areas, exchange areas, emission and reflectance; symmetric to the last bit.
    pub enclosure: RandomEnclosure,
}

impl StiffCase {
    /// B = (I − ρF)⁻¹ E to double precision, eliminated in twice that; `None` if the matrix is singular.
    ///
    /// n³/3 operations of about 20 flops each.
    pub fn exact(&self) -> Option<Vec<f64>> {
        let (n, system) = (self.enclosure.len(), &self.enclosure);
        let coefficient = |k: usize| {
            let (s, t) = (k / n, k % n);
            let coupling = DoubleDouble::from(system.reflectance[s]) * system.exchange[k].into();
            DoubleDouble::from(f64::from(s == t)) - coupling / system.areas[s].into()
        };
        solve((0..n * n).map(coefficient).collect(), system.emission.iter().map(|&e| e.into()).collect())
    }
}

/// Passes of [`exact_in_closed_room`]: twice what a room needs at ρ = 1 − 10⁻⁶.
const PASSES: usize = 200;

/// Largest closure error of the analytic rows of a convex room: symmetric scaling takes it to rounding.
const TOLERANCE: f64 = 1e-12;

/// Exchange areas of single-polygon facets among which nothing blocks; row sums of a closed room are scaled to the areas.
fn table(facets: &Facets, closed: bool) -> Vec<f64> {
    let rows = PairwiseRows::new(Analytic::new(None), facets, facets, TOLERANCE, 1);
    let (mut store, _) = DenseFormFactors::assemble(&rows).expect("exchange areas of polygons");
    if closed {
        let scaling = repair::repair(&store, &facets.areas(), true).expect("rows of a closed room");
        scaling.apply(&mut store);
    }
    let n = store.sources();
    (0..n * n).map(|k| store.entry(k / n, k % n)).collect()
}

/// An empty room of `size`, K × K elements a face, with one reflectance and one element lit.
fn room(size: [f64; 3], k: u32, reflectance: f64) -> RandomEnclosure {
    let scene = empty_box(size, material("room", reflectance, 0.0));
    let settings = MeshSettings { elements: Subdivision::Uniform(k), patches: None, contacts: false };
    let facets =
        Mesh::new(&scene, &Occluders::of_scene(&scene), &settings).expect("a room can be meshed").element_facets;
    of_facets(&facets, true, reflectance)
}

fn of_facets(facets: &Facets, closed: bool, reflectance: f64) -> RandomEnclosure {
    let n = facets.len();
    let mut emission = vec![0.0; n];
    emission[n / 3] = 1.0;
    RandomEnclosure {
        areas: facets.areas(),
        exchange: table(facets, closed),
        emission,
        reflectance: vec![reflectance; n],
    }
}

/// `rooms` well-mixed rooms of `each` elements, joined so that about `leak` of the light goes from one to the next.
fn joined(rooms: usize, each: usize, leak: f64, reflectance: f64) -> RandomEnclosure {
    let n = rooms * each;
    let mixed = RandomEnclosure::new(n, 31);
    let exchange = (0..n * n).map(|k| {
        let (a, b) = (k / n / each, k % n / each);
        match a.abs_diff(b) {
            0 => mixed.exchange[k],
            1 => leak * mixed.exchange[k],
            _ => 0.0,
        }
    });
    let mut emission = vec![0.0; n];
    emission[0] = 1.0;
    RandomEnclosure::closed(mixed.areas.clone(), exchange.collect()).lit(emission, reflectance)
}

/// Two unit squares face to face at a distance, and nothing else.
fn plates(gap: f64) -> RandomEnclosure {
    let square = |z: f64, up: bool| {
        let mut corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| DVec3::new(x, y, z));
        if !up {
            corners.reverse();
        }
        vec![Polygon::new(&corners).expect("a square")]
    };
    let mut facets = Facets::new();
    facets.push(square(0.0, true), false);
    facets.push(square(gap, false), false);
    of_facets(&facets, false, 0.999)
}

/// Areas over six decades; the three largest are alike, since a closed room has no area above the sum of the others.
fn uneven(n: usize) -> RandomEnclosure {
    let area = |s: usize| 1e-6_f64.powf(s.saturating_sub(2) as f64 / (n - 3) as f64);
    let areas: Vec<f64> = (0..n).map(area).collect();
    let pair = |k: usize| {
        let (s, t) = (k / n, k % n);
        if s == t { 0.0 } else { areas[s] * areas[t] * (1.0 + ((s * t + s + t) % 7) as f64) }
    };
    let exchange = (0..n * n).map(pair).collect();
    let mut emission = vec![0.0; n];
    emission[n - 1] = 1.0;
    RandomEnclosure::closed(areas, exchange).lit(emission, 0.95)
}

/// What is lit in a [`bright_room`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Light {
    /// One element.
    Element,
    /// The elements of a sixteenth of the ceiling.
    Panel,
}

/// The closed room 4 × 3 × 5, K × K elements a wall, K a multiple of 4; row sums are scaled to the areas, nothing is lit or reflects yet.
pub fn bright_room(k: u32) -> RandomEnclosure {
    assert!(k > 0 && k.is_multiple_of(4), "a wall of {k} × {k} elements has no panel of a sixteenth");
    room([4.0, 3.0, 5.0], k, 0.0).lit(vec![0.0; 6 * k.pow(2) as usize], 0.0)
}

/// The room of [`bright_room`] with one light of emission 1.
pub fn with_light(room: RandomEnclosure, light: Light, reflectance: f64) -> RandomEnclosure {
    let n = room.len();
    let k = (n / 6).isqrt();
    let mut emission = vec![0.0; n];
    match light {
        Light::Element => emission[n / 3] = 1.0,
        Light::Panel => {
            let panel = (k / 4..k / 2).flat_map(|i| (k / 4..k / 2).map(move |j| 5 * k * k + i * k + j));
            panel.for_each(|e| emission[e] = 1.0);
        }
    }
    room.lit(emission, reflectance)
}

/// B of a closed room of one reflectance ρ to double precision, also of thousands of elements; `None` if it is not reached.
///
/// ```text
/// r = E + ρF x − x,      x ← x + r + c,      c = Σ A r / ((1 − ρ) Σ A)
/// ```
///
/// in twice the working precision. With row sums 1 the constant c is the answer to the even part of r, at once and however small
/// 1 − ρ is; what is left falls by ρ|λ₂| a pass, λ₂ the second eigenvalue of F, which is about 1/3 in a room. It ends when the bound
/// Σ A|r|/(1 − q) of the error is below 2⁻⁵⁸ of Σ A|x|, so that the answer does not depend on how it was found.
pub fn exact_in_closed_room(room: &RandomEnclosure) -> Option<Vec<f64>> {
    let (n, rho) = (room.len(), room.reflectance[0]);
    let total: f64 = room.areas.iter().sum();
    let row = |s: usize| &room.exchange[s * n..(s + 1) * n];
    let largest_sum = (0..n).map(|s| row(s).iter().sum::<f64>() / room.areas[s]).fold(0.0, f64::max);
    // The rounding of the row sums themselves.
    let q = rho * largest_sum * (1.0 + n as f64 * f64::EPSILON);
    let mut x: Vec<DoubleDouble> = room.emission.iter().map(|&e| e.into()).collect();
    for _ in 0..PASSES {
        let residual = |s: usize| {
            let gathered = row(s).iter().zip(&x).fold(DoubleDouble::default(), |sum, (&f, &x)| sum + x * f.into());
            DoubleDouble::from(room.emission[s]) + gathered * rho.into() / room.areas[s].into() - x[s]
        };
        let r: Vec<DoubleDouble> = (0..n).into_par_iter().map(residual).collect();
        let power = |values: &[DoubleDouble], size: fn(f64) -> f64| -> f64 {
            values.iter().zip(&room.areas).map(|(v, a)| a * size((*v).into())).sum()
        };
        if power(&r, f64::abs) < 2.0_f64.powi(-58) * (1.0 - q) * power(&x, f64::abs) {
            return Some(x.into_iter().map(f64::from).collect());
        }
        let even = power(&r, |r| r) / ((1.0 - rho) * total);
        x.iter_mut().zip(r).for_each(|(x, r)| *x = *x + r + even.into());
    }
    None
}

/// All cases.
pub fn stiff() -> Vec<StiffCase> {
    let mut all = Vec::new();
    let mut add = |name: &str, why, enclosure| all.push(StiffCase { name: name.to_owned(), why, enclosure });
    for rho in [0.9, 0.99, 0.999, 0.9999, 0.999_999] {
        add(&format!("room, ρ = {rho}"), "light hardly fades", room([4.0, 3.0, 5.0], 3, rho));
    }
    for rho in [0.9, 0.999, 0.999_999] {
        add(&format!("duct, ρ = {rho}"), "light hardly fades and has far to go", room([1.0, 1.0, 20.0], 4, rho));
    }
    add("two rooms", "a slow mode for each room", joined(2, 30, 1e-6, 0.999));
    add("five rooms", "a slow mode for each room", joined(5, 16, 1e-6, 0.999));
    add("isolated rooms", "a dark room that nothing reaches", joined(2, 30, 0.0, 0.9));
    add("plates 1e-6 apart", "F within 1e-6 of 1 and back", plates(1e-6));
    add("plates 1e4 apart", "F of 1e-9", plates(1e4));
    add("size ratio 1e6", "areas over six decades", uneven(60));
    let mixed = || RandomEnclosure::new(60, 32);
    let decades = (0..60).map(|s| 10.0_f64.powi(-(s % 13))).collect();
    add("emission over 12 decades", "weak lights beside strong ones", mixed().lit(decades, 0.9));
    add("row sums 1.02, ρ = 0.9", "sums above one that do no harm", mixed().with_reflectance(0.9).scaled(1.02));
    add("row sums 1.02, ρ = 0.99", "sums above one: no answer in physics", mixed().with_reflectance(0.99).scaled(1.02));
    let leaky = mixed().with_reflectance(0.99).scaled(1.02);
    let repaired = RandomEnclosure::closed(leaky.areas.clone(), leaky.exchange.clone());
    add("row sums 1.02, repaired", "the same after symmetric scaling", repaired.lit(leaky.emission, 0.99));
    let mut half_black = mixed();
    half_black.reflectance.iter_mut().step_by(2).for_each(|rho| *rho = 0.0);
    add("half black", "rows of the identity", half_black);
    add("all black", "nothing to solve", mixed().with_reflectance(0.0));
    add("nothing emits", "the answer is 0", mixed().lit(vec![0.0; 60], 0.9));
    let one = RandomEnclosure { areas: vec![2.0], exchange: vec![0.0], emission: vec![3.0], reflectance: vec![0.5] };
    add("one patch", "a matrix of one entry", one);
    let mut tiny = mixed();
    tiny.areas.iter_mut().chain(&mut tiny.exchange).for_each(|value| *value *= 2.0_f64.powi(-900));
    add("areas of 2⁻⁹⁰⁰", "products that underflow", tiny);
    let mut faint = mixed();
    faint.emission.iter_mut().for_each(|e| *e *= 2.0_f64.powi(-900));
    add("emission of 2⁻⁹⁰⁰", "powers that underflow", faint);
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With one reflectance in a closed room the emitted power is A E = Σ A B (1 − ρ): an identity of the exact answer.
    #[test]
    fn exact_answers_balance_their_energy() {
        for case in stiff() {
            let e = &case.enclosure;
            let rho = e.reflectance[0];
            let sums =
                (0..e.len()).map(|s| e.exchange[s * e.len()..(s + 1) * e.len()].iter().sum::<f64>() / e.areas[s]);
            let closed = sums.clone().all(|sum| (sum - 1.0).abs() < 1e-13);
            let b = case.exact().unwrap();
            assert!(b.iter().all(|b| b.is_finite()), "{}", case.name);
            if closed && e.reflectance.iter().all(|r| *r == rho) {
                let power = |x: &[f64]| -> f64 { x.iter().zip(&e.areas).map(|(x, a)| x * a).sum() };
                let (kept, emitted) = (power(&b) * (1.0 - rho), power(&e.emission));
                // Row sums are right to 1e-13, which 1/(1 − ρ) amplifies.
                assert!((kept - emitted).abs() <= 2e-13 / (1.0 - rho) * emitted, "{}: {kept} {emitted}", case.name);
            }
        }
    }

    /// Elimination and iteration, both in twice the working precision: answers agree to the rounding of a double.
    #[test]
    fn bright_rooms_have_the_answer_of_elimination() {
        for (light, rho) in [(Light::Element, 0.999), (Light::Panel, 0.999_99)] {
            let enclosure = with_light(bright_room(4), light, rho);
            let iterated = exact_in_closed_room(&enclosure).unwrap();
            let case = StiffCase { name: String::new(), why: "", enclosure };
            let eliminated = case.exact().unwrap();
            assert!(
                iterated.iter().zip(&eliminated).all(|(a, b)| (a - b).abs() <= 2.0 * f64::EPSILON * b),
                "{light:?}"
            );
        }
    }

    #[test]
    fn names_are_unique_and_tables_symmetric() {
        let cases = stiff();
        for (k, case) in cases.iter().enumerate() {
            assert!(cases[..k].iter().all(|other| other.name != case.name), "{}", case.name);
            let (n, exchange) = (case.enclosure.len(), &case.enclosure.exchange);
            assert!((0..n * n).all(|k| exchange[k] == exchange[k % n * n + k / n]), "{}", case.name);
        }
    }
}
