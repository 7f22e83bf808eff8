//! Wrong files and readings are reported, and correct ones are not.

use glam::{DAffine3, DMat3, DQuat, DVec3};
use image::Luma;
use sharp::camera::{Intrinsics, RigidTransform};
use sharp::color::srgb_from_linear;
use sharp::gaussians::Gaussians;
use sharp::render::Rule;
use sharp_datasets::{DatasetError, View, ViewContent};
use sharp_tests::holds;

use super::*;
use crate::evaluate::doubts::doubts_of;
use crate::methods::GaussianSpace;

fn source() -> PosedCamera {
    // Turned about the vertical axis and moved, so that world space and camera space differ.
    let (sin, cos) = 0.4_f64.sin_cos();
    PosedCamera {
        id: "s".to_owned(),
        intrinsics: Intrinsics::new((40.0, 40.0), (20.0, 16.0), (40, 32)).unwrap(),
        camera_from_world: RigidTransform::from_row_major(&[
            cos, 0.0, sin, 0.3, 0.0, 1.0, 0.0, -0.2, -sin, 0.0, cos, 0.5, 0.0, 0.0, 0.0, 1.0,
        ])
        .unwrap(),
    }
}

/// A wall of coloured Gaussians in camera space, 2 m in front of the camera: one per pixel, all
/// at different depths.
fn wall() -> Gaussians {
    let k = source().intrinsics;
    let mut wall = Gaussians::default();
    for y in 0..k.height {
        for x in 0..k.width {
            let at = |p: u32, c: f64, f: f64| (2.0 * (f64::from(p) + 0.5 - c) / f) as f32;
            let place = sharp::random::mix(u64::from(y * k.width + x)) % 4096;
            let z = 2.0 + (place as f32 - 2048.0) * 2.5e-7;
            wall.means.push([at(x, k.cx, k.fx), at(y, k.cy, k.fy), z]);
            wall.quaternions.push([1.0, 0.0, 0.0, 0.0]);
            wall.scales.push([0.03, 0.03, 1e-3]);
            wall.opacities.push(0.95);
            wall.colors.push([
                0.2 + 0.6 * (x / 8 % 2) as f32,
                0.1 + 0.02 * y as f32,
                0.3 + 0.4 * ((x + y) / 16 % 2) as f32,
            ]);
        }
    }
    wall
}

fn mapped(gaussians: &Gaussians, map: DAffine3) -> Gaussians {
    let point = |m: &[f32; 3]| map.transform_point3(DVec3::from(m.map(f64::from)));
    Gaussians {
        means: gaussians
            .means
            .iter()
            .map(|m| point(m).as_vec3().to_array())
            .collect(),
        // Gaussians are spherical, so rotations do not change them.
        scales: vec![[0.03; 3]; gaussians.len()],
        ..gaussians.clone()
    }
}

fn recolored(gaussians: &Gaussians, convert: fn(f32) -> f32) -> Gaussians {
    let colors = gaussians.colors.iter().map(|color| color.map(convert));
    Gaussians {
        colors: colors.collect(),
        ..gaussians.clone()
    }
}

/// The wall as seen by the source's camera.
fn photograph() -> RgbImage {
    let (round, renderer) = (mapped(&wall(), DAffine3::IDENTITY), SharedRenderer::cpu());
    let truth = renderer.render(&round, DAffine3::IDENTITY, source().intrinsics, None);
    renderer.picture(&truth.unwrap())
}

fn doubt_about(gaussians: Gaussians) -> Option<String> {
    doubt_about_read(gaussians, FileReading::of_arrays())
}

/// Like [`doubt_about_read`], for Gaussians in world space.
fn doubt_about_world(gaussians: Gaussians, reading: FileReading) -> Option<String> {
    let map = reading.placement.camera_from_file(&source());
    doubt_of(
        &source(),
        GaussianSpace::Camera(map),
        &photograph(),
        gaussians,
        reading,
        None,
    )
}

fn doubt_about_read(gaussians: Gaussians, reading: FileReading) -> Option<String> {
    doubt_beside(&photograph(), gaussians, reading, None)
}

/// The doubt about Gaussians next to other evidence: `suggested` is a setting that the stored numbers suggest.
fn doubt_beside(
    photograph: &RgbImage,
    gaussians: Gaussians,
    reading: FileReading,
    suggested: Option<&str>,
) -> Option<String> {
    doubt_of(
        &source(),
        GaussianSpace::CAMERA,
        photograph,
        gaussians,
        reading,
        suggested,
    )
}

fn doubt_of(
    source: &PosedCamera,
    space: GaussianSpace,
    photograph: &RgbImage,
    gaussians: Gaussians,
    reading: FileReading,
    suggested: Option<&str>,
) -> Option<String> {
    let depth = DepthMap::from_pixel(40, 32, Luma([2.0]));
    let facts = facts_of(
        source,
        space,
        photograph,
        gaussians,
        reading,
        suggested,
        Some(&depth),
    );
    let mut record = crate::evaluate::record::tests::record();
    record.median_depth_m = Some(2.0);
    (record.warnings, record.extras) = (facts.warnings, facts.extras);
    let found = doubts_of([&record].into_iter(), "gaussians");
    (!found.is_empty()).then(|| found.join("; "))
}

fn facts_of(
    source: &PosedCamera,
    space: GaussianSpace,
    photograph: &RgbImage,
    gaussians: Gaussians,
    reading: FileReading,
    suggested: Option<&str>,
    depth: Option<&DepthMap>,
) -> SourceFacts {
    let scene = Scene::new("m", "s", Vec::new(), sharp_datasets::Pairing::MultiView);
    let (camera, is_chosen, valid) = (source, true, None);
    let checked = CheckedSource {
        camera,
        photograph,
        valid,
        depth,
        scene: &scene,
        is_chosen,
        of_several_views: false,
    };
    facts_about(&checked, space, gaussians, reading, suggested)
}

