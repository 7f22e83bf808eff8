//! Base Gaussians from an image and its depth layers, before any learned refinement.
//!
//! Depth is normalised so that its nearest point is at 1, and clamped to 100. Every block of
//! `stride × stride` pixels of every layer becomes one Gaussian at the block's nearest depth. The
//! network refines these Gaussians; the `depth-splat` method renders them unchanged.

#[cfg(feature = "render")]
mod backward;

#[cfg(feature = "render")]
pub use backward::{BaseGradient, backward};

/// Maximum normalised depth; points farther than this multiple of the nearest depth are clamped.
pub const MAX_NORMALIZED_DEPTH: f32 = 100.0;

/// Errors of building base Gaussians.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum InitializerError {
    /// A slice does not have the length that its shape requires.
    #[error("{what} has {found} values instead of {expected}")]
    Length {
        what: &'static str,
        expected: usize,
        found: usize,
    },
    /// A side is zero or not a multiple of the stride, or there are no layers.
    #[error("a grid of {0:?} is empty or cannot be divided into whole blocks")]
    Grid(Grid),
    /// A predictor's depth is NaN, infinite or not positive.
    #[error("{count} of {total} depth values are not finite positive numbers")]
    InvalidDepth { count: usize, total: usize },
    #[error("no valid depth: none of {total} values is finite and positive")]
    NoValidDepth { total: usize },
}

/// Dimensions of image, depth layers and grid of Gaussians.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Grid {
    /// Number of depth layers; 2 in the SHARP release.
    pub layers: usize,
    /// Width of image and depth in pixels; the SHARP release resizes every image to 1536.
    pub width: usize,
    /// Height of image and depth in pixels.
    pub height: usize,
    /// Side of a block in pixels; 2 in the SHARP release.
    pub stride: usize,
}

impl Grid {
    /// The SHARP release's grid: two layers of 768 × 768 Gaussians over 1536 × 1536 pixels.
    pub const RELEASE: Self = Self {
        layers: 2,
        width: 1536,
        height: 1536,
        stride: 2,
    };

    /// Number of blocks along x.
    pub fn columns(&self) -> usize {
        self.width / self.stride
    }

    /// Number of blocks along y.
    pub fn rows(&self) -> usize {
        self.height / self.stride
    }

    pub fn pixels(&self) -> usize {
        self.width * self.height
    }

    /// Number of blocks per layer.
    pub fn blocks(&self) -> usize {
        self.columns() * self.rows()
    }

    /// Standard deviation of a Gaussian at depth 1. Depends only on the picture's width, even if
    /// the picture is not square.
    fn size_at_unit_depth(&self) -> f32 {
        2.0 * self.stride as f32 / self.width as f32
    }

    fn check(&self, image: &[f32], depth: &[f32]) -> Result<(), InitializerError> {
        self.check_blocks()?;
        check_length("image", 3 * self.pixels(), image)?;
        check_length("depth", self.layers * self.pixels(), depth)
    }

    fn check_blocks(&self) -> Result<(), InitializerError> {
        let Self {
            layers,
            width,
            height,
            stride,
        } = *self;
        if layers == 0
            || stride == 0
            || width == 0
            || height == 0
            || !width.is_multiple_of(stride)
            || !height.is_multiple_of(stride)
        {
            return Err(InitializerError::Grid(*self));
        }
        Ok(())
    }
}

fn check_length(
    what: &'static str,
    expected: usize,
    values: &[f32],
) -> Result<(), InitializerError> {
    let found = values.len();
    if found == expected {
        return Ok(());
    }
    Err(InitializerError::Length {
        what,
        expected,
        found,
    })
}

/// Treatment of depth values that are NaN, infinite, zero or negative.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InvalidDepth {
    /// Invalid values are an error: predictors never produce them.
    Refuse,
    /// For measured depth, which has holes: minimum and pooling use valid pixels only, and blocks
    /// without a valid pixel are omitted.
    Skip,
}

/// Depth scaled so that the nearest valid value over all layers is 1.
#[derive(Debug, Clone, PartialEq)]
pub struct NormalizedDepth {
    /// `min(depth · factor, 100)`, `[layers, height, width]`; 0 for invalid depth.
    pub depth: Vec<f32>,
    /// `1 / (nearest + 1e-6)`, in 1/m.
    pub factor: f32,
}

impl NormalizedDepth {
    /// Normalises metric depth `[layers, height, width]` in metres.
    ///
    /// # Errors
    /// [`InitializerError::InvalidDepth`] for invalid values with [`InvalidDepth::Refuse`];
    /// [`InitializerError::NoValidDepth`] if no value is valid.
    pub fn new(depth: &[f32], invalid: InvalidDepth) -> Result<Self, InitializerError> {
        let total = depth.len();
        let (mut nearest, mut valid) = (f32::INFINITY, 0);
        for &d in depth.iter().filter(|d| is_valid(**d)) {
            nearest = nearest.min(d);
            valid += 1;
        }
        if valid < total && invalid == InvalidDepth::Refuse {
            let count = total - valid;
            return Err(InitializerError::InvalidDepth { count, total });
        }
        if valid == 0 {
            return Err(InitializerError::NoValidDepth { total });
        }
        let factor = 1.0 / (nearest + 1e-6);
        let normalize = |&d: &f32| {
            if is_valid(d) {
                (d * factor).min(MAX_NORMALIZED_DEPTH)
            } else {
                0.0
            }
        };
        Ok(Self {
            depth: depth.iter().map(normalize).collect(),
            factor,
        })
    }

