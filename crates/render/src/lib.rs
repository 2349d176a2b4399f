//! Pictures of radiosity solutions.
//!
//! A [`Camera`] looks at facets, a [`View`] remembers what each of its pixels sees, and colours come from one
//! [`Exposure`] for all pictures of a comparison or from a [`Scale`] of false colours. There every facet is shown in the one radiosity it
//! has, the same from all sides and without interpolation, so that blockiness is seen as it is, or in what a function says of its points
//! ([`View::picture_of`]).
//!
//! Where surfaces are specular, a [`Stage`] is the scene as paths of light see it, with the functions of [`brdf`]: a [`TwoPass`] follows
//! specular paths from the eye to stored irradiance, and a [`PathTracer`] is the reference. Both expose a [`Film`].
//!
//! What is *not* here: files (`radiosity-io` writes them), and the first pass.

pub mod brdf;
pub mod camera;
mod eye;
pub mod false_colour;
pub mod film;
mod fingerprint;
pub mod flat;
pub mod image;
pub mod numbers;
pub mod path_class;
pub mod path_tracer;
pub mod stage;
pub mod tone;
pub mod two_pass;
pub mod view;
mod walk;

pub use camera::{Camera, CameraError};
pub use false_colour::{Scale, ScaleError};
pub use film::{Allotment, Film};
pub use fingerprint::fingerprint;
pub use flat::flat_picture;
pub use image::Image;
pub use path_class::{PathClass, PathClasses};
pub use path_tracer::PathTracer;
pub use stage::Stage;
pub use tone::{Exposure, Tone};
pub use two_pass::{Control, FacetIrradiance, Field, Stored, TwoPass, TwoPassSettings};
pub use view::{BackFaces, View, ViewSettings, render};
