//! What can be wrong with a View3D file.

/// Why a line of a View3D file cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum View3dFault {
    /// A first word that begins no statement.
    #[error("'{word}' begins no statement; write T, C, F, V, S, O, N, E or a comment after !")]
    Keyword {
        /// The word found.
        word: String,
    },
    /// A statement that is known but not supported.
    #[error("{what} are not supported; {instead}")]
    Unsupported {
        /// What is not.
        what: &'static str,
        /// What to do instead.
        instead: &'static str,
    },
    /// A geometry format other than 3 and 3a.
    #[error("format '{word}' is not known; F takes 3 or 3a")]
    Format {
        /// The word found.
        word: String,
    },
    /// A word where a number belongs.
    #[error("'{word}' is no {what}; correct it")]
    Number {
        /// What belongs there.
        what: &'static str,
        /// The word found.
        word: String,
    },
    /// A statement that ends before it is complete.
    #[error("the {what} is missing; complete the statement")]
    Missing {
        /// What is.
        what: &'static str,
    },
    /// A vertex or surface number given twice.
    #[error("{what} {number} is defined twice; renumber one of them")]
    Twice {
        /// `vertex` or `surface`.
        what: &'static str,
        /// Its number.
        number: u64,
    },
    /// A number that names nothing.
    #[error("{what} {number} is not defined; correct the number or add it")]
    Undefined {
        /// `vertex`, `base surface` or `surface to combine with`.
        what: &'static str,
        /// The number.
        number: u64,
    },
    /// A surface that refers to itself or to a later one.
    #[error("the {what} {number} must come before surface {surface}; change their order")]
    Order {
        /// `base surface` or `surface to combine with`.
        what: &'static str,
        /// The surface named.
        number: u64,
        /// The surface that names it.
        surface: u64,
    },
    /// A surface combined with one that is itself combined, or is no radiating surface.
    #[error("surface {number} cannot be combined with: it is {why}; name the surface that keeps the row")]
    Combined {
        /// The surface named.
        number: u64,
        /// What speaks against it.
        why: &'static str,
    },
    /// A null surface without a base.
    #[error("null surface {surface} names no base surface; give one")]
    NoBase {
        /// The surface.
        surface: u64,
    },
    /// A subsurface that cannot be cut out of its base.
    #[error("subsurface {surface} {why} its base surface {base}; correct its vertices")]
    Subsurface {
        /// The subsurface.
        surface: u64,
        /// Its base.
        base: u64,
        /// What is wrong, as part of the sentence.
        why: &'static str,
    },
    /// An emittance that is none.
    #[error("the emittance is {value}; it must lie in [0, 1]")]
    Emittance {
        /// The value found.
        value: f64,
    },
    /// Emittance 0: light in an enclosure of it would never settle.
    #[error("emittance {value} makes a reflectance of 1 or more; correct it or give --clamp-reflectance 0.95")]
    Reflectance {
        /// The emittance.
        value: f64,
    },
}
