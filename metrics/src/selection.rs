//! Lists of metrics as typed on a command line.

use crate::identity::{Family, IdentityError, MetricKey, MetricRegion};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Selected {
    pub key: MetricKey,
    /// True if the metric was requested by key, alias or family name. The request fails if such a
    /// metric cannot be computed; a metric included by `paper` or `all` may be listed as
    /// unavailable.
    pub explicit: bool,
}

/// Metrics in the order in which they were requested, without duplicates.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Selection {
    entries: Vec<Selected>,
}

/// Errors of parsing a list of metrics.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SelectionError {
    #[error("the list of metrics is empty; try 'paper', 'all', 'psnr' or 'lpips-vgg,dists'")]
    Empty,
    /// One of the names is not a key, family or group.
    #[error("{0}; names: psnr ssim lpips dists; groups: paper all ssim-all lpips-all dists-all")]
    Name(#[from] IdentityError),
}

impl Selection {
    /// The paper's metrics in their default variants: DISTS, LPIPS with AlexNet, PSNR, SSIM with a Gaussian window. The
    /// default.
    pub fn paper() -> Self {
        Self::group(&PAPER)
    }

    /// Every variant over the whole picture.
    pub fn all() -> Self {
        Self::group(&MetricKey::all())
    }

    /// Exactly these metrics, each counted as requested by name.
    pub fn of(keys: &[MetricKey]) -> Self {
        let mut selection = Self { entries: vec![] };
        selection.extend(keys.iter().copied(), true);
        selection
    }

    /// Parses a comma-separated list of keys (`ssim[gauss11,valid]`), aliases (`lpips-vgg`), family names (`ssim`: its
    /// default variant; `ssim-all`: all variants), `paper` and `all`.
    ///
    /// The suffix `@frustum` or `@mask` on a group selects the masked variants of its members, where they exist.
    ///
    /// # Errors
    /// [`SelectionError`] if the list is empty, or a name in it is unknown or rejected.
    pub fn parse(list: &str) -> Result<Self, SelectionError> {
        let mut selection = Self { entries: vec![] };
        for name in split_outside_brackets(list) {
            let (base, region) = MetricRegion::split(name);
            let (group, explicit) = match base {
                "paper" => (PAPER.to_vec(), false),
                "all" => (MetricKey::all_inside(region), false),
                "ssim-all" => (family(Family::Ssim, region), true),
                "lpips-all" => (family(Family::Lpips, region), true),
                "dists-all" => (family(Family::Dists, region), true),
                _ => {
                    selection.extend([name.parse()?], true);
                    continue;
                }
            };
            let keys = group.into_iter().filter_map(|key| key.inside(region));
            selection.extend(keys, explicit);
        }
        if selection.entries.is_empty() {
            return Err(SelectionError::Empty);
        }
        Ok(selection)
    }

    /// The metrics in the order in which they were requested.
    pub fn entries(&self) -> &[Selected] {
        &self.entries
    }

    /// The keys in the order in which they were requested.
    pub fn keys(&self) -> impl Iterator<Item = MetricKey> + '_ {
        self.entries.iter().map(|entry| entry.key)
    }

    /// True if the metric was requested by name.
    pub fn is_explicit(&self, key: MetricKey) -> bool {
        self.entries
            .iter()
            .any(|entry| entry.key == key && entry.explicit)
    }

    /// Returns this selection with each metric over the whole picture followed by the same metric
    /// in `region`, where that is defined.
    #[must_use]
    pub fn with_region(&self, region: MetricRegion) -> Self {
        let mut selection = Self { entries: vec![] };
        for entry in &self.entries {
            let masked = entry.key.inside(region).filter(|_| !entry.key.is_masked());
            selection.extend(
                [Some(entry.key), masked].into_iter().flatten(),
                entry.explicit,
            );
        }
        selection
    }

    fn group(keys: &[MetricKey]) -> Self {
        let mut selection = Self { entries: vec![] };
        selection.extend(keys.iter().copied(), false);
        selection
    }

    fn extend(&mut self, keys: impl IntoIterator<Item = MetricKey>, explicit: bool) {
        for key in keys {
            match self.entries.iter_mut().find(|entry| entry.key == key) {
                Some(entry) => entry.explicit |= explicit,
                None => self.entries.push(Selected { key, explicit }),
            }
        }
    }
}

impl Default for Selection {
    fn default() -> Self {
        Self::paper()
    }
}

