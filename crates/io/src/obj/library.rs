//! Material libraries (MTL), read by `tobj`, one material at a time.
//!
//! `tobj` panics at a colour of fewer than three numbers, stops at the first value it cannot read and gives no line
//! numbers. So lines are looked at first: colours are checked (one number stands for all three) or refused with their
//! line, values that only say something about parts left out anyway are dropped with a warning if they cannot be read,
//! and `tobj` gets what is sound.

use std::collections::HashMap;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};

use super::lines::{Line, logical_lines};
use super::optics::Optics;
use super::report::Texture;
use crate::ReadError;
use crate::error::shown;

/// A material as its library gives it.
#[derive(Clone, Debug)]
pub(crate) struct RawMaterial {
    pub name: String,
    pub path: PathBuf,
    /// Lines of its colours.
    pub lines: Lines,
    /// Diffuse reflectance; `None` if there is no `Kd`.
    pub kd: Option<[f64; 3]>,
    /// Specular reflectance.
    pub ks: [f64; 3],
    /// Radiance in W/(m² sr).
    pub ke: [f64; 3],
    /// Keyword and file of every texture.
    pub textures: Vec<Texture>,
    /// How it reflects and refracts.
    pub optics: Optics,
    /// What is specular about it, empty if nothing is.
    pub specular: String,
    /// What is transparent about it without refracting, which has no meaning here; empty if nothing is.
    pub transparent: String,
}

/// Lines of `Kd` and `Ks`; that of `newmtl` where one is absent.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lines {
    pub kd: usize,
    pub ks: usize,
}

/// Materials of all libraries by name, and what was odd about them.
#[derive(Default)]
pub(crate) struct Library {
    pub materials: HashMap<String, RawMaterial>,
    pub warnings: Vec<String>,
}

/// The statements of one `newmtl` block that are sound.
struct Block {
    name: String,
    text: String,
    lines: Lines,
}

impl Library {
    /// Adds the materials in the bytes of an MTL file; a name defined again takes the place of the earlier one.
    ///
    /// # Errors
    ///
    /// [`ReadError`] at a `Kd`, `Ks` or `Ke` that is no colour, negative or not finite.
    pub(crate) fn add(&mut self, path: &Path, bytes: &[u8]) -> Result<(), ReadError> {
        let mut block: Option<Block> = None;
        for line in logical_lines(bytes) {
            let Some((key, rest)) = line.key() else { continue };
            if key == "newmtl" {
                self.finish(path, block.take())?;
                let lines = Lines { kd: line.number, ks: line.number };
                // A material without a name cannot be asked for; its statements are skipped with it.
                if rest.is_empty() {
                    self.warn(path, &line, "a material without a name is left out");
                } else {
                    block = Some(Block { name: rest.to_owned(), text: format!("newmtl {rest}\n"), lines });
                }
            } else if let Some(block) = &mut block {
                match statement(path, &line, key, rest, &block.name)? {
                    Some(sound) => {
                        match key {
                            "Kd" => block.lines.kd = line.number,
                            "Ks" => block.lines.ks = line.number,
                            _ => {}
                        }
                        block.text.push_str(&sound);
                        block.text.push('\n');
                    }
                    None => self.warn(path, &line, &format!("'{}' cannot be read and is left out", shown(&line.text))),
                }
            }
        }
        self.finish(path, block)
    }

    fn warn(&mut self, path: &Path, line: &Line, what: &str) {
        self.warnings.push(format!("{}:{}: {what}", path.display(), line.number));
    }

    /// Lets `tobj` read a block and keeps what it found.
    fn finish(&mut self, path: &Path, block: Option<Block>) -> Result<(), ReadError> {
        let Some(Block { name, text, lines }) = block else { return Ok(()) };
        let read =
            tobj::load_mtl_buf(&mut text.as_bytes()).ok().and_then(|(materials, _)| materials.into_iter().next());
        let Some(material) = read else {
            // Statements were checked one by one, so this is a name that tobj does not take.
            self.warnings.push(format!(
                "{}: material '{}' cannot be read and is left out",
                path.display(),
                shown(&name)
            ));
            return Ok(());
        };
        let raw = RawMaterial {
            path: path.to_owned(),
            lines,
            kd: material.diffuse,
            ks: material.specular.unwrap_or_default(),
            ke: material.emissive.unwrap_or_default(),
            textures: textures(path, &name, &text),
            optics: optics(&material),
            specular: specular(&material),
            transparent: transparent(&material),
            name: name.clone(),
        };
        if self.materials.insert(name.clone(), raw).is_some() {
            let what = "is defined twice; the later one counts";
            self.warnings.push(format!("{}: material '{}' {what}", path.display(), shown(&name)));
        }
        Ok(())
    }
}

