//! Pictures as PNG.

use std::path::Path;

use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};

use crate::{WriteError, write_atomically};

/// Writes an 8-bit RGB picture; `rgb` holds three bytes a pixel, rows from the top, sRGB as screens expect it.
///
/// # Errors
///
/// [`WriteError::Picture`] if the picture has no pixel, [`WriteError::File`] if the file cannot be written.
///
/// # Panics
///
/// If `rgb` does not hold 3 · width · height bytes.
pub fn write_png(path: &Path, width: u32, height: u32, rgb: &[u8]) -> Result<(), WriteError> {
    let bytes = 3 * u64::from(width) * u64::from(height);
    assert_eq!(rgb.len() as u64, bytes, "bytes of a picture of {width} × {height} pixels");
    if bytes == 0 {
        return Err(WriteError::Picture { path: path.to_owned(), width, height });
    }
    write_atomically(path, |out| {
        PngEncoder::new(out).write_image(rgb, width, height, ExtendedColorType::Rgb8).map_err(io_error)
    })
}

/// What stopped an encoder.
pub(crate) fn io_error(error: image::ImageError) -> std::io::Error {
    match error {
        image::ImageError::IoError(e) => e,
        e => std::io::Error::other(e),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atomic::tests::Folder;

    #[test]
    fn a_picture_reads_back_to_the_same_bytes() {
        let folder = Folder::new("png");
        let path = folder.0.join("picture.png");
        let rgb: Vec<u8> = (0..5 * 3 * 3).map(|k| (k * 5) as u8).collect();
        write_png(&path, 5, 3, &rgb).unwrap();
        let read = image::open(&path).unwrap().into_rgb8();
        assert_eq!((read.dimensions(), read.into_raw()), ((5, 3), rgb));
    }

    #[test]
    fn a_picture_without_pixels_is_refused() {
        let folder = Folder::new("png-empty");
        assert!(matches!(write_png(&folder.0.join("p.png"), 0, 3, &[]), Err(WriteError::Picture { .. })));
    }
}
