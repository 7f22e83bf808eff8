//! Joint readings: the same reading for all metrics of a dataset, as in a paper that scored them together.

use sharp_metrics::MetricKey;
use sharp_metrics::identity::MetricRegion;

use crate::evaluate::readings::PictureReading;

use super::cells::{Averaging, CellExplanation, ReadingValue, SceneReading};

/// One reading applied to all metrics of a dataset. Only the variant may differ between metrics: each has the variant
/// whose value is nearest to the published number.
#[derive(Debug, Clone, PartialEq)]
pub struct JointReading {
    pub column: &'static str,
    pub picture: PictureReading,
    pub scenes: SceneReading,
    pub averaging: Averaging,
    pub region: MetricRegion,
    /// For each metric of the table, the variant with its value and its distance to the published number.
    pub variants: Vec<Variant>,
    /// The largest distance of the variants from the published numbers, in units of half the last published digit. If
    /// it is at most 1, every variant rounds to its published number.
    pub farthest: f64,
}

/// The variant of a published metric that comes closest under a joint reading, and its value.
#[derive(Debug, Clone, PartialEq)]
pub struct Variant {
    /// Name as published, such as `LPIPS`.
    pub metric: String,
    pub key: MetricKey,
    pub value: f64,
    pub distance: f64,
}

/// All joint readings, sorted by dataset, then by increasing distance. Of several readings with equal numbers, only the
/// first is returned.
pub(super) fn joint_readings(cells: &[CellExplanation]) -> Vec<JointReading> {
    let mut all = Vec::new();
    for cells in cells.chunk_by(|a, b| a.dataset == b.dataset) {
        let mut shared: Vec<(PictureReading, SceneReading, Averaging)> = Vec::new();
        for value in cells.iter().flat_map(|cell| &cell.readings) {
            let reading = value.reading;
            let key = (reading.picture, reading.scenes, reading.averaging);
            // A pooled error exists only for PSNR, so it cannot be a joint reading.
            if reading.averaging != Averaging::PooledError && !shared.contains(&key) {
                shared.push(key);
            }
        }
        let mut of_dataset = Vec::new();
        for (picture, scenes, averaging) in shared {
            for region in [MetricRegion::Whole, MetricRegion::Frustum] {
                let belongs = |cell: &CellExplanation, value: &ReadingValue| {
                    let reading = value.reading;
                    let of_region = reading.key.region() == region
                        || (cell.metric.family() == "dists" && !reading.key.is_masked());
                    (reading.picture, reading.scenes, reading.averaging)
                        == (picture, scenes, averaging)
                        && of_region
                };
                let variants: Option<Vec<Variant>> = cells
                    .iter()
                    .map(|cell| nearest(cell, |value| belongs(cell, value)))
                    .collect();
                let Some(variants) = variants else { continue };
                let only_dists =
                    region == MetricRegion::Frustum && variants.iter().all(|v| !v.key.is_masked());
                if only_dists {
                    continue;
                }
                let farthest = variants.iter().zip(cells).map(|(variant, cell)| {
                    variant.distance.abs() / (0.5 * 0.1_f64.powi(cell.metric.decimals as i32))
                });
                of_dataset.push(JointReading {
                    column: cells[0].column,
                    picture,
                    scenes,
                    averaging,
                    region,
                    farthest: farthest.fold(0.0, f64::max),
                    variants,
                });
            }
        }
        of_dataset.sort_by(|a, b| a.farthest.total_cmp(&b.farthest));
        // Some readings have equal numbers, such as different means over scenes with one pair each. Keep one of them.
        of_dataset.dedup_by(|a, b| a.variants == b.variants && a.region == b.region);
        all.extend(of_dataset);
    }
    all
}

fn nearest(cell: &CellExplanation, belongs: impl Fn(&ReadingValue) -> bool) -> Option<Variant> {
    let values = cell.readings.iter().filter(|value| belongs(value));
    let distance = |value: &ReadingValue| (value.value - cell.published).abs();
    let best = values.min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
    Some(Variant {
        metric: cell.metric.label.clone(),
        key: best.reading.key,
        value: best.value,
        distance: best.value - cell.published,
    })
}
