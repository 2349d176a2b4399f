//! Lays out a figure: panels in rows, axes, marks.

use super::axis::{Span, Tick};
use super::legend;
use super::shapes::{Align, Drawing, Shape, clip, dashes};
use super::surface::text_width;
use super::{Axis, Dash, Figure, Guide, Panel, Scale, Series};
use crate::Quality;
use crate::fit::PowerLaw;
use crate::palette::{Rgb, lighter, style};

pub(super) const INK: Rgb = [0x26, 0x26, 0x26];
pub(super) const GREY: Rgb = [0x70, 0x70, 0x70];
const GRID_LINE: Rgb = [0xe2, 0xe2, 0xe2];
const FAINT_LINE: Rgb = [0xf3, 0xf3, 0xf3];
const FRAME: Rgb = [0x8a, 0x8a, 0x8a];

pub(super) const LABEL_SIZE: f64 = 12.5;
const TICK_SIZE: f64 = 11.5;
const TITLE_SIZE: f64 = 15.5;
const PANEL_TITLE_SIZE: f64 = 13.0;
const FIT_SIZE: f64 = 11.5;

const MARGIN: f64 = 14.0;
/// Between a panel and its neighbour, so that the last tick label of one has room.
const PANEL_GAP: f64 = 26.0;
const LEGEND_GAP: f64 = 22.0;
const FIT_ROW: f64 = 17.0;
/// Where a value that its axis cannot show is drawn, inside of the frame.
const EDGE: f64 = 13.0;

/// Size of the plot area and panels in a row, by the number of panels.
fn arrangement(panels: usize) -> (f64, f64, usize) {
    match panels {
        0 | 1 => (560.0, 390.0, 1),
        2 => (410.0, 330.0, 2),
        4 => (410.0, 300.0, 2),
        _ => (290.0, 270.0, 3),
    }
}

/// A panel whose axes are settled.
struct Settled<'a> {
    panel: &'a Panel,
    x: Span,
    y: Span,
    /// Labelled ticks of y; their width decides the left margin.
    y_ticks: Vec<Tick>,
    /// Room left of the plot area.
    left: f64,
    /// Fitted power laws, if they stand under the panel.
    fits: Vec<(&'a Series, PowerLaw)>,
}

/// Upper left and lower right corner of a plot area.
#[derive(Clone, Copy)]
struct Area {
    low: (f64, f64),
    high: (f64, f64),
}

impl Area {
    fn x(&self, share: f64) -> f64 {
        self.low.0 + share * (self.high.0 - self.low.0)
    }

    fn y(&self, share: f64) -> f64 {
        self.high.1 - share * (self.high.1 - self.low.1)
    }
}

pub(super) fn figure(figure: &Figure) -> Drawing {
    let (width, height, in_row) = arrangement(figure.panels.len());
    let width = figure.panels.iter().map(width_of_categories).fold(width, f64::max);
    let several = figure.panels.len() > 1;
    let settled = settle(figure, height, several);
    let mut shapes = Vec::new();

    // Heading.
    let title_height = if figure.title.is_empty() { 0.0 } else { TITLE_SIZE + 16.0 };
    if !figure.title.is_empty() {
        shapes.push(Shape::text((MARGIN, MARGIN + TITLE_SIZE * 0.8), &*figure.title, TITLE_SIZE, INK, Align::Left));
    }

    // Panels, row by row; those above each other share the left margin.
    let mut y = MARGIN + title_height;
    let mut right = MARGIN;
    let mut first_top = y;
    for (row_index, row) in settled.chunks(in_row).enumerate() {
        if row.iter().any(|p| !p.panel.title.is_empty()) {
            y += PANEL_TITLE_SIZE + 9.0;
        }
        if row_index == 0 {
            first_top = y;
        }
        let mut x = MARGIN;
        for (column, panel) in row.iter().enumerate() {
            let left = settled.iter().skip(column).step_by(in_row).map(|p| p.left).fold(0.0, f64::max);
            let area = Area { low: (x + left, y), high: (x + left + width, y + height) };
            draw_panel(panel, area, &mut shapes);
            x = area.high.0 + PANEL_GAP;
            right = f64::max(right, area.high.0);
        }
        let fits = row.iter().map(|p| p.fits.len()).max().unwrap_or(0);
        y += height + below(row, width) + FIT_ROW * fits as f64 + if fits > 0 { 6.0 } else { 0.0 } + 12.0;
    }

    // Legend: beside one panel, under several.
    let entries = legend::entries(figure, !several);
    let alone = entries.len() <= 1 && !several && entries.iter().all(|e| e.label.is_empty() && e.notes.is_empty());
    let (mut total_width, mut total_height) = (right + PANEL_GAP, y);
    if several && !entries.is_empty() {
        legend::rows(&entries, (MARGIN, y), right - MARGIN, &mut shapes);
        total_height = y + legend::rows_height(&entries, right - MARGIN) + MARGIN;
    } else if !alone && !entries.is_empty() {
        legend::column(&entries, (right + LEGEND_GAP, first_top), &mut shapes);
        let (legend_width, legend_height) = legend::column_size(&entries);
        total_width = right + LEGEND_GAP + legend_width + MARGIN;
        total_height = total_height.max(first_top + legend_height + MARGIN);
    }
    total_width = total_width.max(2.0 * MARGIN + text_width(&figure.title, TITLE_SIZE));
    Drawing { width: total_width.ceil(), height: total_height.ceil(), shapes }
}

