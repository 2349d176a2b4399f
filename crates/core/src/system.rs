//! The radiosity system: form factors, areas, emission and reflectance, and how elements hang on patches.

use crate::{BandValues, Bands, BandsMut, Cost, FormFactors, StoreError, SystemError};

/// Which way rows are read where a store allows both.
///
/// On a symmetric store both solve the same system. Rows of a row-wise estimator carry their own errors, and then
/// gathering and shooting solve *different* systems.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// H_s = (1/A_s) Σ_t A_s F_st B_t.
    Gather,
    /// H_t = (1/A_t) Σ_s A_s F_st B_s.
    Shoot,
}

/// What the rows of the store run between.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// m × m: every element sends to every element.
    Full,
    /// m × n: elements gather from patches, whose radiosity is the area mean of their elements.
    ElementsToPatches,
    /// n × m: patches shoot to elements.
    PatchesToElements,
}

/// Areas and parents of the patches of a substructured system.
#[derive(Clone, Debug)]
struct Patches<'a> {
    parent: &'a [u32],
    areas: Vec<f64>,
}

/// B = E + ρ H over m elements, with H linear in B through a store of form factors.
///
/// Elements hold B; in the substructured forms the n patches send the area mean of their elements. The data are borrowed: a system
/// takes no memory an element of its own.
#[derive(Clone)]
pub struct System<'a> {
    store: &'a dyn FormFactors,
    form: Form,
    areas: &'a [f64],
    emission: Bands<'a>,
    reflectance: Bands<'a>,
    patches: Option<Patches<'a>>,
}

impl std::fmt::Debug for System<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "System {{ {:?}, {} elements, store {} }}", self.form, self.elements(), self.store.name())
    }
}

impl<'a> System<'a> {
    /// A system in which every element sends to every element.
    ///
    /// Areas in m² (any one unit), emission in W/m², reflectance in [0, 1); all bands of a row-independent F.
    ///
    /// # Errors
    ///
    /// [`SystemError`] if a value is out of range or a length does not fit.
    pub fn full(
        store: &'a dyn FormFactors,
        areas: &'a [f64],
        emission: Bands<'a>,
        reflectance: Bands<'a>,
    ) -> Result<Self, SystemError> {
        Self::build(store, Form::Full, areas, emission, reflectance, None)
    }

    /// A substructured system: `parent[e]` is the patch of element e; `form` says which way the store's rows run.
    ///
    /// # Errors
    ///
    /// [`SystemError`] if a value is out of range, a length does not fit or a patch has no element.
    pub fn substructured(
        store: &'a dyn FormFactors,
        form: Form,
        areas: &'a [f64],
        parent: &'a [u32],
        emission: Bands<'a>,
        reflectance: Bands<'a>,
    ) -> Result<Self, SystemError> {
        if form == Form::Full {
            return Self::full(store, areas, emission, reflectance);
        }
        if parent.len() != areas.len() {
            return Err(SystemError::Length { what: "the parent map", has: parent.len(), needs: areas.len() });
        }
        let n = if form == Form::PatchesToElements { store.sources() } else { store.targets() };
        let mut patch_areas = vec![0.0; n];
        for (e, (&p, &area)) in parent.iter().zip(areas).enumerate() {
            *patch_areas.get_mut(p as usize).ok_or(SystemError::Parent { at: e, patches: n })? += area;
        }
        if let Some(at) = patch_areas.iter().position(|&a| a == 0.0) {
            return Err(SystemError::Parent { at, patches: n });
        }
        let patches = Patches { parent, areas: patch_areas };
        Self::build(store, form, areas, emission, reflectance, Some(patches))
    }

