//! The command line.

use std::path::PathBuf;

use clap::{ArgGroup, Args as ClapArgs, Parser, Subcommand, ValueEnum};
use glam::DVec3;
use radiosity::{Method, SpecularBy, SpecularTransport, Store};
use radiosity_form_factors::analytic::PartialVisibility;
use radiosity_form_factors::extended::SpecularBounces;
use radiosity_render::{PathClass, Tone};

use crate::false_colour::FalseColourArgs;
use crate::solve::SPECULAR_RAYS;

/// Radiosity: form factors, solutions, pictures, comparisons.
#[derive(Debug, Parser)]
#[command(name = "radiosity", version, about)]
pub struct Args {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Write the matrix of form factors between the faces of a scene (row = from).
    FormFactors(FormFactorsArgs),
    /// Solve a scene and write radiosity and irradiance of every element.
    Solve(SolveArgs),
    /// Take a picture of a scene, mirrors, glass and glossy surfaces included.
    Render(RenderArgs),
    /// Error against time of every strategy that fits the scene: a table, a CSV file and a plot.
    Compare(CompareArgs),
    /// Tell what is in a scene, what will be left out and why, and what a solution would cost.
    Inspect(InspectArgs),
}

impl Args {
    /// The options that all commands share.
    pub fn common(&self) -> &Common {
        match &self.command {
            Command::FormFactors(a) => &a.common,
            Command::Solve(a) => &a.common,
            Command::Render(a) => &a.common,
            Command::Compare(a) => &a.common,
            Command::Inspect(a) => &a.common,
        }
    }
}

/// Options of every command.
#[derive(ClapArgs, Clone, Debug)]
pub struct Common {
    /// Scene: an OBJ file with its MTL, a View3D .vs3 file or an STL file.
    pub scene: PathBuf,
    /// Threads to use; all by default.
    #[arg(long, value_parser = at_least_one)]
    pub threads: Option<usize>,
    /// Seed of everything random.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Print one JSON object on stdout.
    #[arg(long)]
    pub json: bool,
    /// Print nothing but errors.
    #[arg(long)]
    pub quiet: bool,
    /// Show no progress.
    #[arg(long)]
    pub no_progress: bool,
    /// Say what would be done and what it would cost, and stop.
    #[arg(long)]
    pub dry_run: bool,
    /// Memory that may be taken, with a suffix k, M, G or T if you like; what the machine has left if not given. What would take more is
    /// refused before it begins.
    #[arg(long, value_name = "BYTES", value_parser = crate::memory::parse)]
    pub memory: Option<u64>,
    /// Scale reflectances at or above 1 (and Kd + Ks above 1) down to this.
    #[arg(long, value_name = "RHO", value_parser = below_one)]
    pub clamp_reflectance: Option<f64>,
    /// Reflectance of faces without a material.
    #[arg(long, value_name = "RHO", value_parser = below_one)]
    pub default_reflectance: Option<f64>,
}

fn at_least_one(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|&n| n >= 1).ok_or_else(|| "must be a whole number of at least 1".to_owned())
}

fn below_one(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|rho| (0.0..1.0).contains(rho)).ok_or_else(|| "must lie in [0, 1)".to_owned())
}

fn open_unit(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|t| *t > 0.0 && *t < 1.0).ok_or_else(|| "must lie between 0 and 1".to_owned())
}

fn positive(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|h: &f64| h.is_finite() && *h > 0.0).ok_or_else(|| "must be positive".to_owned())
}

fn count(text: &str) -> Result<u32, String> {
    text.parse().ok().filter(|&n| n >= 1).ok_or_else(|| "must be a whole number of at least 1".to_owned())
}

fn resolution(text: &str) -> Result<u32, String> {
    let even = |n: &u32| n.is_multiple_of(2) && (2..=4096).contains(n);
    text.parse().ok().filter(even).ok_or_else(|| "must be an even number from 2 to 4096".to_owned())
}

