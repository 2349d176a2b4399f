//! The sum of what arrives straight and by way of specular surfaces.

use radiosity_core::{BandValues, Bands, BandsMut, Cost, Entries, FormFactors, Properties, Row, RowBuf, StoreError};

use super::SparseFormFactors;

/// F + F′: form factors in any store, and extended ones ([`crate::extended`]) in sparse tables, one for each group of bands that share one.
///
/// *Memory*: that of both. *Reads*: a product reads both once for every group of bands. Symmetric if F and the one table are.
pub struct ExtendedFormFactors<'a> {
    straight: &'a dyn FormFactors,
    tables: Vec<SparseFormFactors>,
    /// The table of every band.
    of_band: Vec<usize>,
}

impl<'a> ExtendedFormFactors<'a> {
    /// `straight` with table `of_band[b]` added in band b. A single table serves any number of bands.
    ///
    /// # Panics
    ///
    /// If a table does not fit, there is none, or `straight` differs between bands itself.
    pub fn new(straight: &'a dyn FormFactors, tables: Vec<SparseFormFactors>, of_band: Vec<usize>) -> Self {
        assert!(!tables.is_empty() && of_band.iter().all(|&t| t < tables.len()), "tables of bands");
        assert!(!straight.properties().per_band, "form factors that are per band already");
        for table in &tables {
            let ends = |store: &dyn FormFactors| (store.sources(), store.targets());
            assert_eq!(ends(table), ends(straight), "extended form factors of another mesh");
        }
        Self { straight, tables, of_band }
    }

    fn table(&self, band: usize) -> &SparseFormFactors {
        if self.tables.len() == 1 { &self.tables[0] } else { &self.tables[self.of_band[band]] }
    }

    /// `apply` of every table to its bands.
    fn product(
        &self,
        x: Bands<'_>,
        mut y: BandsMut<'_>,
        apply: impl Fn(&SparseFormFactors, Bands<'_>, BandsMut<'_>) -> Result<Cost, StoreError>,
    ) -> Result<Cost, StoreError> {
        if let [table] = &self.tables[..] {
            return apply(table, x, y);
        }
        let mut cost = Cost::default();
        for (k, table) in self.tables.iter().enumerate() {
            let own: Vec<usize> = (0..x.count()).filter(|&b| self.of_band[b] == k).collect();
            let mut from = BandValues::zeros(own.len(), x.len());
            let mut to = BandValues::zeros(own.len(), y.len());
            own.iter().enumerate().for_each(|(at, &b)| from.band_mut(at).copy_from_slice(x.band(b)));
            cost += apply(table, from.view(), to.view_mut())?;
            own.iter().enumerate().for_each(|(at, &b)| y.band(b).copy_from_slice(to.band(at)));
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
        let mut specular = BandValues::zeros(y.count(), y.len());
        let cost = apply(self.straight, x, y.reborrow())?;
        let more = self.product(x, specular.view_mut(), |table, x, y| apply(table, x, y))?;
        y.values().iter_mut().zip(specular.values()).for_each(|(y, more)| *y += more);
        Ok(cost + more)
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
        let tables = self.tables.iter().map(FormFactors::properties);
        let per_band = self.tables.len() > 1;
        Properties {
            symmetric: straight.symmetric && !per_band && tables.clone().all(|table| table.symmetric),
            per_band,
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
        let mut more = RowBuf::default();
        let specular = self.table(band).row(s, band, &mut more)?;
        specular.entries.for_each(|t, value| buf.values[t] += value);
        Ok(Row { entries: Entries::Dense(&buf.values), cost: row.cost + specular.cost })
    }

    fn gather(&self, x: Bands<'_>, y: BandsMut<'_>) -> Result<Cost, StoreError> {
        self.sum(x, y, |store, x, y| store.gather(x, y))
    }

    fn scatter(&self, x: Bands<'_>, y: BandsMut<'_>) -> Result<Cost, StoreError> {
        self.sum(x, y, |store, x, y| store.scatter(x, y))
    }
}
