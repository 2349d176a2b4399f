//! Values of every element in every band, stored band after band.

/// A borrowed table of `bands` × `len` values: all elements of band 0, then all of band 1, and so on.
#[derive(Clone, Copy, Debug)]
pub struct Bands<'a> {
    values: &'a [f64],
    len: usize,
}

/// The mutable form of [`Bands`].
#[derive(Debug)]
pub struct BandsMut<'a> {
    values: &'a mut [f64],
    len: usize,
}

/// The owned form of [`Bands`].
#[derive(Clone, Debug, PartialEq)]
pub struct BandValues {
    values: Vec<f64>,
    len: usize,
}

fn check(values: usize, len: usize) {
    let whole = if len == 0 { values == 0 } else { values.is_multiple_of(len) };
    assert!(whole, "{values} values are not a whole number of bands of length {len}");
}

impl<'a> Bands<'a> {
    /// Views `values` as bands of `len` values each.
    ///
    /// # Panics
    ///
    /// If `values.len()` is no multiple of `len`.
    pub fn new(values: &'a [f64], len: usize) -> Self {
        check(values.len(), len);
        Self { values, len }
    }

    /// Number of bands.
    pub fn count(&self) -> usize {
        self.values.len().checked_div(self.len).unwrap_or(0)
    }

    /// Number of values in a band.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether a band holds no value.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The values of band `b`.
    pub fn band(&self, b: usize) -> &'a [f64] {
        &self.values[b * self.len..(b + 1) * self.len]
    }

    /// All values, band after band.
    pub fn values(&self) -> &'a [f64] {
        self.values
    }

    /// An owned copy.
    pub fn to_owned(&self) -> BandValues {
        BandValues { values: self.values.to_vec(), len: self.len }
    }
}

impl<'a> BandsMut<'a> {
    /// Views `values` as bands of `len` values each.
    ///
    /// # Panics
    ///
    /// If `values.len()` is no multiple of `len`.
    pub fn new(values: &'a mut [f64], len: usize) -> Self {
        check(values.len(), len);
        Self { values, len }
    }

    /// Number of bands.
    pub fn count(&self) -> usize {
        self.values.len().checked_div(self.len).unwrap_or(0)
    }

    /// Number of values in a band.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether a band holds no value.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The values of band `b`.
    pub fn band(&mut self, b: usize) -> &mut [f64] {
        &mut self.values[b * self.len..(b + 1) * self.len]
    }

    /// All values, band after band.
    pub fn values(&mut self) -> &mut [f64] {
        self.values
    }

    /// A read-only view.
    pub fn view(&self) -> Bands<'_> {
        Bands { values: self.values, len: self.len }
    }

    /// The same table for a shorter lifetime.
    pub fn reborrow(&mut self) -> BandsMut<'_> {
        BandsMut { values: self.values, len: self.len }
    }
}

impl BandValues {
    /// A table of zeros.
    pub fn zeros(bands: usize, len: usize) -> Self {
        Self { values: vec![0.0; bands * len], len }
    }

    /// Takes `values`, band after band, each of `len` values.
    ///
    /// # Panics
    ///
    /// If `values.len()` is no multiple of `len`.
    pub fn new(values: Vec<f64>, len: usize) -> Self {
        check(values.len(), len);
        Self { values, len }
    }

    /// A table of one band.
    pub fn single(values: Vec<f64>) -> Self {
        let len = values.len();
        Self { values, len }
    }

    /// Number of bands.
    pub fn count(&self) -> usize {
        self.view().count()
    }

    /// Number of values in a band.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether a band holds no value.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The values of band `b`.
    pub fn band(&self, b: usize) -> &[f64] {
        &self.values[b * self.len..(b + 1) * self.len]
    }

    /// The values of band `b`, to write.
    pub fn band_mut(&mut self, b: usize) -> &mut [f64] {
        &mut self.values[b * self.len..(b + 1) * self.len]
    }

    /// All values, band after band.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// All values, to write.
    pub fn values_mut(&mut self) -> &mut [f64] {
        &mut self.values
    }

    /// A borrowed view.
    pub fn view(&self) -> Bands<'_> {
        Bands { values: &self.values, len: self.len }
    }

    /// A mutable view.
    pub fn view_mut(&mut self) -> BandsMut<'_> {
        BandsMut { values: &mut self.values, len: self.len }
    }
}