/// Estimators by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum MethodName {
    /// Exact pairs.
    Analytic,
    /// Rays over the hemisphere.
    RayCast,
    /// Rays over the hemisphere, with exact totals towards the emitters.
    #[value(name = "rays+emitters")]
    RaysAndEmitters,
    /// Item buffers on a half cube.
    Hemicube,
}

/// Most rays of a row whose error is asked for.
const MOST_RAYS: u32 = 1 << 20;

/// Which estimator, and how fine.
#[derive(ClapArgs, Clone, Debug)]
pub struct Estimator {
    /// Estimator of form factors; chosen by the size of the scene if not given.
    #[arg(long, value_enum)]
    pub method: Option<MethodName>,
    /// Rays a row of the ray-cast estimator.
    #[arg(long, value_name = "N", value_parser = count)]
    pub rays: Option<u32>,
    /// Standard error of a ray-cast row at which no more rays are cast, the root of the sum of its form factors' variances; --rays is then
    /// the most.
    #[arg(long, value_name = "T", value_parser = open_unit)]
    pub row_error: Option<f64>,
    /// Pixels along the top of a hemicube, even.
    #[arg(long, value_name = "R", value_parser = resolution)]
    pub resolution: Option<u32>,
    /// Test partly blocked pairs of the analytic estimator by this many segments instead of exactly.
    #[arg(long, value_name = "N", value_parser = count)]
    pub samples: Option<u32>,
}

impl Estimator {
    /// The method asked for by any of these options, among `blocking` polygons that may block.
    pub fn named(&self, blocking: usize) -> Option<Method> {
        let settings = self.rays.is_some() || self.row_error.is_some() || self.resolution.is_some();
        let asked = self.method.is_some() || settings || self.samples.is_some();
        asked.then(|| self.method(Method::analytic_among(blocking), blocking))
    }

    /// The method asked for with its settings, or `otherwise`, among `blocking` polygons that may block.
    pub fn method(&self, otherwise: Method, blocking: usize) -> Method {
        let named = self.method.map(|name| match name {
            MethodName::Analytic => Method::analytic_among(blocking),
            MethodName::RayCast => Method::RAY_CAST,
            MethodName::RaysAndEmitters => Method::RAYS_AND_EMITTERS,
            MethodName::Hemicube => Method::HEMICUBE,
        });
        // A setting of one estimator asks for it.
        let rays = self.rays.map(|_| ()).or(self.row_error.map(|_| ()));
        let implied = rays.map(|()| Method::RAY_CAST).or(self.resolution.map(|_| Method::HEMICUBE));
        match named.or(implied).unwrap_or(otherwise) {
            Method::Analytic { tolerance, partial } => {
                let rays =
                    self.samples.map(|samples| PartialVisibility::Rays { samples, standard_error: f64::INFINITY });
                Method::Analytic { tolerance, partial: rays.unwrap_or(partial) }
            }
            Method::RayCast { rays, error } => {
                // As many rays as the error needs, unless told how many at most.
                let most = if self.row_error.is_some() { MOST_RAYS } else { rays };
                Method::RayCast { rays: self.rays.unwrap_or(most), error: self.row_error.or(error) }
            }
            Method::RaysAndEmitters { rays } => Method::RaysAndEmitters { rays: self.rays.unwrap_or(rays) },
            Method::Hemicube { resolution } => Method::Hemicube { resolution: self.resolution.unwrap_or(resolution) },
        }
    }
}

/// Ways to form factors by way of specular surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SpecularName {
    /// By 4,096 rays a row: any specular surface.
    Rays,
    /// By mirror images: ideal mirrors alone, exactly; any number of bounces only where mirrors do not face each other.
    Images,
}

impl From<SpecularName> for SpecularBy {
    fn from(name: SpecularName) -> Self {
        match name {
            SpecularName::Rays => Self::Rays(SPECULAR_RAYS),
            SpecularName::Images => Self::Images,
        }
    }
}

