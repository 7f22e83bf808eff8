//! Moves a target's camera until the rendering fits the target's photograph, as done in evaluations
//! of methods without known poses (NoPoSplat, AnySplat).
//!
//! First, the camera is turned by the shift that brings a small rendering closest to the photograph. Gauss-Newton steps
//! with Levenberg's damping then reduce the squared difference of sRGB values over the covered pixels, at increasing
//! picture sizes. Derivatives are central differences of renderings, so they work with every rule and both renderers.

use glam::{DAffine3, DQuat, DVec3};
use image::imageops::{FilterType, resize};
use image::{ImageBuffer, Luma, Rgb, Rgb32FImage, RgbImage};
use sharp::camera::Intrinsics;
use sharp::gaussians::Gaussians;
use sharp::render::{LoadedScene, RenderError, RenderOutput, Rule};
use sharp_metrics::Mask;

use super::shared::{HOLE_ALPHA, SharedRenderer, surface_depth};
use crate::pairs::depth::median_depth_m;

/// Width of the last and largest picture, in pixels; for narrower targets, the width of the target.
/// Each earlier picture is half as wide as the next.
const WIDEST: u32 = 640;
/// Minimum width of all pictures but the last, in pixels.
const NARROWEST: u32 = 60;
/// Minimum low-pass for all pictures but the last, in px²; this low-pass blurs Gaussians that would
/// be smaller than a pixel.
const LOW_PASS: f32 = 0.3;
/// Maximum width of the picture in which the initial shift is searched, in pixels.
const SHIFT_WIDTH: u32 = 160;
/// Maximum initial shift, as a share of the width.
const MAX_SHIFT: f64 = 0.1;
/// Maximum number of steps at each picture width and each reach (see [`REACH`]).
const STEPS: usize = 20;
/// Half the distance between the two renderings of a central difference, in pixels.
const REACH: f64 = 0.5;
/// Smaller values of [`REACH`] for the final rounds at the last width, in pixels. Smaller values
/// reduce the effect of single pixels.
const FINE_REACHES: [f64; 2] = [0.25, 0.1];
/// Minimum length of a step, in pixels. A shorter step ends the iteration at a picture width.
const LAST_STEP: f64 = 0.01;
/// Damping of the first step.
const INITIAL_DAMPING: f64 = 1e-3;
/// Maximum damping that is tried.
const MAX_DAMPING: f64 = 1e3;

/// Describes the procedure, for identities. The procedure is defined by this file, whose hash is part of each method's
/// code.
pub fn procedure() -> String {
    format!(
        "pose ({NARROWEST} to {WIDEST} px wide, at most {STEPS} steps each, until {LAST_STEP} px)"
    )
}

/// How a camera was moved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moved {
    /// Maps coordinates of the original camera to coordinates of the moved camera.
    pub map: DAffine3,
    pub rotation_deg: f64,
    /// Length of the translation, in metres.
    pub translation: f64,
    pub steps: usize,
}

/// A camera's motion: rotation about x, y and z, then translation along x, y and z.
type Six = [f64; 6];

/// One level of the image pyramid: renderer and photograph at one size.
struct Level<'a> {
    renderer: &'a SharedRenderer,
    rule: Option<Rule>,
    camera_from_scene: DAffine3,
    intrinsics: Intrinsics,
    is_last: bool,
    photograph: Rgb32FImage,
    /// Pixels of the photograph that count; `None` for all.
    valid: Option<Vec<bool>>,
}

/// Moves a camera so that the rendering fits the photograph, inside the mask `valid` if given. The
/// photograph must have the size stated in `intrinsics`. The camera stays in place if nothing is
/// drawn.
///
/// # Errors
/// If rendering fails.
pub fn fit_camera(
    renderer: &SharedRenderer,
    scene: &Gaussians,
    camera_from_scene: DAffine3,
    intrinsics: Intrinsics,
    rule: Option<Rule>,
    (photograph, valid): (&RgbImage, Option<&Mask>),
) -> Result<Moved, RenderError> {
    let widest = intrinsics.width.min(WIDEST);
    let half = |width: &u32| Some(width.div_ceil(2)).filter(|width| *width >= NARROWEST);
    let widths: Vec<u32> = std::iter::successors(Some(widest), half).collect();
    let level = |width: u32| Level {
        renderer,
        rule,
        camera_from_scene,
        intrinsics: at_width(intrinsics, width),
        is_last: width == widest,
        photograph: shrunk(photograph, at_width(intrinsics, width)),
        valid: valid.map(|valid| shrunk_mask(valid, at_width(intrinsics, width))),
    };
    let mut map = DAffine3::IDENTITY;
    let mut steps = 0;
    renderer.with_loaded(scene, |loaded| {
        if let Some(width) = widths.iter().find(|width| **width <= SHIFT_WIDTH) {
            let level = level(*width);
            map = level.shifted(&level.render(loaded, map)?);
        }
        for width in widths.iter().rev() {
            steps += level(*width).fit(loaded, &mut map, REACH)?;
        }
        for reach in FINE_REACHES {
            steps += level(widest).fit(loaded, &mut map, reach)?;
        }
        Ok(())
    })?;
    let (_, rotation, translation) = map.to_scale_rotation_translation();
    Ok(Moved {
        map,
        rotation_deg: rotation.to_axis_angle().1.to_degrees(),
        translation: translation.length(),
        steps,
    })
}

