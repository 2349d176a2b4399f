//! From radiosity to the bytes a screen expects.

/// How intensities between black and white are spread: a curve over x, the radiosity over the one shown as white, band by band.
///
/// ```text
/// clamp      y = min(x, 1)
/// Reinhard   y = l (1 + l/w²)/(1 + l)      l = w x, w = 4
/// filmic     y = f(v x)/f(v)               f(l) = (l (A l + C B) + D E)/(l (A l + B) + D F) − E/F, v = 11.2
/// ```
///
/// with A = 0.15, B = 0.5, C = 0.1, D = 0.2, E = 0.02, F = 0.3. Every curve grows from 0 at 0 to 1 at white, and what is brighter is white. (Reinhard, Stark,
/// Shirley, Ferwerda 2002, equation 4; Hable 2010.) The last two lift what is dark by 4 and 4.3, and keep apart what is bright; per band, so that bright colours
/// pale towards white.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tone {
    /// In proportion, cut off at white: intensities can be compared.
    #[default]
    Clamp,
    /// By Reinhard and others.
    Reinhard,
    /// By Hable, with a toe and a shoulder like those of film.
    Filmic,
}

/// White of [`Tone::Reinhard`] over the level at which it bends.
const BEND: f64 = 4.0;

/// White of [`Tone::Filmic`] on the scale of its curve.
const LINEAR_WHITE: f64 = 11.2;

/// The curve of Hable.
fn hable(l: f64) -> f64 {
    let (a, b, c, d, e, f) = (0.15, 0.5, 0.1, 0.2, 0.02, 0.3);
    (l * (a * l + c * b) + d * e) / (l * (a * l + b) + d * f) - e / f
}

impl Tone {
    /// y of x = 0 to 1.
    fn map(self, x: f64) -> f64 {
        match self {
            Self::Clamp => x,
            Self::Reinhard => {
                let l = BEND * x;
                l * (1.0 + l / (BEND * BEND)) / (1.0 + l)
            }
            Self::Filmic => hable(LINEAR_WHITE * x) / hable(LINEAR_WHITE),
        }
    }

    /// How many times brighter white can be than under [`Tone::Clamp`], with dark places shown about alike.
    pub fn headroom(self) -> f64 {
        match self {
            Self::Clamp => 1.0,
            Self::Reinhard | Self::Filmic => BEND,
        }
    }
}

/// The radiosity that is shown as full white, and the curve below it; one for all pictures that are to be compared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    white: f64,
    tone: Tone,
}

impl Exposure {
    /// Shows a radiosity of `white` W/m² as white; what is brighter is cut off.
    ///
    /// # Panics
    ///
    /// If `white` is not finite and positive.
    pub fn white_at(white: f64) -> Self {
        assert!(white.is_finite() && white > 0.0, "the white level must be finite and positive, got {white}");
        Self { white, tone: Tone::Clamp }
    }

    /// Shows as white what only the brightest part of the area exceeds: 1 − `share` of it, in its brightest band.
    ///
    /// Lights are far brighter than what they light, so a share of about 0.98 shows a room; dark areas (radiosity 0 in
    /// every band) do not count. White is 1 if nothing is bright.
    ///
    /// # Panics
    ///
    /// If there are not as many areas as values.
    pub fn of_share(values: &[[f64; 3]], areas: &[f64], share: f64) -> Self {
        assert_eq!(values.len(), areas.len(), "areas of {} values", values.len());
        let brightest = |value: &[f64; 3]| value.iter().copied().fold(0.0, f64::max);
        let mut lit: Vec<(f64, f64)> = values.iter().map(brightest).zip(areas.iter().copied()).collect();
        lit.retain(|(value, area)| *value > 0.0 && value.is_finite() && *area > 0.0);
        lit.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut left = share * lit.iter().map(|(_, area)| area).sum::<f64>();
        let white = lit.iter().find(|(_, area)| {
            left -= area;
            left <= 0.0
        });
        Self { white: white.or(lit.last()).map_or(1.0, |(value, _)| *value), tone: Tone::Clamp }
    }

    /// The same white by way of another curve.
    #[must_use]
    pub fn toned(self, tone: Tone) -> Self {
        Self { tone, ..self }
    }

    /// The radiosity shown as white in W/m².
    pub fn white(&self) -> f64 {
        self.white
    }

