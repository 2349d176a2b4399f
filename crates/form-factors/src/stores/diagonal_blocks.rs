//! Systems that do not see each other, in one store.

use radiosity_core::{BandValues, Bands, BandsMut, Cost, Entries, FormFactors, Properties, Row, RowBuf, StoreError};

/// Stores of parts that exchange nothing: the blocks of a matrix that is 0 elsewhere.
///
/// *Memory*: that of the blocks; their sources and targets are named by lists. *Reads*: a product reads every block once and nothing
/// beside them. Symmetric if all blocks are.
pub struct DiagonalBlocks<'a> {
    blocks: Vec<Block<'a>>,
    /// Block of every source, and its row there.
    place: Vec<(u32, u32)>,
    targets: usize,
}

/// One part.
struct Block<'a> {
    store: Box<dyn FormFactors + 'a>,
    sources: Vec<u32>,
    targets: Vec<u32>,
}

/// A store with the sources and targets, ascending, that its rows and columns are.
pub type Part<'a> = (Box<dyn FormFactors + 'a>, Vec<u32>, Vec<u32>);

impl<'a> DiagonalBlocks<'a> {
    /// The matrix of `parts` between so many sources and targets.
    ///
    /// # Panics
    ///
    /// If a list does not fit its store, or the lists do not name every source once; if form factors of a part differ between bands.
    pub fn new(parts: Vec<Part<'a>>, sources: usize, targets: usize) -> Self {
        let mut place = vec![(u32::MAX, 0); sources];
        let of_part = |(part, (store, own, to)): (u32, Part<'a>)| {
            assert_eq!((store.sources(), store.targets()), (own.len(), to.len()), "sources and targets of a part");
            assert!(to.iter().all(|&t| (t as usize) < targets), "targets lie below {targets}");
            assert!(!store.properties().per_band, "form factors that are per band");
            (0..).zip(&own).for_each(|(row, &s)| place[s as usize] = (part, row));
            Block { store, sources: own, targets: to }
        };
        let blocks: Vec<Block<'a>> = (0..).zip(parts).map(of_part).collect();
        let named: usize = blocks.iter().map(|block| block.sources.len()).sum();
        assert!(named == sources && place.iter().all(|(part, _)| *part < u32::MAX), "every source in one part");
        Self { blocks, place, targets }
    }

    /// `apply` to the parts of x and y of each block, which `ends` names.
    fn product(
        &self,
        x: Bands<'_>,
        mut y: BandsMut<'_>,
        ends: impl for<'b> Fn(&'b Block<'a>) -> [&'b [u32]; 2],
        apply: impl Fn(&dyn FormFactors, Bands<'_>, BandsMut<'_>) -> Result<Cost, StoreError>,
    ) -> Result<Cost, StoreError> {
        y.values().fill(0.0);
        let mut cost = Cost::default();
        for block in &self.blocks {
            let [from, to] = ends(block);
            let part = (0..x.count()).flat_map(|b| from.iter().map(move |&k| x.band(b)[k as usize])).collect();
            let part = BandValues::new(part, from.len());
            let mut sums = BandValues::zeros(x.count(), to.len());
            cost += apply(&*block.store, part.view(), sums.view_mut())?;
            for b in 0..x.count() {
                let all = y.band(b);
                to.iter().zip(sums.band(b)).for_each(|(&k, &sum)| all[k as usize] += sum);
            }
        }
        Ok(cost)
    }
}

impl FormFactors for DiagonalBlocks<'_> {
    fn name(&self) -> &'static str {
        "blocks"
    }

    fn sources(&self) -> usize {
        self.place.len()
    }

    fn targets(&self) -> usize {
        self.targets
    }

    fn properties(&self) -> Properties {
        let of = self.blocks.iter().map(|block| block.store.properties());
        Properties {
            symmetric: of.clone().all(|part| part.symmetric),
            per_band: false,
            stored_bytes: of.clone().map(|part| part.stored_bytes).sum(),
            rounding: of.map(|part| part.rounding).fold(0.0, f64::max),
        }
    }

    fn row<'a>(&'a self, s: usize, band: usize, buf: &'a mut RowBuf) -> Result<Row<'a>, StoreError> {
        let (part, row) = self.place[s];
        let block = &self.blocks[part as usize];
        let mut own = RowBuf::default();
        let row = block.store.row(row as usize, band, &mut own)?;
        buf.targets.clear();
        buf.values.clear();
        row.entries.for_each(|t, value| {
            buf.targets.push(block.targets[t]);
            buf.values.push(value);
        });
        Ok(Row { entries: Entries::Sparse { targets: &buf.targets, values: &buf.values }, cost: row.cost })
    }

    fn gather(&self, x: Bands<'_>, y: BandsMut<'_>) -> Result<Cost, StoreError> {
        self.product(x, y, |block| [&block.targets, &block.sources], |store, x, y| store.gather(x, y))
    }

    fn scatter(&self, x: Bands<'_>, y: BandsMut<'_>) -> Result<Cost, StoreError> {
        self.product(x, y, |block| [&block.sources, &block.targets], |store, x, y| store.scatter(x, y))
    }
}