/// Room under a row of plot areas for tick labels and axis labels.
fn below(row: &[Settled<'_>], width: f64) -> f64 {
    let lines =
        row.iter().map(|p| category_lines(p.panel, width).iter().map(Vec::len).max().unwrap_or(1)).max().unwrap_or(1);
    let label = if row.iter().any(|p| !p.panel.x.label.is_empty()) { LABEL_SIZE + 9.0 } else { 0.0 };
    8.0 + TICK_SIZE * 1.25 * lines as f64 + label
}

fn settle(figure: &Figure, height: f64, several: bool) -> Vec<Settled<'_>> {
    let xs = |p: &Panel| -> Vec<f64> { p.series.iter().flat_map(|s| &s.points).map(|p| p.x).collect() };
    let ys = |panel: &Panel| -> Vec<f64> {
        let points = panel.series.iter().flat_map(|s| &s.points).map(|p| p.y);
        let levels = panel.guides.iter().filter_map(|g| match g {
            Guide::Level { y, .. } => Some(*y),
            Guide::Slope { .. } | Guide::Diagonal { .. } => None,
        });
        points.chain(levels).collect()
    };
    let span = |axis: &Axis, shared: bool, of: &dyn Fn(&Panel) -> Vec<f64>, own: &Panel| {
        let values: Vec<f64> = if shared { figure.panels.iter().flat_map(of).collect() } else { of(own) };
        Span::new(axis.scale, axis.limits, axis.zero, values.into_iter())
    };
    let settle_one = |panel| -> Settled<'_> {
        let panel: &Panel = panel;
        let x = if panel.categories.is_empty() {
            span(&panel.x, figure.shared.0, &xs, panel)
        } else {
            Span::new(Scale::Linear, Some((-0.5, panel.categories.len() as f64 - 0.5)), false, std::iter::empty())
        };
        let y = span(&panel.y, figure.shared.1, &ys, panel);
        let y_ticks = y.ticks((height / 42.0) as usize);
        let labels = y_ticks.iter().filter_map(|t| t.label.as_deref()).map(|l| text_width(l, TICK_SIZE));
        let left = labels.fold(0.0, f64::max) + 8.0 + if panel.y.label.is_empty() { 0.0 } else { LABEL_SIZE + 12.0 };
        let fits = panel.series.iter().filter_map(|s| s.fit.map(|fit| (s, fit))).filter(|_| several).collect();
        Settled { panel, x, y, y_ticks, left, fits }
    };
    figure.panels.iter().map(settle_one).collect()
}

fn draw_panel(settled: &Settled<'_>, area: Area, shapes: &mut Vec<Shape>) {
    let panel = settled.panel;
    draw_axes(settled, area, shapes);
    if panel.series.iter().all(|s| s.points.is_empty()) {
        let middle = (area.x(0.5), area.y(0.5));
        shapes.push(Shape::text(middle, "no data", LABEL_SIZE, GREY, Align::Centre));
    }
    for guide in &panel.guides {
        draw_guide(settled, guide, area, shapes);
    }
    if panel.categories.is_empty() {
        // All lines below all marks.
        panel.series.iter().for_each(|series| draw_line(settled, series, area, shapes));
        panel.series.iter().for_each(|series| draw_marks(settled, series, area, shapes));
    } else {
        draw_bars(settled, area, shapes);
    }
    let bottom = area.high.1 + below(std::slice::from_ref(settled), area.high.0 - area.low.0) + 6.0;
    for (k, (series, fit)) in settled.fits.iter().enumerate() {
        let middle = bottom + FIT_ROW * (k as f64 + 0.5);
        let look = style(&series.method);
        let x = area.low.0;
        dashed_line(&[(x, middle), (x + 26.0, middle)], series.dash, 1.8, look.colour, shapes);
        shapes.push(Shape::Mark { at: (x + 13.0, middle), marker: look.marker, colour: look.colour, hollow: false });
        let place = (x + 34.0, middle + 0.36 * FIT_SIZE);
        let full = format!("{}: slope {fit}", series.label);
        let fits = text_width(&full, FIT_SIZE) <= area.high.0 - place.0;
        let text = if fits { full } else { format!("slope {fit}") };
        shapes.push(Shape::text(place, text, FIT_SIZE, INK, Align::Left));
    }
}

