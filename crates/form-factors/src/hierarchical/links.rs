//! Links and what all of them err by together.

use rayon::prelude::*;

use super::brightness::Brightness;
use super::oracle::Contributions;
use super::tree::{Hierarchy, NONE};

/// Links that one task adds up; fixed, so that sums round alike at any number of threads.
const PIECE: usize = 4096;

/// One kernel for all pairs of elements of two nodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Link {
    pub p: u32,
    pub q: u32,
    pub kernel: f32,
    pub estimate: Estimate,
}

/// What a kernel may err by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Estimate {
    /// Standard deviation of F(x → q) over p, and of F(y → p) over q.
    pub varies: [f32; 2],
    /// What the kernel may be off by.
    pub wrong: f32,
}

impl Estimate {
    pub const EXACT: Self = Self { varies: [0.0; 2], wrong: 0.0 };
}

/// Links that cover every pair of elements that may see each other once.
#[derive(Clone, Debug, Default)]
pub struct Links {
    pub(super) links: Vec<Link>,
}

impl Links {
    /// Number of links.
    pub fn len(&self) -> usize {
        self.links.len()
    }

    /// Whether nothing sees anything.
    pub fn is_empty(&self) -> bool {
        self.links.is_empty()
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        size_of_val(&self.links[..]) as u64
    }

    /// Bytes of so many links.
    pub fn bytes_of(links: u64) -> u64 {
        size_of::<Link>() as u64 * links
    }

    /// Estimated rms error of the irradiance of elements with this brightness, relative to its mean.
    ///
    /// ```text
    /// √( Σ_links (ε_p² + ε_q²) / Σ A )       each ε² as often as it counts ([`Brightness::worth`]), where receivers get what is linear over them
    /// ([`Brightness::linear`])
    /// √( Σ_e A_e (Σ_{p ∋ e} Σ_{links of p} ε_p/√A_p)² / Σ A )      where they hold one value
    /// ```
    ///
    /// What is left beyond a linear function, and what sampled visibility adds, hardly depend on each other; slopes of all links of a receiver
    /// may tend the same way, so that they are added by size.
    pub fn error(&self, hierarchy: &Hierarchy, brightness: &Brightness) -> f64 {
        let total = f64::from(hierarchy.nodes[0].area);
        let of = |link: &Link| Contributions::of(hierarchy, brightness, link.p, link.q);
        if brightness.linear {
            let square = |link: &Link| f64::from(of(link).square(link.estimate));
            let parts: Vec<f64> = self.links.par_chunks(PIECE).map(|links| links.iter().map(square).sum()).collect();
            return (parts.iter().sum::<f64>() / total).sqrt();
        }
        let mut off = vec![0.0_f64; hierarchy.len()];
        for link in &self.links {
            let pair = of(link);
            for (k, node) in [link.p, link.q].into_iter().enumerate() {
                off[node as usize] += f64::from(pair.missed(k, link.estimate));
            }
        }
        let mut sum = 0.0;
        for (k, node) in hierarchy.nodes.iter().enumerate() {
            if hierarchy.parents[k] != NONE {
                off[k] += off[hierarchy.parents[k] as usize];
            }
            if node.is_leaf() {
                sum += f64::from(node.area) * f64::from(brightness.counts(k)) * off[k].powi(2);
            }
        }
        (sum / total).sqrt()
    }
}