fn facts_about(
    checked: &CheckedSource<'_>,
    space: GaussianSpace,
    gaussians: Gaussians,
    reading: FileReading,
    suggested: Option<&str>,
) -> SourceFacts {
    let renderer = SharedRenderer::cpu();
    let prediction = GaussianPrediction {
        rule: reading.rule,
        rule_note: None,
        gaussians,
        space,
        first_layer: None,
        extras: BTreeMap::new(),
        reading: Some(reading),
        warnings: suggested
            .map(|setting| (setting.to_owned(), format!("suggested: {setting}")))
            .into_iter()
            .collect(),
    };
    check_source(&prediction, checked, &renderer).unwrap()
}

#[test]
fn a_wrong_frame_colour_space_or_unit_is_named_and_a_right_one_is_not() {
    let round = mapped(&wall(), DAffine3::IDENTITY);
    assert_eq!(doubt_about(round.clone()), None);
    let gl = DAffine3::from_mat3(DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)));
    let world = source().camera_from_world.to_affine().inverse();
    let normalized = placed(GaussianSpace::Normalized, &source(), &source()).inverse();
    let millimetres = DAffine3::from_scale(DVec3::splat(1000.0));
    let in_millimetres = Gaussians {
        scales: vec![[30.0; 3]; round.len()],
        ..mapped(&round, millimetres)
    };
    let in_millimetres_too = in_millimetres.clone();
    let in_feet = Gaussians {
        scales: vec![[0.1; 3]; round.len()],
        ..mapped(&round, DAffine3::from_scale(DVec3::splat(1.0 / 0.3)))
    };
    let mut bgr = round.clone();
    bgr.colors.iter_mut().for_each(|color| color.reverse());
    let in_normalized = Gaussians {
        scales: vec![[0.06, 0.075, 0.03]; round.len()],
        ..mapped(&round, normalized)
    };
    for (gaussians, words) in [
        (mapped(&round, gl), "with `axes=rub`, they"),
        (mapped(&round, world), "with `space=world`, they"),
        (in_normalized, "with `space=normalized`, they"),
        (
            recolored(&round, srgb_from_linear),
            "with `color_space=srgb`, they",
        ),
        (
            recolored(&mapped(&round, gl), srgb_from_linear),
            "with `color_space=srgb` and `axes=rub`, they",
        ),
        (
            in_millimetres,
            "times as far away as the dataset's depth (s); if the dataset's unit is right, use `scale=0.001`",
        ),
        (in_feet, "use `scale=0.3`"),
        (bgr, "with `channels=bgr`, they"),
        (
            recolored(&round, |_| 0.9),
            "no other setting that was tried",
        ),
        // Reporting one problem does not hide another.
        (recolored(&in_millimetres_too, |_| 0.9), "times as far away"),
    ] {
        let said = doubt_about(gaussians).unwrap_or_default();
        assert!(said.contains(words), "{words}: {said}");
    }
}

/// The colours are stored in a form other than coefficients, but read as coefficients, as in a PLY without a setting.
#[test]
fn colours_of_another_form_are_named() {
    let mut reading = FileReading::of_arrays();
    reading.stored.colors = Some(sharp::ply::StoredColors::Dc);
    let read_as_dc = |store: fn(f32) -> f32| {
        let mut stored = recolored(&mapped(&wall(), DAffine3::IDENTITY), store);
        reading.stored.decode(&mut stored);
        doubt_about_read(stored, reading).unwrap_or_default()
    };
    for (store, words) in [
        (
            (|c| c * 255.0) as fn(f32) -> f32,
            "with `colors=rgb255`, they",
        ),
        (|c| c, "with `colors=rgb01`, they"),
        (|c| c / 0.282_094_79, "with `colors=dc-uncentered`, they"),
    ] {
        let said = read_as_dc(store);
        assert!(said.contains(words), "{words}: {said}");
    }
    assert_eq!(read_as_dc(|c| (c - 0.5) / 0.282_094_79), "");
}

#[test]
fn what_numbers_suggest_is_told_where_the_photograph_does_not_refute_it() {
    let round = mapped(&wall(), DAffine3::IDENTITY);
    let mut dc = FileReading::of_arrays();
    dc.stored.colors = Some(sharp::ply::StoredColors::Dc);
    let rgb01 = Some("colors=rgb01");
    // A pastel wall, whose coefficients are all in 0..1.
    let pastel = recolored(&round, |c| 0.5 + 0.28 * c);
    let seen = SharedRenderer::cpu();
    let shown = seen.render(&pastel, DAffine3::IDENTITY, source().intrinsics, None);
    let shown = seen.picture(&shown.unwrap());
    assert_eq!(doubt_beside(&shown, pastel, dc, rgb01), None);
    let mut misread = round.clone();
    dc.stored.decode(&mut misread);
    let said = doubt_beside(&photograph(), misread, dc, rgb01).unwrap();
    holds(&said, &["suggested: ", "with `colors=rgb01`, they"]);
    // If two settings are needed, a single sentence names both.
    let bytes = recolored(&round, |c| 255.0 * srgb_from_linear(c));
    let arrays = FileReading::of_arrays();
    let said = doubt_beside(&photograph(), bytes, arrays, Some("colors=rgb255")).unwrap();
    assert!(
        said.contains("with `color_space=srgb` and `colors=rgb255`, they"),
        "{said}"
    );
    assert!(!said.contains("suggested"), "{said}");
}

