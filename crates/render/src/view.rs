//! What a camera sees of facets, found by one or more rays a pixel.

use glam::DVec3;
use radiosity_geometry::{Facets, Occluders};
use rayon::prelude::*;

use crate::tone::bytes;
use crate::{Camera, Exposure, Image, Scale};

/// How faces seen from behind are shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BackFaces {
    /// Black: nothing leaves a back.
    #[default]
    Black,
    /// A dark grey that no exposure changes, to tell backs from shadows.
    DarkGrey,
    /// Not at all: rays go on, so a closed room can be looked into from outside.
    SeeThrough,
}

/// Settings of a [`View`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ViewSettings {
    /// Rays a pixel along each side: 1 for jagged, 2 for smoother edges (2 × 2 rays).
    pub samples: u32,
    /// How faces seen from behind are shown.
    pub back_faces: BackFaces,
    /// Colour where nothing is seen.
    pub background: [u8; 3],
}

impl Default for ViewSettings {
    fn default() -> Self {
        Self { samples: 2, back_faces: BackFaces::default(), background: [0; 3] }
    }
}

/// What one ray meets.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Seen {
    Nothing,
    Back,
    /// A facet at a distance from the eye: single precision places a point to 1e-7 of it, far below a pixel.
    Front(u32, f32),
}

/// The facets that the pixels of a camera see; the rays are cast once, for any number of pictures.
#[derive(Clone, Debug)]
pub struct View {
    camera: Camera,
    settings: ViewSettings,
    facets: usize,
    /// samples² a pixel, pixel after pixel.
    seen: Vec<Seen>,
}

/// The linear intensity of backs shown in dark grey: sRGB 64.
const DARK_GREY: f64 = 0.051_269_458;

impl View {
    /// Casts the rays of `camera` at `facets`, whose polygons `occluders` holds ([`Occluders::of_facets`]).
    ///
    /// # Panics
    ///
    /// If `settings.samples` is 0.
    pub fn new(facets: &Facets, occluders: &Occluders, camera: &Camera, settings: ViewSettings) -> Self {
        assert!(settings.samples > 0, "a pixel needs at least one ray");
        let mut view = Self { camera: camera.clone(), settings, facets: facets.len(), seen: Vec::new() };
        let rays = camera.width() as usize * (settings.samples * settings.samples) as usize;
        let row = |y: usize| {
            let directions = (y * rays..(y + 1) * rays).map(|ray| view.direction(ray));
            directions.map(|d| look(occluders, camera.eye(), d, settings.back_faces)).collect::<Vec<_>>()
        };
        view.seen = (0..camera.height() as usize).into_par_iter().flat_map_iter(row).collect();
        view
    }

    /// Direction of a ray by its number.
    fn direction(&self, ray: usize) -> DVec3 {
        let (k, width) = (self.settings.samples as usize, self.camera.width() as usize);
        let (pixel, sample) = (ray / (k * k), ray % (k * k));
        let offset = |s: usize| (s as f64 + 0.5) / k as f64;
        let (x, y) = ((pixel % width) as f64, (pixel / width) as f64);
        self.camera.direction(x + offset(sample % k), y + offset(sample / k))
    }

    /// A picture of radiosities, one a facet, in W/m².
    ///
    /// # Panics
    ///
    /// If there are not as many values as facets.
    pub fn picture(&self, values: &[[f64; 3]], exposure: Exposure) -> Image {
        assert_eq!(values.len(), self.facets, "values of the facets seen");
        self.paint(|facet, _| exposure.intensity(values[facet]))
    }

    /// A picture of radiosities in W/m² that `value` gives for every facet and point of it that is seen.
    pub fn picture_of(&self, value: impl Fn(usize, DVec3) -> [f64; 3] + Sync, exposure: Exposure) -> Image {
        self.paint(|facet, ray| {
            let Seen::Front(_, distance) = self.seen[ray] else { return [0.0; 3] };
            exposure.intensity(value(facet, self.camera.eye() + self.direction(ray) * f64::from(distance)))
        })
    }

    /// A picture of any one number a facet, in false colours.
    ///
    /// # Panics
    ///
    /// If there are not as many values as facets.
    pub fn false_colours(&self, values: &[f64], scale: &Scale) -> Image {
        assert_eq!(values.len(), self.facets, "values of the facets seen");
        let colours: Vec<[f64; 3]> = values.iter().map(|v| scale.colour(*v).map(linear)).collect();
        self.paint(|facet, _| colours[facet])
    }

    /// How many rays see each facet's front.
    pub fn counts(&self) -> Vec<u64> {
        let mut counts = vec![0; self.facets];
        for seen in &self.seen {
            if let Seen::Front(facet, _) = seen {
                counts[*facet as usize] += 1;
            }
        }
        counts
    }

