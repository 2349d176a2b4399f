//! Pictures in memory.

/// An 8-bit picture in sRGB, three bytes a pixel, rows from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// 3 · width · height bytes.
    pub rgb: Vec<u8>,
}

impl Image {
    /// A picture of one colour.
    pub fn filled(width: u32, height: u32, colour: [u8; 3]) -> Self {
        let pixels = width as usize * height as usize;
        Self { width, height, rgb: colour.repeat(pixels) }
    }

    /// The pixel in column `x` of row `y`.
    ///
    /// # Panics
    ///
    /// If there is no such pixel.
    pub fn pixel(&self, x: u32, y: u32) -> [u8; 3] {
        let at = self.place(x, y);
        [self.rgb[at], self.rgb[at + 1], self.rgb[at + 2]]
    }

    /// Sets the pixel in column `x` of row `y`.
    ///
    /// # Panics
    ///
    /// If there is no such pixel.
    pub fn set(&mut self, x: u32, y: u32, colour: [u8; 3]) {
        let at = self.place(x, y);
        self.rgb[at..at + 3].copy_from_slice(&colour);
    }

    /// Every pixel as a square of `factor` × `factor`.
    #[must_use]
    pub fn enlarged(&self, factor: u32) -> Self {
        let mut image = Self::filled(self.width * factor, self.height * factor, [0; 3]);
        let (width, height) = (image.width, image.height);
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            image.set(x, y, self.pixel(x / factor, y / factor));
        }
        image
    }

    /// Rows of pictures, each from left to right, `gap` black pixels apart.
    pub fn sheet(rows: &[Vec<&Self>], gap: u32) -> Self {
        let spaced =
            |lengths: &mut dyn Iterator<Item = u32>| lengths.fold(0, |sum, l| if sum == 0 { l } else { sum + gap + l });
        let height = |row: &Vec<&Self>| row.iter().map(|i| i.height).max().unwrap_or(0);
        let width = rows.iter().map(|row| spaced(&mut row.iter().map(|i| i.width))).max().unwrap_or(0);
        let mut sheet = Self::filled(width, spaced(&mut rows.iter().map(height)), [0; 3]);
        let mut top = 0;
        for row in rows {
            let mut left = 0;
            for image in row {
                for (x, y) in (0..image.height).flat_map(|y| (0..image.width).map(move |x| (x, y))) {
                    sheet.set(left + x, top + y, image.pixel(x, y));
                }
                left += image.width + gap;
            }
            top += height(row) + gap;
        }
        sheet
    }

    fn place(&self, x: u32, y: u32) -> usize {
        assert!(x < self.width && y < self.height, "pixel ({x}, {y}) of {} × {}", self.width, self.height);
        3 * (y as usize * self.width as usize + x as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_of_a_sheet_lie_where_their_rows_say() {
        let [a, b, c] = [([1; 3], (3, 5)), ([2; 3], (2, 4)), ([3; 3], (7, 1))]
            .map(|(colour, (width, height))| Image::filled(width, height, colour));
        let sheet = Image::sheet(&[vec![&a, &b], vec![&c]], 2);
        assert_eq!((sheet.width, sheet.height), (7, 5 + 2 + 1));
        let at = |x: u32, y: u32| sheet.pixel(x, y)[0];
        assert_eq!([at(2, 4), at(3, 0), at(5, 3), at(6, 4), at(0, 6), at(6, 7)], [1, 0, 2, 0, 0, 3]);
        let count = |k: u8| sheet.rgb.chunks(3).filter(|p| p[0] == k).count();
        assert_eq!([count(1), count(2), count(3)], [15, 8, 7]);
    }

    #[test]
    fn an_enlarged_picture_shows_every_pixel_as_a_square() {
        let mut image = Image::filled(2, 3, [0; 3]);
        image.set(1, 2, [9, 8, 7]);
        let large = image.enlarged(4);
        assert_eq!((large.width, large.height), (8, 12));
        let set = large.rgb.chunks(3).filter(|p| *p == [9, 8, 7]).count();
        assert_eq!((set, large.pixel(4, 8), large.pixel(7, 11)), (16, [9, 8, 7], [9, 8, 7]));
    }
}
