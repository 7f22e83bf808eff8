//! Determines which program's rendering rule a file was made for, from the marks that programs leave in their files.

use crate::ply::{FileMarks, Generator, SplatRenderMode};
use crate::render::Rule;

/// A rendering rule and the reason for choosing it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MarkedRule {
    pub rule: Rule,
    /// True if the file states the rule, false if the rule is only likely.
    pub is_stated: bool,
    pub why: &'static str,
}

impl MarkedRule {
    pub fn of(marks: &FileMarks) -> Self {
        let stated = |rule, why| Self {
            rule,
            is_stated: true,
            why,
        };
        let likely = |rule, why| Self {
            rule,
            is_stated: false,
            why,
        };
        match (marks.generator, marks.antialiased) {
            (Some(Generator::Sharp), _) => stated(
                Rule::SHARP,
                "it states the encoding of its colours, as SHARP's files do",
            ),
            _ if marks.has_filter_3d => stated(
                Rule::MIP_SPLATTING,
                "it has Mip-Splatting's filter_3D, which was folded into its scales and opacities",
            ),
            (Some(Generator::Brush), _) if marks.mode == Some(SplatRenderMode::Mip) => {
                stated(Rule::BRUSH_MIP, "brush exported it in mode mip")
            }
            (Some(Generator::Brush), _) => stated(Rule::GSPLAT_1_5_3_CLASSIC, "brush exported it"),
            (_, Some(true)) => stated(
                Rule::GSPLAT_ANTIALIASED,
                "it is marked as antialiased, but does not state whether its low-pass is 0.3 or 0.1",
            ),
            (_, Some(false)) => stated(Rule::GSPLAT_CLASSIC, "it is marked as not antialiased"),
            (Some(Generator::Nerfstudio), None) => likely(
                Rule::GSPLAT_CLASSIC,
                "nerfstudio exported it (its config.yml states the rasterize_mode)",
            ),
            (Some(Generator::InriaLike), None) => likely(
                Rule::INRIA_GENERAL,
                "it has normals, like files of Inria's program; `inria` ignores the principal point, like that \
                 program",
            ),
            (Some(Generator::GsplatLike | Generator::SplatTransform), None) => likely(
                Rule::GSPLAT_CLASSIC,
                "it has no normals, like files of gsplat",
            ),
            (None, None) => likely(
                Rule::GSPLAT_CLASSIC,
                "most programs render this format this way",
            ),
        }
    }
}
