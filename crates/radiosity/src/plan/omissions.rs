//! The exact omissions by name, and sets of them: each can be switched alone, to see what it saves.

use std::ops::{BitOr, Sub};

/// An exact omission.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Omission {
    /// Rows and elements of what is not asked for and sends nothing, or nothing to what is.
    Blockers,
    /// Everything in rooms that no light reaches.
    Dark,
    /// Form factors between rooms.
    Rooms,
    /// Black surfaces as unknowns.
    Black,
    /// Bands that are 0 or follow from others.
    Bands,
    /// Rows that are mirror images of others.
    Symmetry,
}

impl Omission {
    /// All of them, in the order in which savings are counted.
    pub const ALL: [Self; 6] = [Self::Blockers, Self::Dark, Self::Rooms, Self::Black, Self::Bands, Self::Symmetry];

    /// The name used in tables.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Blockers => "blockers",
            Self::Dark => "dark rooms",
            Self::Rooms => "rooms apart",
            Self::Black => "black faces",
            Self::Bands => "bands",
            Self::Symmetry => "symmetry",
        }
    }

    /// Why it changes nothing.
    pub fn reason(&self) -> &'static str {
        match self {
            Self::Blockers => "nothing that is asked for depends on what they send: they only block",
            Self::Dark => "no light reaches them: 0",
            Self::Rooms => "closed walls part them: 0",
            Self::Black => {
                "black faces reflect nothing: what they send is known, what arrives is gathered once, at the end"
            }
            Self::Bands => "nothing emits in them, or they are multiples of others",
            Self::Symmetry => "they are mirror images of rows that are computed",
        }
    }
}

/// A set of exact omissions.
///
/// # Examples
///
/// ```
/// # use radiosity::plan::{Omission, Omissions};
/// let some = Omissions::from(Omission::Bands) | Omission::Rooms.into();
/// assert!(some.contains(Omission::Rooms) && !some.contains(Omission::Black));
/// assert_eq!(Omissions::ALL - some - Omissions::ALL, Omissions::NONE);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Omissions(u8);

impl Omissions {
    /// Nothing is left out.
    pub const NONE: Self = Self(0);
    /// Everything is that the scene does not need.
    pub const ALL: Self = Self((1 << Omission::ALL.len()) - 1);

    /// Whether the set has it.
    pub fn contains(self, omission: Omission) -> bool {
        self.0 & Self::from(omission).0 != 0
    }
}

impl From<Omission> for Omissions {
    fn from(omission: Omission) -> Self {
        Self(1 << omission as u8)
    }
}

impl BitOr for Omissions {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl Sub for Omissions {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }
}
