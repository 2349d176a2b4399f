//! Paints a drawing with plotters, as SVG text or as a PNG file.
//!
//! Both are drawn on a grid [`GRID`] times finer than a point, since plotters knows whole coordinates only: the SVG
//! says so in its `viewBox`, the bitmap is averaged down, which also smooths its edges.

use std::path::Path;
use std::sync::Once;

use plotters::backend::{BitMapBackend, DrawingBackend, SVGBackend};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{
    Color, FontDesc, FontFamily, FontStyle, FontTransform, RGBColor, ShapeStyle, TextStyle, register_font,
};

use super::shapes::corners;
use super::{Align, Drawing, Shape};
use crate::palette::{Marker, Rgb, lighter};

/// The one font of all figures (DejaVu Sans, subset); its licence lies beside it.
const FONT: &[u8] = include_bytes!("../assets/dejavu-sans-subset.ttf");

/// Families an SVG asks for: the font itself, one of nearly the same widths, anything.
const FAMILY: &str = "DejaVu Sans, Verdana, sans-serif";
/// Steps of the drawing grid per point.
const GRID: u32 = 6;
/// Pixels of a PNG per point.
const PNG_SCALE: u32 = 2;
/// Ascent less descent of the font over its em: the height ab_glyph scales to the size it is given.
const FONT_HEIGHT: f64 = 2384.0 / 2048.0;
/// plotters divides sizes by this before it writes them into an SVG.
const SVG_SIZE: f64 = 1.24;
/// plotters lowers the baseline of an SVG text anchored at its top by this share of the em.
const SVG_TOP: f64 = 0.76;
/// Radius of a data point.
const RADIUS: f64 = 4.0;

/// Width of a line of text of em size `size`.
pub(super) fn text_width(text: &str, size: f64) -> f64 {
    register();
    // Measured large, since plotters rounds to whole pixels.
    let em = 1000.0;
    let font = FontDesc::new(FontFamily::Name(FAMILY), em * FONT_HEIGHT, FontStyle::Normal);
    let ((left, _), (right, _)) = font.layout_box(text).expect("the font is registered");
    f64::from(right - left) * size / em
}

fn register() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let registered = register_font(FAMILY, FontStyle::Normal, FONT);
        assert!(registered.is_ok(), "the embedded font is a font");
    });
}

/// Failure to draw or write, as text: plotters' own errors are generic over the backend.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DrawError(String);

impl std::fmt::Display for DrawError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "drawing failed: {}", self.0)
    }
}

impl std::error::Error for DrawError {}

fn failed(error: impl std::fmt::Display) -> DrawError {
    DrawError(error.to_string())
}

impl Drawing {
    fn grid_size(&self) -> (u32, u32) {
        (self.width.ceil() as u32 * GRID, self.height.ceil() as u32 * GRID)
    }

    /// The drawing as SVG text.
    ///
    /// # Errors
    ///
    /// [`DrawError`] if plotters fails.
    pub fn to_svg(&self) -> Result<String, DrawError> {
        let (width, height) = self.grid_size();
        let mut svg = String::new();
        {
            let mut backend = SVGBackend::with_string(&mut svg, (width, height));
            self.paint(&mut backend, Kind::Svg)?;
            backend.present().map_err(failed)?;
        }
        // The size in points; the viewBox keeps the grid.
        let grid = format!("width=\"{width}\" height=\"{height}\"");
        let points = format!("width=\"{}\" height=\"{}\"", width / GRID, height / GRID);
        Ok(svg.replacen(&grid, &points, 1))
    }

    /// Writes the drawing as PNG, two pixels a point.
    ///
    /// # Errors
    ///
    /// [`DrawError`] if plotters fails or the file cannot be written.
    pub fn write_png(&self, path: &Path) -> Result<(), DrawError> {
        let (width, height) = self.grid_size();
        let mut fine = vec![255_u8; 3 * width as usize * height as usize];
        {
            let mut backend = BitMapBackend::with_buffer(&mut fine, (width, height));
            self.paint(&mut backend, Kind::Bitmap)?;
            backend.present().map_err(failed)?;
        }
        let pixels = average(&fine, (width, height), GRID / PNG_SCALE);
        write_png(path, (width / GRID * PNG_SCALE, height / GRID * PNG_SCALE), &pixels)
    }

