//! Hierarchical form factors: exchange held between nodes of any size, as coarse as an error allows.
//!
//! Elements are the leaves of a tree ([`Hierarchy`]): cells of a surface in quarters of quarters, surfaces in clusters. A link joins two
//! nodes and gives one kernel κ to all pairs of their elements ([`Links`]), and every pair of elements that may see each other lies under
//! one link:
//!
//! ```text
//! A_s F_st = κ_pq A_s A_t,      s ∈ p, t ∈ q
//! ```
//!
//! A product of this matrix takes the sums A_s x_s up the tree, passes them along the links and takes what arrives down to the leaves, in
//! O(links + nodes) instead of m² (Hanrahan, Salzman, Aupperle, "A rapid hierarchical radiosity algorithm", SIGGRAPH 1991). Links join
//! unordered pairs, so the matrix is symmetric to the last bit, and every solver works on it.
//!
//! **Error.** Kernels are kept in single precision and areas to 26 bits, which is a relative error of 1e-7 an entry. What a link errs by
//! is estimated when it is made, see `links`; [`Links::error`] sums it up.
//!
//! What is *not* here: light that is better taken exactly (direct light of small emitters), and refinement of the mesh.

mod brightness;
mod clusters;
mod exchange;
mod links;
mod oracle;
mod pieces;
mod refinement;
mod sample;
mod screens;
mod shaft;
mod tree;
mod walls;

use std::sync::Arc;

use radiosity_core::{BandValues, Bands, BandsMut, Cost, Entries, FormFactors, Properties, Row, RowBuf, StoreError};
use rayon::prelude::*;

pub use brightness::Brightness;
pub use links::Links;
pub use refinement::Linking;
pub use tree::Hierarchy;

use exchange::Points;
use tree::{NONE, Node};

/// Nodes that one task computes; fixed, so that the work is cut alike at any number of threads.
const PIECE: usize = 4096;

/// The symmetric matrix of exchange areas that links stand for.
///
/// *Memory*: 8 bytes an end of a link and 4 a node, beside the hierarchy. *Reads*: `gather` and `scatter` take O(links + nodes) for all
/// bands at once; a row takes the links of one leaf and of all nodes above it, and m numbers.
#[derive(Clone, Debug)]
pub struct HierarchicalFormFactors {
    hierarchy: Arc<Hierarchy>,
    /// First end of every node's links, and their number.
    begins: Vec<u32>,
    /// The other node of every link of a node, and the kernel.
    ends: Vec<(u32, f32)>,
}

impl HierarchicalFormFactors {
    /// The matrix of `links` over `hierarchy`.
    ///
    /// # Panics
    ///
    /// If there are 2³¹ links or more.
    pub fn new(hierarchy: Arc<Hierarchy>, links: &Links) -> Self {
        assert!(links.len() < 1 << 31, "{} links", links.len());
        let seen = || links.links.iter().filter(|link| link.kernel > 0.0);
        let mut begins = vec![0_u32; hierarchy.len() + 1];
        for link in seen() {
            [link.p, link.q].iter().for_each(|&k| begins[k as usize + 1] += 1);
        }
        for k in 1..begins.len() {
            begins[k] += begins[k - 1];
        }
        let mut next = begins.clone();
        let mut ends = vec![(0, 0.0); begins[hierarchy.len()] as usize];
        for link in seen() {
            for (own, other) in [(link.p, link.q), (link.q, link.p)] {
                ends[next[own as usize] as usize] = (other, link.kernel);
                next[own as usize] += 1;
            }
        }
        Self { hierarchy, begins, ends }
    }

    /// Number of links that carry light.
    pub fn links(&self) -> usize {
        self.ends.len() / 2
    }

    /// The sums over elements of F, (1/A_s) Σ_t A_s F_st, which are 1 in a closed room.
    ///
    /// # Errors
    ///
    /// None; a store's products may fail in general.
    pub fn row_sums(&self) -> Result<Vec<f64>, StoreError> {
        let m = self.sources();
        let mut sums = BandValues::zeros(1, m);
        self.gather(Bands::new(&vec![1.0; m], m), sums.view_mut())?;
        let unit = self.unit();
        let areas = self.hierarchy.weights.iter();
        Ok(sums.values().iter().zip(areas).map(|(sum, area)| sum / (area * unit)).collect())
    }