#[test]
fn variances_and_another_focal_length_are_named() {
    let round = mapped(&wall(), DAffine3::IDENTITY);
    let mut logs = FileReading::of_arrays();
    logs.stored.scales = Some(sharp::ply::StoredScales::Log);
    assert_eq!(doubt_about_read(round.clone(), logs), None);
    let mut squared = round.clone();
    squared.scales.fill([0.03 * 0.03; 3]);
    let said = doubt_about_read(squared, logs).unwrap_or_default();
    assert!(said.contains("with `scales=log-variance`, they"), "{said}");
    let narrow = DAffine3::from_scale(DVec3::new(0.8, 0.8, 1.0));
    let said = doubt_about(mapped(&round, narrow)).unwrap_or_default();
    assert!(said.contains("with `focal=1.2"), "{said}");
    let low = DAffine3::from_scale(DVec3::new(1.0, 0.8, 1.0));
    let said = doubt_about(mapped(&round, low)).unwrap_or_default();
    assert!(said.contains("with `focal=1:1.2"), "{said}");
}

#[test]
fn means_rescaled_without_their_deviations_are_named() {
    let mut near = mapped(&wall(), DAffine3::from_scale(DVec3::splat(0.25)));
    let said = doubt_about(near.clone()).unwrap_or_default();
    assert!(said.contains("only their means have that unit"), "{said}");
    near.scales.fill([0.0075; 3]);
    let said = doubt_about(near).unwrap_or_default();
    assert!(
        said.contains("use `scale=4`") && !said.contains("only their means"),
        "{said}"
    );
}

/// The rule ignores a principal point that is off the centre. The Gaussians are too wide, and other rotations would
/// narrow them.
#[test]
fn an_ignored_principal_point_is_named_and_wide_gaussians_are_not_called_turned() {
    for off in [[6.0, 0.0], [2.0, -2.0]] {
        ignored_and_wide(off);
    }
}

fn ignored_and_wide([x, y]: [f64; 2]) {
    let mut aside = source();
    aside.intrinsics.cx += x;
    aside.intrinsics.cy += y;
    let mut wide = Gaussians::default();
    let (k, base) = (aside.intrinsics, wall());
    for (at, color) in base.colors.iter().enumerate() {
        let (x, y) = (at as u32 % k.width, at as u32 / k.width);
        let place = |p: u32, c: f64, f: f64| (2.0 * (f64::from(p) + 0.5 - c) / f) as f32;
        wide.means.push([
            place(x, k.cx, k.fx),
            place(y, k.cy, k.fy),
            base.means[at][2],
        ]);
        // Discs that face the camera, rolled about its axis.
        let roll = at as f32;
        wide.quaternions.push([roll.cos(), 0.0, 0.0, roll.sin()]);
        wide.scales.push([0.09, 0.06, 1e-3]);
        wide.opacities.push(0.6);
        wide.colors.push(color.map(srgb_from_linear));
    }
    let mut reading = FileReading::of_arrays();
    reading.stored.blending = ColorSpace::Srgb;
    reading.rule = Some(sharp::render::Rule::INRIA_GENERAL);
    let round = {
        let mut round = wide.clone();
        round.scales.fill([0.03; 3]);
        round.opacities.fill(0.95);
        round
    };
    let renderer = SharedRenderer::cpu();
    let shown = renderer
        .render(&round, DAffine3::IDENTITY, k, reading.rule)
        .unwrap();
    let shown = renderer.picture(&shown);
    let said = |gaussians: &Gaussians, reading: FileReading| {
        doubt_of(
            &aside,
            GaussianSpace::CAMERA,
            &shown,
            gaussians.clone(),
            reading,
            None,
        )
    };
    assert_eq!(said(&round, reading), None);
    let about_wide = said(&wide, reading).unwrap_or_default();
    assert!(!about_wide.contains("quaternions="), "{about_wide}");
    reading.rule = Some(sharp::render::Rule::INRIA);
    let text = said(&round, reading).unwrap_or_default();
    holds(&text, &["with `rendering=inria-general`, they"]);
}

/// The first axes are used by no known program: x forward, y right, z down.
#[test]
fn unusual_axes_and_units_of_a_world_are_named() {
    let round = mapped(&wall(), DAffine3::IDENTITY);
    let turned = DMat3::from_cols(DVec3::Y, DVec3::Z, DVec3::X);
    let said = doubt_about(mapped(&round, DAffine3::from_mat3(turned))).unwrap_or_default();
    assert!(said.contains("with `axes=frd`, they"), "{said}");
    let world_from_camera = source().camera_from_world.inverse().to_affine();
    let millimetres = DAffine3::from_scale(DVec3::splat(1000.0)) * world_from_camera;
    let mut world = mapped(&round, millimetres);
    world.scales.fill([30.0; 3]);
    let mut reading = FileReading::of_arrays();
    reading.placement.space = FileSpace::World;
    let said = doubt_about_world(world, reading).unwrap_or_default();
    assert!(said.contains("with `scale=0.001`, they"), "{said}");
}

