//! Findings on a stored picture. Which of them are reported depends on all pictures of a dataset.

use std::collections::BTreeSet;

use glam::{DMat2, DVec2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Maximum number of sources that a sentence names; further sources are only counted.
const MAX_NAMED: usize = 8;

/// Defines an enum of findings, each with the words that state it in a sentence.
macro_rules! worded {
    ($(#[$about:meta])* pub enum $name:ident {
        $($(#[$doc:meta])* $finding:ident $(($measured:ty))? = $text:literal,)+
    }) => {
        $(#[$about])*
        pub enum $name {
            $($(#[$doc])* $finding $(($measured))?,)+
        }

        impl $name {
            /// Completes a sentence that begins with "its pictures" (for changes) or "pictures show" (for targets).
            pub fn text(self) -> &'static str {
                match self {
                    $(Self::$finding { .. } => $text,)+
                }
            }
        }
    };
}

worded! {
    /// How a stored picture was probably altered.
    #[derive(
        Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
    )]
    #[serde(rename_all = "kebab-case")]
    pub enum PictureChange {
        /// The photograph itself was stored.
        Photograph = "are the photographs themselves",
        /// The source's photograph was stored.
        CopiedSource =
            "are copies of the source's photograph, as with the baseline `copy`; if this is not intended, store the \
             predictions",
        /// The picture resembles neither its photograph nor the source's, and no other change explains the difference.
        Unlike = "have little in common with the photographs",
        Linear = "contain linear light but were read as sRGB (exr=linear reads such EXR files)",
        EncodedTwice = "are sRGB-encoded twice (exr=srgb reads EXR files that hold sRGB values)",
        HalfContrast = "have half their contrast, as if values from 0 to 1 had been stored as values from −1 to 1",
        Quarter =
            "have a quarter of their photographs' levels, like 14-bit values in 16-bit files; multiply them by 4",
        DarkHalfCutOff =
            "have their darker half cut off, as if values from −1 to 1 had been stored as values from 0 to 1",
        LimitedRange =
            "have the limited range of video, 16 to 235, but were read as 0 to 255; store them with the full range",
        Negative = "are negatives",
        /// Where the photograph is white, the picture is black, or vice versa; all other parts are alike.
        OtherBackground =
            "have a black background where the photographs' is white, or a white one where it is black; render them \
             with the photographs' background",
        /// Red and blue are swapped.
        Bgr = "have red and blue swapped",
        Grb = "have red and green swapped",
        Rbg = "have green and blue swapped",
        Gbr = "contain green, blue and red but were read as red, green and blue",
        Brg = "contain blue, red and green but were read as red, green and blue",
        /// The two chroma channels are swapped.
        SwappedChroma =
            "have Cb and Cr (or U and V) swapped; convert them to RGB with the planes in the right order (NV12 or NV21, \
             I420 or YV12)",
        Mirrored = "are mirrored left to right",
        UpsideDown = "are mirrored top to bottom",
        Turned180 = "are turned by 180°",
        Turned90 = "are turned by 90°",
        Turned270 = "are turned by 270°",
        Transposed = "have rows and columns swapped",
        /// Samples in the order channel, row, column were reshaped to row, column, channel.
        ReshapedPlanes =
            "have their channels one after another (C, H, W) but were reshaped to (H, W, C); permute the axes instead of \
             reshaping",
        /// Samples in the order row, column, channel were reshaped to channel, row, column.
        ReshapedPixels =
            "have their channels pixel by pixel (H, W, C) but were reshaped to (C, H, W); permute the axes instead of \
             reshaping",
        /// Rows and columns were exchanged by reshaping.
        ReshapedSides =
            "have width and height exchanged by reshaping (W, H) to (H, W); transpose the axes instead of reshaping",
        /// The content is moved by quarters of the size; what leaves at one side enters at the opposite one.
        Rolled =
            "are rolled by a quarter, a half or three quarters of their width or height, so that what leaves at one \
             side enters at the opposite one, as by `fftshift` or `roll`; undo it before storing them",
        /// The patches lie column by column instead of row by row, or the other way round.
        PatchOrder =
            "have their patches or tiles in another order, column by column instead of row by row or the other way round; \
             put them together in the order in which they were cut, as in `(h w)` rather than `(w h)`",
        /// Rows and columns are exchanged within each block of some pixels.
        SubPixelOrder =
            "have rows and columns exchanged within each block of 2x2 pixels or more, as by a pixel shuffle or patches \
             with exchanged axes; exchange the two axes within the blocks",
        /// Luma and chroma are stored as red, green and blue.
        Luma = "contain Y, Cb and Cr but were read as red, green and blue",
        /// Hue, saturation and value are stored as red, green and blue.
        Hsv = "contain hue, saturation and value but were read as red, green and blue",
        /// CIE L*a*b* is stored as red, green and blue.
        Lab = "contain L*a*b* but were read as red, green and blue",
        /// Values are normalised by ImageNet's mean and standard deviation.
        Normalised =
            "are normalised by ImageNet's or CLIP's mean and standard deviation; undo the normalisation before \
             storing them",
        /// Values are normalised by ImageNet's or CLIP's mean and standard deviation, then stretched to 0..255 by one
        /// range for all channels.
        NormalisedAndStretched =
            "were normalised by ImageNet's or CLIP's mean and standard deviation of each channel and then stretched \
             to 0..255; undo the normalisation before storing them",
        /// Levels beyond 0..255 wrapped around.
        Wrapped =
            "have very bright levels stored as very dark ones, or very dark as very bright ones, because levels outside \
             0..255 wrapped around; limit levels to 0..255 before converting to 8 bit",
        /// Values of 0..1 are stored as whole levels.
        Unscaled = "have no level above 1, because values from 0 to 1 were not multiplied by 255",
        /// Two opposite sides have bars of one colour.
        Bars = "have bars of one colour at two opposite sides, probably padding; remove the bars before storing them",
        /// All rows from some row to the last have one colour.
        Unfinished = "have a single colour from some row down to the last row, as if they were unfinished",
        /// Successive rows are equal.
        RepeatedRow =
            "repeat one row over at least a twentieth of their height, as if their other rows had not been written, or as \
             if a border had been repeated; write all rows",
        /// Every second row differs from its neighbours.
        Interlaced = "have every second row from another picture, as if two pictures were interlaced",
        /// A white border on all sides.
        Framed = "have a white border on all sides, like figures with axes or margins; store only the picture",
        /// The top or the bottom has a strip of white or black rows. The value is the [top, bottom] thickness in
        /// thousandths of the height; one of the two is 0.
        Strip([i16; 2]) =
            "have a strip of one colour along one side, of the same thickness in all pictures, probably a caption or \
             padding; store only the picture",
        /// Several pictures side by side or one above the other.
        Panels =
            "are several pictures side by side or one above the other, squeezed into one; store only the prediction",
        /// The content was padded: it appears reduced along one axis about the middle, or along both with its upper left
        /// corner in place.
        Padded =
            "were resized with padding around them; remove the padding before resizing, or store the pictures \
             without padding",
        /// The content was cropped and stretched to the target's size: it appears enlarged along one axis.
        Cropped =
            "are crops stretched to the target's size; store them unstretched and set crop=center:1:1 (or the crops' \
             own aspect ratio)",
        /// Contrast was increased so that the darkest level is 0 and the brightest 255. The value is the gain in
        /// percent.
        Stretched(i16) =
            "were stretched separately, so that the darkest level of each picture is 0 and the brightest 255 \
             (`normalize=True` of torchvision's save_image, for example); store the values as predicted",
        /// The three channels are equal, although the photograph is coloured.
        Grey =
            "have three equal channels, although the photographs have colours; if the method predicts colours, store \
             these",
        /// Two channels are equal, although the same channels of the photograph differ.
        EqualChannels =
            "have two equal channels, although these channels differ in the photographs; perhaps one channel was stored \
             in place of another",
        /// Neighbouring pixels are uncorrelated.
        Noise =
            "are noise, with uncorrelated neighbouring pixels (perhaps latents, unfinished sampling or bytes read as \
             another type)",
        /// At most 256 colours.
        Palette =
            "have at most 256 different colours, as if they had been stored with a palette; store them with 8 bits per \
             channel",
        /// Blocks of equal pixels.
        Blocks =
            "consist of blocks of equal pixels, as if small pictures had been enlarged by repeating pixels; store \
             them at the size at which they were predicted, and see resize=",
    }
}

impl PictureChange {
    /// True if the change leaves traces that predictions never have, whether good or poor.
    pub fn is_visible(self) -> bool {
        matches!(
            self,
            Self::Wrapped
                | Self::Unscaled
                | Self::Palette
                | Self::Bars
                | Self::Unfinished
                | Self::Interlaced
                | Self::Framed
                | Self::Panels
                | Self::EqualChannels
                | Self::Noise
                | Self::Blocks
        )
    }

    /// True if the change is distinctive enough to name single pictures that have it.
    pub fn is_clear(self) -> bool {
        use PictureChange::*;
        let is_moved = matches!(
            self,
            Mirrored | UpsideDown | Turned180 | Turned90 | Turned270 | Transposed
        );
        is_moved
            || self.is_recoloured()
            || matches!(
                self,
                Photograph | CopiedSource | Panels | EqualChannels | Noise | Unscaled
            )
    }

    fn is_recoloured(self) -> bool {
        use PictureChange::*;
        matches!(
            self,
            Bgr | Grb | Rbg | Gbr | Brg | SwappedChroma | Luma | Hsv | Lab | Normalised | Negative
        )
    }

    /// Whether the change alters the levels of each pixel and moves none.
    pub(super) fn is_of_levels(self) -> bool {
        use PictureChange::*;
        let is_of_range = matches!(self, HalfContrast | Quarter | DarkHalfCutOff | LimitedRange);
        self.is_recoloured() || is_of_range || matches!(self, Linear | EncodedTwice)
    }

    /// The change with its measured numbers set to 0.
    pub fn kind(self) -> Self {
        match self {
            Self::Strip(_) => Self::Strip([0; 2]),
            Self::Stretched(_) => Self::Stretched(0),
            other => other,
        }
    }
}

worded! {
    /// The target that a stored picture shows best.
    #[derive(
        Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
    )]
    #[serde(rename_all = "kebab-case")]
    pub enum ShownTarget {
        Own = "their own target",
        /// The target of the previous pair.
        Previous = "the target of the pair before theirs",
        /// The target of the next pair.
        Next = "the target of the pair after theirs",
        Other = "the target of another pair",
        /// The view before the target in the scene's order; pairs need not have it as a target.
        ViewBefore = "the scene's view before their target",
        /// The view after the target in the scene's order.
        ViewAfter = "the scene's view after their target",
        /// Not a target: the source's photograph.
        Source = "the source's photograph",
        /// Not a target: the source's view, but no copy of its photograph.
        SourceView = "the source's view",
        /// Not a target: the source's view, worst where the target does not show it.
        SourceFromTarget = "the source's view as rendered from the target's photograph",
    }
}

/// The camera from which a stored picture shows the scene, compared with the target's camera.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum ShownCamera {
    /// A camera that moved by this percentage of the target's motion; 100 is the target's own camera.
    Moved(i16),
    /// The target's camera with the source's intrinsics.
    SourceIntrinsics,
    /// A camera at the inverse of the target's pose relative to the source.
    InversePose,
    /// A camera at the target's pose with y and z reversed.
    OtherAxes,
    /// A camera at the target's pose with the rotation transposed.
    TransposedRotation,
    /// A camera that moved like the target's but did not turn.
    NoRotation,
    /// A camera at the target's pose with one component of the translation reversed: x, y or z.
    Reversed(u8),
    /// A camera at the target's pose with the translation in world axes: the source's centre minus the target's, or the
    /// other way round if `true`.
    WorldTranslation(bool),
    /// The target's camera, for which near content moves less than far content.
    NearFarExchanged,
    /// The target's camera with another framing.
    Reframed(Framing),
}

