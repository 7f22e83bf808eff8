//! Rectangles of tiles that are binned and rasterised together.

/// Minimum side of a tile in pixels: the side of the squares that `raster` processes.
pub(super) const MIN_TILE: u32 = 8;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct SubFrame {
    /// Column and row of the first tile.
    pub(super) first: (u32, u32),
    /// Number of columns and rows of tiles.
    pub(super) tiles: (u32, u32),
    /// Side of a tile in pixels.
    pub(super) side: u32,
}

impl SubFrame {
    /// The sub-frame of all tiles of a picture.
    pub(super) fn whole(width: u32, height: u32, side: u32) -> Self {
        Self {
            first: (0, 0),
            tiles: (width.div_ceil(side), height.div_ceil(side)),
            side,
        }
    }

    /// Splits the longer side in half; `None` for a single tile.
    pub(super) fn halves(self) -> Option<[Self; 2]> {
        let (x, y) = self.tiles;
        if x * y == 1 {
            return None;
        }
        let (mut a, mut b) = (self, self);
        if x > y {
            a.tiles.0 = x / 2;
            b.tiles.0 = x - x / 2;
            b.first.0 += x / 2;
        } else {
            a.tiles.1 = y / 2;
            b.tiles.1 = y - y / 2;
            b.first.1 += y / 2;
        }
        Some([a, b])
    }

    pub(super) fn count(self) -> u32 {
        self.tiles.0 * self.tiles.1
    }

    /// Width and height in pixels, in whole tiles.
    pub(super) fn size(self) -> (u32, u32) {
        (self.tiles.0 * self.side, self.tiles.1 * self.side)
    }

    /// Column and row of the first pixel.
    pub(super) fn corner(self) -> (u32, u32) {
        (self.first.0 * self.side, self.first.1 * self.side)
    }

    pub(super) fn pixels(self) -> u64 {
        let (width, height) = self.size();
        u64::from(width) * u64::from(height)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halving_covers_every_tile_once_and_ends() {
        let mut seen = [[0; 9]; 5];
        let mut waiting = vec![SubFrame {
            first: (2, 3),
            tiles: (9, 5),
            side: 8,
        }];
        while let Some(part) = waiting.pop() {
            match part.halves() {
                Some(halves) => waiting.extend(halves),
                None => seen[part.first.1 as usize - 3][part.first.0 as usize - 2] += 1,
            }
        }
        assert_eq!(seen, [[1; 9]; 5]);
    }

    #[test]
    fn tiles_reach_beyond_the_picture() {
        let whole = SubFrame::whole(17, 8, 8);
        assert_eq!((whole.tiles, whole.count()), ((3, 1), 3));
        assert_eq!((whole.size(), whole.pixels()), ((24, 8), 192));
        let [_, right] = whole.halves().unwrap();
        assert_eq!((right.corner(), right.tiles), ((8, 0), (2, 1)));
    }
}