impl Level<'_> {
    fn render(
        &self,
        loaded: &mut dyn LoadedScene,
        map: DAffine3,
    ) -> Result<RenderOutput, RenderError> {
        let camera = map * self.camera_from_scene;
        let view = self.renderer.view(camera, self.intrinsics, self.rule);
        let low_pass = if self.is_last {
            view.rule.low_pass
        } else {
            view.rule.low_pass.max(LOW_PASS)
        };
        loaded.render(&view.with_low_pass(low_pass))
    }

    fn counts(&self, pixel: usize) -> bool {
        self.valid.as_ref().is_none_or(|valid| valid[pixel])
    }

    /// Finds the shift in whole pixels that brings the rendering closest to the photograph, and returns the rotation of
    /// the camera that has the same effect.
    fn shifted(&self, output: &RenderOutput) -> DAffine3 {
        let shown = self.shown(output);
        let (width, height) = (shown.width() as i32, shown.height() as i32);
        let reach = (MAX_SHIFT * f64::from(width)).ceil() as i32;
        let error = |[dx, dy]: [i32; 2]| {
            let (mut sum, mut count) = (0.0, 0);
            for y in dy.max(0)..(height + dy).min(height) {
                for x in dx.max(0)..(width + dx).min(width) {
                    let (from_x, from_y) = ((x - dx) as u32, (y - dy) as u32);
                    let is_seen =
                        output.alpha[(from_y * shown.width() + from_x) as usize] >= HOLE_ALPHA;
                    if is_seen && self.counts((y * width + x) as usize) {
                        let (a, b) = (
                            shown.get_pixel(from_x, from_y),
                            self.photograph.get_pixel(x as u32, y as u32),
                        );
                        sum += (0..3).map(|c| f64::from(a[c] - b[c]).powi(2)).sum::<f64>();
                        count += 1;
                    }
                }
            }
            // The overlap must be large, because a few pixels may be alike by chance.
            if 4 * count > width * height {
                sum / f64::from(count)
            } else {
                f64::INFINITY
            }
        };
        let all = (-reach..=reach).flat_map(|dx| (-reach..=reach).map(move |dy| [dx, dy]));
        let unmoved = error([0, 0]);
        let best = all
            .map(|by| (error(by), by))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let [dx, dy] = match best {
            Some((least, by)) if least < unmoved => by.map(f64::from),
            _ => [0.0; 2],
        };
        motion([
            -dy / self.intrinsics.fy,
            dx / self.intrinsics.fx,
            0.0,
            0.0,
            0.0,
            0.0,
        ])
    }

    /// Takes steps until a step is small enough; returns the number of steps. `reach` is the
    /// half-width of the central differences, in pixels.
    fn fit(
        &self,
        loaded: &mut dyn LoadedScene,
        map: &mut DAffine3,
        reach: f64,
    ) -> Result<usize, RenderError> {
        let mut damping = INITIAL_DAMPING;
        let mut steps = 0;
        let mut output = self.render(loaded, *map)?;
        while steps < STEPS {
            let Some(depth) = median_depth_m(&surface_depth(&output)) else {
                break;
            };
            steps += 1;
            let covered: Vec<bool> = (0..output.alpha.len())
                .map(|k| output.alpha[k] >= HOLE_ALPHA && self.counts(k))
                .collect();
            let shown = self.shown(&output);
            let error = self.error(&shown, &covered);
            // Each unit moves the picture by about one pixel.
            let unit = 1.0 / self.intrinsics.fx;
            let units = [unit, unit, unit, unit * depth, unit * depth, unit * depth];
            let moved = |by: Six| motion(std::array::from_fn(|k| by[k] * units[k])) * *map;
            let mut slopes = Vec::with_capacity(6);
            for k in 0..6 {
                let mut sides = Vec::with_capacity(2);
                for by_reach in [-reach, reach] {
                    let mut by = [0.0; 6];
                    by[k] = by_reach;
                    sides.push(self.shown(&self.render(loaded, moved(by))?));
                }
                slopes.push(difference(&sides[1], &sides[0], 1.0 / (2.0 * reach)));
            }
            let (squares, slope) = self.normal_equations(&shown, &slopes, &covered);
            let (taken, next, step) = loop {
                let by = damped_step(&squares, &slope, damping);
                let next = moved(by);
                let tried = self.render(loaded, next)?;
                let is_better = self.error(&self.shown(&tried), &covered) < error;
                let largest = by.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
                if is_better {
                    damping = (damping * 0.1).max(1e-9);
                } else {
                    damping *= 10.0;
                }
                if is_better || damping > MAX_DAMPING || largest < LAST_STEP {
                    break (is_better.then_some(tried), next, largest);
                }
            };
            let Some(taken) = taken else {
                break;
            };
            *map = next;
            output = taken;
            if step < LAST_STEP {
                break;
            }
        }
        Ok(steps)
    }

    /// The picture to be scored, but not rounded to 8 bit.
    fn shown(&self, output: &RenderOutput) -> Rgb32FImage {
        let mut picture = output.srgb(self.renderer.settings().background);
        for value in picture.iter_mut() {
            *value = value.clamp(0.0, 1.0);
        }
        picture
    }

    /// Sum of squared differences from the photograph over the covered pixels.
    fn error(&self, shown: &Rgb32FImage, covered: &[bool]) -> f64 {
        let each = shown.pixels().zip(self.photograph.pixels()).zip(covered);
        let each = each.filter(|(_, covered)| **covered);
        each.map(|((a, b), _)| (0..3).map(|c| f64::from(a[c] - b[c]).powi(2)).sum::<f64>())
            .sum()
    }

    /// The products of the derivatives with each other (JᵀJ), and with the difference from the photograph (Jᵀr).
    fn normal_equations(
        &self,
        shown: &Rgb32FImage,
        slopes: &[Rgb32FImage],
        covered: &[bool],
    ) -> ([Six; 6], Six) {
        let (mut squares, mut right) = ([[0.0; 6]; 6], [0.0; 6]);
        let pixels = covered.iter().enumerate().filter(|(_, covered)| **covered);
        for sample in pixels.flat_map(|(pixel, _)| 3 * pixel..3 * pixel + 3) {
            let off = f64::from(shown.as_raw()[sample] - self.photograph.as_raw()[sample]);
            let slope: Six = std::array::from_fn(|k| f64::from(slopes[k].as_raw()[sample]));
            for row in 0..6 {
                right[row] += slope[row] * off;
                for column in 0..=row {
                    squares[row][column] += slope[row] * slope[column];
                }
            }
        }
        (squares, right)
    }
}

