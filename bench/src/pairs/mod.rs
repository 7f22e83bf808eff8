//! Selection of the pairs to evaluate, and the geometry behind it.
//!
//! The paper fixes four rules: stereo pairs go from left to right, sets have ten views, overlap is above 60 %, and at
//! most 512 pairs are used per dataset. Everything else is an option of [`PairOptions`], printed with the result.
//!
//! * [`sets`]: groups views into sets of ten.
//! * [`depth`]: depth maps with their cameras, and sources of depth.
//! * [`overlap`]: share of one view visible in another; [`overlap_cache`]: cached measurements.
//! * [`options`]: every open choice, with its default and its text form.
//! * [`pair_id`]: `dataset/scene/source__target`, in a decodable encoding.
//! * [`DatasetConfig`]: a dataset spec with its pair options; [`dataset`]: an opened dataset; [`frame`]: views at
//!   another size.
//! * [`build`]: pairs from scenes; [`recipe`]: the choices and files behind a list; [`advice`]: why a dataset has no
//!   pairs.
//! * [`description`]: one pair in JSON, and the cameras of its views.
//! * [`provenance`]: origin of a list, for manifests.
//! * [`ambiguity`]: sensitivity of the pairs to the open choices.
//! * [`sampling`]: sampling of qualified pairs.
//! * [`scene_checks`]: contradictions in scenes, checked before a run begins.
//! * [`pair_list`]: pairs as a file that can be published, verified and compared.
//! * [`foreign`]: published lists in other formats.
//! * [`alignment`]: the global scale between predicted and ground-truth depth.
//! * [`valid_depth`]: valid depths, their median and density.

pub mod advice;
pub mod alignment;
pub mod ambiguity;
pub mod build;
pub mod dataset;
mod dataset_config;
pub mod depth;
pub mod description;
pub mod error;
pub mod foreign;
pub mod frame;
pub mod options;
pub mod overlap;
pub mod overlap_cache;
mod pair;
pub mod pair_id;
pub mod pair_list;
pub mod provenance;
pub mod recipe;
pub mod sampling;
pub mod scene_checks;
pub mod sets;
#[cfg(test)]
mod test_scene;
pub mod valid_depth;

pub use build::{BuildContext, PairBuild, build_pairs};
pub use dataset::OpenDataset;
pub(crate) use dataset_config::clap_dataset;
pub use dataset_config::{DatasetConfig, PairOverrides};
pub use description::PosedCamera;
pub use error::PairError;
pub use options::PairOptions;
pub use overlap_cache::OverlapCache;
pub use pair::Pair;
pub use pair_list::PairList;
pub use provenance::PairProvenance;
pub use recipe::{PairOrigin, PairRecipe};
pub use scene_checks::SceneChecks;
