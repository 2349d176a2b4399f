//! Pictures as OpenEXR.

use std::io::Cursor;
use std::path::Path;

use image::{ExtendedColorType, ImageEncoder, ImageFormat, ImageReader, codecs::openexr::OpenExrEncoder};

use crate::png::io_error;
use crate::{ReadError, WriteError, write_atomically};

/// A linear picture in single precision.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearPicture {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Red, green and blue of every pixel, rows from the top.
    pub rgb: Vec<[f32; 3]>,
}

/// Reads a picture; what is in it beside red, green and blue is left out.
///
/// # Errors
///
/// [`ReadError::File`] if the file cannot be read, [`ReadError::Picture`] if it is no such picture.
pub fn read_exr(path: &Path) -> Result<LinearPicture, ReadError> {
    let bytes = std::fs::read(path).map_err(|source| ReadError::File { path: path.to_owned(), source })?;
    let picture = ImageReader::with_format(Cursor::new(bytes), ImageFormat::OpenExr).decode();
    let picture = picture.map_err(|fault| ReadError::Picture { path: path.to_owned(), fault: fault.to_string() })?;
    let picture = picture.into_rgb32f();
    Ok(LinearPicture { width: picture.width(), height: picture.height(), rgb: picture.pixels().map(|p| p.0).collect() })
}

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
        assert_eq!(read_exr(&path).unwrap(), LinearPicture { width: 5, height: 3, rgb });
    }

    #[test]
    fn what_is_no_picture_is_an_error_that_names_the_file() {
        let folder = Folder::new("exr-broken");
        let path = folder.0.join("broken.exr");
        assert!(matches!(read_exr(&path), Err(ReadError::File { .. })));
        let picture = folder.0.join("picture.exr");
        write_exr(&picture, 3, 2, &[[1.0, 2.0, 3.0]; 6]).unwrap();
        let whole = std::fs::read(&picture).unwrap();
        for bytes in [&b""[..], b"no picture", &whole[..whole.len() / 2], &whole[..whole.len() - 3]] {
            std::fs::write(&path, bytes).unwrap();
            let error = read_exr(&path).unwrap_err();
            assert!(matches!(error, ReadError::Picture { .. }) && error.to_string().contains("broken.exr"), "{error}");
        }
    }

    #[test]
    fn a_picture_without_pixels_is_refused() {
        let folder = Folder::new("exr-empty");
        assert!(matches!(write_exr(&folder.0.join("p.exr"), 3, 0, &[]), Err(WriteError::Picture { .. })));
    }
}
