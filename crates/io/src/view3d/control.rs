//! The control line: `C encl=1 eps=1.e-4 …`.

use super::View3dFault;
use crate::error::shown;

/// What the control line asks for, as far as it means something here.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Control {
    /// `encl`: the surfaces bound an enclosure, so every row of form factors sums to 1.
    pub enclosure: bool,
    /// `eps`, or the smaller of the older `epsu` and `epso`: error of a form factor asked for, in (0, 1).
    pub tolerance: Option<f64>,
    /// One sentence for every word that would change View3D's answer and does not change this one.
    pub warnings: Vec<String>,
}

impl Control {
    /// Takes the words of one control line; `=`, commas and blanks separate names and values.
    pub(super) fn read(&mut self, text: &str) -> Result<(), View3dFault> {
        let mut words = text.split(|c: char| c == '=' || c == ',' || c.is_whitespace()).filter(|word| !word.is_empty());
        while let Some(name) = words.next() {
            let value = words.next().ok_or(View3dFault::Missing { what: "value of the last control word" })?;
            let key = name.to_ascii_lowercase();
            let number = |what| {
                let number = value.parse::<f64>().ok().filter(|x| x.is_finite());
                number.ok_or(View3dFault::Number { what, word: shown(value) })
            };
            match key.as_str() {
                "encl" => self.enclosure = number("value of encl (0 or 1)")? != 0.0,
                "eps" | "epsu" | "epso" => {
                    let eps = number("tolerance between 0 and 1")?;
                    if !(eps > 0.0 && eps < 1.0) {
                        return Err(View3dFault::Number { what: "tolerance between 0 and 1", word: shown(value) });
                    }
                    self.tolerance = Some(self.tolerance.map_or(eps, |known| known.min(eps)));
                }
                "emit" if number("value of emit (0 or 1)")? != 0.0 => self.warnings.push(
                    "emit=1 asks for total interchange factors, which hold reflected light; plain form factors are given"
                        .to_owned(),
                ),
                "row" | "col" if number("whole number")? != 0.0 => {
                    self.warnings.push(format!("{key}={} is left out: all rows and columns are given", shown(value)));
                }
                // How View3D lists, writes and subdivides.
                "emit" | "row" | "col" | "list" | "out" | "maxu" | "maxo" | "mino" | "maxv" | "prjd" => {}
                _ => self.warnings.push(format!("control word '{}={}' is not used", shown(name), shown(value))),
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Control, View3dFault> {
        let mut control = Control::default();
        control.read(text).map(|()| control)
    }

    #[test]
    fn names_are_read_in_any_case_with_or_without_blanks() {
        let control = read("ENCL = 1, list=2  Eps=1.0e-4 maxU=8").unwrap();
        assert_eq!(control, Control { enclosure: true, tolerance: Some(1e-4), warnings: Vec::new() });
        assert_eq!(read("epsu=1.e-5 epso=1.e-4").unwrap().tolerance, Some(1e-5));
        assert_eq!(read("encl=0 row=0 emit=0").unwrap(), Control::default());
    }

    #[test]
    fn words_that_would_change_the_answer_are_named() {
        for (text, word) in [("emit=1", "emit"), ("row=3", "row=3"), ("maxD=96.0", "maxD")] {
            let warnings = read(text).unwrap().warnings;
            assert!(warnings.len() == 1 && warnings[0].contains(word), "{warnings:?}");
        }
    }

    #[test]
    fn a_tolerance_out_of_range_is_refused() {
        for text in ["eps=0", "eps=1", "eps=-1e-4", "eps=nan", "eps=x"] {
            assert!(matches!(read(text), Err(View3dFault::Number { .. })), "{text}");
        }
        assert!(matches!(read("eps"), Err(View3dFault::Missing { .. })));
    }
}