impl ShownCamera {
    /// The camera and what to check, as the predicate of a sentence that begins with "its pictures".
    pub fn text(self) -> String {
        let shown = match self {
            Self::Moved(percent) => {
                return format!(
                    "move by {:.2} times the target's motion from the source's view; {}",
                    f64::from(percent) / 100.0,
                    if percent < 0 {
                        "check the sign of the translation, and whether the pose is inverted"
                    } else {
                        "check the unit of the translation and the scale of the depths"
                    }
                );
            }
            Self::Reframed(framing) => {
                return format!("show what the target's camera would see {}", framing.text());
            }
            Self::NoRotation => {
                "what the target's camera would see if it were not turned; apply the rotation of the pose as well"
            }
            Self::Reversed(axis) => {
                let axis = ["x", "y", "z"][usize::from(axis.min(2))];
                return format!(
                    "show what a camera at the target's pose would see if the {axis} of its translation were reversed; check its \
                     sign"
                );
            }
            Self::WorldTranslation(is_reversed) => {
                return format!(
                    "show what a camera at the target's pose would see if its translation were {} in world axes; use the \
                     source's centre minus the target's, multiplied by the rotation of the target's world-to-camera pose",
                    if is_reversed {
                        "the target's centre minus the source's"
                    } else {
                        "the source's centre minus the target's"
                    }
                );
            }
            Self::NearFarExchanged => {
                return "move near content by less than far content, as if disparity (inverse depth) had been used as \
                        depth, or depth as disparity; use its reciprocal"
                    .to_owned();
            }
            Self::SourceIntrinsics => {
                "the target through the source's intrinsics, whose principal point or focal length differs; render them \
                 with the target's intrinsics"
            }
            Self::InversePose => {
                "the view from the inverse of the target's pose; check whether the pose maps from or to the camera"
            }
            Self::OtherAxes => {
                "the view from the target's pose with y and z reversed; check the axes (OpenCV or OpenGL)"
            }
            Self::TransposedRotation => {
                "the view from the target's pose with its rotation transposed; check the order of rows and columns"
            }
        };
        format!("show {shown}")
    }