    fn build(
        store: &'a dyn FormFactors,
        form: Form,
        areas: &'a [f64],
        emission: Bands<'a>,
        reflectance: Bands<'a>,
        patches: Option<Patches<'a>>,
    ) -> Result<Self, SystemError> {
        let m = areas.len();
        if m == 0 {
            return Err(SystemError::Empty);
        }
        // Shapes: the store against the form, the vectors against the elements.
        let n = patches.as_ref().map_or(m, |p| p.areas.len());
        let (needs_sources, needs_targets) = match form {
            Form::Full => (m, m),
            Form::ElementsToPatches => (m, n),
            Form::PatchesToElements => (n, m),
        };
        let (has_sources, has_targets) = (store.sources(), store.targets());
        if (has_sources, has_targets) != (needs_sources, needs_targets) {
            return Err(SystemError::Shape { form, needs_sources, needs_targets, has_sources, has_targets });
        }
        for (what, values) in [("the emission", emission), ("the reflectance", reflectance)] {
            if values.len() != m {
                return Err(SystemError::Length { what, has: values.len(), needs: m });
            }
        }
        if reflectance.count() != emission.count() || emission.count() == 0 {
            return Err(SystemError::Length {
                what: "the list of bands",
                has: reflectance.count(),
                needs: emission.count().max(1),
            });
        }
        // Ranges.
        if let Some(element) = areas.iter().position(|a| !(a.is_finite() && *a > 0.0)) {
            return Err(SystemError::Area { element, value: areas[element] });
        }
        for band in 0..emission.count() {
            for (element, &value) in reflectance.band(band).iter().enumerate() {
                if !(0.0..1.0).contains(&value) {
                    return Err(SystemError::Reflectance { element, band, value });
                }
            }
            for (element, &value) in emission.band(band).iter().enumerate() {
                if !(value.is_finite() && value >= 0.0) {
                    return Err(SystemError::Emission { element, band, value });
                }
            }
        }
        Ok(Self { store, form, areas, emission, reflectance, patches })
    }

    /// Number m of elements.
    pub fn elements(&self) -> usize {
        self.areas.len()
    }

    /// Number of bands.
    pub fn bands(&self) -> usize {
        self.emission.count()
    }

