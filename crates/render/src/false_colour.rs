//! False colours of even perceptual steps, with a legend.
//!
//! The map runs from dark violet over blue and green to light yellow. It is drawn in Oklab (Björn Ottosson, 2020): the
//! lightness grows evenly with the value, so that it also reads in grey, the hue turns evenly, and the chroma is as
//! high as the screen can show up to a limit.
//!
//! Differences have a map of their own, light grey at 0 and darker and more colourful on both sides alike: blue below, red above. Each side by itself reads in
//! grey, and blue and red differ to any eye.

use crate::Image;
use crate::tone::bytes;

/// Lightness of the lowest and of the highest value.
const LIGHTNESS: (f64, f64) = (0.25, 0.93);
/// Hue of the lowest and of the highest value, in degrees.
const HUE: (f64, f64) = (310.0, 105.0);
/// Highest chroma.
const CHROMA: f64 = 0.16;

/// The colour at `t` in [0, 1]; outside it is that of the nearer end.
pub fn colour(t: f64) -> [u8; 3] {
    let t = if t.is_nan() { 0.0 } else { t.clamp(0.0, 1.0) };
    let between = |(a, b): (f64, f64)| a + (b - a) * t;
    shown(between(LIGHTNESS), between(HUE), CHROMA)
}

/// The lightness of no difference and of the largest, hues of the lowest and the highest, and their chroma.
const SIGNED_LIGHTNESS: (f64, f64) = (0.95, 0.42);
const SIGNED_HUE: [f64; 2] = [260.0, 30.0];
const SIGNED_CHROMA: f64 = 0.19;

/// The colour of a difference: grey at `t` = 0, blue at −1, red at 1; outside it is that of the nearer end.
pub fn signed_colour(t: f64) -> [u8; 3] {
    let t = if t.is_nan() { 0.0 } else { t.clamp(-1.0, 1.0) };
    let (grey, end) = SIGNED_LIGHTNESS;
    let hue = SIGNED_HUE[usize::from(t > 0.0)];
    shown(grey + (end - grey) * t.abs(), hue, SIGNED_CHROMA * t.abs())
}

/// A colour of Oklab with hue in degrees, its chroma lowered to what the screen can show.
fn shown(lightness: f64, hue: f64, most: f64) -> [u8; 3] {
    let (sin, cos) = hue.to_radians().sin_cos();
    let of = |chroma: f64| linear_srgb(lightness, chroma * cos, chroma * sin);
    let fits = |chroma: f64| of(chroma).iter().all(|l| (0.0..=1.0).contains(l));
    if fits(most) {
        return bytes(of(most));
    }
    // By bisection: grey always fits.
    let (mut low, mut high) = (0.0, most);
    for _ in 0..20 {
        let middle = 0.5 * (low + high);
        if fits(middle) { low = middle } else { high = middle }
    }
    bytes(of(low))
}

/// Oklab to linear sRGB.
fn linear_srgb(lightness: f64, a: f64, b: f64) -> [f64; 3] {
    let l = (lightness + 0.396_337_777_4 * a + 0.215_803_757_3 * b).powi(3);
    let m = (lightness - 0.105_561_345_8 * a - 0.063_854_172_8 * b).powi(3);
    let s = (lightness - 0.089_484_177_5 * a - 1.291_485_548_0 * b).powi(3);
    [
        4.076_741_662_1 * l - 3.307_711_591_3 * m + 0.230_969_929_2 * s,
        -1.268_438_004_6 * l + 2.609_757_401_1 * m - 0.341_319_396_5 * s,
        -0.004_196_086_3 * l - 0.703_418_614_7 * m + 1.707_614_701_0 * s,
    ]
}

/// The values that the colours stand for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    low: f64,
    high: f64,
    steps: Steps,
}

/// How values between the ends are spread over the colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Steps {
    /// Equal differences are equally long.
    Linear,
    /// Equal ratios are equally long.
    Logarithmic,
    /// Equal differences about 0, in the colours of differences.
    Signed,
}