    /// Whether this camera clearly differs from the target's.
    pub fn is_wrong(self) -> bool {
        !matches!(self, Self::Moved(65..150))
    }

    /// Whether two pictures of one dataset agree on the camera, within measurement errors.
    pub fn is_like(self, other: Self) -> bool {
        match (self, other) {
            (Self::Moved(percent), Self::Moved(other)) => {
                let other = f64::from(other);
                (f64::from(percent) - other).abs() <= MAX_UNEVEN.max(MAX_UNEVEN_SHARE * other.abs())
            }
            (Self::Reframed(framing), Self::Reframed(other)) => framing.is_like(other),
            _ => self == other,
        }
    }
}

/// Maximum difference of multiples of the motion ([`ShownCamera::Moved`]) that count as alike, in percentage points.
const MAX_UNEVEN: f64 = 8.0;
/// Like [`MAX_UNEVEN`], but as a share of the multiple; the larger limit applies.
const MAX_UNEVEN_SHARE: f64 = 0.12;

/// How a picture frames its target, compared with its photograph.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
pub struct Framing {
    /// Scale of the shown content about the principal point, in thousandths.
    pub zoom: i16,
    /// Clockwise rotation, thousandths of a degree.
    pub roll: i16,
    /// Shift to the right and down, thousandths of the width. If all epipolar lines are parallel, the shift along them
    /// is unknown and left out.
    pub shift: [i16; 2],
    /// OpenCV's coefficient k1 of radial distortion, in thousandths.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub lens: i16,
}

