//! What dropped pairs exchanged, given back.

use radiosity_core::{Bands, BandsMut, Cost, Entries, FormFactors, Properties, Row, RowBuf, StoreError};

use super::{Held, assert_factors};

/// A symmetric store without its small pairs, and in their place an exchange of everything with everything that gives rows their sums:
///
/// ```text
/// S_ij = K_ij + d_i d_j / D,      d_i = A_i − Σ_j K_ij,      D = Σ_j d_j
/// ```
///
/// with K what was kept. So S is symmetric to the last bit, not negative, and the rows of a closed scene sum to A_i; in an open one d_i is a share of A_i − Σ_j K_ij,
/// as what is missing may be what never arrived. A row of K that lost
/// d_i gets as much back from the mean of x over what was lost, Σ_j d_j x_j / D, instead of from where it came: what that
/// changes is bounded by what was lost, times how much x varies there ([`Thinning::carried`](crate::Thinning::carried)). Elements that K leaves in separate groups have a D each, since what
/// a closed partition parts must stay dark.
///
/// *Why not otherwise*: scaling ([`crate::repair`]) changes direct light, where an error counts most, and takes tens of products; what was lost
/// added to the diagonal
/// gives an element its own light back instead of the mean of many. *Memory*: that of the store, 12 bytes an element and 16 a group. *Reads*: a product
/// reads the store and d once; rows are full, and shots and sweeps go by them.
pub struct ThinnedFormFactors {
    kept: Box<dyn Held>,
    given: GivenBack,
}

/// d and D of [`ThinnedFormFactors`].
#[derive(Clone, Debug)]
pub struct GivenBack {
    /// d_i.
    given: Vec<f64>,
    /// Group of every element.
    group: Vec<u32>,
    /// 1/D of every group, 0 of one that lost nothing.
    rates: Vec<f64>,
    /// Largest d of every group.
    largest: Vec<f64>,
}

impl ThinnedFormFactors {
    /// Gives the rows of `kept` this share of what they miss of the sums `areas`, no row more than of what it can have lost: all of it in a closed scene, in
    /// which what is missing was lost; in an open one half of it halves what it may be wrong by.
    ///
    /// # Errors
    ///
    /// [`StoreError`] if a row cannot be had.
    ///
    /// # Panics
    ///
    /// If the store is not symmetric, there is not an area and a largest loss of every element, or the share is not in (0, 1].
    pub fn new(kept: Box<dyn Held>, areas: &[f64], lost: &[f64], share: f64) -> Result<(Self, Cost), StoreError> {
        let m = kept.sources();
        assert!(kept.properties().symmetric, "only pairs are dropped in both of their rows");
        assert_eq!((areas.len(), lost.len()), (m, m), "an area and a largest loss of every element");
        assert!(share > 0.0 && share <= 1.0, "a share of what was lost, not {share}");
        let (ones, mut given) = (vec![1.0; m], vec![0.0; m]);
        let mut cost = kept.gather(Bands::new(&ones, m), BandsMut::new(&mut given, m))?;
        given.iter_mut().zip(areas).zip(lost).for_each(|((d, area), lost)| *d = share * (area - *d).clamp(0.0, *lost));
        let (group, spent) = groups(&*kept)?;
        cost += spent;
        Ok((Self { kept, given: GivenBack::new(given, group) }, cost))
    }

    /// What rows got back.
    pub fn given(&self) -> &GivenBack {
        &self.given
    }
}

impl GivenBack {
    fn new(given: Vec<f64>, group: Vec<u32>) -> Self {
        let count = group.iter().map(|&g| g as usize + 1).max().unwrap_or(0);
        let (mut sums, mut largest) = (vec![0.0; count], vec![0.0_f64; count]);
        for (&g, &d) in group.iter().zip(&given) {
            let g = g as usize;
            (sums[g], largest[g]) = (sums[g] + d, largest[g].max(d));
        }
        let rates = sums.into_iter().map(|sum| if sum > 0.0 { 1.0 / sum } else { 0.0 }).collect();
        Self { given, group, rates, largest }
    }

    /// What rows would get back if all elements were one group.
    pub fn to_all(given: Vec<f64>) -> Self {
        let group = vec![0; given.len()];
        Self::new(given, group)
    }

    /// d_i: what each row got back.
    pub fn areas(&self) -> &[f64] {
        &self.given
    }

