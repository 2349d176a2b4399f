//! Tiles of a packed store: their layout, and the one pass over a tile that every product is made of.
//!
//! Sums are in double precision whatever the tile holds: a single-precision entry is widened on its way to the multiplier. Each row has one running vector, and rows come in order, so the
//! bytes depend on the instruction set but not on how many bands or threads take part.

use pulp::bytemuck::{Pod, cast_slice};

use super::lanes::{Lanes, Work};

/// Rows and columns of a whole tile: 256 KB in single and 512 KB in double precision, so that a tile stays in a second-level
/// cache between groups of bands.
pub(super) const TILE: usize = 256;

/// Multiple to which the sides of a tile are padded: the widest vector, so that a pass has no tail.
pub(super) const LANES: usize = 8;

/// Rows that lie interleaved, 8 entries of each in turn: a pass takes as many rows at once and still reads one stream, which is
/// what the prefetchers of the machine follow. Rows that lay one after another made single-precision products about 2 × slower.
pub(super) const STRIP: usize = 4;

/// A cache line, in bytes.
pub(super) const LINE: usize = 64;

/// Values in a page of memory: caches place by the address within it.
const PAGE: usize = 512;

/// Bytes by which a pass asks for entries ahead of those it works on. The machine's own prefetchers stop where a page ends, which is
/// where every strip of single-precision entries does; with three bands this gains a quarter.
const AHEAD: usize = 8192;

/// Place of entry (r, t) in a tile whose rows have `width` entries.
pub(super) fn place(width: usize, r: usize, t: usize) -> usize {
    (r / STRIP * width + t / LANES * LANES) * STRIP + r % STRIP * LANES + t % LANES
}

/// A symmetric matrix of n rows cut into tiles (I, J) with I ≤ J, one after another by rows of tiles.
#[derive(Clone, Debug)]
pub(super) struct Layout {
    n: usize,
    /// Where each tile begins, and the end of the last.
    begins: Vec<usize>,
}

impl Layout {
    pub fn new(n: usize) -> Self {
        let mut layout = Self { n, begins: vec![0] };
        let mut end = 0;
        for i in 0..layout.blocks() {
            for j in i..layout.blocks() {
                end += layout.side(i) * layout.side(j);
                layout.begins.push(end);
            }
        }
        layout
    }

    /// Entries of the tiles of n rows, without listing them.
    pub fn entries_of(n: usize) -> u64 {
        let (whole, tile, last) = ((n / TILE) as u64, TILE as u64, (n % TILE).next_multiple_of(LANES) as u64);
        tile * tile * (whole * (whole + 1) / 2) + whole * tile * last + last * last
    }

    /// Rows of the matrix.
    pub fn n(&self) -> usize {
        self.n
    }

    /// Values from one band of a vector to the next: n, room for the padding of the last tile, and a third of a page, so that the bands
    /// of x and y do not fall on the same places of a first-level cache (three bands took 1.4 × as long when they did).
    pub fn stride(&self) -> usize {
        self.n.next_multiple_of(PAGE) + PAGE / 3 / LANES * LANES
    }

    /// Rows of tiles.
    pub fn blocks(&self) -> usize {
        self.n.div_ceil(TILE)
    }

    /// Tiles in all.
    pub fn tiles(&self) -> usize {
        self.begins.len() - 1
    }

    /// Entries in all, with the padding.
    pub fn entries(&self) -> usize {
        self.begins[self.tiles()]
    }

    /// Rows of the tiles of row I, without padding.
    pub fn height(&self, i: usize) -> usize {
        TILE.min(self.n - i * TILE)
    }

    /// Rows of the tiles of row I, and entries in a row of those of column I, with padding.
    pub fn side(&self, j: usize) -> usize {
        self.height(j).next_multiple_of(LANES)
    }

    /// Place of tile (I, J ≥ I) in the order of tiles.
    pub fn index(&self, i: usize, j: usize) -> usize {
        i * self.blocks() - i * (i + 1) / 2 + j
    }