    fn paint<B: DrawingBackend>(&self, backend: &mut B, kind: Kind) -> Result<(), DrawError> {
        register();
        let mut painter = Painter { backend, kind };
        let (width, height) = (self.width.ceil(), self.height.ceil());
        painter.polygon(&[(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)], [255; 3])?;
        self.shapes.iter().try_for_each(|shape| painter.shape(shape))
    }
}

/// Writes 8-bit sRGB pixels, row by row from the top, as PNG.
///
/// # Errors
///
/// [`DrawError`] if the file cannot be written.
///
/// # Panics
///
/// If `rgb` does not hold 3 · width · height bytes.
pub fn write_png(path: &Path, (width, height): (u32, u32), rgb: &[u8]) -> Result<(), DrawError> {
    assert_eq!(rgb.len(), 3 * width as usize * height as usize, "a picture of {width} × {height} pixels");
    let mut backend = BitMapBackend::new(path, (width, height));
    backend.blit_bitmap((0, 0), (width, height), rgb).map_err(failed)?;
    backend.present().map_err(failed)
}

/// Means of squares of `side` × `side` pixels.
fn average(fine: &[u8], (width, height): (u32, u32), side: u32) -> Vec<u8> {
    let (w, side) = (width as usize, side as usize);
    let (columns, rows) = (w / side, height as usize / side);
    let mut pixels = Vec::with_capacity(3 * columns * rows);
    for row in 0..rows {
        let mut sums = vec![0_u32; 3 * columns];
        for line in fine[3 * w * side * row..].chunks_exact(3 * w).take(side) {
            for (sums, block) in sums.chunks_exact_mut(3).zip(line.chunks_exact(3 * side)) {
                for pixel in block.chunks_exact(3) {
                    sums.iter_mut().zip(pixel).for_each(|(sum, &c)| *sum += u32::from(c));
                }
            }
        }
        let count = (side * side) as u32;
        pixels.extend(sums.iter().map(|sum| ((sum + count / 2) / count) as u8));
    }
    pixels
}

/// The two backends place text differently.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Svg,
    Bitmap,
}

struct Painter<'a, B> {
    backend: &'a mut B,
    kind: Kind,
}

fn grid((x, y): (f64, f64)) -> (i32, i32) {
    ((x * f64::from(GRID)).round() as i32, (y * f64::from(GRID)).round() as i32)
}

fn rgb([r, g, b]: Rgb) -> RGBColor {
    RGBColor(r, g, b)
}

