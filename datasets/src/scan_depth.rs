//! Depth of laser scans, meshes and triangulated points as seen by a pinhole camera.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use glam::{DVec2, DVec3};
use sharp::camera::{Intrinsics, RigidTransform};

use crate::depth_map::{valid_depth, z_buffer};
use crate::format::ply_points::{self, Geometry};
use crate::{DatasetError, DepthMap, files};

/// Minimum depth that is drawn, in metres (the near plane of ScanNet++'s toolbox).
const NEAR_M: f64 = 0.05;

/// The scan that was used last, so that it is read only once for the views of a scene. Shared by
/// all scenes of a dataset, so that only one scan is in memory at a time.
#[derive(Debug, Clone, Default)]
pub(crate) struct ScanCache(Arc<Mutex<Option<CachedScan>>>);

#[derive(Debug)]
struct CachedScan {
    file: PathBuf,
    geometry: Arc<Geometry>,
}

impl ScanCache {
    fn get(&self, file: &Path) -> Result<Arc<Geometry>, DatasetError> {
        // A panic elsewhere cannot leave the slot in an inconsistent state.
        let mut slot = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match &*slot {
            Some(held) if held.file == file => Ok(Arc::clone(&held.geometry)),
            _ => {
                *slot = None;
                let geometry = Arc::new(files::parse(file, ply_points::parse)?);
                *slot = Some(CachedScan {
                    file: file.to_owned(),
                    geometry: Arc::clone(&geometry),
                });
                Ok(geometry)
            }
        }
    }
}

/// A scan or mesh in world coordinates, in metres.
#[derive(Debug, Clone)]
pub(crate) struct ScanFile {
    pub(crate) file: PathBuf,
    pub(crate) cache: ScanCache,
    /// Points mark all pixels within this distance, in pixels. Triangles are filled and ignore this radius.
    pub(crate) splat_radius: u32,
}

impl ScanFile {
    /// Depth of the scan as seen by a view.
    pub(crate) fn seen_by(
        &self,
        pinhole: &Intrinsics,
        camera_from_world: &RigidTransform,
    ) -> Result<DepthMap, DatasetError> {
        let geometry = self.cache.get(&self.file)?;
        let points = geometry.points.iter().map(|p| p.as_dvec3());
        if geometry.triangles.is_empty() {
            let radius = self.splat_radius;
            return Ok(points_seen_by(pinhole, camera_from_world, points, radius));
        }
        let mut depth = DepthMap::new(pinhole.width, pinhole.height);
        for triangle in &geometry.triangles {
            let corner = |i: u32| geometry.points[i as usize].as_dvec3();
            let corners = triangle.map(|i| camera_from_world.apply(corner(i)));
            draw(pinhole, corners, &mut depth);
        }
        Ok(depth)
    }
}

/// Depth of points in world coordinates, each of which marks the pixels within `radius`.
pub(crate) fn points_seen_by(
    pinhole: &Intrinsics,
    camera_from_world: &RigidTransform,
    points: impl Iterator<Item = DVec3>,
    radius: u32,
) -> DepthMap {
    let places = points.filter_map(|p| place(pinhole, camera_from_world.apply(p)));
    z_buffer((pinhole.width, pinhole.height), radius, places)
}

fn place(pinhole: &Intrinsics, point: DVec3) -> Option<(DVec2, f64)> {
    (point.z >= NEAR_M).then(|| Some((pinhole.project(point)?, point.z)))?
}

/// Draws the part of a triangle beyond the near plane.
fn draw(pinhole: &Intrinsics, corners: [DVec3; 3], depth: &mut DepthMap) {
    let beyond = corners.map(|c| c.z >= NEAR_M);
    match beyond.iter().filter(|b| **b).count() {
        0 => return,
        3 => return fill(pinhole, corners, depth),
        _ => {}
    }
    // The clipped triangle has three or four corners.
    let mut left = Vec::with_capacity(4);
    for i in 0..3 {
        let (a, b) = (corners[i], corners[(i + 1) % 3]);
        if beyond[i] {
            left.push(a);
        }
        if beyond[i] != beyond[(i + 1) % 3] {
            let cut = a.lerp(b, (NEAR_M - a.z) / (b.z - a.z));
            left.push(cut.truncate().extend(NEAR_M));
        }
    }
    for pair in left[1..].windows(2) {
        fill(pinhole, [left[0], pair[0], pair[1]], depth);
    }
}