    /// Σ_j d_j x_j / D of the group of every element: what it exchanges with in place of what was dropped.
    ///
    /// # Panics
    ///
    /// If there is not one value an element.
    pub fn means(&self, x: &[f64]) -> Vec<f64> {
        assert_eq!(x.len(), self.given.len(), "means: length");
        let mut sums = vec![0.0; self.rates.len()];
        for ((&g, d), x) in self.group.iter().zip(&self.given).zip(x) {
            sums[g as usize] += d * x;
        }
        self.group.iter().map(|&g| sums[g as usize] * self.rates[g as usize]).collect()
    }

    /// d_s d_t / D.
    fn exchange(&self, s: usize, t: usize) -> f64 {
        let apart = self.group[s] != self.group[t];
        // The product of the two first: the same for (s, t) and (t, s).
        if apart { 0.0 } else { (self.given[s] * self.given[t]) * self.rates[self.group[s] as usize] }
    }

    /// Bytes held.
    fn bytes(&self) -> u64 {
        (12 * self.given.len() + 16 * self.rates.len()) as u64
    }
}

/// The groups of elements that exchange nothing with each other, numbered by their first elements.
fn groups(store: &dyn FormFactors) -> Result<(Vec<u32>, Cost), StoreError> {
    const NONE: u32 = u32::MAX;
    let (mut group, mut cost, mut buf) = (vec![NONE; store.sources()], Cost::default(), RowBuf::default());
    let (mut count, mut found, mut open) = (0, 0, Vec::new());
    for first in 0..group.len() {
        if group[first] != NONE {
            continue;
        }
        (group[first], found) = (count, found + 1);
        open.push(first);
        // Rows are read while there is something left to be found: a few of a room.
        while let Some(s) = open.pop().filter(|_| found < group.len()) {
            let row = store.row(s, 0, &mut buf)?;
            cost += row.cost;
            row.entries.for_each(|t, value| {
                if value > 0.0 && group[t] == NONE {
                    (group[t], found) = (count, found + 1);
                    open.push(t);
                }
            });
        }
        open.clear();
        count += 1;
    }
    Ok((group, cost))
}

impl FormFactors for ThinnedFormFactors {
    fn name(&self) -> &'static str {
        "thinned"
    }

    fn sources(&self) -> usize {
        self.kept.sources()
    }

    fn targets(&self) -> usize {
        self.kept.targets()
    }

    fn properties(&self) -> Properties {
        let kept = self.kept.properties();
        Properties { stored_bytes: kept.stored_bytes + self.given.bytes(), ..kept }
    }

    fn row<'a>(&'a self, s: usize, band: usize, buf: &'a mut RowBuf) -> Result<Row<'a>, StoreError> {
        let mut own = RowBuf::default();
        let kept = self.kept.row(s, band, &mut own)?;
        buf.values.clear();
        buf.values.extend((0..self.targets()).map(|t| self.given.exchange(s, t)));
        kept.entries.for_each(|t, value| buf.values[t] += value);
        Ok(Row { entries: Entries::Dense(&buf.values), cost: kept.cost })
    }

    fn gather(&self, x: Bands<'_>, mut y: BandsMut<'_>) -> Result<Cost, StoreError> {
        let cost = self.kept.gather(x, y.reborrow())?;
        for b in 0..x.count() {
            let means = self.given.means(x.band(b));
            y.band(b).iter_mut().zip(self.given.areas()).zip(means).for_each(|((y, d), mean)| *y += d * mean);
        }
        Ok(cost + Cost::applied(2 * self.sources(), size_of::<f64>(), x.count()))
    }
}

impl Held for ThinnedFormFactors {
    fn bound(&self, s: usize) -> Option<f64> {
        let given = &self.given;
        let group = given.group[s] as usize;
        let largest = (given.given[s] * given.largest[group]) * given.rates[group];
        self.kept.bound(s).map(|bound| bound + largest)
    }

    fn scale(&mut self, factors: &[f64]) {
        assert_factors(self, factors);
        self.kept.scale(factors);
        let given = &mut self.given;
        given.given.iter_mut().zip(factors).for_each(|(d, factor)| *d *= factor);
        given.largest.fill(0.0);
        given.group.iter().zip(&given.given).for_each(|(&g, &d)| {
            let largest = &mut given.largest[g as usize];
            *largest = largest.max(d);
        });
    }
}
