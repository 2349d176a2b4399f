//! Classes of paths, from light to eye, in the letters of Heckbert (1990).
//!
//! L is the light, D a diffuse reflection, S a specular one (glossy lobes count as S) or several in a row, E the eye. Every path that arrives belongs to
//! exactly one class, by what happens next to the eye:
//!
//! | class | what the eye sees | whose work in the two-pass method |
//! |---|---|---|
//! | `LE`, `LSE` | a light, by itself or by way of S | second pass |
//! | `LDE`, `LDSE` | a diffuse surface lit by a light | first pass, or emitters sampled in the second |
//! | `LSDE`, `LSDSE` | one lit by a light by way of S: caustics, light thrown by mirrors | first pass with specular bounces, or final gather |
//! | `LDDE`, `LDDSE` | one lit by another diffuse surface, lit in any way | first pass, or final gather |
//! | `LDSDE`, `LDSDSE` | one lit by another diffuse surface by way of S | first pass with specular bounces, or final gather |
//!
//! The last two rows stand for all paths of two diffuse reflections and more.

use std::fmt;

/// How light arrives at the diffuse surface nearest to the eye, or that there is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Arrival {
    /// No diffuse surface: the light itself.
    Light,
    /// From a light.
    Direct,
    /// From a light by way of S.
    SpecularDirect,
    /// From another diffuse surface.
    Indirect,
    /// From another diffuse surface by way of S.
    SpecularIndirect,
}

/// A class of paths.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct PathClass {
    /// How light arrives at the diffuse surface nearest to the eye.
    pub arrival: Arrival,
    /// Whether there is S between there and the eye.
    pub specular_eye: bool,
}

impl PathClass {
    /// Every class.
    pub const ALL: [Self; 10] = {
        use Arrival::{Direct, Indirect, Light, SpecularDirect, SpecularIndirect};
        let mut all = [Self { arrival: Light, specular_eye: false }; 10];
        let arrivals = [Light, Direct, SpecularDirect, Indirect, SpecularIndirect];
        let mut k = 0;
        while k < all.len() {
            all[k] = Self { arrival: arrivals[k / 2], specular_eye: k % 2 == 1 };
            k += 1;
        }
        all
    };

    /// Its letters.
    pub fn name(self) -> &'static str {
        let names = match self.arrival {
            Arrival::Light => ["LE", "LSE"],
            Arrival::Direct => ["LDE", "LDSE"],
            Arrival::SpecularDirect => ["LSDE", "LSDSE"],
            Arrival::Indirect => ["LDDE", "LDDSE"],
            Arrival::SpecularIndirect => ["LDSDE", "LDSDSE"],
        };
        names[usize::from(self.specular_eye)]
    }

    /// The class of these letters.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|class| class.name() == name)
    }

    /// Its place in [`Self::ALL`].
    pub fn index(self) -> usize {
        2 * self.arrival as usize + usize::from(self.specular_eye)
    }
}

impl fmt::Display for PathClass {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A set of classes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PathClasses(u16);

impl PathClasses {
    /// Every class.
    pub const ALL: Self = Self((1 << PathClass::ALL.len()) - 1);
    /// No class.
    pub const NONE: Self = Self(0);

    /// With `class` added.
    #[must_use]
    pub fn with(self, class: PathClass) -> Self {
        Self(self.0 | 1 << class.index())
    }

    /// Without `class`.
    #[must_use]
    pub fn without(self, class: PathClass) -> Self {
        Self(self.0 & !(1 << class.index()))
    }

    /// Whether `class` is in the set.
    pub fn has(self, class: PathClass) -> bool {
        self.0 >> class.index() & 1 == 1
    }
}

/// What a path has met since it left the eye.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Itinerary {
    specular_eye: bool,
    diffuse: u32,
    specular_between: bool,
}

impl Itinerary {
    /// A path that begins at a diffuse surface, whose irradiance is asked for.
    pub const AT_RECEIVER: Self = Self { specular_eye: false, diffuse: 1, specular_between: false };

    /// After a diffuse reflection.
    #[must_use]
    pub fn diffuse(self) -> Self {
        Self { diffuse: self.diffuse + 1, ..self }
    }

    /// After a specular one.
    #[must_use]
    pub fn specular(self) -> Self {
        match self.diffuse {
            0 => Self { specular_eye: true, ..self },
            1 => Self { specular_between: true, ..self },
            _ => self,
        }
    }

    /// The class if a light comes next.
    pub fn class(self) -> PathClass {
        let arrival = match (self.diffuse, self.specular_between) {
            (0, _) => Arrival::Light,
            (1, false) => Arrival::Direct,
            (1, true) => Arrival::SpecularDirect,
            (_, false) => Arrival::Indirect,
            (_, true) => Arrival::SpecularIndirect,
        };
        PathClass { arrival, specular_eye: self.specular_eye }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every string of D and S up to six letters, read from the eye, against the table of the module read as patterns.
    #[test]
    fn every_path_has_the_class_that_its_letters_say() {
        for length in 0..=6 {
            for bits in 0..1_u32 << length {
                let letters: Vec<bool> = (0..length).map(|k| bits >> k & 1 == 1).collect();
                let walk = |path: Itinerary, &d: &bool| if d { path.diffuse() } else { path.specular() };
                let class = letters.iter().fold(Itinerary::default(), walk).class();
                // From the light, runs of S as one S.
                let text: String = letters.iter().rev().map(|&d| if d { 'D' } else { 'S' }).collect();
                let mut text = format!("L{text}E");
                while text.contains("SS") {
                    text = text.replace("SS", "S");
                }
                let diffuse = text.matches('D').count();
                let ends = |tail: &str| text.ends_with(tail);
                let expected = match diffuse {
                    0 => text.clone(),
                    1 => text.clone(),
                    _ if ends("DDE") => "LDDE".into(),
                    _ if ends("DDSE") => "LDDSE".into(),
                    _ if ends("DSDE") => "LDSDE".into(),
                    _ => "LDSDSE".into(),
                };
                assert_eq!(class.name(), expected, "{text}");
                assert_eq!(PathClass::named(class.name()), Some(class));
                assert_eq!(PathClass::ALL[class.index()], class);
            }
        }
    }

    #[test]
    fn sets_hold_what_was_put_in() {
        let caustics = PathClass::named("LSDE").unwrap();
        let set = PathClasses::NONE.with(caustics);
        assert!(set.has(caustics) && PathClass::ALL.iter().filter(|class| set.has(**class)).count() == 1);
        assert!(PathClass::ALL.iter().all(|class| PathClasses::ALL.has(*class)));
    }
}
