//! What each surface does in the exchange of light: what sends nothing is no unknown, and what is not asked for either only blocks.
//!
//! With ρ = 0 in all bands a surface reflects nothing: B = E, known before anything is solved. If it does not emit either, no other surface's
//! H depends on it, and its own is one gather from the solution,
//!
//! ```text
//! H_s = (1/A_s) Σ_t A_s F_st B_t.
//! ```
//!
//! So it leaves the system, exactly: form factors between two such surfaces are needed by nobody, and if its H is not asked for those with the
//! others are not either; it is a blocker then, not meshed. A black surface that emits stays in the system: its rows are those that light
//! comes by. The same holds of a surface that no light reaches, whatever it reflects: H = 0. A test sees both answers within 1e-12, and the counts that are predicted.

use radiosity_geometry::Scene;

/// What a surface does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// It reflects or emits: an unknown of the system.
    Exchanges,
    /// Black, without emission: what arrives is gathered once, when the system is solved.
    Receives,
    /// No light reaches it, and its answer, 0, is asked for.
    Dark,
    /// It sends nothing and is not asked for: it blocks, and has no elements.
    Blocks,
}

/// The role of every surface; `lit` and `asked` tell which may receive light and which are asked for.
pub(super) fn roles(scene: &Scene, lit: impl Fn(usize) -> bool, asked: impl Fn(usize) -> bool) -> Vec<Role> {
    let role = |(s, surface): (usize, &radiosity_geometry::Surface)| {
        let material = &scene.materials[surface.material];
        let sends = material.emission.iter().chain(&material.reflectance).any(|&value| value != 0.0);
        match (lit(s) && sends, asked(s), lit(s)) {
            (true, ..) => Role::Exchanges,
            (false, false, _) => Role::Blocks,
            (false, true, true) => Role::Receives,
            (false, true, false) => Role::Dark,
        }
    };
    scene.surfaces.iter().enumerate().map(role).collect()
}
