//! One colour and one marker per method, the same in every figure of the project.
//!
//! Methods that meet in one figure (solvers, estimators, forms of substructuring, stores) keep apart for readers with
//! a red–green deficiency and in print: the colours within a group differ in lightness as well, and no two of a group
//! share a marker. Bars and lines have no marker, so colour alone must do.

/// Red, green and blue, 0 to 255 (sRGB).
pub type Rgb = [u8; 3];

/// Shape of a data point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Marker {
    /// ●
    Circle,
    /// ■
    Square,
    /// ▲
    Triangle,
    /// ▼
    Wedge,
    /// ◆
    Diamond,
    /// Five corners, one up.
    Pentagon,
    /// Five points.
    Star,
    /// Upright cross of thick arms.
    Plus,
}

/// How a method is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Style {
    /// Colour of lines, markers and bars.
    pub colour: Rgb,
    /// Shape of points.
    pub marker: Marker,
}

/// Groups whose members meet in one figure.
const GROUPS: [&[(&str, Rgb, Marker)]; 7] = [
    // Solvers.
    &[
        ("jacobi", [0x00, 0x72, 0xb2], Marker::Circle),
        ("gauss-seidel", [0xd5, 0x5e, 0x00], Marker::Square),
        ("cg", [0x00, 0x9e, 0x73], Marker::Diamond),
        ("direct", [0x22, 0x22, 0x22], Marker::Triangle),
        ("shooting", [0xcc, 0x79, 0xa7], Marker::Wedge),
        ("sor", [0xe6, 0x9f, 0x00], Marker::Pentagon),
        ("chebyshev", [0x56, 0xb4, 0xe9], Marker::Star),
        ("gmres", [0x88, 0x22, 0x55], Marker::Plus),
    ],
    // Variants of solvers, which share the marker of what they vary.
    &[
        ("direct-f32", [0x44, 0x00, 0xff], Marker::Triangle),
        ("deflated-cg", [0x99, 0xcc, 0x77], Marker::Diamond),
        ("overshooting", [0x77, 0x33, 0x11], Marker::Wedge),
        ("stochastic", [0x00, 0x99, 0x99], Marker::Circle),
    ],
    // Estimators of form factors.
    &[
        ("analytic", [0x00, 0x44, 0x88], Marker::Circle),
        ("ray-cast", [0xbb, 0x55, 0x66], Marker::Square),
        ("hemicube", [0xdd, 0xaa, 0x33], Marker::Triangle),
        ("rays+emitters", [0x66, 0xcc, 0xee], Marker::Wedge),
        ("hierarchical", [0x88, 0x22, 0x55], Marker::Star),
        ("analytic, segments", [0x77, 0x00, 0xee], Marker::Pentagon),
        ("ray-cast, adaptive", [0x99, 0x44, 0x00], Marker::Plus),
    ],
    // Forms of substructuring.
    &[
        ("full", [0x33, 0x22, 0x88], Marker::Circle),
        ("elements-to-patches", [0x44, 0xaa, 0x99], Marker::Square),
        ("patches-to-elements", [0xcc, 0x66, 0x33], Marker::Triangle),
        ("two-level", [0xdd, 0xaa, 0x22], Marker::Diamond),
        ("adaptive", [0x33, 0x77, 0xee], Marker::Pentagon),
    ],
    // Stores.
    &[
        ("dense", [0x1b, 0x4f, 0x72], Marker::Circle),
        ("sparse", [0xe0, 0x8a, 0x3c], Marker::Square),
        ("on-demand", [0xa0, 0x5f, 0xc0], Marker::Triangle),
        ("packed", [0x2e, 0x8b, 0x57], Marker::Diamond),
        ("packed-f32", [0xb2, 0x22, 0x22], Marker::Wedge),
    ],
    // What is left out.
    &[
        ("blockers", [0x00, 0x72, 0xb2], Marker::Circle),
        ("dark rooms", [0xd5, 0x5e, 0x00], Marker::Square),
        ("rooms apart", [0x00, 0x9e, 0x73], Marker::Diamond),
        ("all", [0x22, 0x22, 0x22], Marker::Triangle),
        ("black faces", [0xcc, 0x79, 0xa7], Marker::Wedge),
        ("bands", [0xe6, 0x9f, 0x00], Marker::Pentagon),
    ],
    // Ways to take pictures.
    &[
        ("radiosity alone", [0xcc, 0x79, 0xa7], Marker::Wedge),
        ("ray tracing alone", [0x56, 0xb4, 0xe9], Marker::Star),
        ("two passes, 0 bounces", [0xe6, 0x9f, 0x00], Marker::Pentagon),
        ("two passes, 1 bounce", [0xd5, 0x5e, 0x00], Marker::Square),
        ("two passes, any bounces", [0x00, 0x9e, 0x73], Marker::Diamond),
        ("path tracing", [0x22, 0x22, 0x22], Marker::Triangle),
        ("specular radiosity", [0x88, 0x22, 0x55], Marker::Circle),
    ],
];