/// Solves `(A + λ diag A) step = −b` by Cholesky; `squares` holds the lower half of A.
fn damped_step(squares: &[Six; 6], b: &Six, damping: f64) -> Six {
    let floor = (0..6)
        .map(|k| squares[k][k])
        .fold(f64::MIN_POSITIVE, f64::max)
        * 1e-12;
    let mut l = *squares;
    let mut step = b.map(|v| -v);
    for row in 0..6 {
        l[row][row] += damping * squares[row][row] + floor;
        for column in 0..=row {
            let known: f64 = (0..column).map(|k| l[row][k] * l[column][k]).sum();
            let rest = l[row][column] - known;
            l[row][column] = if row == column {
                rest.max(floor).sqrt()
            } else {
                rest / l[column][column]
            };
        }
        let known: f64 = (0..row).map(|k| l[row][k] * step[k]).sum();
        step[row] = (step[row] - known) / l[row][row];
    }
    for row in (0..6).rev() {
        let known: f64 = (row + 1..6).map(|k| l[k][row] * step[k]).sum();
        step[row] = (step[row] - known) / l[row][row];
    }
    step
}

fn motion([x, y, z, right, down, forward]: Six) -> DAffine3 {
    let rotation = DQuat::from_scaled_axis(DVec3::new(x, y, z));
    DAffine3::from_rotation_translation(rotation, DVec3::new(right, down, forward))
}

fn difference(a: &Rgb32FImage, b: &Rgb32FImage, factor: f64) -> Rgb32FImage {
    let samples = a.as_raw().iter().zip(b.as_raw());
    let samples = samples.map(|(a, b)| (a - b) * factor as f32).collect();
    ImageBuffer::from_raw(a.width(), a.height(), samples).unwrap_or_default()
}

fn at_width(whole: Intrinsics, width: u32) -> Intrinsics {
    let height = f64::from(whole.height) * f64::from(width) / f64::from(whole.width);
    whole.resized(width, (height.round() as u32).max(1))
}