/// Stores by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum StoreName {
    /// Every entry, 8 bytes each.
    Dense,
    /// Entries that are not zero, 12 bytes each.
    Sparse,
    /// Every pair once, 4 bytes an entry of the matrix; of symmetric form factors.
    Packed,
    /// Every pair once in single precision, 2 bytes an entry of the matrix; of symmetric form factors.
    #[value(name = "packed-f32")]
    PackedF32,
    /// Rows computed whenever they are asked for; nothing is held.
    OnDemand,
    /// Rows computed when they are first asked for, and kept.
    OnDemandKept,
    /// Links between groups of elements of any size, refined with the solution; of the analytic method.
    Hierarchical,
}

impl From<StoreName> for Store {
    fn from(name: StoreName) -> Self {
        match name {
            StoreName::Dense => Self::Dense,
            StoreName::Sparse => Self::Sparse,
            StoreName::Packed => Self::Packed,
            StoreName::PackedF32 => Self::PackedSingle,
            StoreName::OnDemand => Self::KeepNone,
            StoreName::OnDemandKept => Self::KeepAll,
            StoreName::Hierarchical => Self::HIERARCHICAL,
        }
    }
}

/// `radiosity form-factors`.
#[derive(ClapArgs, Debug)]
pub struct FormFactorsArgs {
    /// Scene and common options.
    #[command(flatten)]
    pub common: Common,
    /// Estimator.
    #[command(flatten)]
    pub estimator: Estimator,
    /// Largest error of an unblocked form factor of the analytic estimator; that of the file (eps of a .vs3), else 1e-10, if not given.
    #[arg(long, value_name = "T", value_parser = open_unit)]
    pub tolerance: Option<f64>,
    /// Split each quadrilateral K × K and each triangle into K²; rows are the cells.
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = count)]
    pub subdivide: u32,
    /// Cut cells where surfaces touch or cross, as `solve` does: one row a line of its output, in the same order, 0 inside solids.
    #[arg(long, conflicts_with = "from")]
    pub contacts: bool,
    /// Close the row sums of a closed scene by symmetric scaling; rows of rays or hemicubes are made symmetric first.
    #[arg(long, conflicts_with = "from")]
    pub repair: bool,
    /// File to write: .csv, .mtx or .npy, or .vf or .txt in the layout of View3D; F.csv.json beside it says what it holds.
    #[arg(long, short, required_unless_present = "from")]
    pub output: Option<PathBuf>,
    /// Factors from this point with this normal to every face instead of the matrix, exact; as a table if no file is named.
    #[arg(
        long,
        value_name = "X,Y,Z,NX,NY,NZ",
        value_parser = point_normal,
        allow_hyphen_values = true,
        conflicts_with_all = ["method", "rays", "resolution", "samples", "tolerance"]
    )]
    pub from: Option<PointNormal>,
}

/// A point with a normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointNormal {
    /// The point.
    pub point: DVec3,
    /// Its unit normal.
    pub normal: DVec3,
}

fn point_normal(text: &str) -> Result<PointNormal, String> {
    let words: Vec<&str> = text.split(',').map(str::trim).collect();
    let numbers: Vec<f64> = words.iter().filter_map(|w| w.parse().ok().filter(|x: &f64| x.is_finite())).collect();
    if words.len() != 6 || numbers.len() != 6 {
        return Err("must be six numbers x,y,z,nx,ny,nz".to_owned());
    }
    let normal = DVec3::from_slice(&numbers[3..]);
    match normal.try_normalize() {
        Some(normal) => Ok(PointNormal { point: DVec3::from_slice(&numbers), normal }),
        None => Err("the normal nx,ny,nz must not be zero".to_owned()),
    }
}

/// How fine the mesh is.
#[derive(ClapArgs, Clone, Debug)]
pub struct MeshArgs {
    /// K × K elements a face.
    #[arg(long, value_name = "K", value_parser = count, group = "fineness")]
    pub subdivide: Option<u32>,
    /// Elements with edges of at most this length.
    #[arg(long, value_name = "H", value_parser = positive, group = "fineness")]
    pub element_size: Option<f64>,
    /// K × K patches a face, which must divide the elements: substructuring.
    #[arg(long, value_name = "K", value_parser = count)]
    pub patch_subdivide: Option<u32>,
}

/// How elements are shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Shading {
    /// One polygon and one radiosity an element.
    Flat,
    /// Triangles with radiosities at their vertices.
    Linear,
}