    /// Factor from lengths in the normalised space to metres, `1 / factor`.
    pub fn global_scale(&self) -> f32 {
        1.0 / self.factor
    }

    /// Input of the refinement network: `2 · (r, g, b, 1/depth…) − 1`, `[3 + layers, height, width]`. `image` is `[3,
    /// height, width]`, sRGB in 0..1.
    pub fn feature_input(&self, image: &[f32]) -> Vec<f32> {
        let colors = image.iter().map(|&c| 2.0 * c - 1.0);
        let inverse = self.depth.iter().map(|&d| 2.0 * (1.0 / d) - 1.0);
        colors.chain(inverse).collect()
    }
}

fn is_valid(depth: f32) -> bool {
    depth.is_finite() && depth > 0.0
}

/// One Gaussian per block and layer, in the normalised space: x/z and y/z over [−1, 1] across the image, nearest depth
/// 1.
#[derive(Debug, Clone, PartialEq)]
pub struct BaseGaussians {
    /// Dimensions of the inputs.
    pub grid: Grid,
    /// x/z of the block centres `[columns]`.
    pub x: Vec<f32>,
    /// y/z of the block centres `[rows]`.
    pub y: Vec<f32>,
    /// Inverse normalised depth `[layers, rows, columns]` in 0.01..1; 0 for a block without valid pixels, which the
    /// composer omits.
    pub inverse_depth: Vec<f32>,
    /// Isotropic standard deviation `[layers, rows, columns]`; 0 for a block without valid pixels.
    pub scales: Vec<f32>,
    /// sRGB-encoded block means `[3, rows, columns]`, shared by all layers.
    pub colors: Vec<f32>,
    /// `min(1 / layers, ½)`, shared by all Gaussians.
    pub opacity: f32,
    /// Metres per normalised unit.
    pub global_scale: f32,
}

impl BaseGaussians {
    /// Builds base Gaussians from `image` (`[3, height, width]`, sRGB-encoded in 0..1) and metric `depth` (`[layers,
    /// height, width]`, in metres).
    ///
    /// Colours are means over all pixels of a block, because pictures have no invalid pixels.
    ///
    /// # Errors
    /// [`InitializerError`]: inconsistent shapes, invalid depth with [`InvalidDepth::Refuse`], or no valid depth at
    /// all.
    pub fn new(
        image: &[f32],
        depth: &[f32],
        grid: Grid,
        invalid: InvalidDepth,
    ) -> Result<Self, InitializerError> {
        grid.check(image, depth)?;
        let normalized = NormalizedDepth::new(depth, invalid)?;
        Self::from_normalized(image, &normalized, grid)
    }

    /// Like [`Self::new`], for depth that is already normalised.
    ///
    /// # Errors
    /// [`InitializerError::Grid`] for an empty or indivisible grid; [`InitializerError::Length`] if an input does not
    /// fill the grid.
    pub fn from_normalized(
        image: &[f32],
        normalized: &NormalizedDepth,
        grid: Grid,
    ) -> Result<Self, InitializerError> {
        grid.check(image, &normalized.depth)?;
        let inverse_depth = pool(&normalized.depth, grid, |block| {
            // The largest inverse depth is the nearest surface; 0 means that the block has no valid pixel.
            block
                .filter(|&d| d > 0.0)
                .fold(0.0, |largest, d| f32::max(largest, 1.0 / d))
        });
        let size_at_unit_depth = grid.size_at_unit_depth();
        let scales = inverse_depth
            .iter()
            .map(|&inverse| {
                if inverse > 0.0 {
                    (1.0 / inverse) * size_at_unit_depth
                } else {
                    0.0
                }
            })
            .collect();
        let area = (grid.stride * grid.stride) as f32;
        Ok(Self {
            grid,
            x: block_centers(grid.width, grid.stride),
            y: block_centers(grid.height, grid.stride),
            inverse_depth,
            scales,
            colors: pool(image, grid, |block| block.sum::<f32>() / area),
            opacity: (1.0 / grid.layers as f32).min(0.5),
            global_scale: normalized.global_scale(),
        })
    }

    /// Number of blocks, over all layers, that have no valid depth and therefore no Gaussian.
    pub fn dropped(&self) -> usize {
        self.inverse_depth.iter().filter(|&&v| v == 0.0).count()
    }
}

/// Centres of the blocks along one side, scaled to [−1, 1]; block k is centred at pixel coordinate `stride · (k + ½)`.
fn block_centers(side: usize, stride: usize) -> Vec<f32> {
    (0..side / stride)
        .map(|k| 2.0 * (stride as f32 * (k as f32 + 0.5)) / side as f32 - 1.0)
        .collect()
}