fn is_zero(value: &i16) -> bool {
    *value == 0
}

impl Framing {
    /// Framings count as alike if their zoom, roll and shift differ by at most these values, in the units of the
    /// fields. In zoomed pictures, larger differences are allowed.
    const UNEVEN: [i16; 3] = [25, 700, 4];
    /// A framing is wrong if its zoom, roll or shift differs from the target's by at least these values, in the units
    /// of the fields. In zoomed pictures, roll and shift must differ by more.
    const MIN_FRAMING: [i16; 3] = [15, 700, 5];
    /// Minimum magnitude of [`Framing::lens`] in a wrong framing.
    const MIN_LENS: i16 = 40;
    /// Maximum difference of [`Framing::lens`] in framings that count as alike; a quarter of the value if that is
    /// larger.
    const UNEVEN_LENS: i16 = 30;

    fn is_distorted(self) -> bool {
        self.lens.abs() >= Self::MIN_LENS
    }

    fn is_zoomed(self) -> bool {
        (self.zoom - 1000).abs() >= Self::MIN_FRAMING[0]
    }

    fn is_rolled(self) -> bool {
        self.roll.abs() >= self.coarser() * Self::MIN_FRAMING[1]
    }

    fn is_shifted(self) -> bool {
        let least = self.coarser() * Self::MIN_FRAMING[2];
        self.shift.iter().any(|by| by.abs() >= least)
    }