/// What a run may leave out.
#[derive(ClapArgs, Clone, Debug)]
#[command(group = ArgGroup::new("camera").args(["eye", "look_at", "up", "fov", "size"]).multiple(true).requires("ask_view"))]
pub struct PlanArgs {
    /// Compute also what the scene does not need: dark rooms and bands, form factors between rooms, black faces as unknowns; and what its error
    /// does not need: small pairs, weak bounces, elements that the faces asked for do not see.
    #[arg(long)]
    pub keep_everything: bool,
    /// Faces or groups whose solution is wanted, by number from 0 or by name, with commas between; all if not given. What sends nothing
    /// and is not wanted only blocks, as does a closed room that holds nothing wanted; --tolerance is of these faces, and links and refinement elsewhere are as coarse as they allow.
    #[arg(long, value_name = "FACE,GROUP,…", value_delimiter = ',')]
    pub ask: Vec<String>,
    /// Only what a camera shows is wanted, placed by --eye, --look-at, --up, --fov and --size as that of `render`: --tolerance, --thin-error and --bounce-error are
    /// rms over pixels of what they show of reflected light, relative to its mean; with --ask of the faces named alone. Faces in view are written.
    #[arg(long)]
    pub ask_view: bool,
    /// The camera.
    #[command(flatten)]
    pub view: ViewArgs,
}