    /// The store of form factors.
    pub fn store(&self) -> &'a dyn FormFactors {
        self.store
    }

    /// What the rows of the store run between.
    pub fn form(&self) -> Form {
        self.form
    }

    /// Areas of the elements.
    pub fn areas(&self) -> &'a [f64] {
        self.areas
    }

    /// Emission E of the elements.
    pub fn emission(&self) -> Bands<'a> {
        self.emission
    }

    /// Reflectance ρ of the elements.
    pub fn reflectance(&self) -> Bands<'a> {
        self.reflectance
    }

    /// The patch of every element, in the substructured forms.
    pub fn parent(&self) -> Option<&[u32]> {
        self.patches.as_ref().map(|p| p.parent)
    }

    /// Areas of the patches; in the full form those of the elements.
    pub fn patch_areas(&self) -> &[f64] {
        self.patches.as_ref().map_or(self.areas, |p| &p.areas)
    }

    /// Area means over the patches of values on the elements; a copy in the full form.
    pub fn patch_means(&self, x: Bands<'_>) -> BandValues {
        let Some(patches) = &self.patches else { return x.to_owned() };
        let mut means = BandValues::zeros(x.count(), patches.areas.len());
        for b in 0..x.count() {
            let band = means.band_mut(b);
            for ((&p, &area), &value) in patches.parent.iter().zip(self.areas).zip(x.band(b)) {
                band[p as usize] += area * value;
            }
            band.iter_mut().zip(&patches.areas).for_each(|(mean, area)| *mean /= area);
        }
        means
    }

    /// Irradiance H of every element when the elements have radiosity x, rows read in `direction`.
    ///
    /// The substructured forms fix their direction themselves.
    ///
    /// # Errors
    ///
    /// [`StoreError`] if a row cannot be had.
    pub fn irradiance(&self, direction: Direction, x: Bands<'_>, mut h: BandsMut<'_>) -> Result<Cost, StoreError> {
        let cost = match (self.form, direction) {
            (Form::Full, Direction::Gather) => self.store.gather(x, h.reborrow()),
            (Form::Full, Direction::Shoot) => self.store.scatter(x, h.reborrow()),
            (Form::ElementsToPatches, _) => self.store.gather(self.patch_means(x).view(), h.reborrow()),
            (Form::PatchesToElements, _) => self.store.scatter(self.patch_means(x).view(), h.reborrow()),
        }?;
        for b in 0..h.count() {
            h.band(b).iter_mut().zip(self.areas).for_each(|(h, area)| *h /= area);
        }
        Ok(cost)
    }

    /// Residual r = E + ρ H(x) − x: the radiosity that is still to be shot when x has been.
    ///
    /// # Errors
    ///
    /// [`StoreError`] if a row cannot be had.
    pub fn residual(&self, direction: Direction, x: Bands<'_>, mut r: BandsMut<'_>) -> Result<Cost, StoreError> {
        let cost = self.irradiance(direction, x, r.reborrow())?;
        for b in 0..r.count() {
            let (e, rho, x) = (self.emission.band(b), self.reflectance.band(b), x.band(b));
            for (k, r) in r.band(b).iter_mut().enumerate() {
                *r = e[k] + rho[k] * *r - x[k];
            }
        }
        Ok(cost)
    }

    /// B = E + ρH of every element.
    ///
    /// # Panics
    ///
    /// If H does not fit the system.
    pub fn radiosity(&self, irradiance: Bands<'_>) -> BandValues {
        assert_eq!(
            (irradiance.count(), irradiance.len()),
            (self.bands(), self.elements()),
            "irradiance of another system"
        );
        let mut b = irradiance.to_owned();
        let data = self.emission.values().iter().zip(self.reflectance.values());
        b.values_mut().iter_mut().zip(data).for_each(|(b, (e, rho))| *b = e + rho * *b);
        b
    }

    /// η = Σ A|r| / Σ A E of the worst band; a band in which nothing emits counts as 0 (or as infinite if r ≠ 0).
    pub fn unshot(&self, r: Bands<'_>) -> f64 {
        self.band_fractions(r)
            .into_iter()
            .fold(0.0, |worst: f64, eta| if worst.is_nan() || eta <= worst { worst } else { eta })
    }

    fn band_fractions(&self, r: Bands<'_>) -> Vec<f64> {
        (0..r.count())
            .map(|b| {
                let emitted: f64 = self.power(self.emission.band(b));
                let unshot: f64 = self.areas.iter().zip(r.band(b)).map(|(a, r)| a * r.abs()).sum();
                if unshot == 0.0 { 0.0 } else { unshot / emitted }
            })
            .collect()
    }

    /// Σ A x: the power of radiosity x of the elements.
    pub fn power(&self, x: &[f64]) -> f64 {
        self.areas.iter().zip(x).map(|(a, x)| a * x).sum()
    }

    /// q of every band: the largest part of any sender's power that is reflected once, counting its own row sum.
    ///
    /// In the norm Σ A|z| the operator z → ρ F z has norm q = max_t (1/A_t) Σ_s A_s ρ_s F_st when gathering (with
    /// rows instead of columns when shooting). If q < 1, Σ A|B* − B| ≤ Σ A|r| · q/(1 − q) for B = x + r.
    ///
    /// # Errors
    ///
    /// [`StoreError`] if a row cannot be had.
    pub fn contraction(&self, direction: Direction) -> Result<(Vec<f64>, Cost), StoreError> {
        let ones = BandValues::new(vec![1.0; self.bands() * self.elements()], self.elements());
        let (reflected, cost) = self.adjoint(direction, ones.view())?;
        let largest = |b: usize| reflected.band(b).iter().copied().fold(0.0, f64::max);
        Ok(((0..self.bands()).map(largest).collect(), cost))
    }

    /// T w = A⁻¹ (ρF)ᵀ A w: what comes back, in units of w, of the power that each element sends.
    ///
    /// ```text
    /// (T w)_t = (1/A_t) Σ_s A_s F_st ρ_s w_s      when gathering; with rows instead of columns when shooting
    /// ```
    ///
    /// In the substructured forms the elements of a patch share a value.
    ///
    /// # Errors
    ///
    /// [`StoreError`] if a row cannot be had.
    pub fn adjoint(&self, direction: Direction, w: Bands<'_>) -> Result<(BandValues, Cost), StoreError> {
        let shoots = match self.form {
            Form::Full => direction == Direction::Shoot,
            form => form == Form::PatchesToElements,
        };
        let mut reflected = w.to_owned();
        reflected.values_mut().iter_mut().zip(self.reflectance.values()).for_each(|(w, rho)| *w *= rho);
        let senders = self.patch_areas();
        let mut back = BandValues::zeros(self.bands(), senders.len());
        let cost = if shoots {
            self.store.gather(reflected.view(), back.view_mut())?
        } else {
            self.store.scatter(reflected.view(), back.view_mut())?
        };
        for b in 0..self.bands() {
            back.band_mut(b).iter_mut().zip(senders).for_each(|(back, area)| *back /= area);
        }
        let Some(patches) = &self.patches else { return Ok((back, cost)) };
        for b in 0..self.bands() {
            let of_patches = back.band(b);
            let own = reflected.band_mut(b).iter_mut().zip(patches.parent);
            own.for_each(|(value, &p)| *value = of_patches[p as usize]);
        }
        Ok((reflected, cost))
    }
}
