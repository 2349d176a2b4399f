//! Systems that do not see each other, in one store.

use radiosity_core::{
    BandValues, Bands, BandsMut, Block as Rows, Cost, Entries, FormFactors, Properties, Relax, Row, RowBuf, StoreError,
    sweep_by_rows,
};

/// Stores of parts that exchange nothing: the blocks of a matrix that is 0 elsewhere.
///
/// *Memory*: that of the blocks; their sources and targets are named by lists. *Reads*: a product reads every block once and nothing
/// beside them; so does a sweep, by the sweeps of the blocks where each is one range of elements, and row by row where they lie among each other.
/// Symmetric if all blocks are.
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
    pub fn new(mut parts: Vec<Part<'a>>, sources: usize, targets: usize) -> Self {
        let mut place = vec![(u32::MAX, 0); sources];
        let of_part = |(part, (store, own, to)): (u32, Part<'a>)| {
            assert_eq!((store.sources(), store.targets()), (own.len(), to.len()), "sources and targets of a part");
            assert!(to.iter().all(|&t| (t as usize) < targets), "targets lie below {targets}");
            assert!(!store.properties().per_band, "form factors that are per band");
            (0..).zip(&own).for_each(|(row, &s)| place[s as usize] = (part, row));
            Block { store, sources: own, targets: to }
        };
        // In the order of their first sources, as a sweep goes.
        parts.sort_by_key(|(_, own, _)| own.first().copied());
        let blocks: Vec<Block<'a>> = (0..).zip(parts).map(of_part).collect();
        let named: usize = blocks.iter().map(|block| block.sources.len()).sum();
        assert!(named == sources && place.iter().all(|(part, _)| *part < u32::MAX), "every source in one part");
        Self { blocks, place, targets }
    }

    /// First elements of the blocks, if each is the elements from there on among themselves and they follow each other.
    fn ranges(&self) -> Option<Vec<usize>> {
        let mut begin = 0;
        let of_block = |block: &Block<'_>| {
            let first = begin;
            begin += block.sources.len();
            let range = (first as u32)..(begin as u32);
            let runs = |list: &[u32]| list.iter().copied().eq(range.clone());
            (runs(&block.sources) && runs(&block.targets)).then_some(first)
        };
        self.blocks.iter().map(of_block).collect()
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
        if let Entries::Sparse { targets, values } = row.entries {
            buf.targets.extend(targets.iter().map(|&t| block.targets[t as usize]));
            buf.values.extend_from_slice(values);
        } else {
            row.entries.for_each(|t, value| {
                buf.targets.push(block.targets[t]);
                buf.values.push(value);
            });
        }
        Ok(Row { entries: Entries::Sparse { targets: &buf.targets, values: &buf.values }, cost: row.cost })
    }

    fn gather(&self, x: Bands<'_>, y: BandsMut<'_>) -> Result<Cost, StoreError> {
        self.product(x, y, |block| [&block.targets, &block.sources], |store, x, y| store.gather(x, y))
    }

    fn scatter(&self, x: Bands<'_>, y: BandsMut<'_>) -> Result<Cost, StoreError> {
        self.product(x, y, |block| [&block.sources, &block.targets], |store, x, y| store.scatter(x, y))
    }

    fn sweep(&self, mut x: BandsMut<'_>, relax: &mut Relax<'_>) -> Result<Cost, StoreError> {
        let Some(firsts) = self.ranges() else { return sweep_by_rows(self, x, relax) };
        let (bands, mut cost) = (x.count(), Cost::default());
        for (block, first) in self.blocks.iter().zip(firsts) {
            let own = first..first + block.sources.len();
            let part = (0..bands).flat_map(|b| x.view().band(b)[own.clone()].to_vec()).collect();
            let mut part = BandValues::new(part, own.len());
            cost += block.store.sweep(part.view_mut(), &mut |rows, mut part| {
                let range = first + rows.range.start..first + rows.range.end;
                relax(&Rows { range: range.clone(), outside: rows.outside, inside: rows.inside }, x.reborrow());
                for b in 0..bands {
                    part.band(b)[rows.range.clone()].copy_from_slice(&x.band(b)[range.clone()]);
                }
            })?;
        }
        Ok(cost)
    }
}
