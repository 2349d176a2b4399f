//! One surface seen flat: a picture of its cells.

use crate::Image;

/// A picture of `columns` × `rows` cells, each `side` × `side` pixels of the colour that `colour(i, j)` gives.
///
/// i runs to the right and j upwards, as the cells of a surface do along its first and its last edge.
pub fn flat_picture(columns: u32, rows: u32, side: u32, mut colour: impl FnMut(u32, u32) -> [u8; 3]) -> Image {
    let mut image = Image::filled(columns * side, rows * side, [0; 3]);
    for (i, j) in (0..rows).flat_map(|j| (0..columns).map(move |i| (i, j))) {
        let (cell, left, top) = (colour(i, j), i * side, (rows - 1 - j) * side);
        for (x, y) in (0..side).flat_map(|y| (0..side).map(move |x| (x, y))) {
            image.set(left + x, top + y, cell);
        }
    }
    image
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_cell_lies_at_the_lower_left() {
        let image = flat_picture(3, 2, 4, |i, j| [i as u8, j as u8, 7]);
        assert_eq!((image.width, image.height), (12, 8));
        assert_eq!((image.pixel(0, 7), image.pixel(11, 0), image.pixel(4, 3)), ([0, 0, 7], [2, 1, 7], [1, 1, 7]));
    }
}