    /// Entries of a tile, given its place.
    pub fn range(&self, index: usize) -> std::ops::Range<usize> {
        self.begins[index]..self.begins[index + 1]
    }
}

/// What a tile may hold: `f64` or `f32`.
pub trait Entry: Copy + Default + Pod + Send + Sync + Into<f64> + 'static {
    /// Name of the store, for tables.
    const NAME: &'static str;
    /// Largest relative rounding of a value that is kept.
    const ROUNDING: f64;
    /// A table whose largest value is smaller would lose most of the others.
    const LEAST: f64;

    /// One vector's worth of entries as they are stored.
    #[doc(hidden)]
    type Chunk<L: Lanes>: Pod;

    /// The nearest entry to a value.
    fn round(value: f64) -> Self;

    /// The entries of a chunk, as doubles.
    #[doc(hidden)]
    fn load<L: Lanes>(simd: L, chunk: Self::Chunk<L>) -> L::f64s;
}

impl Entry for f64 {
    const NAME: &'static str = "packed";
    const ROUNDING: f64 = 0.0;
    const LEAST: f64 = 0.0;

    type Chunk<L: Lanes> = L::f64s;

    fn round(value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn load<L: Lanes>(_: L, chunk: L::f64s) -> L::f64s {
        chunk
    }
}

impl Entry for f32 {
    const NAME: &'static str = "packed-f32";
    const ROUNDING: f64 = 0.5 * f32::EPSILON as f64;
    // Values down to 1e-8 of it keep all 24 bits.
    const LEAST: f64 = 1e8 * f32::MIN_POSITIVE as f64;

    type Chunk<L: Lanes> = L::Singles;

    fn round(value: f64) -> Self {
        value as f32
    }

    #[inline(always)]
    fn load<L: Lanes>(simd: L, chunk: L::Singles) -> L::f64s {
        simd.widen(chunk)
    }
}

/// Which sums a pass takes of a tile v.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Half {
    /// Along its rows: sums_s += Σ_t v_st x_t.
    Rows,
    /// Along its columns: y_t += Σ_s v_st x_s.
    Columns,
    /// Both, while the tile is read once.
    Both,
}

