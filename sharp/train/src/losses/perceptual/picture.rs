//! Conversion of pictures to a network's input, and of gradients back.

use sharp::random::SplitMix64;

/// Mean of ImageNet's channels, which is subtracted from both networks' inputs.
const MEAN: [f32; 3] = [0.485, 0.456, 0.406];
/// Standard deviation of ImageNet's channels, by which both networks' inputs are divided.
const DEVIATION: [f32; 3] = [0.229, 0.224, 0.225];

/// Region of a picture that is compared.
pub(super) struct Region {
    /// Rows and columns of the whole picture.
    whole: [usize; 2],
    /// Row and column of the region's first pixel.
    from: [usize; 2],
    /// Rows and columns of the region.
    pub(super) size: [usize; 2],
}

impl Region {
    /// A random square of side `crop`, limited to the picture; without `crop`, the whole picture.
    pub(super) fn new(whole: [usize; 2], crop: Option<usize>, seed: u64) -> Self {
        let size = whole.map(|side| crop.map_or(side, |crop| crop.min(side)));
        let mut random = SplitMix64::new(seed);
        let from = [0, 1].map(|axis: usize| {
            let places = whole[axis] - size[axis] + 1;
            random.below(places as u64) as usize
        });
        Self { whole, from, size }
    }

    /// Indices of the region's row `y` in the whole picture.
    fn row(&self, y: usize) -> std::ops::Range<usize> {
        let start = (self.from[0] + y) * self.whole[1] + self.from[1];
        start..start + self.size[1]
    }

    pub(super) fn cut<T: Copy>(&self, picture: &[T]) -> Vec<T> {
        let rows = (0..self.size[0]).flat_map(|y| &picture[self.row(y)]);
        rows.copied().collect()
    }

    /// Inverse of [`cut`](Self::cut), with zeros outside the region.
    pub(super) fn paste<T: Copy + Default>(&self, part: &[T]) -> Vec<T> {
        let mut out = vec![T::default(); self.whole[0] * self.whole[1]];
        for (y, row) in part.chunks_exact(self.size[1]).enumerate() {
            out[self.row(y)].copy_from_slice(row);
        }
        out
    }
}

/// Input of a network; black outside `mask`.
pub(super) fn normalized(picture: &[[f32; 3]], mask: Option<&[bool]>) -> Vec<f32> {
    let pixel = |(p, rgb): (usize, &[f32; 3])| {
        let kept = mask.is_none_or(|mask| mask[p]);
        [0, 1, 2].map(|c: usize| (if kept { rgb[c] } else { 0.0 } - MEAN[c]) / DEVIATION[c])
    };
    picture.iter().enumerate().flat_map(pixel).collect()
}

/// Converts the gradient with respect to a network's input to one with respect to the picture.
pub(super) fn denormalized(gradient: &[f32], mask: Option<&[bool]>) -> Vec<[f32; 3]> {
    let (pixels, _) = gradient.as_chunks::<3>();
    let pixel = |(p, of): (usize, &[f32; 3])| {
        let kept = mask.is_none_or(|mask| mask[p]);
        [0, 1, 2].map(|c: usize| if kept { of[c] / DEVIATION[c] } else { 0.0 })
    };
    pixels.iter().enumerate().map(pixel).collect()
}

/// Resizes a mask to a layer: for each pixel of the layer, the fraction of kept pixels in the area
/// that it covers.
pub(super) fn shrunk(mask: &[bool], from: [usize; 2], to: [usize; 2]) -> Vec<f32> {
    let covers = |axis: usize, i: usize| {
        let start = i * from[axis] / to[axis];
        start..((i + 1) * from[axis] / to[axis]).max(start + 1)
    };
    let share = |i: usize| {
        let (rows, columns) = (covers(0, i / to[1]), covers(1, i % to[1]));
        let count = rows.len() * columns.len();
        let kept = rows.flat_map(|y| &mask[y * from[1]..][columns.clone()]);
        kept.filter(|kept| **kept).count() as f32 / count as f32
    };
    (0..to[0] * to[1]).map(share).collect()
}
