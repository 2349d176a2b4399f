//! The page of all results: one file that needs nothing beside it.

use std::fmt::Write;

use crate::experiment::Picture;
use crate::runner::Manifest;
use radiosity_plot::FONT;
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
    /// Its pictures with the bytes of their files.
    pub pictures: Vec<(Picture, Vec<u8>)>,
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
    /// The SVG itself.
    pub svg: String,
}

const STYLE: &str = "
body { font: 16px/1.5 system-ui, sans-serif; color: #222; background: #fff; max-width: 1140px; margin: 2em auto; padding: 0 1.2em; }
h1 { font-size: 1.7em; margin-bottom: .2em; } h2 { margin-top: 2.6em; border-top: 1px solid #ddd; padding-top: 1em; }
h1, h2 { line-height: 1.25; font-weight: 600; } a { color: #0a58a6; }
p, dl { max-width: 46em; } dt { font-weight: 600; margin-top: .6em; } dd { margin-left: 0; }
figure { margin: 1.6em 0; } figure svg { max-width: 100%; height: auto; display: block; } figcaption { color: #555; font-size: .92em; max-width: 50em; }
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
         <title>What a radiosity solution costs</title>\n<style>\
         @font-face {{ font-family: \"DejaVu Sans\"; src: url(data:font/ttf;base64,{}); }}{STYLE}</style>\n</head>\n<body>\n\
         <h1>What a radiosity solution of a given accuracy costs</h1>\n",
        base64(FONT)
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
    for Shown { name: figure, caption, svg } in &section.figures {
        let _ = write!(
            page,
            "<figure>\n{}\n<figcaption>{} <span class=\"small\">(<a href=\"{name}/{figure}.svg\">SVG</a>, \
             <a href=\"{name}/{figure}.png\">PNG</a>)</span></figcaption>\n</figure>\n",
            svg.trim_end(),
            escape(caption)
        );
    }
    if !section.pictures.is_empty() {
        page.push_str("<div class=\"pictures\">\n");
        for (picture, png) in &section.pictures {
            let caption = escape(&picture.caption);
            let _ = writeln!(
                page,
                "<figure><img src=\"data:image/png;base64,{}\" width=\"{}\" height=\"{}\" alt=\"{caption}\">\
                 <figcaption>{caption}</figcaption></figure>",
                base64(png),
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
    troubled(page, section);
    machine(page, &section.manifest);
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

/// RFC 4648, section 4.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let word = (0..3).fold(0_u32, |word, k| word << 8 | u32::from(chunk.get(k).copied().unwrap_or(0)));
        for k in 0..4 {
            let digit = DIGITS[(word >> (18 - 6 * k)) as usize & 63];
            text.push(if k <= chunk.len() { digit.into() } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The test vectors of RFC 4648, section 10.
    #[test]
    fn base64_follows_the_standard() {
        let words = ["", "f", "fo", "foo", "foob", "fooba", "foobar"];
        let texts = ["", "Zg==", "Zm8=", "Zm9v", "Zm9vYg==", "Zm9vYmE=", "Zm9vYmFy"];
        assert_eq!(words.map(|word| base64(word.as_bytes())), texts);
    }
}