/// One reading of some rows of a tile. Vectors of several bands lie `stride` apart.
pub(super) struct Pass<'a, T> {
    pub half: Half,
    pub bands: usize,
    /// Strips of a tile whose rows have `width` entries.
    pub rows: &'a [T],
    pub width: usize,
    /// What the rows are multiplied with, `width` values a band.
    pub x_t: (&'a [f64], usize),
    /// What the columns are multiplied with, a value a row.
    pub x_s: (&'a [f64], usize),
    /// Sums along the rows are added here.
    pub sums: (&'a mut [f64], usize),
    /// Sums along the columns are added here.
    pub y_t: (&'a mut [f64], usize),
}

impl<T: Entry> Work for Pass<'_, T> {
    #[inline(always)]
    fn run<L: Lanes>(mut self, simd: L) {
        let mut band = 0;
        while band < self.bands {
            // As many bands at once as registers allow; what is left of the tile is in the cache for the others.
            let group = match self.bands - band {
                1 => 1,
                2 | 4 => 2,
                _ => 3,
            };
            match group {
                1 => group_of::<L, T, 1>(simd, &mut self, band),
                2 => group_of::<L, T, 2>(simd, &mut self, band),
                _ => group_of::<L, T, 3>(simd, &mut self, band),
            }
            band += group;
        }
    }
}

#[inline(always)]
fn group_of<L: Lanes, T: Entry, const B: usize>(simd: L, pass: &mut Pass<'_, T>, band: usize) {
    match pass.half {
        Half::Rows => strips::<L, T, B, true, false>(simd, pass, band),
        Half::Columns => strips::<L, T, B, false, true>(simd, pass, band),
        Half::Both => strips::<L, T, B, true, true>(simd, pass, band),
    }
}

/// All rows of a pass for the B bands from `band` on, several rows at a time.
#[inline(always)]
fn strips<L: Lanes, T: Entry, const B: usize, const ROWS: bool, const COLUMNS: bool>(
    simd: L,
    pass: &mut Pass<'_, T>,
    band: usize,
) {
    let width = pass.width;
    let mut x_t: [&[L::f64s]; B] = [&[]; B];
    if ROWS {
        for (b, x) in x_t.iter_mut().enumerate() {
            let at = (band + b) * pass.x_t.1;
            *x = L::as_simd_f64s(&pass.x_t.0[at..at + width]).0;
        }
    }
    let mut y_t: [&mut [L::f64s]; B] = std::array::from_fn(|_| Default::default());
    if COLUMNS {
        for (y, values) in y_t.iter_mut().zip(pass.y_t.0.chunks_mut(pass.y_t.1).skip(band)) {
            *y = L::as_mut_simd_f64s(&mut values[..width]).0;
        }
    }
    let mut strips = Strips::<L, B> { band, x_t, x_s: pass.x_s, sums: (&mut *pass.sums.0, pass.sums.1), y_t };
    for (k, strip) in pass.rows.chunks_exact(STRIP * width).enumerate() {
        let (entries, r): (&[T::Chunk<L>], usize) = (cast_slice(strip), k * STRIP);
        if L::ROWS == STRIP {
            strips.apply::<T, STRIP, 0, ROWS, COLUMNS>(simd, entries, r);
        } else {
            strips.apply::<T, 2, 0, ROWS, COLUMNS>(simd, entries, r);
            strips.apply::<T, 2, 2, ROWS, COLUMNS>(simd, entries, r);
        }
    }
}

/// Vectors of B bands.
struct Strips<'a, L: Lanes, const B: usize> {
    band: usize,
    x_t: [&'a [L::f64s]; B],
    x_s: (&'a [f64], usize),
    sums: (&'a mut [f64], usize),
    y_t: [&'a mut [L::f64s]; B],
}

impl<L: Lanes, const B: usize> Strips<'_, L, B> {
    /// R rows from row FROM of a strip that begins at row r of the pass: each vector of a row is read, widened and applied to B
    /// bands in both directions.
    #[inline(always)]
    fn apply<T: Entry, const R: usize, const FROM: usize, const ROWS: bool, const COLUMNS: bool>(
        &mut self,
        simd: L,
        entries: &[T::Chunk<L>],
        r: usize,
    ) {
        let zero = simd.splat_f64s(0.0);
        let mut lit = [[zero; R]; B];
        if COLUMNS {
            for (b, lit) in lit.iter_mut().enumerate() {
                for (k, lit) in lit.iter_mut().enumerate() {
                    *lit = simd.splat_f64s(self.x_s.0[(self.band + b) * self.x_s.1 + r + FROM + k]);
                }
            }
        }
        // Vectors in 8 entries, and in a row. Lengths are told once, so that nothing is checked in the loop.
        let per = LANES / L::F64_LANES;
        let len = entries.len() / (STRIP * per) * per;
        let mut x_t = self.x_t;
        if ROWS {
            for x in &mut x_t {
                *x = &x[..len];
            }
        }
        if COLUMNS {
            for y in &self.y_t {
                assert_eq!(y.len(), len);
            }
        }
        let mut sums = [[zero; R]; B];
        for (group, entries) in entries.chunks_exact(STRIP * per).enumerate() {
            for line in (0..size_of_val(entries)).step_by(LINE) {
                simd.prefetch(entries.as_ptr().wrapping_byte_add(AHEAD + line));
            }
            for part in 0..per {
                let c = group * per + part;
                let mut v = [zero; R];
                for k in 0..R {
                    v[k] = T::load(simd, entries[(FROM + k) * per + part]);
                }
                for b in 0..B {
                    if ROWS {
                        let x = x_t[b][c];
                        for k in 0..R {
                            sums[b][k] = simd.mul_add_e_f64s(v[k], x, sums[b][k]);
                        }
                    }
                    if COLUMNS {
                        let mut y = self.y_t[b][c];
                        for k in 0..R {
                            y = simd.mul_add_e_f64s(v[k], lit[b][k], y);
                        }
                        self.y_t[b][c] = y;
                    }
                }
            }
        }
        if ROWS {
            for (b, sums) in sums.into_iter().enumerate() {
                let at = (self.band + b) * self.sums.1 + r + FROM;
                self.sums.0[at..at + R].iter_mut().zip(simd.reduce(sums)).for_each(|(y, sum)| *y += sum);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::lanes::run;
    use super::*;
    use crate::level::Level;

    /// 8 rows of 11 entries, padded to 16: two strips, and vectors with padding. Halves and small integers: sums
    /// are exact in any order, so every level gives the plain sums to the bit.
    fn passes_agree<T: Entry>() {
        let (height, width, stride) = (8, 16, 20);
        let mut rows = vec![T::default(); height * width];
        for (r, t) in (0..height).flat_map(|r| (0..11).map(move |t| (r, t))) {
            rows[place(width, r, t)] = T::round(((5 * r + t) % 7) as f64 / 2.0);
        }
        let x: Vec<f64> = (0..7 * stride).map(|k| ((k * 5 + 2) % 9) as f64 - 3.0).collect();
        for level in Level::all() {
            for bands in [1, 2, 3, 4, 7] {
                for half in [Half::Rows, Half::Columns, Half::Both] {
                    let (mut sums, mut y) = (vec![1.0; bands * height], vec![2.0; bands * stride]);
                    run(
                        level,
                        Pass {
                            half,
                            bands,
                            rows: &rows,
                            width,
                            x_t: (&x, stride),
                            x_s: (&x[1..], stride),
                            sums: (&mut sums, height),
                            y_t: (&mut y, stride),
                        },
                    );
                    let v = |s: usize, t: usize| -> f64 { rows[place(width, s, t)].into() };
                    for b in 0..bands {
                        for s in 0..height {
                            let sum: f64 = (0..width).map(|t| v(s, t) * x[b * stride + t]).sum();
                            let wanted = if half == Half::Columns { 1.0 } else { 1.0 + sum };
                            assert_eq!(sums[b * height + s], wanted, "{level:?}, {half:?}, row {s}");
                        }
                        for t in 0..width {
                            let sum: f64 = (0..height).map(|s| v(s, t) * x[1 + b * stride + s]).sum();
                            let wanted = if half == Half::Rows { 2.0 } else { 2.0 + sum };
                            assert_eq!(y[b * stride + t], wanted, "{level:?}, {half:?}, column {t}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn every_instruction_set_gives_the_same_exact_sums() {
        passes_agree::<f64>();
        passes_agree::<f32>();
    }

    #[test]
    fn tiles_follow_each_other_by_rows_of_tiles() {
        let layout = Layout::new(600);
        assert_eq!((layout.blocks(), layout.tiles(), layout.stride()), (3, 6, 1024 + 168));
        let order: Vec<usize> =
            (0..3).flat_map(|i| (i..3).map(move |j| (i, j))).map(|(i, j)| layout.index(i, j)).collect();
        assert_eq!(order, [0, 1, 2, 3, 4, 5]);
        // 600 − 512 = 88 rows, a multiple of 8.
        assert_eq!((layout.height(2), layout.side(2)), (88, 88));
        assert_eq!(layout.range(layout.index(1, 2)), 2 * 65536 + 256 * 88 + 65536..2 * 65536 + 2 * 256 * 88 + 65536);
        assert_eq!(Layout::new(0).entries(), 0);
        assert_eq!(Layout::new(13).entries(), 16 * 16);
    }
}