    /// Linear intensities between 0 and 1, by the curve; what is no number is black.
    pub fn intensity(&self, radiosity: [f64; 3]) -> [f64; 3] {
        radiosity.map(|b| if b.is_nan() { 0.0 } else { self.tone.map((b / self.white).clamp(0.0, 1.0)) })
    }

    /// The colour of a radiosity on the screen.
    pub fn colour(&self, radiosity: [f64; 3]) -> [u8; 3] {
        bytes(self.intensity(radiosity))
    }
}

/// The sRGB transfer function (IEC 61966-2-1) from linear intensity to signal, both in [0, 1]:
///
/// ```text
/// s = 12.92·l                      for l ≤ 0.0031308
/// s = 1.055·l^(1/2.4) − 0.055      above
/// ```
pub fn srgb(l: f64) -> f64 {
    if l <= 0.003_130_8 { 12.92 * l } else { 1.055 * l.powf(1.0 / 2.4) - 0.055 }
}

/// Linear intensities as sRGB bytes; below 0 and above 1 are cut off.
pub fn bytes(intensity: [f64; 3]) -> [u8; 3] {
    intensity.map(|l| (255.0 * srgb(l.clamp(0.0, 1.0))).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 0.214041 is the linear intensity of half the signal: ((0.5 + 0.055)/1.055)^2.4.
    #[test]
    fn the_transfer_function_has_its_end_points_and_its_middle() {
        assert_eq!((srgb(0.0), bytes([0.0, 1.0, 2.0])), (0.0, [0, 255, 255]));
        assert!((srgb(1.0) - 1.0).abs() < 1e-15);
        assert!((srgb(0.214_041_140_482_232_55) - 0.5).abs() < 1e-12);
        // The two branches meet within the rounding of the standard's own constants.
        assert!((srgb(0.003_130_8) - srgb(0.003_130_800_1)).abs() < 1e-6);
    }

    #[test]
    fn white_is_where_it_was_set() {
        let exposure = Exposure::white_at(20.0);
        assert_eq!(exposure.colour([20.0, 0.0, 1e9]), [255, 0, 255]);
        assert_eq!(exposure.colour([f64::NAN, -1.0, 10.0]), [0, 0, 188]);
    }

    /// By hand: Reinhard at a quarter of white, where l = 1, is (1 + 1/16)/2; Hable's f(1) = 0.204/0.71 − 1/15 and f(11.2) = 19.38/24.476 − 1/15.
    #[test]
    fn curves_grow_from_black_to_white_through_what_their_authors_give() {
        let at = |tone, b| Exposure::white_at(20.0).toned(tone).intensity([b, b / 3.0, 0.0])[0];
        for tone in [Tone::Clamp, Tone::Reinhard, Tone::Filmic] {
            assert!(at(tone, 0.0).abs() < 1e-15 && (at(tone, 20.0) - 1.0).abs() < 1e-15, "{tone:?}");
            assert_eq!(at(tone, 1e9), at(tone, 20.0), "{tone:?} ends at white");
            let steps: Vec<f64> = (0..=500).map(|k| at(tone, 0.04 * f64::from(k))).collect();
            assert!(steps.is_sorted_by(|a, b| a < b), "{tone:?}");
            let slope = at(tone, 2e-5) / 1e-6;
            assert!((slope / tone.headroom() - 1.0).abs() < 0.08, "{tone:?}: dark places rise by {slope}");
        }
        assert!((at(Tone::Reinhard, 5.0) - 17.0 / 32.0).abs() < 1e-15);
        let (one, white) = (0.204 / 0.71 - 1.0 / 15.0, 19.38 / 24.476 - 1.0 / 15.0);
        assert!((at(Tone::Filmic, 20.0 / 11.2) - one / white).abs() < 1e-12);
    }

    #[test]
    fn a_small_light_does_not_set_the_white_of_a_room() {
        let values = [[100.0, 0.0, 0.0], [1.0, 2.0, 0.5], [0.0; 3], [3.0; 3]];
        assert_eq!(Exposure::of_share(&values, &[1.0, 60.0, 500.0, 39.0], 0.98).white(), 3.0);
        assert_eq!(Exposure::of_share(&values, &[1.0, 60.0, 500.0, 39.0], 1.0).white(), 100.0);
        assert_eq!(Exposure::of_share(&[[0.0; 3]], &[1.0], 0.98).white(), 1.0);
    }
}