fn draw_axes(settled: &Settled<'_>, area: Area, shapes: &mut Vec<Shape>) {
    let panel = settled.panel;
    let x_ticks = if panel.categories.is_empty() { x_ticks(settled, area) } else { Vec::new() };
    // Grid, faint lines first.
    for labelled in [false, true] {
        let colour = if labelled { GRID_LINE } else { FAINT_LINE };
        for tick in x_ticks.iter().filter(|t| t.label.is_some() == labelled) {
            let x = area.x(settled.x.place(tick.value));
            shapes.push(Shape::line((x, area.low.1), (x, area.high.1), 1.0, colour));
        }
        for tick in settled.y_ticks.iter().filter(|t| t.label.is_some() == labelled) {
            let y = area.y(settled.y.place(tick.value));
            shapes.push(Shape::line((area.low.0, y), (area.high.0, y), 1.0, colour));
        }
    }
    let (a, b) = (area.low, area.high);
    for (p, q) in [(a, (b.0, a.1)), ((b.0, a.1), b), (b, (a.0, b.1)), ((a.0, b.1), a)] {
        shapes.push(Shape::line(p, q, 1.0, FRAME));
    }
    // Ticks and their labels.
    for tick in &x_ticks {
        let x = area.x(settled.x.place(tick.value));
        let length = if tick.label.is_some() { 5.0 } else { 2.5 };
        shapes.push(Shape::line((x, b.1), (x, b.1 + length), 1.0, FRAME));
        if let Some(label) = &tick.label {
            let place = (x, b.1 + 8.0 + TICK_SIZE * 0.9);
            shapes.push(Shape::text(place, &**label, TICK_SIZE, INK, Align::Centre));
        }
    }
    for tick in &settled.y_ticks {
        let y = area.y(settled.y.place(tick.value));
        let length = if tick.label.is_some() { 5.0 } else { 2.5 };
        shapes.push(Shape::line((a.0 - length, y), (a.0, y), 1.0, FRAME));
        if let Some(label) = &tick.label {
            let place = (a.0 - 8.0, y + 0.36 * TICK_SIZE);
            shapes.push(Shape::text(place, &**label, TICK_SIZE, INK, Align::Right));
        }
    }
    for (k, lines) in category_lines(panel, b.0 - a.0).iter().enumerate() {
        let x = area.x(settled.x.place(k as f64));
        for (line, text) in lines.iter().enumerate() {
            let place = (x, b.1 + 8.0 + TICK_SIZE * (0.9 + 1.25 * line as f64));
            shapes.push(Shape::text(place, &**text, TICK_SIZE, INK, Align::Centre));
        }
    }
    // Labels and title.
    let x_label = (area.x(0.5), b.1 + below(std::slice::from_ref(settled), area.high.0 - area.low.0) - 3.0);
    shapes.push(Shape::text(x_label, &*panel.x.label, LABEL_SIZE, INK, Align::Centre));
    shapes.push(Shape::Text {
        at: (a.0 - settled.left + LABEL_SIZE * 0.8, area.y(0.5)),
        text: panel.y.label.clone(),
        size: LABEL_SIZE,
        colour: INK,
        align: Align::Centre,
        vertical: true,
    });
    shapes.push(Shape::text((a.0, a.1 - 8.0), &*panel.title, PANEL_TITLE_SIZE, INK, Align::Left));
}

