//! Counts that must not change: a table against the one kept from an earlier version.

use std::fmt;

use crate::table::Table;

/// Largest difference of two floats, relative to the larger one.
const RELATIVE: f64 = 1e-9;

/// One way in which a table differs from the golden one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Difference {
    /// Columns that only one of the tables has, or another order.
    Columns {
        /// Of the golden table.
        golden: Vec<String>,
        /// Of the new table.
        new: Vec<String>,
    },
    /// A run the new table lacks.
    Missing(String),
    /// A run the golden table lacks.
    Extra(String),
    /// Another value.
    Cell {
        /// Key of the run.
        run: String,
        /// Name of the column.
        column: String,
        /// Cell of the golden table.
        golden: String,
        /// Cell of the new table.
        new: String,
    },
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Columns { golden, new } => write!(f, "columns are [{}], not [{}]", new.join(", "), golden.join(", ")),
            Self::Missing(run) => write!(f, "run {run:?} is missing"),
            Self::Extra(run) => write!(f, "run {run:?} is new"),
            Self::Cell { run, column, golden, new } => write!(f, "run {run:?}, {column}: {new:?}, not {golden:?}"),
        }
    }
}

/// All differences: texts and integers must be equal, floats within 1e-9 relative or `slack(column)` absolute.
///
/// The slack is for differences of nearly equal numbers (a solver error of 1e-13), whose last digits depend on the
/// processor. What kind a cell is follows from its text: integers have neither point nor exponent.
pub fn compare(golden: &Table, new: &Table, slack: impl Fn(&str) -> f64) -> Vec<Difference> {
    if golden.columns != new.columns {
        return vec![Difference::Columns { golden: golden.columns.clone(), new: new.columns.clone() }];
    }
    let mut differences = Vec::new();
    for row in &golden.rows {
        let Some(other) = new.rows.iter().find(|other| other[0] == row[0]) else {
            differences.push(Difference::Missing(row[0].clone()));
            continue;
        };
        for ((column, golden), new) in golden.columns.iter().zip(row).zip(other) {
            if !same(golden, new, slack(column)) {
                let (run, column) = (row[0].clone(), column.clone());
                differences.push(Difference::Cell { run, column, golden: golden.clone(), new: new.clone() });
            }
        }
    }
    let extra = new.rows.iter().filter(|row| !golden.rows.iter().any(|other| other[0] == row[0]));
    differences.extend(extra.map(|row| Difference::Extra(row[0].clone())));
    differences
}

fn same(golden: &str, new: &str, slack: f64) -> bool {
    if golden == new {
        return true;
    }
    let is_float = |text: &str| text.parse::<i64>().is_err() && text.parse::<f64>().is_ok();
    if !(is_float(golden) && is_float(new)) {
        return false;
    }
    let [a, b] = [golden, new].map(|text| text.parse::<f64>().unwrap_or(f64::NAN));
    // An infinite difference is no difference within a share of infinity.
    a.is_finite() && b.is_finite() && (a - b).abs() <= (RELATIVE * a.abs().max(b.abs())).max(slack)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(cells: [&str; 4]) -> Table {
        let columns = ["run", "form_factors", "error", "outcome"].map(String::from).to_vec();
        let other = ["q", "5", "0.5", "converged"].map(String::from).to_vec();
        Table { columns, rows: vec![cells.map(String::from).to_vec(), other] }
    }

    fn differences(a: [&str; 4], b: [&str; 4]) -> usize {
        compare(&table(a), &table(b), |_| 0.0).len()
    }

    #[test]
    fn an_integer_off_by_one_is_caught() {
        let found =
            compare(&table(["p", "1000000000000", "1.0", ""]), &table(["p", "1000000000001", "1.0", ""]), |_| 1.0);
        let [golden, new] = ["1000000000000", "1000000000001"].map(String::from);
        assert_eq!(found, [Difference::Cell { run: "p".into(), column: "form_factors".into(), golden, new }]);
    }

    /// 1e-8 relative is ten times, 1e-10 a tenth of what is allowed.
    #[test]
    fn a_float_off_by_1e_8_is_caught_and_one_off_by_1e_10_is_not() {
        assert_eq!(differences(["p", "1", "0.0123", ""], ["p", "1", "0.012300000123", ""]), 1);
        assert_eq!(differences(["p", "1", "0.0123", ""], ["p", "1", "0.01230000000123", ""]), 0);
        assert_eq!(differences(["p", "1", "2.0", ""], ["p", "1", "2", ""]), 1);
        assert_eq!(differences(["p", "1", "NaN", ""], ["p", "1", "NaN", ""]), 0);
        assert_eq!(differences(["p", "1", "inf", ""], ["p", "1", "1.0", ""]), 1);
    }

    #[test]
    fn another_outcome_another_run_and_another_column_are_caught() {
        assert_eq!(differences(["p", "1", "1.0", "converged"], ["p", "1", "1.0", "stagnated"]), 1);
        assert_eq!(differences(["p", "1", "1.0", ""], ["r", "1", "1.0", ""]), 2);
        let mut other = table(["p", "1", "1.0", ""]);
        other.columns[1] = "rays".into();
        assert_eq!(compare(&table(["p", "1", "1.0", ""]), &other, |_| 0.0).len(), 1);
    }

    #[test]
    fn slack_allows_a_small_absolute_difference_in_its_column_alone() {
        let slack = |column: &str| if column == "error" { 1e-13 } else { 0.0 };
        let tables = |error| table(["p", "1", error, ""]);
        assert!(compare(&tables("3.1e-14"), &tables("5.2e-14"), slack).is_empty());
        assert_eq!(compare(&tables("3.1e-14"), &tables("5.2e-12"), slack).len(), 1);
    }
}