#[test]
fn an_inverted_transform_is_named() {
    let turn = DMat3::from_rotation_y(0.9) * DMat3::from_rotation_x(0.4);
    let world_from_file = DAffine3::from_mat3_translation(turn, DVec3::new(0.4, -0.3, 0.8));
    let world_from_camera = source().camera_from_world.inverse().to_affine();
    let file = mapped(&wall(), world_from_file.inverse() * world_from_camera);
    let said = |transform: DAffine3| {
        let mut reading = FileReading::of_arrays();
        reading.placement.space = FileSpace::World;
        reading.placement.transform = Some(transform);
        doubt_about_world(file.clone(), reading)
    };
    assert_eq!(said(world_from_file), None);
    let inverted = said(world_from_file.inverse()).unwrap_or_default();
    holds(&inverted, &["with the inverse of `transform=`, they"]);
}

#[test]
fn gaussians_moved_to_the_world_by_the_inverse_pose_are_named() {
    let mut reading = FileReading::of_arrays();
    reading.placement.space = FileSpace::World;
    let pose = source().camera_from_world;
    let round = mapped(&wall(), DAffine3::IDENTITY);
    let said = |pose: RigidTransform| doubt_about_world(mapped(&round, pose.to_affine()), reading);
    assert_eq!(said(pose.inverse()), None);
    let text = said(pose).unwrap_or_default();
    holds(&text, &["with the inverse of the source's pose, they"]);
}

#[test]
fn few_or_blurred_gaussians_show_something_and_plain_ones_do_not() {
    let round = mapped(&wall(), DAffine3::IDENTITY);
    let said = |gaussians: Gaussians| doubt_about(gaussians).unwrap_or_default();
    let nothing = "so the photograph is hardly recognisable";
    // One Gaussian in forty; the rest of the picture stays black.
    let few = round.filtered(|k| k % 41 == 0);
    assert!(
        !said(few.clone()).contains(nothing),
        "{}",
        said(few.clone())
    );
    let mut blurred = round.filtered(|k| k % 5 == 0);
    blurred.scales.fill([0.25; 3]);
    let text = said(blurred);
    assert!(!text.contains(nothing), "{text}");
    // The same with encoded colours.
    let mut encoded = FileReading::of_arrays();
    encoded.stored.blending = ColorSpace::Srgb;
    encoded.rule = Some(sharp::render::Rule::GSPLAT_1_5_3_CLASSIC);
    let text = doubt_about_read(recolored(&few, srgb_from_linear), encoded);
    let text = text.unwrap_or_default();
    assert!(!text.contains(nothing), "{text}");
    // A uniform wall, which may have the photograph's own colour, and Gaussians that are not
    // visible.
    let (seen, whole) = (photograph(), Region::whole((40, 32)));
    let own = Likeness::of(&seen, whole, &seen).mean_color();
    let own = own.map(|v| linear_from_srgb(v as f32 / 255.0));
    let mut plain = round.clone();
    plain.colors.fill(own);
    assert!(said(plain).contains(nothing));
    assert!(said(recolored(&round, |_| 0.2)).contains(nothing));
    let mut aside = round.clone();
    aside.means.iter_mut().for_each(|mean| mean[1] += 50.0);
    assert!(said(aside).contains(nothing));
}

/// One file has only half of its Gaussians; another shows only what lies below a plain sky.
#[test]
fn a_missing_half_is_named_and_a_sky_without_gaussians_is_not() {
    let round = mapped(&wall(), DAffine3::IDENTITY);
    let missing = "50 % of their source's photograph empty";
    for keeps in [|k: usize| k < 640, |k: usize| k % 40 >= 20] {
        let said = doubt_about(round.filtered(keeps)).unwrap_or_default();
        assert!(said.contains(missing), "{said}");
    }
    let few = doubt_about(round.filtered(|k| k >= 240)).unwrap_or_default();
    assert!(!few.contains("empty"), "{few}");
    let mut sky = photograph();
    for (_, _, pixel) in sky.enumerate_pixels_mut().filter(|(_, y, _)| *y < 16) {
        pixel.0 = [190, 200, 220];
    }
    let below = round.filtered(|k| k >= 640);
    let said = doubt_beside(&sky, below, FileReading::of_arrays(), None).unwrap_or_default();
    assert!(!said.contains("empty"), "{said}");
}

#[test]
fn other_forms_of_logarithms_and_signed_colours_are_named() {
    let mut encoded = FileReading::of_arrays();
    encoded.stored.blending = ColorSpace::Srgb;
    encoded.stored.color_space = Some(ColorSpace::Srgb);
    encoded.rule = Some(sharp::render::Rule::INRIA_GENERAL);
    let mut file = FileReading {
        stored: StoredForm {
            color_space: Some(ColorSpace::Srgb),
            blending: ColorSpace::Srgb,
            ..StoredForm::ply().or_of(&StoredForm::default())
        },
        ..encoded
    };
    file.placement = encoded.placement;
    let round = recolored(&mapped(&wall(), DAffine3::IDENTITY), srgb_from_linear);
    let renderer = SharedRenderer::cpu();
    let seen = renderer.render(&round, DAffine3::IDENTITY, source().intrinsics, file.rule);
    let seen = renderer.picture(&seen.unwrap());
    assert_eq!(doubt_beside(&seen, round.clone(), file, None), None);
    for setting in ["opacity=log", "scales=log10", "colors=rgb-signed"] {
        let (key, value) = setting.split_once('=').unwrap();
        let mut written = file;
        written.set(key, value).unwrap();
        let mut misread = round.clone();
        written.stored.encode(&mut misread);
        file.stored.decode(&mut misread);
        let said = doubt_beside(&seen, misread, file, None).unwrap_or_default();
        assert!(
            said.contains(&format!("with `{setting}`, they")),
            "{setting}: {said}"
        );
    }
}

