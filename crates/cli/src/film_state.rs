//! The state of a picture that was begun, so that it can go on later to the same bytes.
//!
//! ```text
//! radiosity film 2\n
//! one line of JSON: settings, rounds, rays\n
//! Σ of the means of rounds, by pixels, bands and streams: doubles, little-endian
//! ```
//!
//! Settings are those that samples depend on, each as text under the name of its flag; a file whose settings are others is refused.

use std::path::Path;

use radiosity_core::Cost;
use radiosity_io::{WriteError, write_atomically};
use radiosity_render::Film;
use radiosity_render::numbers::STREAMS;
use serde_json::{Value, json};

use crate::Failure;

/// First line of every such file.
const MAGIC: &str = "radiosity film 2";

/// Bytes of a pixel and band.
const WIDTH: usize = 8 * STREAMS;

/// Names and values of what samples depend on.
pub type Settings = Vec<(&'static str, String)>;

/// Writes what `film` has so far.
pub fn write(path: &Path, film: &Film, settings: &Settings) -> Result<(), WriteError> {
    let named: serde_json::Map<_, _> =
        settings.iter().map(|(name, value)| ((*name).to_owned(), value.as_str().into())).collect();
    let header = json!({ "settings": named, "rounds": film.rounds, "rays": film.cost.rays });
    write_atomically(path, |out| {
        writeln!(out, "{MAGIC}\n{header}")?;
        for value in film.state().iter().flatten() {
            out.write_all(&value.to_le_bytes())?;
        }
        Ok(())
    })
}

/// Reads a film of this size, if it was made with these settings.
pub fn read(path: &Path, [width, height]: [u32; 2], bands: usize, settings: &Settings) -> Result<Film, Failure> {
    let name = path.display();
    let bytes = std::fs::read(path)
        .map_err(|error| format!("{name}: cannot be read ({error}); leave out --resume to begin anew"))?;
    let damaged = |why: &str| format!("{name}: {why}; leave out --resume to begin anew");
    let mut parts = bytes.splitn(3, |byte| *byte == b'\n');
    if parts.next() != Some(MAGIC.as_bytes()) {
        return Err(damaged("it holds no state of a picture").into());
    }
    let header: Value = parts
        .next()
        .and_then(|line| serde_json::from_slice(line).ok())
        .ok_or_else(|| damaged("its second line is no JSON"))?;
    for (key, value) in settings {
        let stored = header["settings"][key].as_str().unwrap_or("nothing");
        if stored != value {
            return Err(damaged(&format!("it was made with another {key} ({stored}, not {value})")).into());
        }
    }
    let count = |key: &str| header[key].as_u64().ok_or_else(|| damaged(&format!("its count of {key} is missing")));
    let (rounds, rays) = (count("rounds")?, count("rays")?);
    let values = parts.next().unwrap_or_default();
    let len = width as usize * height as usize * bands;
    if values.len() != WIDTH * len {
        let why = format!("it holds {} bytes of sums, not {}", values.len(), WIDTH * len);
        return Err(damaged(&why).into());
    }
    let value = |bytes: &[u8]| f64::from_le_bytes(bytes.try_into().expect("chunks of eight bytes"));
    let sums = |bytes: &[u8]| std::array::from_fn(|s| value(&bytes[8 * s..8 * s + 8]));
    let state = values.chunks_exact(WIDTH).map(sums).collect();
    Ok(Film::resume(width, height, bands, rounds, state, Cost { rays, ..Cost::default() }))
}
