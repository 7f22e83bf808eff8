//! Rectangular parts of a picture, for methods that crop.
//!
//! The paper scores a cropped prediction "against correspondingly cropped ground-truth images". A region is a
//! rectangle of the target's pixels; nothing is resampled when a picture is cropped to one.

use std::borrow::Cow;
use std::fmt;

use image::{ImageBuffer, Pixel, imageops};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sharp_metrics::{Mask, Picture};

/// A rectangle of pixels; never empty if made by this module.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Region {
    /// Leftmost column.
    pub x: u32,
    /// Topmost row.
    pub y: u32,
    /// Number of columns.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
}

impl Region {
    /// The region that is a whole picture of the given width and height.
    pub fn whole((width, height): (u32, u32)) -> Self {
        Self {
            x: 0,
            y: 0,
            width,
            height,
        }
    }

    /// The largest centred rectangle with the aspect ratio `width : height`; sides are rounded to
    /// the nearest pixel, and the right and lower margins get the odd pixel. `None` if any side is
    /// 0.
    pub fn centered((aspect_w, aspect_h): (u32, u32), (width, height): (u32, u32)) -> Option<Self> {
        if [aspect_w, aspect_h, width, height].contains(&0) {
            return None;
        }
        let [aw, ah, w, h] = [aspect_w, aspect_h, width, height].map(f64::from);
        let (cropped_w, cropped_h) = if w * ah > h * aw {
            (((h * aw / ah).round() as u32).clamp(1, width), height)
        } else {
            (width, ((w * ah / aw).round() as u32).clamp(1, height))
        };
        Some(Self {
            x: (width - cropped_w) / 2,
            y: (height - cropped_h) / 2,
            width: cropped_w,
            height: cropped_h,
        })
    }

    /// Width and height of the region.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    pub fn area(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Whether the region is not empty and lies inside a picture of the given width and height.
    pub fn fits(&self, (width, height): (u32, u32)) -> bool {
        let inside = |start: u32, length: u32, side: u32| {
            length > 0 && start.checked_add(length).is_some_and(|end| end <= side)
        };
        inside(self.x, self.width, width) && inside(self.y, self.height, height)
    }

    /// The common part of two regions; `None` if they do not overlap.
    pub fn intersection(&self, other: &Self) -> Option<Self> {
        let overlap = |a: u32, a_len: u32, b: u32, b_len: u32| {
            let start = a.max(b);
            let end = a.saturating_add(a_len).min(b.saturating_add(b_len));
            (end > start).then_some((start, end - start))
        };
        let (x, width) = overlap(self.x, self.width, other.x, other.width)?;
        let (y, height) = overlap(self.y, self.height, other.y, other.height)?;
        Some(Self {
            x,
            y,
            width,
            height,
        })
    }

    /// This region in coordinates relative to the corner of `outer`; `None` if this region does not
    /// lie inside `outer`.
    pub fn within(&self, outer: &Self) -> Option<Self> {
        let moved = Self {
            x: self.x.checked_sub(outer.x)?,
            y: self.y.checked_sub(outer.y)?,
            ..*self
        };
        moved.fits(outer.size()).then_some(moved)
    }

    /// Share of a picture's pixels in this region, 0..1.
    pub fn share_of(&self, (width, height): (u32, u32)) -> f64 {
        let area = |w: u32, h: u32| f64::from(w) * f64::from(h);
        area(self.width, self.height) / area(width, height)
    }