/// Logarithms to the base of 10, read as natural ones, give Gaussians so wide that rendering takes very long.
#[test]
fn very_wide_gaussians_are_told_with_the_form_that_is_possible() {
    let mut wide = mapped(&wall(), DAffine3::IDENTITY);
    for _ in 0..3 {
        let again = wide.clone();
        wide.means.extend(again.means);
        wide.quaternions.extend(again.quaternions);
        wide.scales.extend(again.scales);
        wide.opacities.extend(again.opacities);
        wide.colors.extend(again.colors);
    }
    let mut reading = FileReading::of_arrays();
    reading.stored.scales = Some(StoredScales::Log);
    wide.scales.fill([0.4; 3]);
    let about = |gaussians: &Gaussians, reading| {
        let prediction = GaussianPrediction {
            gaussians: gaussians.clone(),
            space: GaussianSpace::CAMERA,
            reading: Some(reading),
            ..GaussianPrediction::default()
        };
        absurd_coverage(&prediction, &source()).map(|(_, text)| text)
    };
    let text = about(&wide, reading).unwrap_or_default();
    assert!(text.contains("another form (`scales=log10`)"), "{text}");
    reading.stored.scales = Some(StoredScales::Linear);
    let text = about(&wide, reading).unwrap_or_default();
    assert!(text.contains("another unit (`scale=`)"), "{text}");
    wide.scales.fill([0.03; 3]);
    assert_eq!(about(&wide, reading), None);
}

/// The wall with fine stripes, three pixels wide.
fn stripes() -> Gaussians {
    let mut wall = mapped(&wall(), DAffine3::IDENTITY);
    let width = source().intrinsics.width as usize;
    for (at, color) in wall.colors.iter_mut().enumerate() {
        let (x, y) = (at % width, at / width);
        color[1] = 0.1 + 0.01 * y as f32 + 0.4 * (x / 3 % 2) as f32;
    }
    wall
}

/// The Gaussians are needles in a wall of stripes. Their means were turned with the world, their quaternions were not.
#[test]
fn means_that_were_turned_without_their_quaternions_are_named() {
    let (mut long, k) = (stripes(), source().intrinsics);
    long.scales.fill([0.02, 0.15, 0.002]);
    let renderer = SharedRenderer::cpu();
    let seen = renderer.render(&long, DAffine3::IDENTITY, k, None).unwrap();
    let seen = renderer.picture(&seen);
    let turn = DQuat::from_rotation_z(1.2) * DQuat::from_rotation_x(0.3);
    let mut turned = mapped(&long, DAffine3::from_quat(turn));
    turned.scales.clone_from(&long.scales);
    let mut reading = FileReading::of_arrays();
    let back = DAffine3::from_quat(turn.inverse());
    reading.placement.transform = Some(back);
    let said = |gaussians: &Gaussians| {
        doubt_of(
            &source(),
            GaussianSpace::Camera(reading.placement.camera_from_file(&source())),
            &seen,
            gaussians.clone(),
            reading,
            None,
        )
    };
    let text = said(&turned).unwrap_or_default();
    assert!(text.contains("turned without their quaternions"), "{text}");
    for quaternion in &mut turned.quaternions {
        *quaternion = [turn.w, turn.x, turn.y, turn.z].map(|v| v as f32);
    }
    assert_eq!(said(&turned), None);
}

/// Colours depend on the direction. The means were turned with the world, the harmonics were not.
#[test]
fn gaussians_that_were_turned_without_their_harmonics_are_named() {
    let (mut shiny, k) = (stripes(), source().intrinsics);
    shiny.harmonics = sharp::gaussians::Harmonics {
        degree: 1,
        coefficients: (0..shiny.len())
            .flat_map(|i| {
                [[0.3, -0.2, 0.1], [0.2, 0.3, -0.3], [-0.3, 0.1, 0.2]]
                    .map(|c| c.map(|v| v * [1.0, -1.0][i / 7 % 2]))
            })
            .collect(),
    };
    let renderer = SharedRenderer::cpu();
    let seen = renderer
        .render(&shiny, DAffine3::IDENTITY, k, Some(Rule::GSPLAT_CLASSIC))
        .unwrap();
    let seen = renderer.picture(&seen);
    let world_from_camera = source().camera_from_world.inverse();
    let mut turned = mapped(&shiny, world_from_camera.to_affine());
    turned.scales.clone_from(&shiny.scales);
    let q = DQuat::from_mat3(&world_from_camera.rotation);
    turned
        .quaternions
        .fill([q.w, q.x, q.y, q.z].map(|v| v as f32));
    let mut of_source = FileReading::of_arrays();
    of_source.rule = Some(Rule::GSPLAT_CLASSIC);
    let mut of_world = of_source;
    of_world.placement.space = FileSpace::World;
    let said = |gaussians: &Gaussians, reading: FileReading| {
        let space = GaussianSpace::Camera(reading.placement.camera_from_file(&source()));
        doubt_of(&source(), space, &seen, gaussians.clone(), reading, None)
    };
    let text = said(&turned, of_world).unwrap_or_default();
    assert!(text.contains("turned without the harmonics"), "{text}");
    assert_eq!(said(&shiny, of_source), None);
}