/// Colours for names the table does not hold.
const OTHERS: [(Rgb, Marker); 8] = [
    ([0x44, 0x77, 0xaa], Marker::Plus),
    ([0xee, 0x66, 0x77], Marker::Star),
    ([0x22, 0x88, 0x33], Marker::Pentagon),
    ([0xaa, 0x33, 0x77], Marker::Diamond),
    ([0x99, 0x77, 0x00], Marker::Wedge),
    ([0x55, 0x55, 0x55], Marker::Triangle),
    ([0x33, 0xaa, 0xcc], Marker::Square),
    ([0x77, 0x44, 0x22], Marker::Circle),
];

/// How `method` is drawn: from the table, else by a hash of its name, so that it looks the same in every figure.
pub fn style(method: &str) -> Style {
    let known = GROUPS.iter().copied().flatten().find(|(name, _, _)| *name == method);
    let (colour, marker) = match known {
        Some(&(_, colour, marker)) => (colour, marker),
        // FNV-1a.
        None => {
            let hash =
                method.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3));
            OTHERS[((hash >> 32) % OTHERS.len() as u64) as usize]
        }
    };
    Style { colour, marker }
}

/// `colour` mixed with white: 0 leaves it, 1 is white.
pub fn lighter(colour: Rgb, share: f64) -> Rgb {
    colour.map(|c| (f64::from(c) + (255.0 - f64::from(c)) * share).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn linear(colour: Rgb) -> [f64; 3] {
        colour.map(|c| {
            let c = f64::from(c) / 255.0;
            if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
        })
    }

    /// L*, a*, b* (D65) of linear red, green and blue.
    fn lab([r, g, b]: [f64; 3]) -> [f64; 3] {
        let xyz = [
            (0.4124 * r + 0.3576 * g + 0.1805 * b) / 0.9505,
            0.2126 * r + 0.7152 * g + 0.0722 * b,
            (0.0193 * r + 0.1192 * g + 0.9505 * b) / 1.089,
        ];
        let f = xyz.map(|t| if t > 0.008_856 { t.cbrt() } else { 7.787 * t + 16.0 / 116.0 });
        [116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])]
    }

    /// Complete lack of one cone, in linear light (Machado, Oliveira and Fernandes 2009, severity 1).
    const DEFICIENCIES: [[[f64; 3]; 3]; 3] = [
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    ];

    fn seen(colour: Rgb, deficiency: &[[f64; 3]; 3]) -> [f64; 3] {
        let c = linear(colour);
        lab(deficiency.map(|row| row.iter().zip(c).map(|(m, c)| m * c).sum::<f64>().max(0.0)))
    }

    /// A distance of 2.3 in L*a*b* is just noticeable; thin lines need several times that.
    #[test]
    fn colours_of_a_group_keep_apart_with_and_without_a_deficiency() {
        for group in GROUPS {
            for (k, a) in group.iter().enumerate() {
                for b in &group[..k] {
                    assert_ne!(a.2, b.2, "{} and {} share a marker", a.0, b.0);
                    for deficiency in &DEFICIENCIES {
                        let (p, q) = (seen(a.1, deficiency), seen(b.1, deficiency));
                        let distance = p.iter().zip(q).map(|(p, q)| (p - q).powi(2)).sum::<f64>().sqrt();
                        assert!(distance > 12.0, "{} and {}: {distance:.1}", a.0, b.0);
                    }
                }
            }
        }
    }

    /// Lightness at most 80 of 100 stands out from white paper.
    #[test]
    fn every_colour_stands_out_from_white() {
        for (name, colour, _) in GROUPS.iter().copied().flatten() {
            assert!(lab(linear(*colour))[0] < 80.0, "{name}");
        }
    }

    #[test]
    fn an_unknown_method_always_looks_the_same() {
        assert_eq!(style("my own method"), style("my own method"));
        assert_ne!(style("my own method"), style("another one"));
    }
}
