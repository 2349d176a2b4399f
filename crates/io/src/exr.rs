//! Pictures as OpenEXR.

use std::io::Cursor;
use std::path::Path;

use image::{ExtendedColorType, ImageEncoder, codecs::openexr::OpenExrEncoder};

use crate::png::io_error;
use crate::{WriteError, write_atomically};

/// Writes a linear picture in single precision; `rgb` holds red, green and blue of every pixel, rows from the top.
///
/// # Errors
///
/// [`WriteError::Picture`] if the picture has no pixel, [`WriteError::File`] if the file cannot be written.
///
/// # Panics
///
/// If `rgb` does not hold width · height pixels.
pub fn write_exr(path: &Path, width: u32, height: u32, rgb: &[[f32; 3]]) -> Result<(), WriteError> {
    let pixels = u64::from(width) * u64::from(height);
    assert_eq!(rgb.len() as u64, pixels, "pixels of a picture of {width} × {height}");
    if pixels == 0 {
        return Err(WriteError::Picture { path: path.to_owned(), width, height });
    }
    write_atomically(path, |out| {
        let bytes: Vec<u8> = rgb.iter().flatten().flat_map(|value| value.to_ne_bytes()).collect();
        // The encoder goes back to fill in where lines begin.
        let mut file = Cursor::new(Vec::new());
        OpenExrEncoder::new(&mut file)
            .write_image(&bytes, width, height, ExtendedColorType::Rgb32F)
            .map_err(io_error)?;
        out.write_all(file.get_ref())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atomic::tests::Folder;

    /// Values far beyond 0 to 1, which an 8-bit picture would cut off.
    #[test]
    fn a_picture_reads_back_to_the_last_bit() {
        let folder = Folder::new("exr");
        let path = folder.0.join("picture.exr");
        let rgb: Vec<[f32; 3]> = (0..5 * 3).map(|k| [1e6 / (k as f32 + 0.3), k as f32, 1e-7 * k as f32]).collect();
        write_exr(&path, 5, 3, &rgb).unwrap();
        let read = image::open(&path).unwrap().into_rgb32f();
        assert_eq!((read.dimensions(), read.into_raw()), ((5, 3), rgb.concat()));
    }

    #[test]
    fn a_picture_without_pixels_is_refused() {
        let folder = Folder::new("exr-empty");
        assert!(matches!(write_exr(&folder.0.join("p.exr"), 3, 0, &[]), Err(WriteError::Picture { .. })));
    }
}