impl std::str::FromStr for Selection {
    type Err = SelectionError;

    fn from_str(list: &str) -> Result<Self, SelectionError> {
        Self::parse(list)
    }
}

const PAPER: [MetricKey; 4] = [
    MetricKey::DISTS,
    MetricKey::LPIPS,
    MetricKey::PSNR,
    MetricKey::SSIM,
];

fn family(family: Family, region: MetricRegion) -> Vec<MetricKey> {
    let mut keys = MetricKey::all_inside(region);
    keys.retain(|key| key.family() == family);
    keys
}

/// Non-empty, trimmed parts between commas; commas inside brackets are part of a key.
fn split_outside_brackets(list: &str) -> Vec<&str> {
    let mut depth = 0_i32;
    list.split(|c| {
        match c {
            '[' => depth += 1,
            ']' => depth -= 1,
            _ => {}
        }
        c == ',' && depth <= 0
    })
    .map(str::trim)
    .filter(|name| !name.is_empty())
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(list: &str) -> Vec<String> {
        let selection = Selection::parse(list).unwrap();
        selection.keys().map(|key| key.to_string()).collect()
    }

    #[test]
    fn paper_is_the_default() {
        let expected = ["dists", "lpips[alex,v0.1]", "psnr", "ssim[gauss11,valid]"];
        assert_eq!(keys("paper"), expected);
        assert_eq!(Selection::default(), Selection::parse("paper").unwrap());
        assert!(Selection::paper().entries().iter().all(|e| !e.explicit));
        let spelled = "dists,lpips-alex,psnr,ssim-gauss11-valid";
        assert_eq!(keys(spelled), expected);
    }

    #[test]
    fn commas_inside_brackets_do_not_split() {
        assert_eq!(
            keys("psnr, ssim[gauss11,reflect,range=data],lpips[vgg,v0.1]@frustum"),
            [
                "psnr",
                "ssim[gauss11,reflect,range=data]",
                "lpips[vgg,v0.1]@frustum"
            ]
        );
    }

    #[test]
    fn families_and_groups() {
        assert_eq!(keys("ssim-all").len(), 11);
        assert_eq!(keys("ssim-all@mask").len(), 12);
        assert_eq!(keys("lpips-all").len(), 8);
        assert_eq!(keys("lpips-all@mask").len(), 10);
        assert_eq!(keys("dists-all").len(), 2);
        assert_eq!(
            keys("ssim,lpips,dists,ssim@frustum"),
            [
                "ssim[gauss11,valid]",
                "lpips[alex,v0.1]",
                "dists",
                "ssim[gauss11,valid]@frustum"
            ]
        );
        assert_eq!(keys("all").len(), MetricKey::all().len());
        assert_eq!(
            keys("paper@frustum"),
            [
                "lpips[alex,v0.1]@frustum",
                "psnr@frustum",
                "ssim[gauss11,valid]@frustum"
            ]
        );
    }

    #[test]
    fn a_region_is_added_beside_the_whole_picture() {
        let selection = Selection::parse("dists,psnr,ssim-gauss11-zero@frustum").unwrap();
        let with_mask = selection.with_region(MetricRegion::Given);
        let keys: Vec<String> = with_mask.keys().map(|key| key.to_string()).collect();
        let expected = ["dists", "psnr", "psnr@mask", "ssim[gauss11,zero]@frustum"];
        assert_eq!(keys, expected);
        assert!(with_mask.entries().iter().all(|entry| entry.explicit));
    }

    #[test]
    fn explicitness_survives_a_group_on_either_side() {
        for list in ["all,lpips-vgg", "lpips-vgg,all"] {
            let selection = Selection::parse(list).unwrap();
            assert!(
                selection.is_explicit("lpips-vgg".parse().unwrap()),
                "{list}"
            );
            assert!(!selection.is_explicit(MetricKey::DISTS), "{list}");
        }
        assert!(
            Selection::parse("ssim")
                .unwrap()
                .is_explicit(MetricKey::SSIM)
        );
    }

    #[test]
    fn refusals() {
        assert_eq!(Selection::parse(" , "), Err(SelectionError::Empty));
        assert!(Selection::parse("psnr,foo").is_err());
        assert!(Selection::parse("dists@frustum").is_err());
        let error = Selection::parse("lpips[alex,v0.0]").unwrap_err();
        assert!(error.to_string().contains("v0.0 is refused"));
    }
}