    /// Irradiance of the elements from radiosities x, by links that vary linearly over their receivers.
    ///
    /// ```text
    /// H(y) = Σ_{p ∋ y} Σ_{q} (Σ_{t ∈ q} A_t x_t) · κ_pq (1 + g·(y − c_p)),      κ_pq = ⟨K⟩,   κ_pq g = the slope of ⟨K(y, ·)⟩ over p
    /// ```
    ///
    /// A product of the matrix gives every element of p the same share of what a link brings. This final gather (Lischinski, Tampieri,
    /// Greenberg 1993) evaluates the kernels of all links once more and leaves out only what is not linear over p. The mean over a node
    /// stays what it was, and no link brings less than nothing anywhere. Clusters, and nodes that a hierarchy holds for
    /// what they are not (see the module page of nodes), keep their mean. Costs one evaluation of the kernel an end of a link.
    ///
    /// # Panics
    ///
    /// If x does not fit.
    pub fn final_gather(&self, x: Bands<'_>) -> (BandValues, Cost) {
        assert_eq!(x.len(), self.sources(), "final gather: lengths");
        let (tree, bands) = (&*self.hierarchy, x.count());
        let sums = self.pull(x);
        let inner = tree.pieces[0].start;
        // What clusters bring to the roots of their pieces.
        let mut above = vec![0.0; inner * bands];
        for k in 0..inner {
            for b in 0..bands {
                let parent = tree.parents[k];
                let from_above = if parent == NONE { 0.0 } else { above[parent as usize * bands + b] };
                let own = self.ends_of(k).iter().map(|&(q, kernel)| f64::from(kernel) * sums[q as usize * bands + b]);
                above[k * bands + b] = from_above + own.sum::<f64>();
            }
        }
        let parts: Vec<Vec<f64>> = tree
            .pieces
            .par_iter()
            .map(|piece| {
                let root = tree.parents[piece.start];
                let above = if root == NONE { &[][..] } else { &above[root as usize * bands..][..bands] };
                self.linear(piece.clone(), &sums, above, bands)
            })
            .collect();
        let mut h = BandValues::zeros(bands, self.targets());
        for (piece, values) in tree.pieces.iter().zip(parts) {
            let elements = piece.clone().map(|k| tree.elements[k]).filter(|&e| e != NONE);
            for (e, values) in elements.zip(values.chunks_exact(bands)) {
                values.iter().enumerate().for_each(|(b, value)| h.band_mut(b)[e as usize] = *value);
            }
        }
        let evaluated = Cost { form_factors: self.ends.len() as u64, ..Cost::default() };
        (h, Cost::applied(self.ends.len(), size_of::<(u32, f32)>(), bands) + evaluated)
    }

    /// The final gather on one piece: values of its leaves in the order of nodes, with what clusters above bring.
    fn linear(&self, piece: std::ops::Range<usize>, sums: &[f64], above: &[f64], bands: usize) -> Vec<f64> {
        let tree = &*self.hierarchy;
        // Value at the centre and gradient, of every node and band.
        let mut h = vec![[0.0_f64; 4]; piece.len() * bands];
        h.iter_mut().zip(above).for_each(|(h, above)| h[0] = *above);
        let mut leaves = Vec::new();
        for k in piece.clone() {
            let (own, node) = ((k - piece.start) * bands, &tree.nodes[k]);
            if k > piece.start {
                let parent = tree.parents[k] as usize;
                let offset = (node.centre - tree.nodes[parent].centre).as_dvec3().to_array();
                for b in 0..bands {
                    let from = h[(parent - piece.start) * bands + b];
                    let slope: f64 = (0..3).map(|c| from[c + 1] * offset[c]).sum();
                    h[own + b] = [from[0] + slope, from[1], from[2], from[3]];
                }
            }
            if node.is_leaf() {
                for b in 0..bands {
                    h[own + b][0] += self
                        .ends_of(k)
                        .iter()
                        .map(|&(q, kernel)| f64::from(kernel) * sums[q as usize * bands + b])
                        .sum::<f64>();
                    leaves.push(h[own + b][0]);
                }
                continue;
            }
            let (points, [du, dv]) = (Points::of(tree, node), dual(node));
            for &(q, kernel) in self.ends_of(k) {
                let all = exchange::means(tree, &points, q);
                let whole = 0.25 * all.iter().sum::<f32>();
                // Slopes in proportion where blockers took their share of the mean.
                let share = if whole > 0.0 { kernel / whole } else { 0.0 };
                let [along, across] = exchange::slopes(&all).map(|slope| f64::from(slope * share));
                for b in 0..bands {
                    let x = sums[q as usize * bands + b];
                    let h = &mut h[own + b];
                    h[0] += f64::from(kernel) * x;
                    (0..3).for_each(|c| h[c + 1] += (along * du[c] + across * dv[c]) * x);
                }
            }
        }
        leaves
    }