/// A statement as `tobj` reads it safely; `None` if it cannot be read and says nothing of weight.
fn statement(path: &Path, line: &Line, key: &str, rest: &str, material: &str) -> Result<Option<String>, ReadError> {
    let number = |word: &str| word.parse::<f64>().ok().filter(|v| v.is_finite());
    match key {
        "Kd" | "Ks" | "Ke" => {
            let [r, g, b] = colour(path, line, key, rest, material)?;
            Ok(Some(format!("{key} {r:?} {g:?} {b:?}")))
        }
        "Tf" => Ok(colour(path, line, key, rest, material).ok().map(|[r, g, b]| format!("Tf {r:?} {g:?} {b:?}"))),
        // The ambient colour belongs to other renderers' models.
        "Ka" => Ok(Some(String::new())),
        "Ns" | "Ni" | "d" | "Tr" | "Pr" | "Pm" => {
            let word = rest.split_whitespace().find(|word| *word != "-halo").unwrap_or("");
            Ok(number(word).map(|v| format!("{key} {v:?}")))
        }
        "illum" => Ok(rest.split_whitespace().next().and_then(|w| w.parse::<u8>().ok()).map(|v| format!("illum {v}"))),
        _ if rest.is_empty() => Ok(None),
        _ => Ok(Some(format!("{key} {rest}"))),
    }
}

/// One or three numbers, finite and not negative.
fn colour(path: &Path, line: &Line, key: &str, rest: &str, material: &str) -> Result<[f64; 3], ReadError> {
    let words: Vec<Result<f64, _>> = super::lines::words(rest).map(str::parse).collect();
    let found = match words[..] {
        [Ok(grey)] => Some([grey; 3]),
        [Ok(r), Ok(g), Ok(b), ..] => Some([r, g, b]),
        _ => None,
    };
    let (path, line, material, key) = (path.to_owned(), line.number, shown(material), key.to_owned());
    let Some(found) = found else {
        return Err(ReadError::Colour { path, line, material, key, words: shown(rest) });
    };
    // π·Ke must be finite too.
    match found.into_iter().find(|v| !((v * PI).is_finite() && *v >= 0.0)) {
        Some(value) => Err(ReadError::ColourRange { path, line, material, key, value }),
        None => Ok(found),
    }
}

/// Every statement of a block that names a picture, in file order.
fn textures(library: &Path, material: &str, block: &str) -> Vec<Texture> {
    let statements = block.lines().filter_map(|line| line.split_once(' '));
    let pictures = statements.filter(|(key, _)| {
        let key = key.to_ascii_lowercase();
        key.starts_with("map_") || ["bump", "disp", "decal", "refl", "norm"].contains(&key.as_str())
    });
    let texture = |(key, rest): (&str, &str)| {
        // Options such as `-s 1 1 1` come before the file, whose name may hold blanks.
        let file = if rest.starts_with('-') { rest.split_whitespace().next_back().unwrap_or(rest) } else { rest };
        let found = beside(library, file).is_some();
        Texture { material: material.to_owned(), key: key.to_owned(), file: file.to_owned(), found }
    };
    pictures.map(texture).collect()
}

/// The regular file that `named` means in `file`'s folder, with `\` read as `/` if need be.
pub(crate) fn beside(file: &Path, named: &str) -> Option<PathBuf> {
    if named.is_empty() || named.contains('\0') {
        return None;
    }
    let folder = file.parent().unwrap_or(Path::new(""));
    [named.to_owned(), named.replace('\\', "/")].iter().map(|n| folder.join(n)).find(|p| p.is_file())
}

/// What `tobj` read, and what it kept as unknown.
fn optics(material: &tobj::Material) -> Optics {
    let unknown = |key: &str| material.unknown_param.get(key);
    let number = |key: &str| unknown(key).and_then(|v| v.trim().parse::<f64>().ok());
    let tf = unknown("Tf").and_then(|v| {
        let numbers: Vec<f64> = v.split_whitespace().filter_map(|w| w.parse().ok()).collect();
        numbers.try_into().ok()
    });
    Optics {
        ns: material.shininess,
        ni: material.optical_density,
        illum: material.illumination_model,
        tf,
        pr: number("Pr"),
        pm: number("Pm"),
    }
}

/// What in a material goes beyond diffuse reflection and emission, as `Ks 0.2, Ns 50, illum 3, Ni 1.5, Pr 0.4`.
fn specular(material: &tobj::Material) -> String {
    let ks = material.specular.unwrap_or_default();
    let optics = optics(material);
    let illum = material.illumination_model.unwrap_or(0);
    let mut parts = Vec::new();
    // Exporters write Ns, Ni and illum 2 to every material: without Ks, metal or a ray-traced model they change nothing.
    if ks.iter().any(|v| *v > 0.0) {
        let grey = ks[0] == ks[1] && ks[1] == ks[2];
        parts.push(if grey { format!("Ks {}", ks[0]) } else { format!("Ks {} {} {}", ks[0], ks[1], ks[2]) });
        parts.extend(material.shininess.map(|ns| format!("Ns {ns}")));
    }
    if illum >= 3 {
        parts.push(format!("illum {illum}"));
        parts.extend(material.optical_density.map(|ni| format!("Ni {ni}")));
    }
    if optics.is_metal() {
        parts.extend(optics.pm.map(|pm| format!("Pm {pm}")));
    }
    if !parts.is_empty() {
        parts.extend(optics.pr.map(|pr| format!("Pr {pr}")));
    }
    parts.join(", ")
}