impl<B: DrawingBackend> Painter<'_, B> {
    fn shape(&mut self, shape: &Shape) -> Result<(), DrawError> {
        match shape {
            Shape::Line { points, width, colour } => self.line(points, *width, *colour),
            Shape::Polygon { points, colour } => self.polygon(points, *colour),
            Shape::Mark { at, marker, colour, hollow } => self.mark(*at, *marker, *colour, *hollow),
            Shape::Cross { at: (x, y), colour } => {
                let r = 1.6 * RADIUS;
                self.line(&[(x - r, y - r), (x + r, y + r)], 1.8, *colour)?;
                self.line(&[(x - r, y + r), (x + r, y - r)], 1.8, *colour)
            }
            Shape::Arrow { at: (x, y), towards: (u, v), colour } => {
                // From the rim of the mark outwards, as wide as long.
                let (near, far, half) = (RADIUS + 2.0, RADIUS + 7.0, 3.0);
                let corner = |along: f64, across: f64| (x + u * along - v * across, y + v * along + u * across);
                self.polygon(&[corner(near, -half), corner(near, half), corner(far, 0.0)], *colour)
            }
            Shape::Text { at, text, size, colour, align, vertical } => {
                self.text(*at, text, *size, *colour, *align, *vertical)
            }
        }
    }

    fn line(&mut self, points: &[(f64, f64)], width: f64, colour: Rgb) -> Result<(), DrawError> {
        if self.kind == Kind::Bitmap {
            return self.thick_line(points, width, colour);
        }
        let stroke_width = (width * f64::from(GRID)).round() as u32;
        let style = ShapeStyle { color: rgb(colour).to_rgba(), filled: false, stroke_width };
        self.backend.draw_path(points.iter().copied().map(grid), &style).map_err(failed)
    }

    /// plotters' own thick lines come out thinner where they turn back or close: rectangles with round joins do not.
    fn thick_line(&mut self, points: &[(f64, f64)], width: f64, colour: Rgb) -> Result<(), DrawError> {
        for (k, pair) in points.windows(2).enumerate() {
            let ((x0, y0), (x1, y1)) = (pair[0], pair[1]);
            let length = (x1 - x0).hypot(y1 - y0);
            if length == 0.0 {
                continue;
            }
            let (u, v) = ((y0 - y1) / length * width / 2.0, (x1 - x0) / length * width / 2.0);
            self.polygon(&[(x0 + u, y0 + v), (x1 + u, y1 + v), (x1 - u, y1 - v), (x0 - u, y0 - v)], colour)?;
            if k > 0 {
                self.disc((x0, y0), width / 2.0, colour)?;
            }
        }
        Ok(())
    }

    fn disc(&mut self, at: (f64, f64), radius: f64, colour: Rgb) -> Result<(), DrawError> {
        let radius = (radius * f64::from(GRID)).round() as u32;
        let style = ShapeStyle { color: rgb(colour).to_rgba(), filled: true, stroke_width: 0 };
        self.backend.draw_circle(grid(at), radius, &style, true).map_err(failed)
    }

    fn polygon(&mut self, points: &[(f64, f64)], colour: Rgb) -> Result<(), DrawError> {
        self.backend.fill_polygon(points.iter().copied().map(grid), &rgb(colour)).map_err(failed)
    }

    /// A white rim keeps marks apart from lines and from each other.
    fn mark(&mut self, at: (f64, f64), marker: Marker, colour: Rgb, hollow: bool) -> Result<(), DrawError> {
        let inside = if hollow { [255; 3] } else { lighter(colour, 0.1) };
        for (radius, colour) in [(RADIUS + 1.0, [255; 3]), (RADIUS, colour), (RADIUS - 1.5, inside)] {
            let corners = corners(marker, radius);
            if corners.is_empty() {
                self.disc(at, radius, colour)?;
            } else {
                let points: Vec<_> = corners.iter().map(|(x, y)| (at.0 + x, at.1 + y)).collect();
                self.polygon(&points, colour)?;
            }
        }
        Ok(())
    }

    fn text(
        &mut self,
        at: (f64, f64),
        text: &str,
        size: f64,
        colour: Rgb,
        align: Align,
        vertical: bool,
    ) -> Result<(), DrawError> {
        // Anchored at the top, which is this far above the baseline.
        let (size, above) = match self.kind {
            Kind::Svg => (size * SVG_SIZE, SVG_TOP * size),
            Kind::Bitmap => (size * FONT_HEIGHT, 0.5 * FONT_HEIGHT * size),
        };
        let anchor = match align {
            Align::Left => HPos::Left,
            Align::Centre => HPos::Center,
            Align::Right => HPos::Right,
        };
        let turn = if vertical { FontTransform::Rotate270 } else { FontTransform::None };
        let font = FontDesc::new(FontFamily::Name(FAMILY), size * f64::from(GRID), FontStyle::Normal).transform(turn);
        let style = TextStyle { font, color: rgb(colour).to_backend_color(), pos: Pos::new(anchor, VPos::Top) };
        let at = if vertical { (at.0 - above, at.1) } else { (at.0, at.1 - above) };
        self.backend.draw_text(text, &style, grid(at)).map_err(failed)
    }
}