/// As many ticks of x as have room for their labels side by side.
fn x_ticks(settled: &Settled<'_>, area: Area) -> Vec<Tick> {
    let width = area.high.0 - area.low.0;
    let fits = |ticks: &[Tick]| {
        let labelled = ticks.iter().filter_map(|t| {
            let half = text_width(t.label.as_deref()?, TICK_SIZE) / 2.0 + 5.0;
            let x = width * settled.x.place(t.value);
            Some((x - half, x + half))
        });
        let mut end = f64::NEG_INFINITY;
        labelled.into_iter().all(|(low, high)| low >= std::mem::replace(&mut end, high))
    };
    let most = (width / 48.0) as usize;
    (2..=most).rev().map(|most| settled.x.ticks(most)).find(|ticks| fits(ticks)).unwrap_or_else(|| {
        let mut ticks = settled.x.ticks(2);
        // Crowded even so: every other label.
        ticks.iter_mut().filter(|t| t.label.is_some()).skip(1).step_by(2).for_each(|t| t.label = None);
        ticks
    })
}

/// Width between names of neighbouring categories, at least.
const CATEGORY_GAP: f64 = 6.0;

/// Width in which the widest word of all categories has room under each group of bars.
fn width_of_categories(panel: &Panel) -> f64 {
    let words = panel.categories.iter().flat_map(|name| name.split_whitespace());
    let widest = words.map(|word| text_width(word, TICK_SIZE)).fold(0.0, f64::max);
    panel.categories.len() as f64 * (widest + CATEGORY_GAP)
}

/// Names of the categories, broken between words where they are wider than their group of bars.
fn category_lines(panel: &Panel, width: f64) -> Vec<Vec<String>> {
    let room = width / panel.categories.len().max(1) as f64 - CATEGORY_GAP;
    let broken = |name: &String| {
        let mut lines: Vec<String> = Vec::new();
        for word in name.split_whitespace() {
            match lines.last_mut() {
                Some(line) if text_width(&format!("{line} {word}"), TICK_SIZE) <= room => {
                    line.push(' ');
                    line.push_str(word);
                }
                _ => lines.push(word.into()),
            }
        }
        lines
    };
    panel.categories.iter().map(broken).collect()
}

/// Place of a point, and whether its axes can show it.
fn place(settled: &Settled<'_>, (x, y): (f64, f64), area: Area) -> ((f64, f64), bool) {
    let shown = settled.x.shows(x) && settled.y.shows(y);
    let at = (area.x(settled.x.place(x)), area.y(settled.y.place(y)));
    if shown {
        return (at, true);
    }
    let x = at.0.clamp(area.low.0 + EDGE, area.high.0 - EDGE);
    let y = at.1.clamp(area.low.1 + EDGE, area.high.1 - EDGE);
    ((x, y), false)
}

fn draw_line(settled: &Settled<'_>, series: &Series, area: Area, shapes: &mut Vec<Shape>) {
    let colour = style(&series.method).colour;
    let mut draw = |points: &[(f64, f64)]| {
        for piece in clip(points, area.low, area.high) {
            dashed_line(&piece, series.dash, 1.8, colour, shapes);
        }
    };
    if series.joined {
        // Failed points and points no axis can show interrupt the line.
        let points = series.points.iter().map(|p| {
            let (at, shown) = place(settled, (p.x, p.y), area);
            (shown && p.quality != Quality::Failed).then_some(at)
        });
        let points: Vec<Option<(f64, f64)>> = points.collect();
        for piece in points.split(Option::is_none) {
            draw(&piece.iter().flatten().copied().collect::<Vec<_>>());
        }
    }
    if let Some(fit) = &series.fit {
        draw(&curve(settled, area, |x| fit.at(x), fit.range));
    }
}

/// Places of y(x) for x from `range.0` to `range.1`, straight on a log–log panel.
fn curve(settled: &Settled<'_>, area: Area, y: impl Fn(f64) -> f64, range: (f64, f64)) -> Vec<(f64, f64)> {
    let steps = 64;
    let at = |k: i32| {
        let x = range.0 * (range.1 / range.0).powf(f64::from(k) / f64::from(steps));
        place(settled, (x, y(x)), area).0
    };
    if settled.x.is_log() && settled.y.is_log() { vec![at(0), at(steps)] } else { (0..=steps).map(at).collect() }
}

