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
//! others are not either; it is a blocker then, not meshed. A black surface that emits is no unknown either where its light can be given to the others beforehand (`lamps.rs`); where
//! rows are estimated as a whole, or patches take part, it stays in the system, since its columns come with the others' rows. The same holds of a surface that no light reaches, whatever it reflects: H = 0; and where some surfaces are asked for, those of a room that holds none of them
//! only block as well: closed walls keep their light from those that are. A test sees both answers within 1e-12, and the counts that are predicted.

use radiosity_geometry::Scene;

/// What a surface does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// It reflects or emits: an unknown of the system.
    Exchanges,
    /// Black, without emission: what arrives is gathered once, when the system is solved.
    Receives,
    /// Black, with emission: B = E is known, and given to the others before the system is solved; what arrives is gathered once.
    Shines,
    /// No light reaches it, and its answer, 0, is asked for.
    Dark,
    /// It is not asked for, and sends nothing or nothing to what is: it blocks, and has no elements.
    Blocks,
}

/// The role of every surface; `lit`, `asked` and `wanted` tell which may receive light, which are asked for and which stand in a room with one that is.
pub(super) fn roles(
    scene: &Scene,
    lit: impl Fn(usize) -> bool,
    asked: impl Fn(usize) -> bool,
    wanted: impl Fn(usize) -> bool,
) -> Vec<Role> {
    let role = |(s, surface): (usize, &radiosity_geometry::Surface)| {
        let material = &scene.materials[surface.material];
        let [reflects, emits] =
            [&material.reflectance, &material.emission].map(|of| of.iter().any(|&value| value != 0.0));
        match (lit(s) && wanted(s) && (reflects || emits), asked(s), lit(s)) {
            (true, ..) => {
                if reflects {
                    Role::Exchanges
                } else {
                    Role::Shines
                }
            }
            (false, false, _) => Role::Blocks,
            (false, true, true) => Role::Receives,
            (false, true, false) => Role::Dark,
        }
    };
    scene.surfaces.iter().enumerate().map(role).collect()
}
