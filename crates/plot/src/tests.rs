//! Facts about drawn figures.

use super::*;
use crate::testing::Scratch;

fn point(x: f64, y: f64, quality: Quality) -> Point {
    Point { x, y, quality }
}

fn figure(points: impl IntoIterator<Item = Point>) -> Figure {
    let panel = Panel::new(Axis::log("time", "s"), Axis::log("error", ""));
    Figure::new("test", "Test").panel(panel.series(Series::new("Jacobi", "jacobi").points(points)))
}

fn count(figure: &Figure, which: impl Fn(&Shape) -> bool) -> usize {
    figure.draw().shapes.iter().filter(|shape| which(shape)).count()
}

fn crosses(figure: &Figure) -> usize {
    count(figure, |s| matches!(s, Shape::Cross { .. }))
}

/// One cross at each failed point, one in the legend.
#[test]
fn failed_runs_are_crossed_even_without_a_value() {
    let good = [point(1.0, 1.0, Quality::Good), point(2.0, 0.1, Quality::Good)];
    assert_eq!(crosses(&figure(good)), 0);
    let failed = [point(3.0, 0.5, Quality::Failed), point(4.0, f64::NAN, Quality::Failed)];
    let figure = figure(good.into_iter().chain(failed));
    assert_eq!(crosses(&figure), 3);
    let drawing = figure.draw();
    for shape in &drawing.shapes {
        if let Shape::Cross { at: (x, y), .. } = shape {
            assert!(*x > 0.0 && *x < drawing.width && *y > 0.0 && *y < drawing.height, "({x}, {y})");
        }
    }
}

/// One hollow mark at the point, one in the legend.
#[test]
fn runs_stopped_early_are_hollow() {
    let figure = figure([point(1.0, 1.0, Quality::Good), point(2.0, 0.1, Quality::Limited)]);
    assert_eq!(count(&figure, |s| matches!(s, Shape::Mark { hollow: true, .. })), 2);
    assert_eq!(crosses(&figure), 0);
}

#[test]
fn a_failed_bar_is_crossed() {
    let panel = Panel::bars(["a", "b"], Axis::linear("time", "s"));
    let points = [point(0.0, 2.0, Quality::Good), point(1.0, f64::NAN, Quality::Failed)];
    let figure = Figure::new("bars", "").panel(panel.series(Series::new("Jacobi", "jacobi").points(points)));
    assert_eq!(crosses(&figure), 2);
}

/// Names that stand on one line begin where those before have ended.
#[test]
fn names_of_many_bars_do_not_run_into_each_other() {
    let names: Vec<String> = (0..16).map(|k| format!("furnished, kaleidoscope {k}")).collect();
    let points = (0..16).map(|k| point(f64::from(k), 1.0, Quality::Good));
    let panel = Panel::bars(names, Axis::linear("time", "s")).series(Series::new("Jacobi", "jacobi").points(points));
    let drawing = Figure::new("bars", "").panel(panel).draw();
    let mut ends = Vec::new();
    for shape in &drawing.shapes {
        if let Shape::Text { at, text, size, .. } = shape
            && text.starts_with("kaleidoscope")
        {
            let half = surface::text_width("kaleidoscope", *size) / 2.0;
            ends.push((at.0 - half, at.0 + half));
        }
    }
    assert_eq!(ends.len(), 16);
    assert!(ends.windows(2).all(|pair| pair[0].1 < pair[1].0));
    assert!(ends[15].1 < drawing.width);
}

#[test]
fn the_fitted_slope_stands_in_the_figure() {
    let power = |s: f64| Series::new("CG", "cg").values([1.0, 2.0, 4.0, 8.0].map(|x: f64| (x, x.powf(s)))).fit();
    let panel = |s| Panel::new(Axis::log("m", ""), Axis::log("time", "s")).series(power(s));
    for (figure, texts) in [
        (Figure::new("one", "").panel(panel(2.0)), vec!["slope 2.000 ± <0.001"]),
        (
            Figure::new("two", "").panel(panel(2.0)).panel(panel(-0.5)),
            vec!["slope 2.000 ± <0.001", "slope −0.500 ± <0.001"],
        ),
    ] {
        for wanted in texts {
            let found = count(&figure, |s| matches!(s, Shape::Text { text, .. } if text.ends_with(wanted)));
            assert_eq!(found, 1, "{wanted} in {}", figure.name());
        }
    }
}