fn draw_marks(settled: &Settled<'_>, series: &Series, area: Area, shapes: &mut Vec<Shape>) {
    let look = style(&series.method);
    for point in &series.points {
        let (at, shown) = place(settled, (point.x, point.y), area);
        let inside = (area.low.0..=area.high.0).contains(&at.0) && (area.low.1..=area.high.1).contains(&at.1);
        if !inside {
            continue;
        }
        let hollow = point.quality != Quality::Good;
        if !shown {
            let out = |at: f64, low: f64, high: f64| if at <= low + EDGE { -1.0 } else { f64::from(at >= high - EDGE) };
            let along_x = if settled.x.shows(point.x) { 0.0 } else { out(at.0, area.low.0, area.high.0) };
            let along_y = if settled.y.shows(point.y) { 0.0 } else { out(at.1, area.low.1, area.high.1) };
            shapes.push(Shape::Arrow { at, towards: (along_x, along_y), colour: look.colour });
        }
        if series.marked || hollow || !shown {
            shapes.push(Shape::Mark { at, marker: look.marker, colour: look.colour, hollow });
        }
        if point.quality == Quality::Failed {
            shapes.push(Shape::Cross { at, colour: look.colour });
        }
    }
}

fn draw_bars(settled: &Settled<'_>, area: Area, shapes: &mut Vec<Shape>) {
    let panel = settled.panel;
    let group = (area.high.0 - area.low.0) / panel.categories.len() as f64;
    let width = (0.78 * group / panel.series.len().max(1) as f64).min(60.0);
    let base = area.y(if settled.y.is_log() { 0.0 } else { settled.y.place(0.0).clamp(0.0, 1.0) });
    for (k, series) in panel.series.iter().enumerate() {
        let colour = style(&series.method).colour;
        let offset = (k as f64 - (panel.series.len() as f64 - 1.0) / 2.0) * width;
        for point in &series.points {
            let (at, shown) = place(settled, (point.x, point.y), area);
            let (x, y) = (at.0 + offset, at.1.clamp(area.low.1, area.high.1));
            let (left, right) = (x - width / 2.0 + 1.0, x + width / 2.0 - 1.0);
            if shown {
                shapes.push(Shape::rectangle((left, y), (right, base), colour));
                if point.quality != Quality::Good && (base - y).abs() > 5.0 {
                    let (top, bottom) = (y.min(base) + 2.0, y.max(base) - 2.0);
                    shapes.push(Shape::rectangle((left + 2.0, top), (right - 2.0, bottom), lighter(colour, 0.8)));
                }
            }
            if point.quality == Quality::Failed || !point.y.is_finite() {
                let y = if shown { y } else { base - EDGE };
                shapes.push(Shape::Cross { at: (x, y), colour });
            }
        }
    }
    shapes.push(Shape::line((area.low.0, base), (area.high.0, base), 1.0, FRAME));
}

fn draw_guide(settled: &Settled<'_>, guide: &Guide, area: Area, shapes: &mut Vec<Shape>) {
    let points = match guide {
        Guide::Level { y, .. } if settled.y.shows(*y) => {
            let y = area.y(settled.y.place(*y));
            vec![(area.low.0, y), (area.high.0, y)]
        }
        Guide::Slope { slope, .. } if settled.x.is_log() && settled.y.is_log() => {
            // Through the mean of the logarithms.
            let points = settled.panel.series.first().into_iter().flat_map(|s| &s.points);
            let logs: Vec<(f64, f64)> = points
                .filter(|p| p.quality == Quality::Good && settled.x.shows(p.x) && settled.y.shows(p.y))
                .map(|p| (p.x.ln(), p.y.ln()))
                .collect();
            if logs.is_empty() {
                return;
            }
            let n = logs.len() as f64;
            let (u, v) = logs.iter().fold((0.0, 0.0), |(a, b), (u, v)| (a + u / n, b + v / n));
            curve(settled, area, |x| (v + slope * (x.ln() - u)).exp(), settled.x.ends())
        }
        Guide::Diagonal { .. } => curve(settled, area, |x| x, settled.x.ends()),
        Guide::Level { .. } | Guide::Slope { .. } => return,
    };
    for piece in clip(&points, area.low, area.high) {
        dashed_line(&piece, Dash::Dashed, 1.2, GREY, shapes);
    }
}

pub(super) fn dashed_line(points: &[(f64, f64)], dash: Dash, width: f64, colour: Rgb, shapes: &mut Vec<Shape>) {
    let pieces = match dash {
        Dash::Solid => vec![points.to_vec()],
        Dash::Dashed => dashes(points, 6.0, 4.0),
        Dash::Dotted => dashes(points, 1.8, 3.2),
    };
    shapes.extend(pieces.into_iter().map(|points| Shape::Line { points, width, colour }));
}