/// Draws a triangle into a z-buffer, sampled at pixel centres. Interpolates 1/z, which is linear in the picture.
fn fill(pinhole: &Intrinsics, corners: [DVec3; 3], depth: &mut DepthMap) {
    let places = corners.map(|c| place(pinhole, c));
    let [Some((a, za)), Some((b, zb)), Some((c, zc))] = places else {
        return;
    };
    let area = (b - a).perp_dot(c - a);
    if area == 0.0 || !area.is_finite() {
        return;
    }
    let low = a.min(b).min(c);
    let high = a.max(b).max(c);
    // Range of pixels whose centres may be inside the triangle.
    let range = |low: f64, high: f64, side: u32| {
        let first = (low - 0.5).ceil().max(0.0);
        let last = (high - 0.5).floor().min(f64::from(side) - 1.0);
        (first <= last).then_some(first as u32..=last as u32)
    };
    let (Some(xs), Some(ys)) = (
        range(low.x, high.x, pinhole.width),
        range(low.y, high.y, pinhole.height),
    ) else {
        return;
    };
    for y in ys {
        for x in xs.clone() {
            let p = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let wa = (b - p).perp_dot(c - p) / area;
            let wb = (c - p).perp_dot(a - p) / area;
            let wc = 1.0 - wa - wb;
            if wa < 0.0 || wb < 0.0 || wc < 0.0 {
                continue;
            }
            let z = valid_depth(1.0 / (wa / za + wb / zb + wc / zc));
            let into = &mut depth.get_pixel_mut(x, y).0[0];
            if z > 0.0 && (*into == 0.0 || z < *into) {
                *into = z;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slanted_triangle_has_the_planes_depth() {
        let pinhole = Intrinsics::new((50.0, 50.0), (20.0, 15.0), (40, 30)).unwrap();
        // The plane z = 2 + x/2.
        let at = |x: f64, y: f64| DVec3::new(x, y, 2.0 + 0.5 * x);
        let mut depth = DepthMap::new(40, 30);
        fill(
            &pinhole,
            [at(-3.0, -3.0), at(3.0, -3.0), at(0.0, 4.0)],
            &mut depth,
        );
        let mut filled = 0;
        for (x, y, z) in depth.enumerate_pixels().filter(|(_, _, z)| z.0[0] > 0.0) {
            let ray = pinhole.unproject(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5), 1.0);
            let expected = 2.0 / (1.0 - 0.5 * ray.x);
            assert!((f64::from(z.0[0]) - expected).abs() < 1e-6 * expected);
            filled += 1;
        }
        assert!(filled > 700, "{filled}");
        // The nearer surface is visible; a triangle behind the camera is not drawn.
        let behind = [(-9.0, -9.0), (9.0, -9.0), (0.0, 9.0)];
        let before = depth.clone();
        draw(
            &pinhole,
            behind.map(|(x, y)| DVec3::new(x, y, 0.049)),
            &mut depth,
        );
        assert_eq!(depth, before);
        let near = [(-1.0, -1.0), (1.0, -1.0), (0.0, 1.0)].map(|(x, y)| DVec3::new(x, y, 1.0));
        fill(&pinhole, near, &mut depth);
        assert_eq!(depth.get_pixel(20, 15).0[0], 1.0);
    }

    /// A floor that starts behind the camera is visible from where it crosses the near plane.
    #[test]
    fn a_triangle_through_the_near_plane_is_cut_there() {
        let pinhole = Intrinsics::new((50.0, 50.0), (20.0, 15.0), (40, 30)).unwrap();
        let floor = |x: f64, z: f64| DVec3::new(x, 1.5, z);
        // First one corner is beyond the plane, then two.
        for corners in [
            [floor(-900.0, -9.0), floor(0.0, 60.0), floor(900.0, -9.0)],
            [floor(-900.0, 60.0), floor(900.0, 60.0), floor(0.0, -90.0)],
        ] {
            let mut depth = DepthMap::new(40, 30);
            draw(&pinhole, corners, &mut depth);
            for (x, y, z) in depth.enumerate_pixels() {
                // The floor 1.5 m below is at 1.5 f / (y - cy).
                let expected = 75.0 / (f64::from(y) + 0.5 - 15.0);
                let seen = expected > 0.0 && expected < 55.0;
                if seen {
                    let error = (f64::from(z.0[0]) - expected).abs();
                    assert!(error < 1e-6 * expected, "({x}, {y}): {error}");
                } else if expected < 0.0 {
                    assert_eq!(z.0[0], 0.0, "({x}, {y})");
                }
            }
        }
    }
}
