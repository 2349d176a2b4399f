//! The tables of an experiment: records go in, two CSV files come out and are read back.
//!
//! `counts.csv` holds what repeats exactly (settings, counts, errors, outcomes) and `times.csv` what does not, joined
//! by the column `run`. Figures and readings see the files only, as [`Tables`].

use std::collections::{HashMap, HashSet};
use std::fmt::{self, Debug};
use std::path::{Path, PathBuf};

use radiosity_plot::{Point, Quality, Series};

/// File of counts, errors and outcomes.
pub const COUNTS: &str = "counts.csv";
/// File of times in seconds.
pub const TIMES: &str = "times.csv";

/// One line of the tables while it is being built.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    run: String,
    counts: Vec<(String, String)>,
    times: Vec<(String, Vec<f64>)>,
}

impl Record {
    /// A record under a key that no other record of the experiment has.
    pub fn new(run: impl Into<String>) -> Self {
        Self { run: run.into(), counts: Vec::new(), times: Vec::new() }
    }

    /// A word, to `counts.csv`. Column `outcome` decides the [`Quality`].
    pub fn text(self, column: impl Into<String>, value: impl fmt::Display) -> Self {
        self.count(column, value.to_string())
    }

    /// A count, to `counts.csv`: must repeat exactly.
    ///
    /// # Panics
    ///
    /// If the count does not fit 64 bits with sign.
    pub fn int<N: TryInto<i64>>(self, column: impl Into<String>, value: N) -> Self
    where
        N::Error: Debug,
    {
        self.count(column, value.try_into().expect("a count fits 63 bits").to_string())
    }

    /// An error or another real number, to `counts.csv`: must repeat to 1e-9, written so that it reads back bit for bit.
    pub fn float(self, column: impl Into<String>, value: f64) -> Self {
        // Debug writes a point or an exponent, so a float stays one when it happens to be whole.
        self.count(column, format!("{value:?}"))
    }

    /// A time, to `times.csv`, measured once.
    pub fn seconds(self, column: impl Into<String>, value: f64) -> Self {
        self.repetitions(column, &[value])
    }

    /// Repeated measurements of one time, to `times.csv` as their number, smallest and median.
    ///
    /// # Panics
    ///
    /// If there are none.
    pub fn repetitions(mut self, column: impl Into<String>, values: &[f64]) -> Self {
        assert!(!values.is_empty(), "a time needs at least one measurement");
        self.times.push((column.into(), values.to_vec()));
        self
    }

    fn count(mut self, column: impl Into<String>, value: String) -> Self {
        self.counts.push((column.into(), value));
        self
    }
}

/// A table that grows: columns in the order of their first appearance, cells that a record lacks empty.
#[derive(Clone, Debug)]
struct Growing {
    columns: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Growing {
    fn new() -> Self {
        Self { columns: vec!["run".into()], rows: Vec::new() }
    }

    fn push(&mut self, cells: impl IntoIterator<Item = (String, String)>) {
        let mut row = vec![String::new(); self.columns.len()];
        for (column, value) in cells {
            let at = self.columns.iter().position(|c| *c == column).unwrap_or_else(|| {
                self.columns.push(column);
                row.push(String::new());
                self.columns.len() - 1
            });
            row[at] = value;
        }
        self.rows.push(row);
    }

    fn write(&self, path: &Path) -> Result<(), TableError> {
        let write = || -> Result<(), csv::Error> {
            let mut writer = csv::Writer::from_path(path)?;
            writer.write_record(&self.columns)?;
            for row in &self.rows {
                let missing = self.columns.len() - row.len();
                writer.write_record(row.iter().map(String::as_str).chain(std::iter::repeat_n("", missing)))?;
            }
            writer.flush()?;
            Ok(())
        };
        write().map_err(|error| TableError { path: path.into(), message: error.to_string() })
    }
}

/// The records of an experiment while it runs.
#[derive(Clone, Debug)]
pub struct Recorder {
    counts: Growing,
    times: Growing,
    failed: usize,
    keys: HashSet<String>,
}

impl Default for Recorder {
    fn default() -> Self {
        Self { counts: Growing::new(), times: Growing::new(), failed: 0, keys: HashSet::new() }
    }
}

impl Recorder {
    /// Adds a record.
    ///
    /// # Panics
    ///
    /// If its key was used before: the two tables are joined by it.
    pub fn push(&mut self, record: Record) {
        let Record { run, counts, times } = record;
        assert!(self.keys.insert(run.clone()), "run {run:?} was recorded twice");
        let outcome = counts.iter().find(|(column, _)| column == "outcome").map_or("", |(_, value)| value);
        self.failed += usize::from(Quality::of_outcome(outcome) != Quality::Good);
        self.counts.push(std::iter::once(("run".into(), run.clone())).chain(counts));
        if !times.is_empty() {
            let cells = times.into_iter().flat_map(|(column, mut values)| {
                values.sort_by(f64::total_cmp);
                let middle = values.len() / 2;
                let median =
                    if values.len() % 2 == 1 { values[middle] } else { (values[middle - 1] + values[middle]) / 2.0 };
                [
                    (format!("{column}_repetitions"), values.len().to_string()),
                    (format!("{column}_min"), format!("{:?}", values[0])),
                    (format!("{column}_median"), format!("{median:?}")),
                ]
            });
            self.times.push(std::iter::once(("run".into(), run)).chain(cells));
        }
    }

