//! `radiosity render --false-colour`: B, H or errors as numbers, in the colours of a scale with a legend.
//!
//! | what | a pixel shows | by two passes | by `--reference` |
//! |---|---|---|---|
//! | `radiosity` | B = E + ρH of the surface that is seen | as its element has it | H from paths that begin there |
//! | `irradiance` | H of that surface | as its element has it | from paths that begin there |
//! | `error` | π (L − L′) of the picture L that `render` makes and of L′ in the file `--against` | | |
//!
//! all in W/m², means over pixel and bands. Surfaces are shown where the eye meets them: mirrors and glass by what arrives at them, nothing is seen through them, and backs
//! are 0. B and H of two passes are those of the first, so that its mesh is seen as it is.
//!
//! What is *not* here: colours, scales and legends (`radiosity-render`).

use std::f64::consts::PI;
use std::path::{Path, PathBuf};

use clap::{Args as ClapArgs, ValueEnum};
use radiosity_core::Cost;
use radiosity_io::{read_exr, write_exr, write_png};
use radiosity_render::numbers::Numbers;
use radiosity_render::path_class::Arrival;
use radiosity_render::stage::Place;
use radiosity_render::{Camera, Field, Film, Image, PathClass, PathClasses, Scale, Stage};

use crate::Failure;
use crate::args::RenderArgs;
use crate::render::{Format, format_of, shows_light};

/// What false colours show.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Quantity {
    /// B of the surfaces that are seen.
    Radiosity,
    /// H of the surfaces that are seen.
    Irradiance,
    /// The picture less that of --against.
    Error,
}

impl Quantity {
    /// Its name in flags.
    pub fn name(self) -> &'static str {
        match self {
            Self::Radiosity => "radiosity",
            Self::Irradiance => "irradiance",
            Self::Error => "error",
        }
    }

    /// Whether it is one of the surfaces that are seen, and not of the picture.
    pub fn is_of_surfaces(self) -> bool {
        self != Self::Error
    }
}

/// Options of pictures in false colours.
#[derive(ClapArgs, Clone, Debug)]
pub struct FalseColourArgs {
    /// Show numbers in W/m², means over bands, in false colours with a legend: B or H of the surfaces that are seen, or the error against another picture. An .exr gets
    /// the numbers themselves, of an error as radiance.
    #[arg(long, value_name = "WHAT", value_enum, conflicts_with_all = ["tone", "white"])]
    pub false_colour: Option<Quantity>,
    /// Ends of the scale in W/m², the same for all pictures that are to be compared; what few pixels exceed if not given. That of errors is even about 0.
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true, requires = "false_colour")]
    pub range: Option<[f64; 2]>,
    /// Picture that errors are taken against: an .exr of the same size that `render` has written.
    #[arg(long, value_name = "FILE", required_if_eq("false_colour", "error"))]
    pub against: Option<PathBuf>,
}

fn range(text: &str) -> Result<[f64; 2], String> {
    let ends = text.split_once(',').and_then(|(low, high)| Some([low.trim().parse().ok()?, high.trim().parse().ok()?]));
    let ends = ends.filter(|[low, high]: &[f64; 2]| low.is_finite() && high.is_finite() && low < high);
    ends.ok_or_else(|| "must be two numbers LOW,HIGH, the first one smaller".to_owned())
}

/// Share of the pixels whose values the scale does not exceed, if no range is asked for; those that show a light do not count.
const ON_SCALE: f64 = 0.98;

/// Rows of a legend at least, and rows for each of its numbers, which are odd in number so that errors of 0 have theirs.
const LEGEND_ROWS: u32 = 24;
const ROWS_A_TICK: u32 = 40;

/// How a film is shown in false colours.
pub struct FalseColours {
    quantity: Quantity,
    range: Option<[f64; 2]>,
    /// Radiance of the other picture.
    against: Vec<[f32; 3]>,
}

impl FalseColours {
    /// Those asked for, if any; reads the picture that errors are taken against.
    pub fn new(args: &RenderArgs) -> Result<Option<Self>, Failure> {
        let FalseColourArgs { false_colour, range, against } = &args.false_colours;
        let Some(quantity) = *false_colour else {
            return against.as_ref().map_or(Ok(None), |_| Err("--against needs --false-colour error".into()));
        };
        if quantity.is_of_surfaces() && args.gather > 0 {
            let name = quantity.name();
            return Err(
                format!("--false-colour {name} shows what the mesh holds, without --gather; leave that out").into()
            );
        }
        if let (Quantity::Error, Some([low, high])) = (quantity, range)
            && *low != -high
        {
            return Err(format!("a scale of errors is even about 0; give --range={},{high}", -high).into());
        }
        let against = match (quantity, against) {
            (Quantity::Error, Some(path)) => picture_of(path, args.view.size)?,
            (_, Some(_)) => return Err("--against needs --false-colour error".into()),
            (_, None) => Vec::new(),
        };
        Ok(Some(Self { quantity, range: *range, against }))
    }

    /// What is shown of surfaces, if it is that.
    pub fn of_surfaces(&self) -> Option<Quantity> {
        Some(self.quantity).filter(|quantity| quantity.is_of_surfaces())
    }