/// `radiosity solve`.
#[derive(ClapArgs, Debug)]
#[command(group = ArgGroup::new("wanted").args(["tolerance", "time"]).multiple(true))]
pub struct SolveArgs {
    /// Scene and common options.
    #[command(flatten)]
    pub common: Common,
    /// Estimator.
    #[command(flatten)]
    pub estimator: Estimator,
    /// Mesh.
    #[command(flatten)]
    pub mesh: MeshArgs,
    /// What is left out.
    #[command(flatten)]
    pub plan: PlanArgs,
    /// Refine until the estimated rms error of irradiance over the report grid is at most this share of its mean.
    #[arg(long, value_name = "T", value_parser = open_unit, group = "fineness")]
    pub tolerance: Option<f64>,
    /// Seconds that refining may take: with --tolerance a strategy that is expected to be there by then, without it the smallest error that is. No
    /// mesh is begun once they are over: what is refined within a time depends on the clock, and may differ from run to run.
    #[arg(
        long,
        value_name = "S",
        value_parser = positive,
        conflicts_with_all = ["form_factors", "after", "subdivide", "element_size", "patch_subdivide", "repair"]
    )]
    pub time: Option<f64>,
    /// Tell which strategies --tolerance and --time choose among, what each is expected to take, and why it is not the one.
    #[arg(long, requires = "wanted")]
    pub explain: bool,
    /// Measure on this scene what pairs and rays take here, and predict times by that.
    #[arg(long, requires = "wanted")]
    pub calibrate: bool,
    /// Write the means over K × K cells a face instead of the elements.
    #[arg(long, value_name = "K", value_parser = count)]
    pub report_grid: Option<u32>,
    /// Specular surfaces in a row that light may take between diffuse ones: 0, 1, …, any.
    #[arg(
        long,
        value_name = "N",
        default_value = "0",
        value_parser = bounces,
        conflicts_with_all = ["form_factors", "after", "wanted"]
    )]
    pub specular_bounces: SpecularBounces,
    /// How form factors by way of specular surfaces are found.
    #[arg(long, value_name = "NAME", value_enum, default_value = "rays")]
    pub specular_by: SpecularName,
    /// Solver: direct, direct-f32, jacobi, gauss-seidel, sor, chebyshev, cg, deflated-cg, gmres, shooting, overshooting, stochastic, or
    /// hierarchical, which is cg on the hierarchical store.
    #[arg(long, value_name = "NAME")]
    pub solver: Option<String>,
    /// Unshot share of the emitted power at which the solver stops; of the stochastic one the estimated error as a share of it. 1e-9, and
    /// 1e-2 for the stochastic one, whose time grows like the inverse square, if not given.
    #[arg(long, value_name = "ETA", value_parser = open_unit)]
    pub unshot: Option<f64>,
    /// Most steps of the solver.
    #[arg(long, value_name = "N", default_value_t = 1_000_000, value_parser = count)]
    pub steps: u32,
    /// What is kept of the form factors; packed stores need the analytic method or symmetric saved form factors. Chosen by the share of entries
    /// that are not zero, their number, the solver and the memory there is if not given; dense where a mesh is refined, light is specular, or form
    /// factors come from a file or an earlier scene.
    #[arg(long, value_name = "NAME", value_enum)]
    pub store: Option<StoreName>,
    /// Estimated rms error of irradiance that the links of the hierarchical store may cause, as a share of its mean.
    #[arg(long, value_name = "T", value_parser = open_unit)]
    pub link_error: Option<f64>,
    /// Drop pairs too small to matter: rms error of irradiance that this may cause, as a share of its mean level. Which they are is found by a coarse solution, and the
    /// bound from the answer is kept below this, if need be by dropping fewer; of the analytic method in the full form. A tenth of --tolerance where that refines the
    /// full form.
    #[arg(long, value_name = "T", value_parser = open_unit, conflicts_with_all = ["form_factors", "after", "repair"])]
    pub thin_error: Option<f64>,
    /// Stop the solver when bounces of light that are left change irradiance by at most this share of its level; a tenth of --tolerance
    /// where --unshot is not given.
    #[arg(long, value_name = "T", value_parser = open_unit, conflicts_with_all = ["form_factors", "after"])]
    pub bounce_error: Option<f64>,
    /// Close the row sums of a closed scene by symmetric scaling; rows of rays or hemicubes are made symmetric first.
    #[arg(long)]
    pub repair: bool,
    /// Take form factors from this file (.csv, .mtx, .npy or .vf; row = from) as `form-factors --contacts` writes it, instead of
    /// computing them; its .json beside it tells the subdivision, areas and bounds.
    #[arg(
        long,
        value_name = "FILE",
        conflicts_with_all = ["method", "rays", "resolution", "samples", "element_size", "patch_subdivide", "tolerance"]
    )]
    pub form_factors: Option<PathBuf>,
    /// Say before the solver begins how many steps it and the others will take: q, spectral radius and condition from 12 products.
    #[arg(long, conflicts_with = "dry_run")]
    pub forecast: bool,
    /// Solve this scene first, then go on to SCENE, which lists the same faces, of other materials or with one face or one object moved:
    /// only form factors that can have changed are computed, and the solver starts from the first answer. Says what that saved.
    #[arg(long, value_name = "BEFORE", conflicts_with_all = ["form_factors", "tolerance"])]
    pub after: Option<PathBuf>,
    /// How a .ply file shows radiosity: flat, every element in the one value it has, or linear inside elements and continuous between them but at
    /// edges and shadow lines.
    #[arg(long, value_name = "NAME", value_enum, default_value = "flat")]
    pub shading: Shading,
    /// File to write: .csv or .ply.
    #[arg(long, short)]
    pub output: Option<PathBuf>,
}

impl SolveArgs {
    /// How light takes specular surfaces.
    pub fn transport(&self) -> SpecularTransport {
        SpecularTransport { bounces: self.specular_bounces, by: self.specular_by.into() }
    }
}