    /// Pixels as means of linear intensities, which `intensity` gives for a facet and the number of the ray that meets it.
    fn paint(&self, intensity: impl Fn(usize, usize) -> [f64; 3] + Sync) -> Image {
        let per_pixel = (self.settings.samples * self.settings.samples) as usize;
        let background = self.settings.background.map(linear);
        let back = if self.settings.back_faces == BackFaces::DarkGrey { [DARK_GREY; 3] } else { [0.0; 3] };
        let pixel = |(pixel, seen): (usize, &[Seen])| {
            let mut sum = DVec3::ZERO;
            for (k, seen) in seen.iter().enumerate() {
                sum += DVec3::from_array(match seen {
                    Seen::Nothing => background,
                    Seen::Back => back,
                    Seen::Front(facet, _) => intensity(*facet as usize, pixel * per_pixel + k),
                });
            }
            bytes((sum / per_pixel as f64).to_array())
        };
        let rgb = self.seen.par_chunks(per_pixel).enumerate().flat_map_iter(pixel).collect();
        Image { width: self.camera.width(), height: self.camera.height(), rgb }
    }
}

/// Follows one ray; through backs if they are not shown.
fn look(occluders: &Occluders, eye: DVec3, direction: DVec3, back_faces: BackFaces) -> Seen {
    let (mut origin, mut travelled) = (eye, 0.0);
    // A ray meets every polygon at most once.
    for _ in 0..occluders.len() {
        match occluders.first_hit(origin, direction) {
            None => return Seen::Nothing,
            Some(hit) if hit.front => return Seen::Front(hit.owner, (travelled + hit.distance) as f32),
            Some(_) if back_faces != BackFaces::SeeThrough => return Seen::Back,
            // Polygons whose plane holds the new origin are not met again.
            Some(hit) => {
                origin += direction * hit.distance;
                travelled += hit.distance;
            }
        }
    }
    Seen::Nothing
}

/// The inverse of [`crate::tone::srgb`] on bytes.
fn linear(byte: u8) -> f64 {
    let s = f64::from(byte) / 255.0;
    if s <= 0.04045 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) }
}

/// A picture of facets and their radiosities in W/m², with the default settings; see [`View`] to make several.
///
/// # Panics
///
/// If there are not as many values as facets.
pub fn render(facets: &Facets, values: &[[f64; 3]], camera: &Camera, exposure: Exposure) -> Image {
    let occluders = Occluders::of_facets(facets);
    View::new(facets, &occluders, camera, ViewSettings::default()).picture(values, exposure)
}

#[cfg(test)]
mod tests {
    use super::*;
    use radiosity_geometry::Polygon;

    /// A box from 0 to (3, 5, 4), faces turned inwards: x = 0, x = 3, y = 0, y = 5, z = 0, z = 4.
    fn room() -> Facets {
        let corner = |k: usize| DVec3::new([0., 3.][k & 1], [0., 5.][k >> 1 & 1], [0., 4.][k >> 2]);
        let mut facets = Facets::new();
        for face in [[0, 2, 6, 4], [1, 5, 7, 3], [0, 4, 5, 1], [2, 3, 7, 6], [0, 1, 3, 2], [4, 6, 7, 5]] {
            facets.push(vec![Polygon::new(&face.map(corner)).unwrap()], false);
        }
        facets
    }

    fn inside() -> Camera {
        Camera::new(DVec3::new(1.1, 2.3, 1.7), DVec3::new(2.0, 1.0, 4.0), DVec3::Y, 75.0, 48, 32).unwrap()
    }

    #[test]
    fn a_furnace_is_one_colour() {
        let image = render(&room(), &[[10.0, 5.0, 2.5]; 6], &inside(), Exposure::white_at(20.0));
        let colour = Exposure::white_at(20.0).colour([10.0, 5.0, 2.5]);
        assert_eq!(image, Image::filled(48, 32, colour));
    }

    #[test]
    fn the_wall_looked_at_is_the_wall_shown() {
        let values: Vec<[f64; 3]> = (0..6).map(|k| [f64::from(k) / 5.0; 3]).collect();
        for (wall, towards) in [-DVec3::X, DVec3::X, -DVec3::Y, DVec3::Y, -DVec3::Z, DVec3::Z].into_iter().enumerate() {
            let eye = DVec3::new(1.1, 2.3, 1.7);
            let camera = Camera::new(eye, eye + towards, DVec3::new(0.3, 0.5, 0.7), 1.0, 3, 3).unwrap();
            let image = render(&room(), &values, &camera, Exposure::white_at(1.0));
            assert_eq!(image.pixel(1, 1), Exposure::white_at(1.0).colour(values[wall]), "wall {wall}");
        }
    }

