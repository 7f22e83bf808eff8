//! Copies a sub-frame's pixels into the picture.

use super::super::RenderOutput;
use super::subframe::SubFrame;
use rayon::prelude::*;

/// Copies data read from the device: colour and alpha (four floats per pixel) if `which` is 0, else depth (one float).
/// Rows of the sub-frame are padded to whole tiles.
pub(super) fn copy_home(part: SubFrame, which: usize, bytes: &[u8], out: &mut RenderOutput) {
    let (x0, y0) = part.corner();
    let (stride, height) = part.size();
    let columns = stride.min(out.width - x0) as usize;
    let rows = height.min(out.height - y0) as usize;
    let (x0, y0, stride) = (x0 as usize, y0 as usize, stride as usize);
    let width = out.width as usize;
    if which == 0 {
        let colors: &[[f32; 4]] = bytemuck::cast_slice(bytes);
        let pictures = out.rgb.par_chunks_exact_mut(width);
        let pictures = pictures.zip(out.alpha.par_chunks_exact_mut(width));
        let rows = pictures.skip(y0).take(rows).zip(colors.par_chunks(stride));
        rows.for_each(|((rgb, alpha), from)| {
            let to = rgb[x0..].iter_mut().zip(&mut alpha[x0..]);
            for ((rgb, alpha), [r, g, b, a]) in to.zip(&from[..columns]) {
                *rgb = [*r, *g, *b];
                *alpha = *a;
            }
        });
    } else {
        let depths: &[f32] = bytemuck::cast_slice(bytes);
        let pictures = out.depth_acc.par_chunks_exact_mut(width);
        let rows = pictures.skip(y0).take(rows).zip(depths.par_chunks(stride));
        rows.for_each(|(depth, from)| {
            depth[x0..x0 + columns].copy_from_slice(&from[..columns]);
        });
    }
}