/// `radiosity render`.
#[derive(ClapArgs, Debug)]
pub struct RenderArgs {
    /// Scene and common options.
    #[command(flatten)]
    pub common: Common,
    /// Where the camera stands and what it shows.
    #[command(flatten)]
    pub view: ViewArgs,
    /// Mesh of the first pass; about 2,000 elements if not given.
    #[command(flatten)]
    pub mesh: MeshArgs,
    /// Specular surfaces in a row that light may take between diffuse ones in the first pass: 0, 1, …, any.
    #[arg(long, value_name = "N", default_value = "any", value_parser = bounces)]
    pub specular_bounces: SpecularBounces,
    /// How form factors by way of specular surfaces are found.
    #[arg(long, value_name = "NAME", value_enum, default_value = "rays")]
    pub specular_by: SpecularName,
    /// Points drawn on lights wherever a diffuse surface is seen; 0 shows direct light as the mesh holds it.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub light_points: u32,
    /// Directions gathered wherever a diffuse surface is seen; 0 shows indirect light as the mesh holds it.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub gather: u32,
    /// Gather only from elements that are off by more than this share of the mean reflected radiosity, by a look around from each; 0 gathers everywhere.
    #[arg(long, value_name = "T", default_value_t = 0.02, value_parser = share)]
    pub gather_tolerance: f64,
    /// What the mesh holds between its values.
    #[arg(long, value_name = "NAME", value_enum, default_value = "linear")]
    pub shading: Shading,
    /// Trace paths from the eye to the lights instead: no mesh, no error but noise.
    #[arg(
        long,
        conflicts_with_all = [
            "subdivide", "element_size", "patch_subdivide", "specular_bounces", "specular_by", "light_points", "gather", "gather_tolerance", "shading",
        ]
    )]
    pub reference: bool,
    /// Show light of these classes of paths alone: LE, LSE, LDE, LDSE, LSDE, LSDSE, LDDE, LDDSE, LDSDE, LDSDSE, by commas.
    #[arg(long, value_name = "CLASSES", value_delimiter = ',', value_parser = path_class)]
    pub paths: Vec<PathClass>,
    /// Stop when the standard error, rms over pixels, is at most this share of the mean level; 0 takes all samples. 0.02 if not given; if
    /// given and not reached, the exit code is 1.
    #[arg(long, value_name = "E", value_parser = share)]
    pub noise: Option<f64>,
    /// Most samples that a pixel takes in the mean; they come in rounds of 16.
    #[arg(long, value_name = "N", default_value_t = 4096, value_parser = count)]
    pub samples: u32,
    /// Take as many samples of every pixel as of any other, instead of more where there is more noise (from 256 samples on, of which the first 64 are even).
    #[arg(long)]
    pub even: bool,
    /// How a PNG shows brightness.
    #[arg(long, value_name = "NAME", value_enum, default_value = "clamp")]
    pub tone: ToneName,
    /// Numbers instead of colours.
    #[command(flatten)]
    pub false_colours: FalseColourArgs,
    /// Radiosity shown as white in a PNG, in W/m²; what 2 % of the pixels that show no light exceed if not given, 4 times that with reinhard or
    /// filmic.
    #[arg(long, value_name = "W", value_parser = positive)]
    pub white: Option<f64>,
    /// Picture of what there is so far, rewritten every few seconds: .png or .exr.
    #[arg(long, value_name = "FILE")]
    pub preview: Option<PathBuf>,
    /// Keep the state of the picture in this file, rewritten every few seconds and at the end.
    #[arg(long, value_name = "FILE")]
    pub state: Option<PathBuf>,
    /// Go on from the file that --state names.
    #[arg(long, requires = "state")]
    pub resume: bool,
    /// Picture to write: .png, or .exr with linear radiance in W/(m² sr).
    #[arg(long, short)]
    pub output: PathBuf,
}

/// A camera.
#[derive(ClapArgs, Clone, Debug)]
pub struct ViewArgs {
    /// Where the camera stands; before the open side of the scene, or inside at the end of a closed one, if not given.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    pub eye: Option<DVec3>,
    /// What it looks at; the middle of the scene if not given.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    pub look_at: Option<DVec3>,
    /// What is up in the picture; the axis from which most light comes, or y, if not given.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    pub up: Option<DVec3>,
    /// Angle of view from the lower to the upper edge of the picture.
    #[arg(long, value_name = "DEG", default_value_t = 60.0)]
    pub fov: f64,
    /// Pixels of the picture.
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = size)]
    pub size: [u32; 2],
}

/// Curves of brightness by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ToneName {
    /// In proportion, cut off at white.
    Clamp,
    /// l (1 + l/w²)/(1 + l), Reinhard and others 2002.
    Reinhard,
    /// With a toe and a shoulder, Hable 2010.
    Filmic,
}