/// Why there is no such scale.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ScaleError {
    /// The ends are not finite or not in order.
    #[error("a scale from {low} to {high} is none; its ends must be finite and the first one smaller")]
    Range {
        /// First value.
        low: f64,
        /// Last value.
        high: f64,
    },
    /// A logarithmic scale that begins at 0 or below.
    #[error("a logarithmic scale cannot begin at {low}; it must be positive")]
    Logarithm {
        /// First value.
        low: f64,
    },
}

impl Scale {
    /// Even steps from `low` to `high`.
    ///
    /// # Errors
    ///
    /// [`ScaleError::Range`] unless both are finite and `low` < `high`.
    pub fn linear(low: f64, high: f64) -> Result<Self, ScaleError> {
        if !(low.is_finite() && high.is_finite() && low < high) {
            return Err(ScaleError::Range { low, high });
        }
        Ok(Self { low, high, steps: Steps::Linear })
    }

    /// Even ratios from `low` to `high`.
    ///
    /// # Errors
    ///
    /// [`ScaleError`] unless both are finite and 0 < `low` < `high`.
    pub fn logarithmic(low: f64, high: f64) -> Result<Self, ScaleError> {
        let Self { low, high, .. } = Self::linear(low, high)?;
        if low <= 0.0 {
            return Err(ScaleError::Logarithm { low });
        }
        Ok(Self { low, high, steps: Steps::Logarithmic })
    }

    /// Differences from −`most` to `most`.
    ///
    /// # Errors
    ///
    /// [`ScaleError::Range`] unless it is finite and positive.
    pub fn signed(most: f64) -> Result<Self, ScaleError> {
        Ok(Self { steps: Steps::Signed, ..Self::linear(-most, most)? })
    }

    /// Its ends.
    pub fn ends(&self) -> [f64; 2] {
        [self.low, self.high]
    }

    /// Where on the scale a value lies: 0 at its low end, 1 at its high end.
    pub fn position(&self, value: f64) -> f64 {
        if self.steps == Steps::Logarithmic {
            (value / self.low).ln() / (self.high / self.low).ln()
        } else {
            (value - self.low) / (self.high - self.low)
        }
    }

    /// The value at a position: the inverse of [`Self::position`].
    pub fn value(&self, position: f64) -> f64 {
        if self.steps == Steps::Logarithmic {
            self.low * (self.high / self.low).powf(position)
        } else {
            self.low + (self.high - self.low) * position
        }
    }

    /// The colour of a value.
    pub fn colour(&self, value: f64) -> [u8; 3] {
        self.colour_at(self.position(value))
    }

    /// The colour at a position.
    fn colour_at(&self, position: f64) -> [u8; 3] {
        match self.steps {
            Steps::Linear | Steps::Logarithmic => colour(position),
            Steps::Signed => signed_colour(2.0 * position - 1.0),
        }
    }

    /// A picture of values, one a pixel, rows from the top.
    ///
    /// # Panics
    ///
    /// If there are not `width` · `height` values.
    pub fn picture(&self, width: u32, height: u32, values: &[f64]) -> Image {
        assert_eq!(values.len(), width as usize * height as usize, "values of {width} × {height} pixels");
        Image { width, height, rgb: values.iter().flat_map(|value| self.colour(*value)).collect() }
    }

    /// An upright legend of `height` rows, high values on top, with `ticks` numbers to its right on black; the topmost is followed by `unit`. Letters grow with the
    /// height, by whole factors, from five rows on.
    ///
    /// # Panics
    ///
    /// If there are fewer than two ticks or fewer than 8 rows a tick.
    pub fn legend(&self, height: u32, ticks: u32, unit: &str) -> Image {
        assert!(ticks >= 2 && height >= 8 * ticks, "{ticks} ticks on {height} rows");
        let size = (height / ROWS_PER_SIZE).max(1);
        let mut labels: Vec<String> =
            (0..ticks).map(|tick| label(self.value(f64::from(tick) / f64::from(ticks - 1)))).collect();
        if let Some(top) = labels.last_mut() {
            *top = format!("{top} {unit}");
        }
        let widest = labels.iter().map(|label| width(label)).max().unwrap_or(0);
        let (bar, margin) = (BAR * size, MARGIN * size);
        let mut image = Image::filled(bar + 2 * margin + widest * size, height, [0; 3]);
        for y in 0..height {
            let colour = self.colour_at(1.0 - f64::from(y) / f64::from(height - 1));
            (0..bar).for_each(|x| image.set(x, y, colour));
        }
        for (tick, label) in (0..).zip(&labels) {
            let position = f64::from(tick) / f64::from(ticks - 1);
            let row = ((1.0 - position) * f64::from(height - 1)).round() as u32;
            (bar..bar + margin - 2 * size).for_each(|x| image.set(x, row, [255; 3]));
            let top = row.saturating_sub(2 * size).min(height - 5 * size);
            draw(&mut image, [bar + margin, top], size, label);
        }
        image
    }
}