/// For each pixel of the smaller picture, whether all pixels that contribute to it are valid.
fn shrunk_mask(valid: &Mask, to: Intrinsics) -> Vec<bool> {
    let (width, height) = valid.dimensions();
    let inside = |x: u32, y: u32| valid.values()[(y * width + x) as usize];
    let whole = ImageBuffer::from_fn(width, height, |x, y| {
        Luma([f32::from(u8::from(inside(x, y)))])
    });
    let seen = if (width, height) == (to.width, to.height) {
        whole
    } else {
        resize(&whole, to.width, to.height, FilterType::Triangle)
    };
    seen.iter().map(|share| *share > 0.999).collect()
}

fn shrunk(photograph: &RgbImage, to: Intrinsics) -> Rgb32FImage {
    let mut whole = Rgb32FImage::new(photograph.width(), photograph.height());
    for (to, from) in whole.pixels_mut().zip(photograph.pixels()) {
        *to = Rgb(from.0.map(|level| f32::from(level) / 255.0));
    }
    if photograph.dimensions() == (to.width, to.height) {
        whole
    } else {
        resize(&whole, to.width, to.height, FilterType::Triangle)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall of blobs, 2 to 4 m away.
    fn blobs() -> Gaussians {
        let mut scene = Gaussians::default();
        let share = |k: usize, of: usize| (k * of % 97) as f32 / 96.0;
        for k in 0..900 {
            let z = 2.0 + 2.0 * share(k, 31);
            scene.means.push([
                (share(k, 7) - 0.5) * 1.4 * z,
                (share(k, 13) - 0.5) * 1.1 * z,
                z,
            ]);
            scene.quaternions.push([1.0, 0.0, 0.0, 0.0]);
            scene.scales.push([0.05 * z; 3]);
            scene.opacities.push(0.9);
            scene
                .colors
                .push([share(k, 41), share(k, 59), share(k, 73)]);
        }
        scene
    }

    #[test]
    fn a_camera_comes_back_and_excluded_pixels_do_not_move_it() {
        let (renderer, scene) = (SharedRenderer::cpu(), blobs());
        let k = Intrinsics::new((80.0, 80.0), (48.0, 32.0), (96, 64)).unwrap();
        let of = |map: DAffine3| renderer.render(&scene, map, k, None).unwrap();
        let mut photograph = renderer.picture(&of(DAffine3::IDENTITY));
        let fitted = |start: DAffine3, photograph: &RgbImage, valid: Option<&Mask>| {
            let moved = fit_camera(&renderer, &scene, start, k, None, (photograph, valid));
            let map = moved.unwrap().map * start;
            let turn = map.to_scale_rotation_translation().1.to_axis_angle().1;
            (turn.to_degrees(), map.translation.length())
        };
        let start = DAffine3::from_rotation_translation(
            DQuat::from_scaled_axis(DVec3::new(0.02, -0.03, 0.02)),
            DVec3::new(0.03, 0.02, -0.04),
        );
        let (turned, moved) = fitted(start, &photograph, None);
        assert!(turned < 0.05 && moved < 0.005, "{turned} {moved}");
        // A third of the picture is masked out and black.
        let is_inside = |x: u32| x >= 32;
        for (x, _, pixel) in photograph.enumerate_pixels_mut() {
            if !is_inside(x) {
                *pixel = Rgb([0; 3]);
            }
        }
        let inside = (0..96 * 64).map(|at| is_inside(at % 96)).collect();
        let valid = Mask::new(96, 64, inside).unwrap();
        let (turned, moved) = fitted(start, &photograph, Some(&valid));
        assert!(turned < 0.1 && moved < 0.01, "{turned} {moved}");
        assert!(fitted(start, &photograph, None).0 > 0.5);
        // Nothing is visible.
        let away = DAffine3::from_translation(DVec3::new(0.0, 0.0, -100.0));
        let moved = fit_camera(&renderer, &scene, away, k, None, (&photograph, None)).unwrap();
        assert_eq!((moved.map, moved.steps), (DAffine3::IDENTITY, 0));
    }

    #[test]
    fn a_damped_step_solves_its_equations() {
        let rows: [Six; 7] = std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                ((i * 7 + j * 3) % 11) as f64 - 4.0 + f64::from(u8::from(i == j))
            })
        });
        let square = |i: usize, j: usize| rows.iter().map(|row| row[i] * row[j]).sum::<f64>();
        let squares: [Six; 6] = std::array::from_fn(|i| std::array::from_fn(|j| square(i, j)));
        let b = [1.0, -2.0, 3.0, 0.5, 0.0, 4.0];
        for damping in [0.0, 0.1, 10.0] {
            let step = damped_step(&squares, &b, damping);
            for (i, b) in b.iter().enumerate() {
                let own: f64 = (0..6).map(|j| squares[i][j] * step[j]).sum();
                let off = own + damping * squares[i][i] * step[i] + b;
                assert!(off.abs() < 1e-8, "{damping} {i}: {off}");
            }
        }
    }
}