/// A wall of narrow Gaussians, which the low-pass of antialiasing rules makes translucent.
#[test]
fn another_rendering_rule_is_named_only_if_it_gains_much() {
    let (mut narrow, k) = (stripes(), source().intrinsics);
    narrow.scales.fill([0.01; 3]);
    let [classic, antialiased] = [Rule::GSPLAT_CLASSIC, Rule::GSPLAT_ANTIALIASED];
    let renderer = SharedRenderer::cpu();
    let seen = renderer
        .render(&narrow, DAffine3::IDENTITY, k, Some(classic))
        .unwrap();
    let seen = renderer.picture(&seen);
    let said = |rule: Rule| {
        let mut reading = FileReading::of_arrays();
        reading.rule = Some(rule);
        let facts = facts_of(
            &source(),
            GaussianSpace::CAMERA,
            &seen,
            narrow.clone(),
            reading,
            None,
            None,
        );
        facts.warnings.into_values().collect::<String>()
    };
    let text = said(antialiased);
    assert!(
        text.contains("with `rendering=gsplat-classic`, they"),
        "{text}"
    );
    assert_eq!(said(classic), "");
}

/// Gaussians with the photograph's colours at its pixels, slightly too wide, in centimetres and millimetres, on ground
/// that slopes away from the camera. Narrower Gaussians, or ones moved down by half a pixel, would resemble the
/// photograph more.
#[test]
fn proper_gaussians_on_sloping_ground_are_proper_in_any_unit() {
    let k = source().intrinsics;
    let level = |x: u32, y: u32, channel: u64| {
        let noise = sharp::random::mix(u64::from(y / 2 * 64 + x / 2) * 3 + channel) % 120;
        (60 + noise) as u8
    };
    let seen = RgbImage::from_fn(k.width, k.height, |x, y| {
        image::Rgb([0, 1, 2].map(|channel| level(x, y, channel)))
    });
    for unit in [1.0, 0.01, 0.001] {
        let mut ground = Gaussians::default();
        for (x, y, pixel) in seen.enumerate_pixels() {
            let z = 2.0 + 6.0 * (1.0 - f64::from(y) / f64::from(k.height));
            let at = |p: u32, c: f64, f: f64| (z * (f64::from(p) + 0.5 - c) / f / unit) as f32;
            ground
                .means
                .push([at(x, k.cx, k.fx), at(y, k.cy, k.fy), (z / unit) as f32]);
            ground.quaternions.push([1.0, 0.0, 0.0, 0.0]);
            ground.scales.push([(0.65 * z / k.fx / unit) as f32; 3]);
            ground.opacities.push(0.95);
            ground.colors.push(
                pixel
                    .0
                    .map(|v| sharp::color::linear_from_srgb(f32::from(v) / 255.0)),
            );
        }
        let mut reading = FileReading::of_arrays();
        reading.placement.scale = unit;
        reading.stored.scales = Some(StoredScales::Log);
        let facts = facts_of(
            &source(),
            GaussianSpace::Camera(reading.placement.camera_from_file(&source())),
            &seen,
            ground,
            reading,
            None,
            None,
        );
        let said = facts.warnings.into_values().collect::<String>();
        assert_eq!(said, "", "{unit}");
    }
}

/// There is no true depth here, so only blur and holes reveal the scale.
#[test]
fn means_scaled_without_their_deviations_are_named_by_their_overlap() {
    let said = |right: &Gaussians, factor: f32| {
        let renderer = SharedRenderer::cpu();
        let seen = renderer.render(right, DAffine3::IDENTITY, source().intrinsics, None);
        let seen = renderer.picture(&seen.unwrap());
        let mut other = right.clone();
        let scales = other.scales.as_flattened_mut().iter_mut();
        scales.for_each(|scale| *scale *= factor);
        let reading = FileReading::of_arrays();
        let space = GaussianSpace::CAMERA;
        let facts = facts_of(&source(), space, &seen, other, reading, None, None);
        facts.warnings.into_values().collect::<String>()
    };
    let dense = stripes();
    let mut sparse = stripes().filtered(|k| k % 3 == 0 && k / 40 % 3 == 0);
    sparse.scales.fill([0.09; 3]);
    let text = said(&dense, 3.0);
    assert!(text.contains("0.333 times as wide"), "{text}");
    let text = said(&sparse, 1.0 / 3.0);
    assert!(text.contains("3 times as wide"), "{text}");
    // Each pixel's centre shows the colour of its own Gaussian, however narrow.
    for (factor, wider) in [(0.1, "10"), (0.01, "100")] {
        let text = said(&dense, factor);
        let named = format!("with standard deviations {wider} times as wide");
        assert!(text.contains(&named), "{factor}: {text}");
    }
    for factor in [0.7, 1.0, 1.5] {
        for right in [&dense, &sparse] {
            assert_eq!(said(right, factor), "", "{factor}");
        }
    }
    // Narrow Gaussians copy the noise of a photograph, which right ones smooth.
    let mut noisy = dense.clone();
    for (k, color) in noisy.colors.iter_mut().enumerate() {
        *color = [color[0] + (k * 7919 % 97) as f32 / 300.0; 3];
    }
    noisy
        .scales
        .iter_mut()
        .for_each(|scale| *scale = scale.map(|s| s / 5.0));
    assert_eq!(said(&noisy, 5.0), "");
    // Gaussians of 0.7 pixels already cover the picture, so narrower ones would only be mere points.
    let mut narrow = noisy.clone();
    for (mean, scales) in narrow.means.iter().zip(&mut narrow.scales) {
        *scales = [0.2 * mean[2] / source().intrinsics.fx as f32; 3];
    }
    assert_eq!(said(&narrow, 3.5), "");
}

/// A picture in memory.
#[derive(Debug)]
struct Still(RgbImage, Option<DepthMap>);

impl ViewContent for Still {
    fn image(&self) -> Result<RgbImage, DatasetError> {
        Ok(self.0.clone())
    }

    fn depth(&self) -> Result<Option<DepthMap>, DatasetError> {
        Ok(self.1.clone())
    }
}