/// Columns of the legend's bar and of the space beside it, of letters of one pixel a dot.
const BAR: u32 = 16;
const MARGIN: u32 = 6;

/// Rows of a legend from which a dot of its letters is two pixels wide, three, …
const ROWS_PER_SIZE: u32 = 180;

/// A number with three digits that count, in at most eight characters.
fn label(value: f64) -> String {
    let exponent = if value == 0.0 { 0 } else { value.abs().log10().floor() as i32 };
    if (-3..5).contains(&exponent) {
        format!("{value:.*}", usize::try_from(2 - exponent).unwrap_or(0))
    } else {
        format!("{value:.1e}")
    }
}

/// A letter of five rows: dots in a row, and its dots from the upper left on; blank for those that no legend needs.
fn glyph(character: char) -> (u32, u32) {
    match character {
        '0' => (3, 0b111_101_101_101_111),
        '1' => (3, 0b010_110_010_010_111),
        '2' => (3, 0b111_001_111_100_111),
        '3' => (3, 0b111_001_111_001_111),
        '4' => (3, 0b101_101_111_001_001),
        '5' => (3, 0b111_100_111_001_111),
        '6' => (3, 0b111_100_111_101_111),
        '7' => (3, 0b111_001_001_001_001),
        '8' => (3, 0b111_101_111_101_111),
        '9' => (3, 0b111_101_111_001_111),
        '-' => (3, 0b000_000_111_000_000),
        '.' => (3, 0b000_000_000_000_010),
        'e' => (3, 0b000_111_111_100_111),
        '/' => (3, 0b001_001_010_100_100),
        '²' => (3, 0b110_010_100_110_000),
        'W' => (5, 0b10001_10001_10101_11011_10001),
        'm' => (5, 0b00000_11110_10101_10101_10101),
        '%' => (5, 0b11001_11010_00100_01011_10011),
        _ => (3, 0),
    }
}

/// Dots that a text is wide, with one after each letter.
fn width(text: &str) -> u32 {
    text.chars().map(|character| glyph(character).0 + 1).sum()
}

