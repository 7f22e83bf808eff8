//! Structures shared by host and shaders, byte for byte. A test compares names and offsets with those in the WGSL.

use super::super::harmonics::ViewColors;
use super::super::view::ViewConstants;
use super::super::{Dropped, Support};
use super::subframe::SubFrame;
use crate::gaussians::Harmonics;
use bytemuck::{Pod, Zeroable};

/// Defines a struct with the layout that the shaders expect. `TWIN` is the struct's name in WGSL;
/// `FIELDS` is for the test.
macro_rules! shared {
    ($(#[$doc:meta])* $name:ident = $twin:literal { $($field:ident: $kind:ty),* $(,)? }) => {
        $(#[$doc])*
        #[repr(C)]
        #[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
        pub(super) struct $name { $(pub(super) $field: $kind),* }

        #[cfg(test)]
        impl $name {
            const TWIN: &str = $twin;
            const FIELDS: &[(&str, usize)] =
                &[$((stringify!($field), std::mem::offset_of!($name, $field))),*];
        }
    };
}

shared! {
    /// [`ViewConstants`] in f32, for the passes over Gaussians.
    ViewUniform = "View" {
        row0: [f32; 4],
        row1: [f32; 4],
        row2: [f32; 4],
        row2_rest: [f32; 4],
        focal: [f32; 2],
        center: [f32; 2],
        bounds: [[f32; 2]; 2],
        size: [f32; 2],
        eps2d: f32,
        near: f32,
        far: f32,
        count: u32,
        zero: u32,
        compensation: u32,
        tiled: u32,
        degree: u32,
        stored: u32,
        padding: u32,
        eye: [f32; 4],
    }
}

impl ViewUniform {
    /// Describes a view to the shaders, for a scene of `count` Gaussians that stores harmonics up to `degree`.
    pub(super) fn new(
        view: &ViewConstants,
        colors: Option<ViewColors>,
        (count, degree): (u32, usize),
    ) -> Self {
        let stored = Harmonics::coefficients_of(degree);
        let (degree, [x, y, z]) = colors.map_or((0, [0.0; 3]), |colors| {
            (colors.degree, colors.eye.map(|v| v as f32))
        });
        let row = |i: usize| {
            let [x, y, z] = view.linear[i];
            [x, y, z, view.offset[i]]
        };
        let narrow = |row: [f64; 4]| row.map(|v| v as f32);
        Self {
            row0: narrow(row(0)),
            row1: narrow(row(1)),
            row2: narrow(row(2)),
            row2_rest: narrow(row(2).map(|v| v - f64::from(v as f32))),
            focal: view.focal.map(|v| v as f32),
            center: view.center.map(|v| v as f32),
            bounds: view.bounds.map(|axis| axis.map(|v| v as f32)),
            size: view.size.map(|v| v as f32),
            eps2d: view.eps2d as f32,
            near: view.near,
            far: view.far,
            count,
            zero: 0,
            compensation: view.compensation.code(),
            tiled: u32::from(view.support == Support::Tiles),
            // The casts fit: the degree is at most 4, the number of stored coefficients at most 24.
            degree: degree as u32,
            stored: stored as u32,
            padding: 0,
            eye: [x, y, z, 0.0],
        }
    }
}

shared! {
    /// A [`SubFrame`], for the passes over its tiles.
    FrameUniform = "Frame" {
        first: [u32; 2],
        tiles: [u32; 2],
        count: u32,
        pairs: u32,
        shift: u32,
        alpha_max: f32,
    }
}

impl FrameUniform {
    /// Describes a sub-frame to the shaders. `count` is the number of Gaussians in the scene, `pairs` the number of
    /// (tile, Gaussian) pairs in the sub-frame.
    pub(super) fn new(part: SubFrame, (count, pairs): (u32, u32), alpha_max: f32) -> Self {
        Self {
            first: part.first.into(),
            tiles: part.tiles.into(),
            count,
            pairs,
            shift: part.side.trailing_zeros(),
            alpha_max,
        }
    }
}

shared! {
    ScanParams = "ScanParams" {
        count: u32,
        padding_0: u32,
        padding_1: u32,
        padding_2: u32,
    }
}

shared! {
    RadixParams = "RadixParams" {
        count: u32,
        shift: u32,
        blocks: u32,
        identity: u32,
    }
}

/// Counts of Gaussians dropped by `project`, in the order of the reasons in `project.wgsl`.
pub(super) type DroppedCounts = [u32; 8];

pub(super) fn dropped(counts: DroppedCounts) -> Dropped {
    let [
        not_finite,
        zero_quaternion,
        near,
        far,
        degenerate,
        transparent,
        outside,
        _,
    ] = counts.map(u64::from);
    Dropped {
        not_finite,
        zero_quaternion,
        near,
        far,
        degenerate,
        transparent,
        outside,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sharp_shaders::PASSES;
    use wgpu::naga::{TypeInner, front::wgsl};

    #[test]
    fn fields_and_offsets_are_those_of_the_shaders() {
        let all = [
            (ViewUniform::TWIN, ViewUniform::FIELDS),
            (FrameUniform::TWIN, FrameUniform::FIELDS),
            (ScanParams::TWIN, ScanParams::FIELDS),
            (RadixParams::TWIN, RadixParams::FIELDS),
        ];
        for (twin, fields) in all {
            let mut seen = 0;
            for (file, source) in PASSES {
                let module = wgsl::parse_str(source).unwrap();
                for (_, found) in module.types.iter() {
                    let TypeInner::Struct { members, .. } = &found.inner else {
                        continue;
                    };
                    if found.name.as_deref() == Some(twin) {
                        let members = members.iter();
                        let members = members.map(|m| (m.name.as_deref().unwrap(), m.offset));
                        let expected = fields.iter().map(|(name, at)| (*name, *at as u32));
                        assert!(members.eq(expected), "{twin} in {file}");
                        seen += 1;
                    }
                }
            }
            assert!(seen > 0, "{twin}");
        }
    }
}
