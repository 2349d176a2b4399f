//! The legend: always outside the panels, so that it never covers data.

use super::panel::{GREY, INK, LABEL_SIZE, dashed_line};
use super::shapes::Shape;
use super::surface::text_width;
use super::{Align, Dash, Figure, Guide, Quality};
use crate::palette::{Marker, Rgb, lighter, style};

/// What stands before a label.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Sample {
    /// A line, a marker, or both.
    Series { colour: Rgb, marker: Option<Marker>, line: Option<Dash> },
    /// A bar.
    Bar(Rgb),
    /// A line for the eye.
    Guide,
    /// A run that was stopped early, as a mark or as a bar.
    Hollow { bar: bool },
    /// A failed run.
    Crossed,
    /// A value that an axis cannot show.
    Beyond,
}

/// One line of the legend, and grey lines of text under it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Entry {
    pub sample: Sample,
    pub label: String,
    pub notes: Vec<String>,
}

/// Length of the sample and distance to its label.
const SAMPLE: f64 = 30.0;
const GAP: f64 = 8.0;
const ENTRY_HEIGHT: f64 = 21.0;
const NOTE_HEIGHT: f64 = 15.0;
const NOTE_SIZE: f64 = 11.0;
/// Between the columns of a legend below the panels.
const COLUMN_GAP: f64 = 26.0;

/// Entries of a figure in order of appearance; equal ones once. `notes`: whether fitted slopes stand here.
pub(super) fn entries(figure: &Figure, notes: bool) -> Vec<Entry> {
    let mut entries: Vec<Entry> = Vec::new();
    let mut add = |sample: Sample, label: &str, note: Option<String>| match entries
        .iter_mut()
        .find(|e| e.sample == sample && e.label == label)
    {
        Some(entry) => entry.notes.extend(note),
        None => entries.push(Entry { sample, label: label.into(), notes: note.into_iter().collect() }),
    };
    for panel in &figure.panels {
        for series in &panel.series {
            let look = style(&series.method);
            let sample = if panel.categories.is_empty() {
                // A fitted line looks like the line through the points.
                let line = (series.joined || series.fit.is_some()).then_some(series.dash);
                Sample::Series { colour: look.colour, marker: series.marked.then_some(look.marker), line }
            } else {
                Sample::Bar(look.colour)
            };
            let note = series.fit.filter(|_| notes).map(|fit| format!("slope {fit}"));
            add(sample, &series.label, note);
        }
    }
    for guide in figure.panels.iter().flat_map(|panel| &panel.guides) {
        let (Guide::Level { label, .. } | Guide::Slope { label, .. } | Guide::Diagonal { label }) = guide;
        add(Sample::Guide, label, None);
    }
    let points =
        || figure.panels.iter().flat_map(|p| p.series.iter().flat_map(move |s| s.points.iter().map(move |q| (p, q))));
    if let Some((panel, _)) = points().find(|(_, point)| point.quality == Quality::Limited) {
        add(Sample::Hollow { bar: !panel.categories.is_empty() }, "stopped early", None);
    }
    if points().any(|(_, point)| point.quality == Quality::Failed) {
        add(Sample::Crossed, "failed", None);
    }
    if points().any(|(panel, point)| panel.categories.is_empty() && !(panel.x.shows(point.x) && panel.y.shows(point.y)))
    {
        add(Sample::Beyond, "off the axis (zero or none)", None);
    }
    entries
}

fn entry_width(entry: &Entry) -> f64 {
    let notes = entry.notes.iter().map(|note| text_width(note, NOTE_SIZE));
    SAMPLE + GAP + notes.fold(text_width(&entry.label, LABEL_SIZE), f64::max)
}

fn entry_height(entry: &Entry) -> f64 {
    ENTRY_HEIGHT + NOTE_HEIGHT * entry.notes.len() as f64
}

/// Size of the legend as one column.
pub(super) fn column_size(entries: &[Entry]) -> (f64, f64) {
    (entries.iter().map(entry_width).fold(0.0, f64::max), entries.iter().map(entry_height).sum())
}

