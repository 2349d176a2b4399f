//! The page of all results: its text, and links to the figures and pictures beside it, which a reader loads as they come into view.

use std::fmt::Write;

use crate::runner::Manifest;
use radiosity_plot::numbers;

/// One experiment on the page.
#[derive(Clone, Debug)]
pub struct Section {
    /// Name of the experiment.
    pub name: &'static str,
    /// Its question.
    pub question: String,
    /// What theory expects.
    pub expects: String,
    /// Its figures.
    pub figures: Vec<Shown>,
    /// What the numbers say.
    pub reading: Vec<String>,
    /// Runs that failed or were stopped early, with their outcome.
    pub troubled: Vec<(String, String)>,
    /// How the results were made.
    pub manifest: Manifest,
}

/// A drawn figure.
#[derive(Clone, Debug)]
pub struct Shown {
    /// Name of its files.
    pub name: String,
    /// What stands under it.
    pub caption: String,
}

const STYLE: &str = "
body { font: 16px/1.5 system-ui, sans-serif; color: #222; background: #fff; max-width: 1140px; margin: 2em auto; padding: 0 1.2em; }
h1 { font-size: 1.7em; margin-bottom: .2em; } h2 { margin-top: 2.6em; border-top: 1px solid #ddd; padding-top: 1em; }
h1, h2 { line-height: 1.25; font-weight: 600; } a { color: #0a58a6; }
p, dl { max-width: 46em; } dt { font-weight: 600; margin-top: .6em; } dd { margin-left: 0; }
figure { margin: 1.6em 0; } figure > img { max-width: 100%; height: auto; display: block; } figcaption { color: #555; font-size: .92em; max-width: 50em; }
.pictures { display: flex; flex-wrap: wrap; gap: 14px; } .pictures figure { margin: 0; flex: 0 1 258px; } .pictures img { width: 100%; height: auto; display: block; }
table { border-collapse: collapse; font-size: .92em; } th, td { text-align: left; padding: .25em 1.1em .25em 0; border-bottom: 1px solid #e4e4e4; vertical-align: top; }
td.number, th.number { text-align: right; } .reading { background: #f4f6f8; border-left: 4px solid #0a58a6; padding: .7em 1em; max-width: 46em; } .reading p { margin: .2em 0; }
.small, details { color: #555; font-size: .88em; } code { font-size: .95em; }
";

/// The whole page.
pub fn html(sections: &[Section]) -> String {
    let mut page = String::new();
    // Writing to a String cannot fail.
    let _ = write!(
        page,
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>What a radiosity solution costs</title>\n<style>{STYLE}</style>\n</head>\n<body>\n\
         <h1>What a radiosity solution of a given accuracy costs</h1>\n",
    );
    overview(&mut page, sections);
    for section in sections {
        write_section(&mut page, section);
    }
    page.push_str("</body>\n</html>\n");
    page
}

fn overview(page: &mut String, sections: &[Section]) {
    page.push_str(
        "<p>Every figure is drawn from the tables beside it. A hollow mark is a run that was stopped early, a crossed one \
         failed; both stay in the tables. Intervals of fitted slopes are 95 % intervals. Times are the smallest of their \
         repetitions.</p>\n<table>\n<tr><th>experiment</th><th>question</th><th class=\"number\">runs</th>\
         <th class=\"number\">not converged</th><th class=\"number\">took</th><th>profile</th></tr>\n",
    );
    for Section { name, question, manifest, .. } in sections {
        let _ = writeln!(
            page,
            "<tr><td><a href=\"#{name}\">{name}</a></td><td>{}</td><td class=\"number\">{}</td><td class=\"number\">{}</td>\
             <td class=\"number\">{}</td><td>{}</td></tr>",
            escape(question),
            manifest.runs,
            manifest.failed,
            numbers::seconds(manifest.seconds),
            manifest.profile.name(),
        );
    }
    page.push_str("</table>\n");
}

fn write_section(page: &mut String, section: &Section) {
    let name = section.name;
    let _ = write!(
        page,
        "<h2 id=\"{name}\">{name}</h2>\n<dl><dt>Question</dt><dd>{}</dd><dt>What theory expects</dt><dd>{}</dd></dl>\n",
        escape(&section.question),
        escape(&section.expects)
    );
    if !section.reading.is_empty() {
        page.push_str("<div class=\"reading\">");
        for sentence in &section.reading {
            let _ = write!(page, "<p>{}</p>", escape(sentence));
        }
        page.push_str("</div>\n");
    }
    for Shown { name: figure, caption } in &section.figures {
        let _ = write!(
            page,
            "<figure>\n<img src=\"{name}/{figure}.svg\" alt=\"{figure}\" loading=\"lazy\">\n<figcaption>{} <span class=\"small\">(<a href=\"{name}/{figure}.svg\">SVG</a>, \
             <a href=\"{name}/{figure}.png\">PNG</a>)</span></figcaption>\n</figure>\n",
            escape(caption)
        );
    }
    let pictures = &section.manifest.pictures;
    if !pictures.is_empty() {
        page.push_str("<div class=\"pictures\">\n");
        for picture in pictures {
            let caption = escape(&picture.caption);
            let _ = writeln!(
                page,
                "<figure><img src=\"{name}/{}\" width=\"{}\" height=\"{}\" alt=\"{caption}\" loading=\"lazy\">\
                 <figcaption>{caption}</figcaption></figure>",
                escape(&picture.file),
                picture.width,
                picture.height
            );
        }
        page.push_str("</div>\n");
    }
    let _ = writeln!(
        page,
        "<p>Tables: <a href=\"{name}/counts.csv\">counts, errors and outcomes</a>, <a href=\"{name}/times.csv\">times</a>, \
         <a href=\"{name}/run.json\">how they were made</a>.</p>"
    );
    left_out(page, &section.manifest);
    troubled(page, section);
    machine(page, &section.manifest);
}

/// A line a scene.
fn left_out(page: &mut String, manifest: &Manifest) {
    if manifest.left_out.is_empty() {
        return;
    }
    page.push_str("<details><summary>What was left out, and what that saved</summary>\n<table>\n");
    for (scene, line) in &manifest.left_out {
        let _ = writeln!(page, "<tr><td>{}</td><td>{}</td></tr>", escape(scene), escape(line));
    }
    page.push_str("</table></details>\n");
}

fn troubled(page: &mut String, section: &Section) {
    if section.troubled.is_empty() {
        return;
    }
    let _ = write!(
        page,
        "<details><summary>{} of {} runs failed or were stopped early</summary>\n<table>\n",
        section.troubled.len(),
        section.manifest.runs
    );
    for (run, outcome) in &section.troubled {
        let _ = writeln!(page, "<tr><td>{}</td><td>{}</td></tr>", escape(run), escape(outcome));
    }
    page.push_str("</table></details>\n");
}

fn machine(page: &mut String, manifest: &Manifest) {
    let machine = &manifest.machine;
    let or_unknown = |text: &str| if text.is_empty() { "unknown".to_string() } else { escape(text) };
    let libraries: Vec<String> = machine.libraries.iter().map(|(name, version)| format!("{name} {version}")).collect();
    let settings = match &manifest.settings {
        serde_json::Value::Null => String::new(),
        settings => format!("<br>Settings: <code>{}</code>", escape(&settings.to_string())),
    };
    let _ = writeln!(
        page,
        "<p class=\"small\">{} profile, {} of {} threads of {}, {} of memory; {} for {}, optimisation level {}; version {} at \
         commit <code>{}</code>{}; {}.{settings}</p>",
        manifest.profile.name(),
        manifest.threads,
        machine.cores,
        or_unknown(&machine.processor),
        numbers::bytes(machine.memory_bytes as f64),
        or_unknown(&machine.compiler),
        or_unknown(&machine.target),
        or_unknown(&machine.optimisation),
        escape(&machine.version),
        or_unknown(machine.commit.get(..12).unwrap_or(&machine.commit)),
        if machine.modified { " with changes" } else { "" },
        escape(&libraries.join(", ")),
    );
}

/// `text` with the characters that mean something in HTML replaced.
fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