    /// Factor by which rotation and shift are measured less exactly in a zoomed picture; 1 without zoom.
    fn coarser(self) -> i16 {
        if self.is_zoomed() {
            3 + (self.zoom - 1000).abs() / 50
        } else {
            1
        }
    }

    pub fn is_wrong(self) -> bool {
        self.is_zoomed() || self.is_rolled() || self.is_shifted() || self.is_distorted()
    }

    /// Whether this measurement is compatible with the framing `other`. The shift of `other` must be complete, whereas
    /// this one may lack the component along its epipolar lines.
    pub fn is_like(self, other: Self) -> bool {
        let near = |a: i16, b: i16, most: i16| (a - b).abs() <= most;
        let [zoom, roll, shift] = Self::UNEVEN;
        let times = self.coarser();
        let [own, all] = [self, other].map(Self::shift_vector);
        let off = own.length() - all.dot(own.normalize_or_zero());
        near(
            self.lens,
            other.lens,
            Self::UNEVEN_LENS.max(other.lens.abs() / 4),
        ) && near(self.zoom, other.zoom, zoom + (other.zoom - 1000).abs() / 10)
            && near(self.roll, other.roll, times * roll)
            && off.abs() <= f64::from(times * shift)
    }

    /// The framing that explains several measurements best; `None` if there are none. Each measurement contains only
    /// one component of the shift: that across its own epipolar lines.
    pub fn common(framings: &[Self]) -> Option<Self> {
        let middle = |of: fn(&Self) -> i16| {
            let mut all: Vec<i16> = framings.iter().map(of).collect();
            all.sort_unstable();
            all.get(all.len() / 2).copied()
        };
        let mut normal = DMat2::from_diagonal(DVec2::splat(0.05));
        let mut sum = DVec2::ZERO;
        for shift in framings.iter().map(|framing| framing.shift_vector()) {
            let along = shift.normalize_or_zero();
            normal += DMat2::from_cols(along.x * along, along.y * along);
            sum += shift;
        }
        let shift = normal.inverse() * sum;
        Some(Self {
            zoom: middle(|framing| framing.zoom)?,
            roll: middle(|framing| framing.roll)?,
            lens: middle(|framing| framing.lens)?,
            shift: [shift.x.round() as i16, shift.y.round() as i16],
        })
    }

    fn shift_vector(self) -> DVec2 {
        DVec2::from(self.shift.map(f64::from))
    }

    /// The framing and what to do, to follow "what the target's camera would see" in a sentence.
    pub fn text(self) -> String {
        let mut parts = Vec::new();
        if self.is_distorted() {
            let k1 = f64::from(self.lens) / 1000.0;
            parts.push(format!(
                "through a lens with radial distortion (k1 = {k1:.2} in OpenCV's model), as if distortion was left in or \
                 removed twice"
            ));
        }
        if self.is_zoomed() {
            let zoom = f64::from(self.zoom) / 1000.0;
            parts.push(format!(
                "with {zoom:.2} times its focal length, as with a wrong focal length or a resized crop"
            ));
        }
        if self.is_rolled() {
            let roll = f64::from(self.roll) / 1000.0;
            parts.push(format!("turned clockwise by {roll:.1}°"));
        }
        if self.is_shifted() {
            let [x, y] = self.shift.map(|by| f64::from(by) / 10.0);
            parts.push(format!(
                "shifted by ({x:.1} %, {y:.1} %) of the width, as with a wrong principal point or a crop"
            ));
        }
        let advice = if self.is_distorted() {
            "; render them without distortion"
        } else {
            ""
        };
        parts.join(", ") + advice
    }
}

/// The first [`MAX_NAMED`] names, separated by commas, and the number of further names.
pub(crate) fn listed(names: BTreeSet<&str>) -> String {
    let more = match names.len().saturating_sub(MAX_NAMED) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    let first: Vec<&str> = names.into_iter().take(MAX_NAMED).collect();
    first.join(", ") + &more
}