/// Writes `text` from its upper left corner on, `size` pixels a dot.
fn draw(image: &mut Image, [mut left, top]: [u32; 2], size: u32, text: &str) {
    for character in text.chars() {
        let (columns, dots) = glyph(character);
        for (x, y) in (0..5 * size).flat_map(|y| (0..columns * size).map(move |x| (x, y))) {
            if dots >> (5 * columns - 1 - (columns * (y / size) + x / size)) & 1 == 1 {
                image.set(left + x, top + y, [255; 3]);
            }
        }
        left += (columns + 1) * size;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative luminance by the sRGB standard's weights, from bytes back through the transfer function.
    fn luminance(colour: [u8; 3]) -> f64 {
        let linear = colour.map(|byte| {
            let s = f64::from(byte) / 255.0;
            if s <= 0.04045 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) }
        });
        0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
    }

    /// CIE lightness L* = 116·Y^(1/3) − 16 is an independent measure of perceived lightness; 64 steps are more than
    /// the eye tells apart, and each differs by more than the rounding to bytes.
    #[test]
    fn lightness_grows_with_every_step() {
        let lightness: Vec<f64> =
            (0..=64).map(|k| 116.0 * luminance(colour(f64::from(k) / 64.0)).cbrt() - 16.0).collect();
        let steps: Vec<f64> = lightness.windows(2).map(|w| w[1] - w[0]).collect();
        let (least, most) =
            (steps.iter().copied().fold(f64::INFINITY, f64::min), steps.iter().copied().fold(0.0, f64::max));
        assert!(least > 0.4 && most < 2.4, "steps of L* from {least} to {most}");
    }

    #[test]
    fn values_outside_of_the_scale_have_the_colours_of_its_ends() {
        let scale = Scale::linear(2.0, 6.0).unwrap();
        assert_eq!((scale.colour(-1e9), scale.colour(f64::NAN)), (colour(0.0), colour(0.0)));
        assert_eq!(scale.colour(1e9), colour(1.0));
    }

    #[test]
    fn the_middle_of_a_logarithmic_scale_is_the_geometric_mean() {
        let scale = Scale::logarithmic(1e-4, 1.0).unwrap();
        assert!((scale.position(1e-2) - 0.5).abs() < 1e-15 && (scale.value(0.5) - 1e-2).abs() < 1e-16);
        assert_eq!(Scale::logarithmic(0.0, 1.0), Err(ScaleError::Logarithm { low: 0.0 }));
        assert_eq!(Scale::linear(1.0, 1.0), Err(ScaleError::Range { low: 1.0, high: 1.0 }));
    }

    #[test]
    fn labels_keep_three_digits() {
        let labels = [0.0, 1.0, 12.34, -0.0123, 54321.0, 1e-7, 2.5e12].map(label);
        assert_eq!(labels, ["0.00", "1.00", "12.3", "-0.0123", "54321", "1.0e-7", "2.5e12"]);
        assert!(labels.iter().all(|l| l.len() <= 8));
    }

    #[test]
    fn a_legend_has_its_high_end_on_top() {
        let legend = Scale::linear(0.0, 1.0).unwrap().legend(100, 5, "W/m²");
        assert_eq!((legend.pixel(0, 0), legend.pixel(0, 99)), (colour(1.0), colour(0.0)));
        let white = |image: &Image| image.rgb.chunks(3).filter(|p| *p == [255; 3]).count();
        assert!(white(&legend) > 5 * 20, "numbers are drawn");
        let plain = Scale::linear(0.0, 1.0).unwrap().legend(100, 5, "");
        assert!(white(&legend) > white(&plain) + 20, "the unit is drawn");
        // Dots of two pixels from twice the height on, and the tick marks of five numbers.
        let large = Scale::linear(0.0, 1.0).unwrap().legend(2 * ROWS_PER_SIZE, 5, "");
        let ticks = |size: usize| 5 * (MARGIN as usize - 2) * size;
        assert_eq!(white(&large) - ticks(2), 4 * (white(&plain) - ticks(1)));
    }

    /// L* of CIE as above: the same on both sides to what blue and red can differ by, and falling with every step.
    #[test]
    fn a_difference_is_darker_the_larger_it_is_and_no_difference_is_grey() {
        let scale = Scale::signed(3.0).unwrap();
        assert_eq!(scale.ends(), [-3.0, 3.0]);
        let grey = scale.colour(0.0);
        assert!(grey[0] == grey[1] && grey[1] == grey[2], "{grey:?}");
        let lightness = |value: f64| 116.0 * luminance(scale.colour(value)).cbrt() - 16.0;
        for sign in [-1.0, 1.0] {
            let side: Vec<f64> = (0..=32).map(|k| lightness(sign * 3.0 * f64::from(k) / 32.0)).collect();
            assert!(side.windows(2).all(|w| w[1] < w[0] - 0.5), "{side:?}");
        }
        assert!((0..=8).all(|k| (lightness(f64::from(k) / 4.0) - lightness(-f64::from(k) / 4.0)).abs() < 6.0));
        let [low, high] = [scale.colour(-9.0), scale.colour(9.0)];
        assert!(low[2] > low[0] + 80 && high[0] > high[2] + 80, "blue {low:?}, red {high:?}");
        assert_eq!(Scale::signed(0.0), Err(ScaleError::Range { low: 0.0, high: 0.0 }));
    }

    #[test]
    fn a_picture_has_the_colours_of_its_values() {
        let scale = Scale::linear(0.0, 5.0).unwrap();
        let picture = scale.picture(3, 2, &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
        assert_eq!((picture.pixel(0, 0), picture.pixel(2, 1)), (scale.colour(0.0), scale.colour(5.0)));
        assert_eq!(picture.pixel(0, 1), scale.colour(3.0));
    }
}