/// Draws the legend as one column with its upper left corner at `at`.
pub(super) fn column(entries: &[Entry], at: (f64, f64), shapes: &mut Vec<Shape>) {
    let mut y = at.1;
    for entry in entries {
        draw(entry, (at.0, y), shapes);
        y += entry_height(entry);
    }
}

/// Height of the legend set in rows of width `width`.
pub(super) fn rows_height(entries: &[Entry], width: f64) -> f64 {
    entries.len().div_ceil(row_widths(entries, width).len()) as f64 * ENTRY_HEIGHT
}

/// Draws the legend in rows of width `width` with its upper left corner at `at`.
pub(super) fn rows(entries: &[Entry], at: (f64, f64), width: f64, shapes: &mut Vec<Shape>) {
    let widths = row_widths(entries, width);
    for (row, entries) in entries.chunks(widths.len()).enumerate() {
        let mut x = at.0;
        for (entry, width) in entries.iter().zip(&widths) {
            draw(entry, (x, at.1 + row as f64 * ENTRY_HEIGHT), shapes);
            x += width + COLUMN_GAP;
        }
    }
}

/// Widths of as many columns as fit, each as wide as its widest entry.
fn row_widths(entries: &[Entry], width: f64) -> Vec<f64> {
    let columns = |count: usize| -> Vec<f64> {
        let widest = |k: usize| entries.iter().skip(k).step_by(count).map(entry_width).fold(0.0, f64::max);
        (0..count).map(widest).collect()
    };
    let fits = |widths: &Vec<f64>| widths.iter().sum::<f64>() + COLUMN_GAP * (widths.len() as f64 - 1.0) <= width;
    (1..=entries.len()).rev().map(columns).find(fits).unwrap_or_else(|| columns(1))
}

fn draw(entry: &Entry, (x, y): (f64, f64), shapes: &mut Vec<Shape>) {
    let middle = y + ENTRY_HEIGHT / 2.0;
    let centre = (x + SAMPLE / 2.0, middle);
    let ends = [(x, middle), (x + SAMPLE, middle)];
    match entry.sample {
        Sample::Series { colour, marker, line } => {
            if let Some(dash) = line {
                dashed_line(&ends, dash, 1.8, colour, shapes);
            }
            if let Some(marker) = marker {
                shapes.push(Shape::Mark { at: centre, marker, colour, hollow: false });
            }
        }
        Sample::Bar(colour) => {
            shapes.push(Shape::rectangle((x + 8.0, middle - 6.0), (x + 22.0, middle + 6.0), colour));
        }
        Sample::Guide => dashed_line(&ends, Dash::Dashed, 1.2, GREY, shapes),
        Sample::Hollow { bar: true } => {
            shapes.push(Shape::rectangle((x + 8.0, middle - 6.0), (x + 22.0, middle + 6.0), GREY));
            shapes.push(Shape::rectangle((x + 10.0, middle - 4.0), (x + 20.0, middle + 4.0), lighter(GREY, 0.8)));
        }
        Sample::Hollow { bar: false } => {
            shapes.push(Shape::Mark { at: centre, marker: Marker::Circle, colour: GREY, hollow: true });
        }
        Sample::Crossed => shapes.push(Shape::Cross { at: centre, colour: GREY }),
        Sample::Beyond => {
            let at = (centre.0, middle + 3.0);
            shapes.push(Shape::Mark { at, marker: Marker::Circle, colour: GREY, hollow: false });
            shapes.push(Shape::Arrow { at, towards: (0.0, -1.0), colour: GREY });
        }
    }
    let left = x + SAMPLE + GAP;
    shapes.push(Shape::text((left, middle + 0.36 * LABEL_SIZE), &*entry.label, LABEL_SIZE, INK, Align::Left));
    for (k, note) in entry.notes.iter().enumerate() {
        let baseline = middle + 0.36 * LABEL_SIZE + NOTE_HEIGHT * (k + 1) as f64;
        shapes.push(Shape::text((left, baseline), &**note, NOTE_SIZE, GREY, Align::Left));
    }
}