    /// Records so far.
    pub fn len(&self) -> usize {
        self.counts.rows.len()
    }

    /// Whether there is no record yet.
    pub fn is_empty(&self) -> bool {
        self.counts.rows.is_empty()
    }

    /// Records whose outcome is not good.
    pub fn failed(&self) -> usize {
        self.failed
    }

    /// Writes both tables into `directory`.
    ///
    /// # Errors
    ///
    /// [`TableError`] if a file cannot be written.
    pub fn write(&self, directory: &Path) -> Result<(), TableError> {
        self.counts.write(&directory.join(COUNTS))?;
        self.times.write(&directory.join(TIMES))
    }
}

/// A table that could not be read or written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TableError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub message: String,
}

impl fmt::Display for TableError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.path.display(), self.message)
    }
}

impl std::error::Error for TableError {}

/// One CSV file as text: the names of its columns and the cells of its rows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Table {
    /// Names of the columns.
    pub columns: Vec<String>,
    /// Cells, as many in each row as there are columns.
    pub rows: Vec<Vec<String>>,
}

impl Table {
    /// Reads a file.
    ///
    /// # Errors
    ///
    /// [`TableError`] if it cannot be read, a row is too short or long, or there is no column `run`.
    pub fn read(path: &Path) -> Result<Self, TableError> {
        let error = |message: String| TableError { path: path.into(), message };
        let mut reader = csv::Reader::from_path(path).map_err(|e| error(e.to_string()))?;
        let cells = |record: &csv::StringRecord| record.iter().map(String::from).collect::<Vec<_>>();
        let columns = cells(reader.headers().map_err(|e| error(e.to_string()))?);
        let rows = reader.records().map(|r| r.map(|r| cells(&r))).collect::<Result<Vec<_>, _>>();
        let table = Self { columns, rows: rows.map_err(|e| error(e.to_string()))? };
        match table.columns.first().map(String::as_str) {
            Some("run") => Ok(table),
            _ => Err(error("the first column must be `run`".into())),
        }
    }
}

/// Both tables of an experiment, joined by `run`.
#[derive(Clone, Debug)]
pub struct Tables {
    index: HashMap<String, usize>,
    rows: Vec<Vec<String>>,
}

impl Tables {
    /// Reads the tables in `directory`; a run without a line in `times.csv` has empty times.
    ///
    /// # Errors
    ///
    /// [`TableError`] if a file is missing or no table.
    pub fn read(directory: &Path) -> Result<Self, TableError> {
        let counts = Table::read(&directory.join(COUNTS))?;
        let times = Table::read(&directory.join(TIMES))?;
        let by_run: HashMap<&str, &Vec<String>> = times.rows.iter().map(|row| (row[0].as_str(), row)).collect();
        let columns = counts.columns.iter().chain(&times.columns[1..]);
        let index = columns.enumerate().map(|(k, column)| (column.clone(), k)).collect();
        let empty = vec![String::new(); times.columns.len()];
        let join = |row: &Vec<String>| {
            let times = by_run.get(row[0].as_str()).copied().unwrap_or(&empty);
            row.iter().chain(&times[1..]).cloned().collect()
        };
        Ok(Self { index, rows: counts.rows.iter().map(join).collect() })
    }

    /// All rows in file order.
    pub fn rows(&self) -> impl Iterator<Item = Row<'_>> {
        self.rows.iter().map(|cells| Row { tables: self, cells })
    }

    /// The rows that `keep` accepts.
    pub fn select(&self, keep: impl Fn(&Row<'_>) -> bool) -> Vec<Row<'_>> {
        self.rows().filter(|row| keep(row)).collect()
    }

    /// The rows where text column `column` is `value`.
    pub fn select_eq(&self, column: &str, value: &str) -> Vec<Row<'_>> {
        self.select(|row| row.text(column) == value)
    }
}

