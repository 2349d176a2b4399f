//! The state of a picture that was begun, so that it can go on later to the same bytes.
//!
//! ```text
//! radiosity film 3\n
//! one line of JSON: settings, rounds, samples, rays, allotment (even or by noise)\n
//! Σ of the means of rounds times their weights, by pixels, bands and streams: doubles, little-endian
//! by noise: nets of samples that every pixel takes in a round: 16 bits each, little-endian
//! ```
//!
//! Settings are those that samples depend on, each as text under the name of its flag; a file whose settings are others is refused.

use std::path::Path;

use radiosity_core::Cost;
use radiosity_io::{WriteError, write_atomically};
use radiosity_render::numbers::{ROUND, STREAMS};
use radiosity_render::{Allotment, Film};
use serde_json::{Value, json};

use crate::Failure;

/// First line of every such file.
const MAGIC: &str = "radiosity film 3";

/// Bytes of a pixel and band.
const WIDTH: usize = 8 * STREAMS;

/// The allotment that is a list.
const BY_NOISE: &str = "by noise";

/// Names and values of what samples depend on.
pub type Settings = Vec<(&'static str, String)>;

/// Writes what `film` has so far.
pub fn write(path: &Path, film: &Film, settings: &Settings) -> Result<(), WriteError> {
    let named: serde_json::Map<_, _> =
        settings.iter().map(|(name, value)| ((*name).to_owned(), value.as_str().into())).collect();
    let (allotment, nets): (_, &[u16]) = match film.allotment() {
        Allotment::Even => ("even", &[]),
        Allotment::ByNoise(nets) => (BY_NOISE, nets),
    };
    let header = json!({
        "settings": named, "rounds": film.rounds, "samples": film.samples, "rays": film.cost.rays, "allotment": allotment,
    });
    write_atomically(path, |out| {
        writeln!(out, "{MAGIC}\n{header}")?;
        for value in film.state().iter().flatten() {
            out.write_all(&value.to_le_bytes())?;
        }
        for count in nets {
            out.write_all(&count.to_le_bytes())?;
        }
        Ok(())
    })
}

/// Reads on where `film`, which has no samples yet, can go on, if the file was made with these settings.
pub fn read(path: &Path, film: Film, settings: &Settings) -> Result<Film, Failure> {
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
    let [rounds, samples, rays] = [count("rounds")?, count("samples")?, count("rays")?];
    let (values, pixels) = (parts.next().unwrap_or_default(), film.width as usize * film.height as usize);
    let sums = WIDTH * pixels * film.bands;
    let expected = sums + if header["allotment"] == BY_NOISE { 2 * pixels } else { 0 };
    if values.len() != expected {
        let why = format!("it holds {} bytes of numbers, not {expected}", values.len());
        return Err(damaged(&why).into());
    }
    let (sums, nets) = values.split_at(sums);
    let value = |bytes: &[u8]| f64::from_le_bytes(bytes.try_into().expect("chunks of eight bytes"));
    let of_streams = |bytes: &[u8]| std::array::from_fn(|s| value(&bytes[8 * s..8 * s + 8]));
    let state = sums.chunks_exact(WIDTH).map(of_streams).collect();
    let allotment = match header["allotment"].as_str() {
        Some("even") => Allotment::Even,
        // A pixel without a net would have no mean.
        Some(BY_NOISE) => {
            Allotment::ByNoise(nets.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]]).max(1)).collect())
        }
        _ => return Err(damaged("it does not say how samples are allotted").into()),
    };
    let least = rounds.saturating_mul(u64::from(ROUND)).saturating_mul(pixels as u64);
    let even = |allotment: &Allotment| *allotment == Allotment::Even;
    if samples < least || (rounds == 0) != (samples == 0) || even(&allotment) != even(film.allotment()) {
        return Err(damaged("its counts do not fit each other").into());
    }
    Ok(film.resume([rounds, samples], state, allotment, Cost { rays, ..Cost::default() }))
}
