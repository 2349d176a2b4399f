//! Links and what all of them err by together.

use super::brightness::Brightness;
use super::oracle::Contributions;
use super::tree::{Hierarchy, NONE};

/// One kernel for all pairs of elements of two nodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Link {
    pub p: u32,
    pub q: u32,
    pub kernel: f32,
    /// Standard deviation of F(x → q) over p, and of F(y → p) over q.
    pub varies: [f32; 2],
    /// What the kernel may be off by.
    pub wrong: f32,
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
    /// √( Σ_links (ε_p² + ε_q²) / Σ A )       where receivers get what is linear over them ([`Brightness::linear`])
    /// √( Σ_e A_e (Σ_{p ∋ e} Σ_{links of p} ε_p/√A_p)² / Σ A )      where they hold one value
    /// ```
    ///
    /// What is left beyond a linear function, and what sampled visibility adds, hardly depend on each other; slopes of all links of a receiver
    /// may tend the same way, so that they are added by size.
    pub fn error(&self, hierarchy: &Hierarchy, brightness: &Brightness) -> f64 {
        let total = f64::from(hierarchy.nodes[0].area);
        let pairs = self.links.iter().map(|link| (link, Contributions::of(hierarchy, brightness, link.p, link.q)));
        if brightness.linear {
            let sum: f64 =
                pairs.map(|(link, pair)| pair.errors(link.varies, link.wrong)).map(|[p, q]| f64::from(p + q)).sum();
            return (sum / total).sqrt();
        }
        let mut off = vec![0.0_f64; hierarchy.len()];
        for (link, pair) in pairs {
            for (k, node) in [link.p, link.q].into_iter().enumerate() {
                off[node as usize] += f64::from(pair.missed(k, link.varies, link.wrong));
            }
        }
        let mut sum = 0.0;
        for (k, node) in hierarchy.nodes.iter().enumerate() {
            if hierarchy.parents[k] != NONE {
                off[k] += off[hierarchy.parents[k] as usize];
            }
            if node.is_leaf() {
                sum += f64::from(node.area) * off[k].powi(2);
            }
        }
        (sum / total).sqrt()
    }
}