/// Series made of rows.
pub trait SeriesOfRows {
    /// With one point per row, at what `at` reads from it, of the row's quality.
    fn rows<'a>(self, rows: impl IntoIterator<Item = Row<'a>>, at: impl Fn(&Row<'a>) -> (f64, f64)) -> Self;
}

impl SeriesOfRows for Series {
    fn rows<'a>(self, rows: impl IntoIterator<Item = Row<'a>>, at: impl Fn(&Row<'a>) -> (f64, f64)) -> Self {
        let points = rows.into_iter().map(|row| {
            let (x, y) = at(&row);
            Point { x, y, quality: row.quality() }
        });
        self.points(points)
    }
}

/// Rows grouped by the text in `column`, groups and rows in order of appearance; rows with an empty cell are left out.
pub fn group_by<'a>(rows: impl IntoIterator<Item = Row<'a>>, column: &str) -> Vec<(String, Vec<Row<'a>>)> {
    let mut groups: Vec<(String, Vec<Row<'a>>)> = Vec::new();
    for row in rows.into_iter().filter(|row| !row.text(column).is_empty()) {
        match groups.iter_mut().find(|(name, _)| name == row.text(column)) {
            Some((_, group)) => group.push(row),
            None => groups.push((row.text(column).into(), vec![row])),
        }
    }
    groups
}

/// One run, as read back.
#[derive(Clone, Copy, Debug)]
pub struct Row<'a> {
    tables: &'a Tables,
    cells: &'a [String],
}

impl<'a> Row<'a> {
    /// Its key.
    pub fn run(&self) -> &'a str {
        self.text("run")
    }

    /// The cell as text; empty if the run or the table lacks it.
    pub fn text(&self, column: &str) -> &'a str {
        self.tables.index.get(column).map_or("", |&k| &self.cells[k])
    }

    /// The cell as a count, if it is one.
    pub fn int(&self, column: &str) -> Option<i64> {
        self.text(column).parse().ok()
    }

    /// The cell as a number, counts included; NaN if it is none.
    pub fn number(&self, column: &str) -> f64 {
        self.text(column).parse().unwrap_or(f64::NAN)
    }

    /// The smallest of the repetitions of a time, in seconds; NaN if it was not measured.
    ///
    /// On a shared machine the smallest repeats best; the median is in column `NAME_median`.
    pub fn seconds(&self, column: &str) -> f64 {
        self.number(&format!("{column}_min"))
    }

    /// How far to trust the run, from column `outcome`.
    pub fn quality(&self) -> Quality {
        Quality::of_outcome(self.text("outcome"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Scratch;

    /// Values are compared bit for bit: the text of a float is its shortest exact one.
    #[test]
    fn what_is_recorded_reads_back_bit_for_bit() {
        let scratch = Scratch::new();
        let mut recorder = Recorder::default();
        let (tiny, third) = (f64::MIN_POSITIVE / 3.0, 1.0 / 3.0);
        recorder.push(
            Record::new("a, \"b\"").int("n", 7_usize).float("error", third).repetitions("time", &[3.0, 1.0, 2.5, 2.0]),
        );
        recorder.push(Record::new("c").float("error", 2.0).text("outcome", "breakdown").float("extra", tiny));
        recorder.push(Record::new("d").int("n", -3).float("error", f64::NAN).seconds("assembly", 0.1));
        assert_eq!((recorder.len(), recorder.failed()), (3, 1));
        recorder.write(scratch.path()).unwrap();
        let tables = Tables::read(scratch.path()).unwrap();
        let rows: Vec<_> = tables.rows().collect();
        assert_eq!(rows.iter().map(Row::run).collect::<Vec<_>>(), ["a, \"b\"", "c", "d"]);
        assert_eq!(rows.iter().map(|r| r.int("n")).collect::<Vec<_>>(), [Some(7), None, Some(-3)]);
        assert_eq!(rows[0].number("error").to_bits(), third.to_bits());
        assert_eq!(rows[1].number("extra").to_bits(), tiny.to_bits());
        assert_eq!(rows[1].text("error"), "2.0");
        assert_eq!((rows[0].seconds("time"), rows[0].number("time_median")), (1.0, 2.25));
        assert_eq!(rows[0].int("time_repetitions"), Some(4));
        assert!(
            rows[2].number("error").is_nan() && rows[1].seconds("time").is_nan() && rows[0].number("none").is_nan()
        );
        assert_eq!(rows[2].seconds("assembly"), 0.1);
        assert_eq!([rows[0].quality(), rows[1].quality()], [Quality::Good, Quality::Failed]);
    }

    #[test]
    #[should_panic(expected = "recorded twice")]
    fn a_key_cannot_be_used_twice() {
        let mut recorder = Recorder::default();
        recorder.push(Record::new("a"));
        recorder.push(Record::new("a"));
    }

    #[test]
    fn a_broken_table_is_an_error_that_names_the_file() {
        let scratch = Scratch::new();
        let path = scratch.path().join(COUNTS);
        assert!(Tables::read(scratch.path()).unwrap_err().to_string().contains("counts.csv"));
        std::fs::write(&path, "run,n\na,1,2\n").unwrap();
        assert!(Table::read(&path).unwrap_err().to_string().contains("counts.csv"));
        std::fs::write(&path, "n\n1\n").unwrap();
        assert!(Table::read(&path).unwrap_err().message.contains("`run`"));
    }
}