    /// From outside, in front of z = 4 and looking along −z: the near wall shows its back, or the far wall through it.
    #[test]
    fn backs_are_black_grey_or_not_there() {
        let facets = room();
        let occluders = Occluders::of_facets(&facets);
        let camera = Camera::new(DVec3::new(1.1, 2.3, 40.0), DVec3::new(1.1, 2.3, 0.0), DVec3::Y, 1.0, 5, 3).unwrap();
        let shown = |back_faces| {
            let settings = ViewSettings { back_faces, ..ViewSettings::default() };
            View::new(&facets, &occluders, &camera, settings).picture(&[[1.0; 3]; 6], Exposure::white_at(1.0))
        };
        assert_eq!(shown(BackFaces::Black), Image::filled(5, 3, [0; 3]));
        assert_eq!(shown(BackFaces::DarkGrey), Image::filled(5, 3, [64; 3]));
        assert_eq!(shown(BackFaces::SeeThrough), Image::filled(5, 3, [255; 3]));
    }

    #[test]
    fn nothing_shows_the_background_and_an_edge_the_mean() {
        let settings = ViewSettings { background: [10, 200, 30], ..ViewSettings::default() };
        let camera = Camera::new(DVec3::Z * 10.0, DVec3::ZERO, DVec3::Y, 90.0, 4, 2).unwrap();
        // Left of x = 0 there is a facet, right of it nothing: the edge runs between pixels, so none is mixed.
        let mut facets = Facets::new();
        let corners = [DVec3::ZERO, DVec3::Y, -DVec3::X + DVec3::Y, -DVec3::X].map(|v| v * 1000.0 - DVec3::Y * 500.0);
        facets.push(vec![Polygon::new(&corners).unwrap()], false);
        let view = View::new(&facets, &Occluders::of_facets(&facets), &camera, settings);
        let image = view.picture(&[[1.0; 3]], Exposure::white_at(1.0));
        assert_eq!((image.pixel(0, 0), image.pixel(1, 1)), ([255; 3], [255; 3]));
        assert_eq!((image.pixel(2, 0), image.pixel(3, 1)), ([10, 200, 30], [10, 200, 30]));
        // Of 4 × 2 pixels of 4 rays the left half sees the facet.
        assert_eq!(view.counts(), [16]);
        // Three columns: the middle one is cut in half, its linear mean of white and black is sRGB 188.
        let camera = Camera::new(DVec3::Z * 10.0, DVec3::ZERO, DVec3::Y, 90.0, 3, 2).unwrap();
        let image = render(&facets, &[[1.0; 3]], &camera, Exposure::white_at(1.0));
        assert_eq!((image.pixel(0, 0), image.pixel(1, 0), image.pixel(2, 0)), ([255; 3], [188; 3], [0; 3]));
    }

    #[test]
    fn false_colours_keep_the_colours_of_the_scale() {
        let facets = room();
        let scale = Scale::linear(0.0, 1.0).unwrap();
        let view = View::new(&facets, &Occluders::of_facets(&facets), &inside(), ViewSettings::default());
        assert_eq!(view.false_colours(&[0.7; 6], &scale), Image::filled(48, 32, scale.colour(0.7)));
    }

    /// Values that are a function of the point show the point: of the wall z = 4 from 2.3 before it, 1° is 0.02 to a side. A byte is 1/255
    /// of the range, 0.01.
    #[test]
    fn what_is_seen_is_shown_at_its_own_point() {
        let facets = room();
        let eye = DVec3::new(1.1, 2.3, 1.7);
        let camera = Camera::new(eye, eye + DVec3::Z, DVec3::Y, 60.0, 9, 9).unwrap();
        let settings = ViewSettings { samples: 1, ..ViewSettings::default() };
        let view = View::new(&facets, &Occluders::of_facets(&facets), &camera, settings);
        let image = view.picture_of(|facet, x| [x.x, x.y, if facet == 5 { x.z } else { 0.0 }], Exposure::white_at(5.0));
        let at = Exposure::white_at(5.0).colour([1.1, 2.3, 4.0]);
        assert!(image.pixel(4, 4).iter().zip(at).all(|(shown, known)| shown.abs_diff(known) <= 1));
        // 60° of height over 9 pixels: the middle of the uppermost is 8/9 · tan 30° · 2.3 up.
        let up = Exposure::white_at(5.0).colour([1.1, 2.3 + 8.0 / 9.0 * 2.3 / 3.0_f64.sqrt(), 4.0]);
        assert!(image.pixel(4, 0).iter().zip(up).all(|(shown, known)| shown.abs_diff(known) <= 1));
    }

    #[test]
    fn one_thread_and_three_make_the_same_bytes() {
        let values: Vec<[f64; 3]> = (0..6).map(|k| [f64::from(k), 1.0, 0.1 * f64::from(k * k)]).collect();
        let picture = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| render(&room(), &values, &inside(), Exposure::white_at(4.0)))
        };
        assert_eq!(picture(1), picture(3));
    }
}