/// A block in front of a wall, seen by two cameras side by side with different principal points.
struct Pair {
    scene: Scene,
    photographs: [RgbImage; 2],
}

const BASELINE_M: f64 = 0.2;

impl Pair {
    fn new() -> Self {
        let views = [(0.0, 20.0), (BASELINE_M, 23.0)].map(|(x, cx)| {
            let k = Intrinsics::new((40.0, 40.0), (cx, 16.0), (40, 32)).unwrap();
            let pose = RigidTransform::new(DMat3::IDENTITY, DVec3::X * -x).unwrap();
            (k, pose)
        });
        let mut world = Gaussians::default();
        // From far to near, with some of the wall beyond the pictures.
        for (z, columns, rows) in [(2.0, -12..60, -4..36), (1.2, 12..26, 8..24)] {
            for (x, y) in columns.flat_map(|x: i32| rows.clone().map(move |y: i32| (x, y))) {
                Self::add(&mut world, (x, y), z);
            }
        }
        let renderer = SharedRenderer::cpu();
        let photographs = views.map(|(k, pose)| {
            let seen = renderer.render(&world, pose.to_affine(), k, None).unwrap();
            renderer.picture(&seen)
        });
        Self::of(views, photographs)
    }

    fn of(views: [(Intrinsics, RigidTransform); 2], photographs: [RgbImage; 2]) -> Self {
        let ids = ["l", "r"].into_iter().zip(&photographs);
        let views = ids.zip(views).map(|((id, picture), (k, pose))| View {
            id: id.to_owned(),
            intrinsics: k,
            camera_from_world: pose,
            content: std::sync::Arc::new(Still(picture.clone(), None)),
        });
        let pairing = sharp_datasets::Pairing::MultiView;
        Self {
            scene: Scene::new("m", "s", views.collect(), pairing),
            photographs,
        }
    }

    /// A floor, seen from 1 m above.
    fn floor() -> Self {
        let views = [0.0, BASELINE_M].map(|x| {
            let k = Intrinsics::new((80.0, 80.0), (40.0, -30.0), (80, 64)).unwrap();
            let pose = RigidTransform::new(DMat3::IDENTITY, DVec3::X * -x).unwrap();
            (k, pose)
        });
        let photographs = views.map(|(k, pose)| {
            RgbImage::from_fn(k.width, k.height, |x, y| {
                let at = Self::of_floor(&k, [x, y].map(|p| f64::from(p) + 0.5));
                let (x, z) = (at.x - pose.translation.x, at.z.ln());
                let waves = [(40.0, 9.0), (33.0, -14.0), (52.0, 4.0)];
                image::Rgb(waves.map(|(of_z, of_x)| {
                    let wave = (of_z * z).sin() + (of_x * x + 3.0 * z).cos();
                    (128.0 + 50.0 * wave) as u8
                }))
            })
        });
        Self::of(views, photographs)
    }

    /// The point of the floor at a place of the picture.
    fn of_floor(k: &Intrinsics, [x, y]: [f64; 2]) -> DVec3 {
        let ray = DVec3::new((x - k.cx) / k.fx, (y - k.cy) / k.fy, 1.0);
        ray / ray.y
    }

    /// One Gaussian per pixel of the floor's photograph, shifted by `by` pixels.
    fn predicted_floor(&self, by: [f64; 2]) -> Gaussians {
        let k = self.scene.views[0].intrinsics;
        let mut floor = Gaussians::default();
        for (x, y, pixel) in self.photographs[0].enumerate_pixels() {
            let at = Self::of_floor(&k, [f64::from(x) + 0.5, f64::from(y) + 0.5]);
            let aside = DVec3::new(by[0] / k.fx, by[1] / k.fy, 0.0);
            floor.means.push((at + at.z * aside).as_vec3().to_array());
            floor.quaternions.push([1.0, 0.0, 0.0, 0.0]);
            floor.scales.push([(0.55 * at.z / k.fx) as f32; 3]);
            floor.opacities.push(0.95);
            floor
                .colors
                .push(pixel.0.map(|v| linear_from_srgb(f32::from(v) / 255.0)));
        }
        floor
    }

    /// Adds a Gaussian at a pixel of the left camera.
    fn add(gaussians: &mut Gaussians, (x, y): (i32, i32), z: f64) {
        let at = |p: i32, c: f64| ((f64::from(p) + 0.5 - c) * z / 40.0) as f32;
        let block = sharp::random::mix((x.div_euclid(3) * 1000 + y.div_euclid(3)) as u64);
        let level = |shift: u32| 0.1 + 0.8 * ((block >> shift) % 64) as f32 / 64.0;
        gaussians.means.push([at(x, 20.0), at(y, 16.0), z as f32]);
        gaussians.quaternions.push([1.0, 0.0, 0.0, 0.0]);
        gaussians.scales.push([0.012 * z as f32; 3]);
        gaussians.opacities.push(0.95);
        gaussians.colors.push([level(0), level(8), level(16)]);
    }

    /// Gaussians of the left view's pixels.
    fn predicted(&self) -> Gaussians {
        let mut predicted = Gaussians::default();
        for (x, y) in (0..32).flat_map(|y| (0..40).map(move |x| (x, y))) {
            let is_near = (12..26).contains(&x) && (8..24).contains(&y);
            Self::add(&mut predicted, (x, y), if is_near { 1.2 } else { 2.0 });
        }
        predicted
    }