    /// The hierarchy's unit of area, a power of two.
    fn unit(&self) -> f64 {
        self.hierarchy.frame.scale.powi(-2)
    }

    fn ends_of(&self, k: usize) -> &[(u32, f32)] {
        &self.ends[self.begins[k] as usize..self.begins[k + 1] as usize]
    }

    /// Sums A x over every node, all bands of a node together.
    fn pull(&self, x: Bands<'_>) -> Vec<f64> {
        let (tree, bands) = (&*self.hierarchy, x.count());
        let mut sums = vec![0.0; tree.len() * bands];
        let inner = tree.pieces[0].start;
        let (clusters, rest) = sums.split_at_mut(inner * bands);
        let up = |nodes: std::ops::Range<usize>, sums: &mut [f64]| {
            for k in nodes.clone().rev() {
                let own = (k - nodes.start) * bands;
                if tree.elements[k] != NONE {
                    let element = tree.elements[k] as usize;
                    (0..bands).for_each(|b| sums[own + b] = tree.weights[element] * x.band(b)[element]);
                }
                if k > nodes.start {
                    let parent = (tree.parents[k] as usize - nodes.start) * bands;
                    (0..bands).for_each(|b| sums[parent + b] += sums[own + b]);
                }
            }
        };
        slices(&tree.pieces, rest, bands).into_par_iter().for_each(|(nodes, sums)| up(nodes, sums));
        // Roots of pieces to their clusters, then clusters to theirs.
        for piece in tree.pieces.iter().filter(|_| inner > 0) {
            let (own, parent) = ((piece.start - inner) * bands, tree.parents[piece.start] as usize * bands);
            (0..bands).for_each(|b| clusters[parent + b] += rest[own + b]);
        }
        for k in (1..inner).rev() {
            let parent = tree.parents[k] as usize * bands;
            (0..bands).for_each(|b| clusters[parent + b] += clusters[k * bands + b]);
        }
        sums
    }

    /// What arrives at every node along its own links.
    fn exchange(&self, sums: &[f64], bands: usize) -> Vec<f64> {
        let mut arrived = vec![0.0; sums.len()];
        arrived.par_chunks_mut(PIECE * bands).enumerate().for_each(|(piece, arrived)| {
            for (k, own) in (piece * PIECE..).zip(arrived.chunks_exact_mut(bands)) {
                match own {
                    [a] => {
                        for &(other, kernel) in self.ends_of(k) {
                            *a += f64::from(kernel) * sums[other as usize];
                        }
                    }
                    [a, b, c] => {
                        for &(other, kernel) in self.ends_of(k) {
                            let (kernel, from) = (f64::from(kernel), other as usize * 3);
                            *a += kernel * sums[from];
                            *b += kernel * sums[from + 1];
                            *c += kernel * sums[from + 2];
                        }
                    }
                    _ => {
                        for &(other, kernel) in self.ends_of(k) {
                            let from = &sums[other as usize * bands..];
                            own.iter_mut().zip(from).for_each(|(a, x)| *a += f64::from(kernel) * x);
                        }
                    }
                }
            }
        });
        arrived
    }