impl From<ToneName> for Tone {
    fn from(name: ToneName) -> Self {
        match name {
            ToneName::Clamp => Self::Clamp,
            ToneName::Reinhard => Self::Reinhard,
            ToneName::Filmic => Self::Filmic,
        }
    }
}

fn bounces(text: &str) -> Result<SpecularBounces, String> {
    match text.parse() {
        Ok(0) => Ok(SpecularBounces::None),
        Ok(most) => Ok(SpecularBounces::AtMost(most)),
        Err(_) if text == "any" => Ok(SpecularBounces::Any),
        Err(_) => Err("must be a whole number, or any".to_owned()),
    }
}

fn path_class(text: &str) -> Result<PathClass, String> {
    PathClass::named(text).ok_or_else(|| {
        let names = PathClass::ALL.map(PathClass::name).join(", ");
        format!("there is no such class of paths; choose among {names}")
    })
}

fn share(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|t| (0.0..1.0).contains(t)).ok_or_else(|| "must lie in [0, 1)".to_owned())
}

fn point(text: &str) -> Result<DVec3, String> {
    let words: Vec<&str> = text.split(',').map(str::trim).collect();
    let numbers: Vec<f64> = words.iter().filter_map(|w| w.parse().ok().filter(|x: &f64| x.is_finite())).collect();
    if words.len() == 3 && numbers.len() == 3 {
        Ok(DVec3::from_slice(&numbers))
    } else {
        Err("must be three numbers x,y,z".to_owned())
    }
}

/// Longest edge of a picture in pixels.
const LONGEST_EDGE: u32 = 16_384;

fn size(text: &str) -> Result<[u32; 2], String> {
    let edge = |word: &str| word.parse().ok().filter(|n| (1..=LONGEST_EDGE).contains(n));
    let edges = text.split_once('x').and_then(|(width, height)| Some([edge(width)?, edge(height)?]));
    edges.ok_or_else(|| format!("must be WIDTHxHEIGHT with edges of 1 to {LONGEST_EDGE} pixels"))
}

impl RenderArgs {
    /// How light takes specular surfaces.
    pub fn transport(&self) -> SpecularTransport {
        SpecularTransport { bounces: self.specular_bounces, by: self.specular_by.into() }
    }
}

/// `radiosity compare`.
#[derive(ClapArgs, Debug)]
pub struct CompareArgs {
    /// Scene and common options.
    #[command(flatten)]
    pub common: Common,
    /// K × K elements a face.
    #[arg(long, value_name = "K", default_value_t = 4, value_parser = count)]
    pub subdivide: u32,
    /// Unshot share of the emitted power at which the solvers stop.
    #[arg(long, value_name = "ETA", default_value_t = 1e-6, value_parser = open_unit)]
    pub unshot: f64,
    /// Compare the strategies that refine to this estimated rms error of irradiance over 8 × 8 cells a face instead: what each was expected
    /// to take beside what it took, the expected first coming first; those ten times as slow as the best are cut off between meshes.
    #[arg(long, value_name = "T", value_parser = open_unit, conflicts_with_all = ["subdivide", "unshot"])]
    pub tolerance: Option<f64>,
    /// Folder for comparison.csv, comparison.svg and comparison.png.
    #[arg(long, short, default_value = "comparison")]
    pub output: PathBuf,
}

/// `radiosity inspect`.
#[derive(ClapArgs, Debug)]
pub struct InspectArgs {
    /// Scene and common options.
    #[command(flatten)]
    pub common: Common,
    /// Mesh to predict.
    #[command(flatten)]
    pub mesh: MeshArgs,
    /// Estimator to predict.
    #[command(flatten)]
    pub estimator: Estimator,
    /// What is left out.
    #[command(flatten)]
    pub plan: PlanArgs,
    /// Compute the form factors, as `solve` would, and forecast the steps of every solver from 12 products.
    #[arg(long, conflicts_with = "dry_run")]
    pub forecast: bool,
    /// Unshot share of the emitted power that steps are forecast for.
    #[arg(long, value_name = "ETA", default_value_t = 1e-9, value_parser = open_unit, requires = "forecast")]
    pub unshot: f64,
}
