//! Figures: what is to be shown, apart from how it is drawn.
//!
//! A [`Figure`] is one or more panels side by side with one legend; [`Figure::draw`] lays it out and
//! [`Drawing`] writes SVG and PNG. The look is fixed for the whole project: colour and marker of a series follow from
//! the name of its method, a mark that is hollow was stopped early and a crossed one failed. Values that an axis
//! cannot show (not finite, or ≤ 0 on a logarithmic axis) stay visible at the edge of the panel.
//!
//! What is *not* here: any data, and any choice that would make one figure look unlike another.

mod axis;
pub mod fit;
mod legend;
pub mod numbers;
pub mod palette;
mod panel;
mod quality;
mod shapes;
mod surface;

pub use shapes::{Align, Drawing, Shape};
pub use surface::{DrawError, write_png};

use fit::PowerLaw;
pub use quality::Quality;

/// How an axis runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Equal factors are equally long.
    Log,
    /// Equal differences are equally long.
    Linear,
}

/// One axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    label: String,
    scale: Scale,
    limits: Option<(f64, f64)>,
    zero: bool,
}

impl Axis {
    /// A logarithmic axis; an empty `unit` is for pure numbers.
    pub fn log(label: &str, unit: &str) -> Self {
        Self { label: labelled(label, unit), scale: Scale::Log, limits: None, zero: false }
    }

    /// A linear axis; an empty `unit` is for pure numbers.
    pub fn linear(label: &str, unit: &str) -> Self {
        Self { label: labelled(label, unit), scale: Scale::Linear, limits: None, zero: false }
    }

    fn shows(&self, value: f64) -> bool {
        value.is_finite() && (self.scale == Scale::Linear || value > 0.0)
    }

    /// With fixed ends instead of ends that follow from the data.
    pub fn limits(self, low: f64, high: f64) -> Self {
        Self { limits: Some((low, high)), ..self }
    }

    /// A linear axis that begins at zero, a logarithmic one that begins at a power of ten.
    pub fn from_zero(self) -> Self {
        Self { zero: true, ..self }
    }
}

fn labelled(label: &str, unit: &str) -> String {
    if unit.is_empty() { label.into() } else { format!("{label} ({unit})") }
}

/// One value of a series.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Abscissa; the number of the category in a panel of bars.
    pub x: f64,
    /// Ordinate.
    pub y: f64,
    /// How it is marked.
    pub quality: Quality,
}

/// How the line of a series is broken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Dash {
    /// ———
    Solid,
    /// – – –
    Dashed,
    /// · · ·
    Dotted,
}

/// Points that belong together: one method under one varied setting.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    label: String,
    method: String,
    points: Vec<Point>,
    joined: bool,
    marked: bool,
    dash: Dash,
    fit: Option<PowerLaw>,
}

impl Series {
    /// An empty series; `method` decides colour and marker, `label` stands in the legend.
    pub fn new(label: impl Into<String>, method: impl Into<String>) -> Self {
        Self {
            label: label.into(),
            method: method.into(),
            points: Vec::new(),
            joined: true,
            marked: true,
            dash: Dash::Solid,
            fit: None,
        }
    }

    /// With these points added.
    pub fn points(mut self, points: impl IntoIterator<Item = Point>) -> Self {
        self.points.extend(points);
        self
    }

    /// With good points at these places added.
    pub fn values(self, values: impl IntoIterator<Item = (f64, f64)>) -> Self {
        self.points(values.into_iter().map(|(x, y)| Point { x, y, quality: Quality::Good }))
    }

    /// As a line without marks, for many points. Limited and failed points keep their mark.
    pub fn line(self) -> Self {
        Self { marked: false, ..self }
    }

    /// As marks alone.
    pub fn scatter(self) -> Self {
        Self { joined: false, ..self }
    }

    /// With a broken line: another variant of the same method.
    pub fn dash(self, dash: Dash) -> Self {
        Self { dash, ..self }
    }

    /// With the power law through its good points in place of the line between them.
    pub fn fit(self) -> Self {
        self.fit_from(f64::NEG_INFINITY)
    }