    /// What arrived at nodes goes down to their elements.
    fn push(&self, mut arrived: Vec<f64>, mut y: BandsMut<'_>) {
        let (tree, bands) = (&*self.hierarchy, y.count());
        let inner = tree.pieces[0].start;
        let (clusters, rest) = arrived.split_at_mut(inner * bands);
        for k in 1..inner {
            let parent = tree.parents[k] as usize * bands;
            (0..bands).for_each(|b| clusters[k * bands + b] += clusters[parent + b]);
        }
        for piece in tree.pieces.iter().filter(|_| inner > 0) {
            let (own, parent) = ((piece.start - inner) * bands, tree.parents[piece.start] as usize * bands);
            (0..bands).for_each(|b| rest[own + b] += clusters[parent + b]);
        }
        slices(&tree.pieces, rest, bands).into_par_iter().for_each(|(nodes, arrived)| {
            for k in nodes.start + 1..nodes.end {
                let (own, parent) = ((k - nodes.start) * bands, (tree.parents[k] as usize - nodes.start) * bands);
                (0..bands).for_each(|b| arrived[own + b] += arrived[parent + b]);
            }
        });
        let unit = self.unit();
        for b in 0..bands {
            y.band(b).par_iter_mut().with_min_len(PIECE).enumerate().for_each(|(e, y)| {
                let leaf = tree.leaves[e] as usize * bands;
                *y = arrived[leaf + b] * tree.weights[e] * unit;
            });
        }
    }
}

/// Vectors whose products with a point's offset from the centre are its coordinates along the half axes; 0 for what is not flat and
/// nowhere near its parallelogram.
fn dual(node: &Node) -> [[f64; 3]; 2] {
    let (u, v) = (node.u.as_dvec3(), node.v.as_dvec3());
    let (uu, uv, vv) = (u.length_squared(), u.dot(v), v.length_squared());
    let size = uu * vv - uv * uv;
    if !node.is_parallelogram() || size <= 0.0 {
        return [[0.0; 3]; 2];
    }
    [(u * vv - v * uv) / size, (v * uu - u * uv) / size].map(|d| d.to_array())
}

/// The values of every piece's nodes, of `values` of all pieces' nodes.
fn slices<'v>(
    pieces: &[std::ops::Range<usize>],
    mut values: &'v mut [f64],
    bands: usize,
) -> Vec<(std::ops::Range<usize>, &'v mut [f64])> {
    let mut parts = Vec::with_capacity(pieces.len());
    for piece in pieces {
        let (own, rest) = values.split_at_mut(piece.len() * bands);
        parts.push((piece.clone(), own));
        values = rest;
    }
    parts
}

impl FormFactors for HierarchicalFormFactors {
    fn name(&self) -> &'static str {
        "hierarchical"
    }

    fn sources(&self) -> usize {
        self.hierarchy.order.len()
    }

    fn targets(&self) -> usize {
        self.sources()
    }

    fn properties(&self) -> Properties {
        let bytes = size_of_val(&self.ends[..]) + size_of_val(&self.begins[..]);
        Properties {
            symmetric: true,
            per_band: false,
            stored_bytes: bytes as u64 + self.hierarchy.bytes(),
            // Half a unit of the kernel's 24 bits, and of 26 bits of either area.
            rounding: (-24.0_f64).exp2() + 2.0 * (-26.0_f64).exp2(),
        }
    }

    fn row<'b>(&'b self, s: usize, _: usize, buf: &'b mut RowBuf) -> Result<Row<'b>, StoreError> {
        let tree = &*self.hierarchy;
        buf.values.clear();
        buf.values.resize(self.targets(), 0.0);
        let (unit, own) = (self.unit(), tree.weights[s]);
        let mut k = tree.leaves[s];
        while k != NONE {
            for &(other, kernel) in self.ends_of(k as usize) {
                for &t in tree.elements_of(other) {
                    // Each product is exact until the last, so that both directions and products round alike.
                    buf.values[t as usize] = f64::from(kernel) * (own * tree.weights[t as usize]) * unit;
                }
            }
            k = tree.parents[k as usize];
        }
        Ok(Row { entries: Entries::Dense(&buf.values), cost: Cost::default() })
    }

    fn gather(&self, x: Bands<'_>, y: BandsMut<'_>) -> Result<Cost, StoreError> {
        let m = self.sources();
        assert_eq!((x.len(), y.len(), y.count()), (m, m, x.count()), "gather: lengths");
        let arrived = self.exchange(&self.pull(x), x.count());
        self.push(arrived, y);
        Ok(Cost::applied(self.ends.len(), size_of::<(u32, f32)>(), x.count()))
    }

    fn scatter(&self, x: Bands<'_>, y: BandsMut<'_>) -> Result<Cost, StoreError> {
        self.gather(x, y)
    }
}
