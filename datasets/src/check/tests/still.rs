//! Poses that stand still while the pictures move, pictures that stand still while the poses move, and pictures that are
//! shifted individually.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;
use image::{Luma, Rgb, RgbImage};

use super::{Pixels, change, found, views};
use crate::check::{Effort, QUICK, THOROUGH, still};
use crate::{DatasetError, DepthMap, View, ViewContent};

const SIZE: (u32, u32) = (256, 192);

/// Fails unless the check finds one thing, which contains `named`, with and without depth.
fn is_named(wrong: &[View], efforts: &[Effort], named: &str) {
    let mut bare = wrong.to_vec();
    change(&mut bare, |c| c.depth = None);
    for (views, depth) in [(wrong, "with depth"), (&bare, "without depth")] {
        for effort in efforts {
            let said = found(views, *effort);
            assert!(
                said.len() == 1 && said[0].contains(named),
                "{depth} {effort:?}: {said:?}"
            );
        }
    }
}

fn is_proper(mut views: Vec<View>) {
    for _ in 0..2 {
        for effort in [QUICK, THOROUGH] {
            assert_eq!(found(&views, effort), [""; 0], "{effort:?}");
        }
        change(&mut views, |c| c.depth = None);
    }
}

/// Views of which the views 4 to 7 are of one camera position.
fn burst() -> Vec<View> {
    let mut views = views(0, SIZE);
    for i in 5..8 {
        views[i].camera_from_world = views[4].camera_from_world;
        views[i].content = Arc::clone(&views[4].content);
    }
    views
}

#[test]
fn frozen_poses_are_named_and_bursts_and_moving_things_are_not() {
    let mut wrong = views(0, SIZE);
    for i in 5..8 {
        wrong[i].camera_from_world = wrong[4].camera_from_world;
    }
    is_named(
        &wrong,
        &[QUICK, THOROUGH],
        "the 4 views from view_04 to view_07 have the same pose",
    );
    let mut exposures = burst();
    for (i, view) in exposures[4..8].iter_mut().enumerate() {
        let times = 0.7 + 0.1 * i as f64;
        change(std::slice::from_mut(view), |c| {
            c.picture
                .iter_mut()
                .for_each(|v| *v = (f64::from(*v) * times) as u8);
        });
    }
    for effort in [QUICK, THOROUGH] {
        assert_eq!(still::frozen_poses(&exposures, effort), None);
    }
    // Half of the picture shows something that moves.
    let mut passing = burst();
    for (i, view) in passing.iter_mut().enumerate() {
        change(std::slice::from_mut(view), |c| {
            let moved = c.picture.clone();
            for (x, y, pixel) in c.picture.enumerate_pixels_mut().filter(|p| p.0 < 128) {
                *pixel = *moved.get_pixel((x + 6 * i as u32) % 128, y);
            }
        });
    }
    for effort in [QUICK, THOROUGH] {
        assert_eq!(still::frozen_poses(&passing, effort), None);
    }
}

/// A view whose picture is in a file.
#[derive(Debug)]
struct InFile(Pixels, PathBuf);

impl ViewContent for InFile {
    fn image(&self) -> Result<RgbImage, DatasetError> {
        self.0.image()
    }

    fn depth(&self) -> Result<Option<DepthMap>, DatasetError> {
        self.0.depth()
    }

    fn image_file(&self) -> Option<&Path> {
        Some(&self.1)
    }
}

#[test]
fn repeated_pictures_are_named_without_depth_and_standing_still_is_not() {
    let mut wrong = views(0, SIZE);
    change(&mut wrong, |c| c.depth = None);
    let right = wrong.clone();
    for i in [1, 3, 5, 7] {
        wrong[i].content = Arc::clone(&wrong[i - 1].content);
    }
    is_named(&wrong, &[QUICK, THOROUGH], "have the same picture");
    is_proper(burst());
    let mut jittered = burst();
    change(&mut jittered, |c| c.depth = None);
    for (i, view) in jittered[4..8].iter_mut().enumerate() {
        view.camera_from_world.translation += DVec3::X * 1e-4 * i as f64;
    }
    is_proper(jittered);
    // A repetition that is in no examined pair is found by its file.
    let folder = tempfile::tempdir().unwrap();
    let mut one = right.clone();
    for (i, view) in one.iter_mut().enumerate() {
        let of = if i == 4 { 3 } else { i };
        let pixels = Pixels::of(&right[of]);
        let file = folder.path().join(format!("{i}.png"));
        pixels.picture.save(&file).unwrap();
        view.content = Arc::new(InFile(pixels, file));
    }
    let said = found(&one, THOROUGH);
    assert!(
        said.len() == 1 && said[0].starts_with("view_03 and view_04 have the same picture, "),
        "{said:?}"
    );
}

#[test]
fn pictures_that_are_shifted_individually_are_named() {
    let mut wrong = views(0, SIZE);
    for (i, view) in wrong.iter_mut().enumerate() {
        let by = [(7, 6), (-6, -7), (4, -6), (-7, 5), (0, 3)][i % 5];
        change(std::slice::from_mut(view), |c| {
            let (w, h) = c.picture.dimensions();
            let at =
                |i: u32, by: i64, n: u32| (i64::from(i) + by).clamp(0, i64::from(n) - 1) as u32;
            let from = |x, y| (at(x, by.0, w), at(y, by.1, h));
            c.turn(|picture| {
                RgbImage::from_fn(w, h, |x, y| -> Rgb<u8> {
                    let (x, y) = from(x, y);
                    *picture.get_pixel(x, y)
                })
            });
            c.change(|depth| {
                DepthMap::from_fn(w, h, |x, y| -> Luma<f32> {
                    let (x, y) = from(x, y);
                    *depth.get_pixel(x, y)
                })
            });
        });
    }
    for effort in [QUICK, THOROUGH] {
        let said = found(&wrong, effort);
        assert!(
            said.len() == 1 && said[0].contains("shifted against each other"),
            "{effort:?}: {said:?}"
        );
    }
}
