//! The order in which the pixels of a picture are drawn.

/// Side of a tile, pixels.
const TILE: usize = 1 << TILE_BITS;
const TILE_BITS: usize = 5;

/// All pixels of a picture, counted row by row: tile by tile, and in each tile along a Z-order curve (Morton 1966). Pixels
/// drawn together then look at one place of the field, whose table entries come from cache.
pub fn in_tiles(width: usize, height: usize) -> impl Iterator<Item = usize> {
    let corners = move |top| (0..width).step_by(TILE).map(move |left| (left, top));
    (0..height).step_by(TILE).flat_map(corners).flat_map(move |(left, top)| {
        Z_ORDER.iter().filter_map(move |&[right, down]| {
            let (u, v) = (left + right as usize, top + down as usize);
            (u < width && v < height).then_some(v * width + u)
        })
    })
}

/// Columns and rows of the pixels of a tile: the even and the odd bits of their number.
static Z_ORDER: [[u8; 2]; TILE * TILE] = {
    let mut order = [[0; 2]; TILE * TILE];
    let mut i = 0;
    while i < TILE * TILE {
        let mut bit = 0;
        while bit < TILE_BITS {
            order[i][0] |= ((i >> (2 * bit) & 1) << bit) as u8;
            order[i][1] |= ((i >> (2 * bit + 1) & 1) << bit) as u8;
            bit += 1;
        }
        i += 1;
    }
    order
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pixel_comes_once() {
        for (width, height) in [(1, 1), (32, 32), (33, 31), (160, 120), (5, 200)] {
            let mut pixels: Vec<usize> = in_tiles(width, height).collect();
            pixels.sort_unstable();
            assert!(pixels.into_iter().eq(0..width * height), "{width}x{height}");
        }
    }

    #[test]
    fn sixteen_pixels_are_a_square_of_neighbours() {
        let pixels: Vec<usize> = in_tiles(100, 64).collect();
        // The last column of tiles is cut off.
        for square in pixels[..3 * 1024].chunks(16) {
            let range = |of: fn(usize) -> usize| {
                let places = square.iter().map(|&pixel| of(pixel));
                places.clone().max().unwrap() - places.min().unwrap()
            };
            assert_eq!((range(|pixel| pixel % 100), range(|pixel| pixel / 100)), (3, 3), "{square:?}");
        }
    }
}
