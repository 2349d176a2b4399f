//! Scenes and systems with known answers.
//!
//! | what | known | tests |
//! |---|---|---|
//! | [`IntegratingSphere`] | F and B, exact for any subdivision | solvers and stores, without geometry |
//! | [`RandomEnclosure`] | F (by construction) | solvers and benches at any size |
//! | [`furnace`] | B uniform | form factors and solvers end to end |
//! | [`boxes`] | closure; tabulated form factors | estimators |
//! | [`ManufacturedRoom`] | B, H and E at every point | everything, interreflection included |
//! | [`FloorUnderLight`] | H at every point of the floor | meshes and form factors |
//! | [`Hinge`] | H at every point of one square | singular edges |
//! | [`BlockedLight`] | H at every point of the floor | shadows from soft to hard |
//! | [`MirrorRoom`] | that a hole into its image is as good as its mirror | specular transport |
//! | [`sphere()`] | volume | curved mirrors and glass |
//! | [`cornell_specular()`], [`mirror_cornell()`] | nothing in closed form; every class of paths is there | pictures |
//! | [`crowded_room()`] | that nothing leaves | many blockers |
//! | [`city()`] | areas | many facets of which most are hidden |
//! | [`rooms`] | what a solution can leave out | omissions |
//! | [`stiff()`] | B in twice the working precision | solvers, stores and bounds where they are stiff |
//! | [`bright_room()`] | B in twice the working precision | counts of products at any size |
//! | [`conformance()`] | what any store must do | stores |
//!
//! What is *not* here: files, and answers that are only known from a finer run.

mod blocked_light;
pub mod boxes;
mod city;
mod conformance;
mod cornell;
mod crowded_room;
mod double_double;
mod floor_under_light;
pub mod furnace;
mod hinge;
mod integrating_sphere;
mod manufactured;
pub mod mirror;
pub mod quadrature;
mod random_enclosure;
pub mod rectangles;
pub mod rooms;
mod sphere;
mod stiff;

pub use blocked_light::BlockedLight;
pub use city::city;
pub use conformance::conformance;
pub use cornell::{CORNELL_FLOOR, cornell_specular, mirror_cornell};
pub use crowded_room::crowded_room;
pub use floor_under_light::FloorUnderLight;
pub use hinge::Hinge;
pub use integrating_sphere::IntegratingSphere;
pub use manufactured::ManufacturedRoom;
pub use mirror::MirrorRoom;
pub use random_enclosure::RandomEnclosure;
pub use sphere::sphere;
pub use stiff::{Light, StiffCase, bright_room, exact_in_closed_room, stiff, with_light};
