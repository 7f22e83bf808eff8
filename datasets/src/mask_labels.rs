//! Distinguishes masks from label maps, whose levels are numbers of objects or classes.

use image::GrayImage;

use crate::left_out::first_few;

/// A level counts as a label if at least this fraction of the picture's pixels have it.
const MIN_LABELLED: f64 = 0.01;
/// In a label map, at least this fraction of the grey pixels (levels 1 to 254) have the level of their left and upper
/// neighbours.
const MIN_FLAT: f64 = 0.8;

/// The first few levels of a label map, for a message. A picture counts as a label map if it has three or more levels,
/// mostly in uniform areas. `None` for a mask, even if it was blurred or stored as JPEG.
pub(crate) fn labels(mask: &GrayImage) -> Option<String> {
    let (width, height) = mask.dimensions();
    let mut counts = [0_usize; 256];
    mask.iter()
        .for_each(|level| counts[usize::from(*level)] += 1);
    let (mut grey, mut flat) = (0, 0);
    for y in 1..height {
        for x in 1..width {
            let level = mask.get_pixel(x, y);
            if (1..255).contains(&level.0[0]) {
                grey += 1;
                let before = [mask.get_pixel(x - 1, y), mask.get_pixel(x, y - 1)];
                flat += usize::from(before == [level; 2]);
            }
        }
    }
    let least = MIN_LABELLED * mask.len() as f64;
    let levels = (0..256).filter(|level| counts[*level] as f64 >= least);
    let levels: Vec<String> = levels.map(|level| level.to_string()).collect();
    let is_map = levels.len() >= 3 && grey > 0 && flat as f64 >= MIN_FLAT * f64::from(grey);
    is_map.then(|| first_few(&levels))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_of_objects_are_told_from_soft_masks() {
        let of = |level: fn(u32, u32) -> u8| {
            GrayImage::from_fn(96, 64, |x, y| image::Luma([level(x, y)]))
        };
        let objects = of(|x, y| ((x / 24 + 4 * (y / 32)) * 16) as u8);
        assert_eq!(labels(&objects).as_deref(), Some("0, 16, 32, …"));
        let mask = of(|x, y| if x / 40 == 1 && y / 30 == 1 { 0 } else { 255 });
        let mut jpeg = std::io::Cursor::new(Vec::new());
        mask.write_to(&mut jpeg, image::ImageFormat::Jpeg).unwrap();
        let jpeg = image::load_from_memory(jpeg.get_ref())
            .unwrap()
            .into_luma8();
        let soft = image::imageops::fast_blur(&mask, 3.0);
        let dim = of(|x, _| if x < 40 { 1 } else { 0 });
        for proper in [&mask, &jpeg, &soft, &dim] {
            assert_eq!(labels(proper), None);
        }
    }
}