/// What in a material lets light through without refraction, as `d 0.4` or `Tr 0.6`.
fn transparent(material: &tobj::Material) -> String {
    let transmission = material.unknown_param.get("Tr").and_then(|v| v.parse::<f64>().ok());
    let dissolve = material.dissolve.filter(|d| *d < 1.0).map(|d| format!("d {d}"));
    // Where both are given d is the one that exporters agree about.
    let tr = transmission.filter(|t| material.dissolve.is_none() && *t > 0.0).map(|t| format!("Tr {t}"));
    dissolve.or(tr).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn library(text: &str) -> Result<Library, ReadError> {
        let mut library = Library::default();
        library.add(Path::new("a.mtl"), text.as_bytes())?;
        Ok(library)
    }

    #[test]
    fn colours_of_three_numbers_and_of_one_are_read() {
        let read =
            library("newmtl wood\r\nKd 0.5 0.25 0.125\r\nKe 2\r\n\r\nnewmtl two words\nKs 0.1 0.1 0.1 # gloss\n")
                .unwrap();
        let wood = &read.materials["wood"];
        assert_eq!((wood.kd, wood.ks, wood.ke), (Some([0.5, 0.25, 0.125]), [0.0; 3], [2.0; 3]));
        assert_eq!((read.materials["two words"].kd, read.materials["two words"].ks), (None, [0.1; 3]));
    }

    #[test]
    fn what_is_no_colour_is_refused_with_its_line() {
        for text in ["Kd", "Kd 0.5 0.5", "Kd spectral wood.rfl", "Kd a b c", "Ke 1 2 x"] {
            match library(&format!("newmtl wood\n{text}\n")) {
                Err(ReadError::Colour { line: 2, material, .. }) => assert_eq!(material, "wood"),
                other => panic!("{text}: {:?}", other.err()),
            }
        }
        for text in ["Kd -0.1 0 0", "Ks nan 0 0", "Ke 0 inf 0"] {
            assert!(
                matches!(library(&format!("newmtl w\n\n{text}\n")), Err(ReadError::ColourRange { line: 3, .. })),
                "{text}"
            );
        }
    }

    #[test]
    fn values_of_parts_left_out_that_cannot_be_read_are_warned_about() {
        let read = library("newmtl w\nNs\nNi x\nd -halo 0.5\nillum 300\nmap_Kd\nKa 1\nKd 0.5\nnewmtl\nKd 2\n").unwrap();
        assert_eq!(read.materials["w"].kd, Some([0.5; 3]));
        assert_eq!((&read.materials["w"].specular[..], &read.materials["w"].transparent[..]), ("", "d 0.5"));
        assert_eq!(read.warnings.len(), 5, "{:?}", read.warnings);
        assert!(read.warnings[0].starts_with("a.mtl:2: 'Ns'"));
    }

    #[test]
    fn specular_parts_and_textures_are_named() {
        let text = "newmtl a\nKs 0.2 0.2 0.2\nNs 50\nNi 1.45\nd 1\nillum 2\nmap_Kd textures/my wood.jpg\nbump -bm 0.1 b.png\n\
                    newmtl b\nNi 1.45\nNs 30\nillum 2\nd 1.0\nTr 1\nnewmtl c\nillum 7\nNi 1.5\nTr 0.75\n";
        let read = library(text).unwrap();
        let specular = |name: &str| read.materials[name].specular.as_str();
        assert_eq!((specular("a"), specular("b"), specular("c")), ("Ks 0.2, Ns 50", "", "illum 7, Ni 1.5"));
        assert_eq!((&read.materials["b"].transparent[..], &read.materials["c"].transparent[..]), ("", "Tr 0.75"));
        let textures: Vec<_> =
            read.materials["a"].textures.iter().map(|t| (t.key.as_str(), t.file.as_str(), t.found)).collect();
        assert_eq!(textures, [("map_Kd", "textures/my wood.jpg", false), ("bump", "b.png", false)]);
    }

    #[test]
    fn the_later_of_two_definitions_counts_and_is_warned_about() {
        let read = library("newmtl w\nKd 0.1\nnewmtl w\nKd 0.2\n").unwrap();
        assert_eq!(read.materials["w"].kd, Some([0.2; 3]));
        assert_eq!(read.warnings.len(), 1);
    }
}