    /// Crops a picture, without copying if the region is the whole picture. The region must fit.
    pub fn crop<'a>(&self, picture: &'a Picture) -> Cow<'a, Picture> {
        if *self == Self::whole(picture.dimensions()) {
            return Cow::Borrowed(picture);
        }
        Cow::Owned(match picture {
            Picture::Rgb8(image) => Picture::Rgb8(self.part_of(image)),
            Picture::RgbF32(image) => Picture::RgbF32(self.part_of(image)),
        })
    }

    /// Copies this region of a picture. The region must fit.
    pub(crate) fn part_of<P: Pixel + 'static>(
        &self,
        image: &ImageBuffer<P, Vec<P::Subpixel>>,
    ) -> ImageBuffer<P, Vec<P::Subpixel>> {
        imageops::crop_imm(image, self.x, self.y, self.width, self.height).to_image()
    }

    /// Crops a mask. The region must fit.
    pub fn crop_mask<'a>(&self, mask: &'a Mask) -> Option<Cow<'a, Mask>> {
        if *self == Self::whole(mask.dimensions()) {
            return Some(Cow::Borrowed(mask));
        }
        let columns = self.x as usize..(self.x + self.width) as usize;
        let inside = mask
            .values()
            .chunks_exact(mask.dimensions().0 as usize)
            .skip(self.y as usize)
            .take(self.height as usize)
            .flat_map(|row| &row[columns.clone()])
            .copied()
            .collect();
        Mask::new(self.width, self.height, inside).map(Cow::Owned)
    }
}

impl fmt::Display for Region {
    /// Formats as `640x480 at 0,16`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            x,
            y,
            width,
            height,
        } = self;
        write!(f, "{width}x{height} at {x},{y}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{Rgb, RgbImage};

    fn region(x: u32, y: u32, width: u32, height: u32) -> Region {
        Region {
            x,
            y,
            width,
            height,
        }
    }

    #[test]
    fn the_middle_of_an_aspect() {
        let centered = |aspect, size| Region::centered(aspect, size).unwrap();
        assert_eq!(centered((1, 1), (640, 480)), region(80, 0, 480, 480));
        assert_eq!(centered((16, 9), (640, 480)), region(0, 60, 640, 360));
        assert_eq!(centered((4, 3), (640, 480)), region(0, 0, 640, 480));
        // 7 rows of 10 remain: 3 above, 4 below.
        assert_eq!(centered((10, 3), (10, 10)), region(0, 3, 10, 3));
        assert_eq!(centered((1, 1000), (10, 10)), region(4, 0, 1, 10));
        assert_eq!(Region::centered((0, 1), (10, 10)), None);
        assert_eq!(Region::centered((1, 1), (0, 10)), None);
    }

    #[test]
    fn fitting_and_sharing() {
        assert!(region(0, 0, 4, 3).fits((4, 3)));
        for outside in [
            region(1, 0, 4, 3),
            region(0, 1, 4, 3),
            region(0, 0, 0, 3),
            region(u32::MAX, 0, 2, 1),
        ] {
            assert!(!outside.fits((4, 3)), "{outside}");
        }
        let (a, b) = (region(0, 2, 10, 4), region(4, 0, 10, 4));
        assert_eq!(a.intersection(&b), Some(region(4, 2, 6, 2)));
        assert_eq!(a.intersection(&region(10, 0, 5, 5)), None);
        assert_eq!(region(4, 2, 6, 2).within(&a), Some(region(4, 0, 6, 2)));
        assert_eq!(region(4, 2, 7, 2).within(&a), None);
        assert_eq!(b.within(&a), None);
        assert_eq!(region(0, 0, 5, 5).share_of((10, 10)), 0.25);
    }

    #[test]
    fn pictures_and_masks_are_cut_alike() {
        let image = RgbImage::from_fn(5, 4, |x, y| Rgb([x as u8, y as u8, 0]));
        let cut = region(1, 2, 3, 2);
        let picture = Picture::Rgb8(image);
        let Picture::Rgb8(cropped) = cut.crop(&picture).into_owned() else {
            panic!("another kind of picture");
        };
        assert_eq!(cropped.dimensions(), (3, 2));
        assert_eq!(cropped.get_pixel(0, 0).0, [1, 2, 0]);
        assert_eq!(cropped.get_pixel(2, 1).0, [3, 3, 0]);
        assert!(matches!(
            Region::whole((5, 4)).crop(&picture),
            Cow::Borrowed(_)
        ));
        let mask = Mask::new(5, 4, (0..20).map(|i| i % 3 == 0).collect()).unwrap();
        let cropped = cut.crop_mask(&mask).unwrap();
        let expected: Vec<bool> = [11, 12, 13, 16, 17, 18].map(|i| i % 3 == 0).into();
        assert_eq!(cropped.values(), expected);
    }
}