/// Points with y = x lie on it, a point with y = 2 x does not.
#[test]
fn the_diagonal_goes_where_both_are_the_same() {
    let points = [(1.0, 1.0), (5.0, 5.0), (40.0, 40.0), (10.0, 20.0)];
    let series = Series::new("Jacobi", "jacobi").values(points).scatter();
    let panel = Panel::new(Axis::log("predicted", "s"), Axis::log("measured", "s")).series(series);
    let drawing = Figure::new("test", "").panel(panel.diagonal("as predicted")).draw();
    let marks = drawing.shapes.iter().filter_map(|s| if let Shape::Mark { at, .. } = s { Some(*at) } else { None });
    let marks: Vec<(f64, f64)> = marks.take(4).collect();
    let dashes: Vec<(f64, f64)> = drawing.shapes.iter().filter_map(dash_of_guide).flatten().collect();
    assert!(dashes.len() > 20);
    let [(x0, y0), (x1, y1)] = [marks[0], marks[2]];
    let off = |(x, y): (f64, f64)| ((x - x0) * (y1 - y0) - (y - y0) * (x1 - x0)) / (x1 - x0).hypot(y1 - y0);
    assert!(dashes.iter().all(|at| off(*at).abs() < 0.01) && off(marks[1]).abs() < 0.01 && off(marks[3]).abs() > 5.0);
}

/// The ends of a dash of a guide that is not level: grey and thin, and no tick or sample of the legend.
fn dash_of_guide(shape: &Shape) -> Option<Vec<(f64, f64)>> {
    match shape {
        Shape::Line { points, width, .. } if *width == 1.2 && points[0].1 != points[points.len() - 1].1 => {
            Some(points.clone())
        }
        _ => None,
    }
}

#[test]
fn nothing_is_drawn_outside_of_the_figure() {
    let wild =
        [point(1e-9, 1e9, Quality::Good), point(0.0, -1.0, Quality::Good), point(f64::NAN, 3.0, Quality::Failed)];
    let panel = |x: Axis| {
        let long = Series::new("a rather long label of a series", "elements-to-patches").points(wild).fit();
        Panel::new(x, Axis::log("error", ""))
            .series(long)
            .title("panel")
            .slope(2.0, "∝ m²")
            .level(1e3, "goal")
            .diagonal("same")
    };
    for n in 1..=6 {
        let panels = (0..n).map(|k| panel(Axis::log("time", "s").limits(1e-3, 10f64.powi(k))));
        let drawing = Figure::new("many", "Title").panels(panels).draw();
        let inside = |(x, y): (f64, f64)| x >= 0.0 && y >= 0.0 && x <= drawing.width && y <= drawing.height;
        for shape in &drawing.shapes {
            let inside = match shape {
                Shape::Line { points, .. } | Shape::Polygon { points, .. } => points.iter().copied().all(inside),
                Shape::Mark { at, .. } | Shape::Cross { at, .. } | Shape::Arrow { at, .. } => inside(*at),
                Shape::Text { at, text, size, align: Align::Left, .. } => {
                    inside(*at) && inside((at.0 + surface::text_width(text, *size), at.1))
                }
                Shape::Text { at, .. } => inside(*at),
            };
            assert!(inside, "{shape:?} with {n} panels");
        }
    }
}

#[test]
fn figures_without_data_or_panels_are_drawn() {
    assert_eq!(count(&figure([]), |s| matches!(s, Shape::Text { text, .. } if text == "no data")), 1);
    assert!(Figure::new("none", "").draw().to_svg().unwrap().starts_with("<svg"));
}

/// Two pixels a point, and an SVG of the size of the drawing that names no other font.
#[test]
fn svg_and_png_have_the_size_of_the_drawing() {
    let scratch = Scratch::new();
    let drawing = figure([point(1.0, 1.0, Quality::Good), point(2.0, 0.1, Quality::Good)]).draw();
    let svg = drawing.to_svg().unwrap();
    assert!(
        svg.starts_with(&format!("<svg width=\"{}\" height=\"{}\"", drawing.width, drawing.height)),
        "{}",
        &svg[..90]
    );
    let path = scratch.path().join("figure.png");
    drawing.write_png(&path).unwrap();
    let png = std::fs::read(&path).unwrap();
    let size = |at: usize| f64::from(u32::from_be_bytes(png[at..at + 4].try_into().unwrap()));
    assert_eq!((size(16), size(20)), (2.0 * drawing.width, 2.0 * drawing.height));
    assert_eq!(svg, drawing.to_svg().unwrap(), "the same bytes each time");
}
