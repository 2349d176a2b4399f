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

    fn place(&self, x: u32, y: u32) -> usize {
        assert!(x < self.width && y < self.height, "pixel ({x}, {y}) of {} × {}", self.width, self.height);
        3 * (y as usize * self.width as usize + x as usize)
    }
}