    /// Writes a film.
    pub fn write(&self, path: &Path, film: &Film, stage: &Stage<'_>, camera: &Camera) -> Result<(), Failure> {
        let (width, height) = (film.width, film.height);
        match format_of(path)? {
            Format::Png => {
                let values = self.values(film);
                let [low, high] = self.ends(film, stage, camera);
                let scale =
                    if self.quantity == Quantity::Error { Scale::signed(high)? } else { Scale::linear(low, high)? };
                let rows = height.max(LEGEND_ROWS);
                let legend = scale.legend(rows, (rows / ROWS_A_TICK).clamp(2, 11) | 1, "W/m²");
                let image = Image::sheet(&[vec![&scale.picture(width, height, &values), &legend]], rows / ROWS_A_TICK);
                write_png(path, image.width, image.height, &image.rgb)?;
            }
            Format::Exr => {
                let pixels = film.means();
                let pixel = |(k, bands): (usize, &[f64])| {
                    let other = self.against.get(k).copied().unwrap_or_default();
                    [0, 1, 2].map(|b| bands[b.min(film.bands - 1)] as f32 - other[b])
                };
                let rgb: Vec<[f32; 3]> = pixels.chunks_exact(film.bands).enumerate().map(pixel).collect();
                write_exr(path, width, height, &rgb)?;
            }
        }
        Ok(())
    }

    /// The number of every pixel.
    fn values(&self, film: &Film) -> Vec<f64> {
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let means = film.means();
        let pixels = means.chunks_exact(film.bands).map(mean);
        match self.quantity {
            Quantity::Radiosity | Quantity::Irradiance => pixels.collect(),
            Quantity::Error => {
                pixels.zip(&self.against).map(|(l, other)| PI * (l - mean(&other.map(f64::from)))).collect()
            }
        }
    }

    /// Ends of the scale in W/m²: those asked for, or such that few values exceed them.
    pub fn ends(&self, film: &Film, stage: &Stage<'_>, camera: &Camera) -> [f64; 2] {
        self.range.unwrap_or_else(|| {
            let sizes: Vec<f64> = self.values(film).into_iter().map(f64::abs).collect();
            let shown =
                sizes.iter().enumerate().filter(|(k, _)| !shows_light(stage, camera, *k)).map(|(_, size)| *size);
            let mut counted: Vec<f64> = shown.collect();
            if counted.is_empty() {
                counted = sizes;
            }
            counted.sort_by(f64::total_cmp);
            let most = counted[((counted.len() - 1) as f64 * ON_SCALE) as usize];
            // Where all is dark any scale will do.
            let most = if most > 0.0 { most } else { 1.0 };
            [if self.quantity == Quantity::Error { -most } else { 0.0 }, most]
        })
    }
}

/// Radiance of every pixel of a picture of this size.
fn picture_of(path: &Path, [width, height]: [u32; 2]) -> Result<Vec<[f32; 3]>, Failure> {
    let picture = read_exr(path)?;
    if [picture.width, picture.height] != [width, height] {
        let other = format!("{}x{}", picture.width, picture.height);
        return Err(format!("{} has {other} pixels, not {width}x{height}; give --size {other}", path.display()).into());
    }
    Ok(picture.rgb)
}

/// Another round of B or H of what is seen: `irradiance(place, numbers, h)` adds a sample of H to `h`.
pub fn expose(
    quantity: Quantity,
    (stage, camera): (&Stage<'_>, &Camera),
    classes: PathClasses,
    seed: u64,
    film: &mut Film,
    irradiance: impl Fn(&Place, &mut Numbers, &mut [f64]) -> Cost + Sync,
) {
    let emitted = classes.has(at_surface(Arrival::Light));
    film.expose(seed, |[x, y], numbers, value| {
        let u = numbers.draw();
        let direction = camera.direction(f64::from(x) + u[0], f64::from(y) + u[1]);
        let mut cost = Cost { rays: 1, ..Cost::default() };
        let Some(place) = stage.first(camera.eye(), direction).filter(|place| place.front) else { return cost };
        let mut h = vec![0.0; value.len()];
        cost += irradiance(&place, numbers, &mut h);
        let materials = stage.emission(place.surface).iter().zip(stage.reflectance(place.surface));
        for ((value, h), (e, rho)) in value.iter_mut().zip(&h).zip(materials) {
            *value += match quantity {
                Quantity::Irradiance => *h,
                _ => rho * h + if emitted { *e } else { 0.0 },
            };
        }
        cost
    });
}

/// The class of light that arrives so at a surface that is seen directly.
pub fn at_surface(arrival: Arrival) -> PathClass {
    PathClass { arrival, specular_eye: false }
}

/// Adds H as the first pass has stored it, by those ways of arriving whose paths count.
pub fn stored(fields: [&dyn Field; 4], classes: PathClasses, place: &Place, h: &mut [f64]) -> Cost {
    const WAYS: [Arrival; 4] = [Arrival::Direct, Arrival::SpecularDirect, Arrival::Indirect, Arrival::SpecularIndirect];
    let wanted = fields.into_iter().zip(WAYS).filter(|(_, way)| classes.has(at_surface(*way)));
    // What lies in no element has no irradiance.
    if place.owner != u32::MAX {
        wanted.for_each(|(field, _)| field.add(place.owner, place.point, 1.0, h));
    }
    Cost::default()
}