    /// As [`fit`](Self::fit), of the points with x ≥ `low` alone.
    pub fn fit_from(mut self, low: f64) -> Self {
        let good = self.points.iter().filter(|p| p.quality == Quality::Good && p.x >= low);
        self.fit = PowerLaw::through(good.map(|p| (p.x, p.y)));
        self.joined = self.joined && self.fit.is_none();
        self
    }

    /// The power law, if one was asked for and could be fitted.
    pub fn power_law(&self) -> Option<&PowerLaw> {
        self.fit.as_ref()
    }
}

/// A grey line for the eye.
#[derive(Clone, Debug, PartialEq)]
enum Guide {
    /// At one ordinate.
    Level { y: f64, label: String },
    /// A power law through the middle of the first series.
    Slope { slope: f64, label: String },
    /// Where ordinate and abscissa are the same.
    Diagonal { label: String },
}

/// One pair of axes with its series.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    title: String,
    x: Axis,
    y: Axis,
    series: Vec<Series>,
    guides: Vec<Guide>,
    /// Names of the groups of bars; none: not a panel of bars.
    categories: Vec<String>,
}

impl Panel {
    /// A panel of points and lines.
    pub fn new(x: Axis, y: Axis) -> Self {
        Self { title: String::new(), x, y, series: Vec::new(), guides: Vec::new(), categories: Vec::new() }
    }

    /// A panel of bars: one group per category, one bar of it per series, whose points have the number of their
    /// category (0, 1, …) as x.
    pub fn bars(categories: impl IntoIterator<Item = impl Into<String>>, y: Axis) -> Self {
        let categories = categories.into_iter().map(Into::into).collect();
        Self { categories, ..Self::new(Axis::linear("", ""), y.from_zero()) }
    }

    /// With a title, needed when a figure has several panels.
    pub fn title(self, title: impl Into<String>) -> Self {
        Self { title: title.into(), ..self }
    }

    /// With a series.
    pub fn series(mut self, series: Series) -> Self {
        self.series.push(series);
        self
    }

    /// With many series.
    pub fn all_series(mut self, series: impl IntoIterator<Item = Series>) -> Self {
        self.series.extend(series);
        self
    }

    /// With a horizontal line at `y`, such as a floor or a target.
    pub fn level(mut self, y: f64, label: impl Into<String>) -> Self {
        self.guides.push(Guide::Level { y, label: label.into() });
        self
    }

    /// With the slope theory expects, drawn through the middle of the first series (log–log panels only).
    pub fn slope(mut self, slope: f64, label: impl Into<String>) -> Self {
        self.guides.push(Guide::Slope { slope, label: label.into() });
        self
    }

    /// With the line y = x: what is compared agrees on it.
    pub fn diagonal(mut self, label: impl Into<String>) -> Self {
        self.guides.push(Guide::Diagonal { label: label.into() });
        self
    }
}

/// One figure: panels side by side, one legend.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    name: String,
    title: String,
    caption: String,
    panels: Vec<Panel>,
    shared: (bool, bool),
}

impl Figure {
    /// A figure whose files are `name.svg` and `name.png`.
    pub fn new(name: impl Into<String>, title: impl Into<String>) -> Self {
        let (name, title) = (name.into(), title.into());
        Self { name, title, caption: String::new(), panels: Vec::new(), shared: (false, false) }
    }

    /// With a sentence under it on the page: what is shown and how to read it.
    pub fn caption(self, caption: impl Into<String>) -> Self {
        Self { caption: caption.into(), ..self }
    }

    /// With a panel.
    pub fn panel(mut self, panel: Panel) -> Self {
        self.panels.push(panel);
        self
    }

    /// With many panels.
    pub fn panels(mut self, panels: impl IntoIterator<Item = Panel>) -> Self {
        self.panels.extend(panels);
        self
    }

    /// With the same x limits in all panels.
    pub fn shared_x(self) -> Self {
        Self { shared: (true, self.shared.1), ..self }
    }

    /// With the same y limits in all panels.
    pub fn shared_y(self) -> Self {
        Self { shared: (self.shared.0, true), ..self }
    }

    /// Name of its files, without extension.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What stands above it.
    pub fn heading(&self) -> &str {
        &self.title
    }

    /// What stands under it.
    pub fn explanation(&self) -> &str {
        &self.caption
    }

    /// Lays the figure out.
    pub fn draw(&self) -> Drawing {
        panel::figure(self)
    }
}

#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
