//! The sum of what arrives straight and by way of specular surfaces.

use radiosity_core::{BandValues, Bands, BandsMut, Cost, Entries, FormFactors, Properties, Row, RowBuf, StoreError};

use super::SparseFormFactors;

/// F + F′: form factors in any store, and extended ones ([`crate::extended`]) in sparse tables, each of which counts in every band with a weight of its own.
///
/// *Memory*: that of all. *Reads*: a product reads each once for all bands in which it counts. Symmetric in every band if F and all tables are.
pub struct ExtendedFormFactors<'a> {
    straight: &'a dyn FormFactors,
    tables: Vec<Table>,
    per_band: bool,
}

/// A part of F′.
struct Table {
    entries: SparseFormFactors,
    /// What it counts in each band.
    weights: Vec<f64>,
}

impl<'a> ExtendedFormFactors<'a> {
    /// `straight` with every table added, times its weight in each band. Tables whose weights are alike in all bands serve any number of bands.
    ///
    /// # Panics
    ///
    /// If a table does not fit, its weights are not as many as those of the others, finite and at least 0, or `straight` differs between bands itself.
    pub fn new(straight: &'a dyn FormFactors, tables: Vec<(SparseFormFactors, Vec<f64>)>) -> Self {
        assert!(!straight.properties().per_band, "form factors that are per band already");
        for (table, weights) in &tables {
            let ends = |store: &dyn FormFactors| (store.sources(), store.targets());
            assert_eq!(ends(table), ends(straight), "extended form factors of another mesh");
            assert!(!weights.is_empty() && weights.len() == tables[0].1.len(), "weights of bands");
            assert!(weights.iter().all(|w| w.is_finite() && *w >= 0.0), "weights of bands");
        }
        let per_band = tables.iter().any(|(_, weights)| weights.iter().any(|w| *w != weights[0]));
        let tables = tables.into_iter().map(|(entries, weights)| Table { entries, weights }).collect();
        Self { straight, tables, per_band }
    }

    /// What a table counts in a band.
    fn weight(&self, table: &Table, band: usize) -> f64 {
        table.weights[if self.per_band { band } else { 0 }]
    }

    /// Adds `apply` of every table, times its weights, to `y`.
    fn product(
        &self,
        x: Bands<'_>,
        mut y: BandsMut<'_>,
        apply: impl Fn(&SparseFormFactors, Bands<'_>, BandsMut<'_>) -> Result<Cost, StoreError>,
    ) -> Result<Cost, StoreError> {
        let mut cost = Cost::default();
        for table in &self.tables {
            let own: Vec<usize> = (0..x.count()).filter(|&b| self.weight(table, b) > 0.0).collect();
            let mut from = BandValues::zeros(own.len(), x.len());
            let mut to = BandValues::zeros(own.len(), y.len());
            own.iter().enumerate().for_each(|(at, &b)| from.band_mut(at).copy_from_slice(x.band(b)));
            cost += apply(&table.entries, from.view(), to.view_mut())?;
            for (at, &b) in own.iter().enumerate() {
                let weight = self.weight(table, b);
                y.band(b).iter_mut().zip(to.band(at)).for_each(|(y, more)| *y += weight * more);
            }
        }
        Ok(cost)
    }

    /// The products of both parts, added.
    fn sum(
        &self,
        x: Bands<'_>,
        mut y: BandsMut<'_>,
        apply: impl Fn(&dyn FormFactors, Bands<'_>, BandsMut<'_>) -> Result<Cost, StoreError>,
    ) -> Result<Cost, StoreError> {
        let cost = apply(self.straight, x, y.reborrow())?;
        Ok(cost + self.product(x, y, |table, x, y| apply(table, x, y))?)
    }
}

impl FormFactors for ExtendedFormFactors<'_> {
    fn name(&self) -> &'static str {
        "extended"
    }

    fn sources(&self) -> usize {
        self.straight.sources()
    }

    fn targets(&self) -> usize {
        self.straight.targets()
    }

    fn properties(&self) -> Properties {
        let straight = self.straight.properties();
        let tables = self.tables.iter().map(|table| table.entries.properties());
        Properties {
            symmetric: straight.symmetric && tables.clone().all(|table| table.symmetric),
            per_band: self.per_band,
            stored_bytes: straight.stored_bytes + tables.map(|table| table.stored_bytes).sum::<u64>(),
            rounding: straight.rounding,
        }
    }

    fn row<'a>(&'a self, s: usize, band: usize, buf: &'a mut RowBuf) -> Result<Row<'a>, StoreError> {
        let mut own = RowBuf::default();
        let row = self.straight.row(s, band, &mut own)?;
        buf.values.clear();
        buf.values.resize(self.targets(), 0.0);
        row.entries.for_each(|t, value| buf.values[t] = value);
        let (mut more, mut cost) = (RowBuf::default(), row.cost);
        for table in &self.tables {
            let (weight, row) = (self.weight(table, band), table.entries.row(s, band, &mut more)?);
            row.entries.for_each(|t, value| buf.values[t] += weight * value);
            cost += row.cost;
        }
        Ok(Row { entries: Entries::Dense(&buf.values), cost })
    }

    fn gather(&self, x: Bands<'_>, y: BandsMut<'_>) -> Result<Cost, StoreError> {
        self.sum(x, y, |store, x, y| store.gather(x, y))
    }

    fn scatter(&self, x: Bands<'_>, y: BandsMut<'_>) -> Result<Cost, StoreError> {
        self.sum(x, y, |store, x, y| store.scatter(x, y))
    }
}