    fn said(&self, gaussians: Gaussians) -> String {
        let camera = PosedCamera::from(&self.scene.views[0]);
        let checked = CheckedSource {
            camera: &camera,
            photograph: &self.photographs[0],
            valid: None,
            depth: None,
            scene: &self.scene,
            is_chosen: true,
            of_several_views: false,
        };
        let reading = FileReading::of_arrays();
        let facts = facts_about(&checked, GaussianSpace::CAMERA, gaussians, reading, None);
        let texts: Vec<String> = facts.warnings.into_values().collect();
        texts.join("; ")
    }
}

/// One file of the scene, made from the left view, with the right view as the source.
#[test]
fn gaussians_of_several_views_are_examined_in_the_view_that_they_show_best() {
    let mut pair = Pair::new();
    let depth = DepthMap::from_fn(40, 32, |x, y| {
        let is_near = (12..26).contains(&x) && (8..24).contains(&y);
        image::Luma([if is_near { 1.2 } else { 2.0 }])
    });
    let still = Still(pair.photographs[0].clone(), Some(depth.clone()));
    pair.scene.views[0].content = std::sync::Arc::new(still);
    let camera = PosedCamera::from(&pair.scene.views[1]);
    let mut reading = FileReading::of_arrays();
    reading.placement.space = FileSpace::World;
    let said = |gaussians: &Gaussians, of_several_views| {
        let checked = CheckedSource {
            camera: &camera,
            photograph: &pair.photographs[1],
            valid: None,
            depth: Some(&depth),
            scene: &pair.scene,
            is_chosen: true,
            of_several_views,
        };
        let space = GaussianSpace::Camera(reading.placement.camera_from_file(&camera));
        let facts = facts_about(&checked, space, gaussians.clone(), reading, None);
        facts.warnings.into_values().collect::<Vec<_>>().join("; ")
    };
    let proper = pair.predicted();
    assert_eq!(said(&proper, true), "");
    let mut larger = mapped(&proper, DAffine3::from_scale(DVec3::splat(20.0)));
    larger.scales = proper.scales.iter().map(|s| s.map(|v| 20.0 * v)).collect();
    let text = said(&larger, true);
    assert!(
        text.contains("depth (l)") && text.contains("use `scale=0.05`"),
        "{text}"
    );
    let mut reversed = proper;
    reversed.colors.iter_mut().for_each(|color| color.reverse());
    let text = said(&reversed, true);
    assert!(text.contains("dB PSNR (l); with `channels=bgr`"), "{text}");
    let text = said(&reversed, false);
    assert!(text.contains("dB PSNR (r); with `channels=bgr`"), "{text}");
}

#[test]
fn variances_are_told_from_standard_deviations() {
    let wall = stripes();
    let mut squared = wall.clone();
    let scales = squared.scales.as_flattened_mut().iter_mut();
    scales.for_each(|scale| *scale *= *scale);
    let text = doubt_about(squared).unwrap_or_default();
    assert!(text.contains("with `scales=variance`, they"), "{text}");
    assert_eq!(doubt_about(wall), None);
}

#[test]
fn another_view_as_the_source_is_named_and_not_called_a_shift() {
    let pair = Pair::new();
    let proper = pair.predicted();
    assert_eq!(pair.said(proper.clone()), "");
    // Colours of the right picture's pixels.
    let mut colored = proper.clone();
    for (at, pixel) in pair.photographs[1].pixels().enumerate() {
        let linear = |level: u8| linear_from_srgb(f32::from(level) / 255.0);
        colored.colors[at] = pixel.0.map(linear);
    }
    let text = pair.said(colored);
    holds(&text, &["perhaps the Gaussians were predicted from r,"]);
    // Means in the right camera.
    let aside = DAffine3::from_translation(DVec3::X * -BASELINE_M);
    let placed = Gaussians {
        scales: proper.scales.clone(),
        ..mapped(&proper, aside)
    };
    let text = pair.said(placed);
    assert!(
        text.contains("with the means read in the camera space of r, they"),
        "{text}"
    );
    // A wrong focal length is a single cause.
    let narrow = DAffine3::from_scale(DVec3::new(0.7, 0.7, 1.0));
    let mut discs = mapped(&proper, narrow);
    for (at, scales) in discs.scales.iter_mut().enumerate() {
        *scales = proper.scales[at];
        scales[2] /= 10.0;
    }
    let text = pair.said(discs);
    assert!(text.contains("with `focal=1.4"), "{text}");
    assert!(!text.contains("` and `"), "{text}");
    // A grid of half the size under the full size's intrinsics takes up the upper left quarter.
    let k = pair.scene.views[0].intrinsics;
    let corner = DMat3::from_cols(
        DVec3::X * 0.5,
        DVec3::Y * 0.5,
        DVec3::new(-0.5 * k.cx / k.fx, -0.5 * k.cy / k.fy, 1.0),
    );
    let mut quarter = mapped(&proper, DAffine3::from_mat3(corner));
    for (scales, proper) in quarter.scales.iter_mut().zip(&proper.scales) {
        *scales = proper.map(|scale| scale / 2.0);
    }
    let text = pair.said(quarter);
    holds(&text, &["`shift=", "`focal=2"]);
}

/// Nearer Gaussians cover farther ones, which moves the rendering of a correct file up. A file whose Gaussians are
/// half a pixel too high is reported, as a shift or as a focal length, which look the same in this part of a floor.
#[test]
fn a_shift_by_the_order_of_depths_is_not_named_and_a_wrong_file_is() {
    let pair = Pair::floor();
    assert_eq!(pair.said(pair.predicted_floor([0.0; 2])), "");
    let text = pair.said(pair.predicted_floor([0.0, -0.5]));
    assert!(text.contains("`, they reach "), "{text}");
}