/// Reduces every `stride × stride` block of every plane to one value. `reduce` receives the pixels of a block row by
/// row.
fn pool(
    planes: &[f32],
    grid: Grid,
    reduce: impl Fn(&mut dyn Iterator<Item = f32>) -> f32,
) -> Vec<f32> {
    let Grid { width, stride, .. } = grid;
    let mut out = Vec::with_capacity(planes.len() / (stride * stride));
    for plane in planes.chunks_exact(grid.pixels()) {
        for row in 0..grid.rows() {
            for column in 0..grid.columns() {
                let corner = row * stride * width + column * stride;
                let mut block = (0..stride)
                    .flat_map(|dy| &plane[corner + dy * width..][..stride])
                    .copied();
                out.push(reduce(&mut block));
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: Grid = Grid {
        layers: 2,
        width: 4,
        height: 2,
        stride: 2,
    };

    #[rustfmt::skip]
    const DEPTH: [f32; 16] = [
        2.0, 3.0, 4.0, 8.0,
        5.0, 6.0, 9.0, 8.0,
        4.0, 4.0, 1e6, 1e6,
        4.0, 4.0, 1e6, 1e6,
    ];

    fn image() -> Vec<f32> {
        (0..24).map(|k| k as f32 / 24.0).collect()
    }

    #[test]
    fn nearest_depth_of_both_layers_is_one_and_the_farthest_a_hundred() {
        let n = NormalizedDepth::new(&DEPTH, InvalidDepth::Refuse).unwrap();
        assert_eq!(n.factor, 1.0 / (2.0 + 1e-6));
        assert!((n.depth[0] - 1.0).abs() < 1e-6);
        assert_eq!(n.depth[10], MAX_NORMALIZED_DEPTH);
        let mut second_nearest = DEPTH;
        second_nearest[8] = 0.5;
        let n = NormalizedDepth::new(&second_nearest, InvalidDepth::Refuse).unwrap();
        assert_eq!(n.factor, 1.0 / (0.5 + 1e-6));
    }

    #[test]
    fn blocks_take_nearest_depth_and_mean_colour() {
        let base = BaseGaussians::new(&image(), &DEPTH, GRID, InvalidDepth::Refuse).unwrap();
        let factor = 1.0 / (2.0 + 1e-6_f32);
        let expected = [2.0, 4.0, 4.0, f32::INFINITY]
            .map(|d: f32| 1.0 / (d * factor).min(MAX_NORMALIZED_DEPTH));
        assert_eq!(base.inverse_depth, expected);
        assert_eq!(base.x, [-0.5, 0.5]);
        assert_eq!(base.y, [0.0]);
        assert_eq!(base.opacity, 0.5);
        assert!((base.scales[3] - 100.0 * 4.0 / 4.0).abs() < 1e-4);
        assert!((base.colors[0] - (0.0 + 1.0 + 4.0 + 5.0) / 96.0).abs() < 1e-7);
        assert_eq!(base.dropped(), 0);
    }

    #[test]
    fn features_are_image_and_inverse_depth_in_minus_one_to_one() {
        let n = NormalizedDepth::new(&DEPTH, InvalidDepth::Refuse).unwrap();
        let features = n.feature_input(&image());
        assert_eq!(features.len(), 5 * GRID.pixels());
        assert_eq!(features[0], -1.0);
        assert!((features[24] - 1.0).abs() < 1e-5);
        assert!((features[24 + 10] - (2.0 * 0.01 - 1.0)).abs() < 1e-6);
    }

    #[test]
    fn holes_are_skipped_or_refused() {
        let mut holed = DEPTH;
        holed[0] = 0.0;
        holed[2..4].fill(f32::NAN);
        holed[6..8].fill(f32::INFINITY);
        let refused = BaseGaussians::new(&image(), &holed, GRID, InvalidDepth::Refuse);
        assert_eq!(
            refused.unwrap_err(),
            InitializerError::InvalidDepth {
                count: 5,
                total: 16
            }
        );
        let base = BaseGaussians::new(&image(), &holed, GRID, InvalidDepth::Skip).unwrap();
        assert_eq!(base.dropped(), 1);
        assert_eq!(base.inverse_depth[1], 0.0);
        // The nearest valid value of the first block is now 3, which is also the nearest of the
        // whole picture.
        assert!((base.inverse_depth[0] - 1.0).abs() < 1e-6);
        assert!((base.global_scale - 3.0).abs() < 1e-5);
    }

    #[test]
    fn nothing_valid_and_wrong_shapes_are_errors() {
        let none = BaseGaussians::new(&image(), &[0.0; 16], GRID, InvalidDepth::Skip);
        assert_eq!(
            none.unwrap_err(),
            InitializerError::NoValidDepth { total: 16 }
        );
        let short = BaseGaussians::new(&image(), &DEPTH[1..], GRID, InvalidDepth::Skip);
        assert!(matches!(
            short,
            Err(InitializerError::Length { what: "depth", .. })
        ));
        let odd = Grid { stride: 3, ..GRID };
        assert!(matches!(
            BaseGaussians::new(&image(), &DEPTH, odd, InvalidDepth::Skip),
            Err(InitializerError::Grid(_))
        ));
    }
}
