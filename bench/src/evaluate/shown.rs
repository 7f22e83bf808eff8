//! Which results a report, a figure or a comparison shows, in which order, and under which names.

use std::collections::BTreeSet;

use sharp_datasets::error::nearest_of;
use sharp_datasets::registry::ENTRIES;
use sharp_metrics::MetricKey;

use super::manifest::DatasetRecord;
use super::results::Results;
use crate::pairs::pair_id::PairName;

/// Which results are shown, in which order, and under which names. An empty list selects all.
#[derive(Debug, Clone, Default, PartialEq, Eq, clap::Args)]
pub struct Shown {
    /// Methods to show, comma-separated, in this order [default: all; in plots, all but the methods `target` and `mean`]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub methods: Vec<String>,
    /// Datasets to show, comma-separated, in this order [default: all]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub datasets: Vec<String>,
    /// Metrics to show, comma-separated, in this order [default: all]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub metrics: Vec<MetricKey>,
    /// Show a method under another name; repeatable
    #[arg(long = "rename", value_name = "OLD=NEW", value_parser = renaming)]
    pub renamed: Vec<(String, String)>,
}

fn renaming(text: &str) -> Result<(String, String), &'static str> {
    let (old, new) = text.split_once('=').ok_or("expected OLD=NEW")?;
    if old.is_empty() || new.is_empty() || new.contains(char::is_control) {
        Err("expected OLD=NEW, with a one-line name on both sides")
    } else {
        Ok((old.to_owned(), new.to_owned()))
    }
}

/// Error for a name on the command line that matches no result, or that two methods would share.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
#[error("--{option}: {reason}")]
pub struct ShownError {
    option: &'static str,
    reason: String,
}

impl Shown {
    /// The selected results. Pass all results that are compared with each other in one call: a name is an error only if
    /// none of them contains it.
    ///
    /// # Errors
    /// If a name is in none of the results, or two methods of one of them would have the same name.
    pub fn of<const N: usize>(&self, all: [Results; N]) -> Result<[Results; N], ShownError> {
        let datasets = self.datasets.iter();
        let shown = Self {
            datasets: datasets.map(|name| dataset_name(name, &all)).collect(),
            ..self.clone()
        };
        shown.check(&all)?;
        Ok(all.map(|results| shown.chosen(results)))
    }

    fn check(&self, all: &[Results]) -> Result<(), ShownError> {
        let methods = all.iter().flat_map(|results| &results.manifest.methods);
        let labels: BTreeSet<&str> = methods.map(|method| method.label.as_str()).collect();
        let datasets = all.iter().flat_map(|results| &results.manifest.datasets);
        let datasets: BTreeSet<&str> = datasets.map(|dataset| dataset.name.as_str()).collect();
        let metrics = all.iter().flat_map(|results| &results.manifest.metrics);
        let metrics: BTreeSet<String> = metrics.map(|m| m.info.key.to_string()).collect();
        let metrics: BTreeSet<&str> = metrics.iter().map(String::as_str).collect();
        let renamed = labels.iter().map(|label| self.name(label));
        let both: BTreeSet<&str> = labels.iter().copied().chain(renamed).collect();
        let old: Vec<String> = self.renamed.iter().map(|(old, _)| old.clone()).collect();
        let keys: Vec<String> = self.metrics.iter().map(MetricKey::to_string).collect();
        for (option, what, names, known) in [
            ("rename", "method", &old, &labels),
            ("methods", "method", &self.methods, &both),
            ("datasets", "dataset", &self.datasets, &datasets),
            ("metrics", "metric", &keys, &metrics),
        ] {
            let mut names = names.iter();
            if let Some(name) = names.find(|name| !known.contains(name.as_str())) {
                let known: Vec<&str> = known.iter().copied().collect();
                let nearest = nearest_of(name, &known);
                let reason = format!("no {what} '{name}' in the results; {nearest}");
                return Err(ShownError { option, reason });
            }
        }
        for results in all {
            let mut names = BTreeSet::new();
            let labels = results
                .manifest
                .methods
                .iter()
                .map(|method| self.name(&method.label));
            if let Some(twice) = labels.into_iter().find(|name| !names.insert(*name)) {
                return Err(ShownError {
                    option: "rename",
                    reason: format!("two methods would be called '{twice}'"),
                });
            }
        }
        Ok(())
    }

    /// The name under which the method with this label is shown.
    pub(crate) fn name<'a>(&'a self, label: &'a str) -> &'a str {
        let renamed = self.renamed.iter().find(|(old, _)| old == label);
        renamed.map_or(label, |(_, new)| new)
    }

    /// Like [`Self::of`] for single results, but ignores unknown names.
    pub(crate) fn chosen(&self, mut results: Results) -> Results {
        if !self.renamed.is_empty() {
            results.relabel(|label| self.name(label).to_owned());
        }
        let manifest = &mut results.manifest;
        if !self.methods.is_empty() {
            let listed: Vec<&str> = self.methods.iter().map(|label| self.name(label)).collect();
            order(&mut manifest.methods, &listed, |method| {
                method.label.clone()
            });
            let place = |label: &str| listed.iter().position(|name| *name == label);
            results
                .records
                .retain(|record| place(&record.method).is_some());
            results.records.sort_by(|a, b| {
                let by_pair = a.pair_id.cmp(&b.pair_id);
                by_pair.then_with(|| place(&a.method).cmp(&place(&b.method)))
            });
            results
                .missing
                .retain(|(_, method)| place(method).is_some());
            results.methods_listed = true;
        }
        if !self.datasets.is_empty() {
            let listed: Vec<&str> = self.datasets.iter().map(String::as_str).collect();
            order(&mut manifest.datasets, &listed, |dataset| {
                dataset.name.clone()
            });
            results
                .records
                .retain(|record| self.datasets.contains(&record.dataset));
            results.missing.retain(|(pair, _)| {
                PairName::decode(pair).is_ok_and(|name| self.datasets.contains(&name.dataset))
            });
        }
        if !self.metrics.is_empty() {
            let keys: Vec<String> = self.metrics.iter().map(MetricKey::to_string).collect();
            let listed: Vec<&str> = keys.iter().map(String::as_str).collect();
            order(&mut manifest.metrics, &listed, |metric| {
                metric.info.key.to_string()
            });
        }
        results
    }
}

/// The exact name of a dataset, given in any case or by its title in the tables; unknown names are returned unchanged.
fn dataset_name(given: &str, all: &[Results]) -> String {
    let datasets = || all.iter().flat_map(|results| &results.manifest.datasets);
    let is_titled = |dataset: &&DatasetRecord| {
        let mut entries = ENTRIES.into_iter();
        let entry = entries.find(|entry| entry.format == dataset.name);
        let title = entry.map_or("", |entry| entry.display_name);
        [dataset.name.as_str(), title]
            .iter()
            .any(|name| name.eq_ignore_ascii_case(given))
    };
    let mut exact = datasets().filter(|dataset| dataset.name == given);
    let found = exact.next().or_else(|| datasets().find(is_titled));
    found.map_or(given, |dataset| &dataset.name).to_owned()
}

/// Keeps the items whose names are in `names`, in the order of `names`.
fn order<T>(items: &mut Vec<T>, names: &[&str], name: impl Fn(&T) -> String) {
    let place = |item: &T| names.iter().position(|listed| *listed == name(item));
    items.retain(|item| place(item).is_some());
    items.sort_by_key(place);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::record::Record;
    use crate::evaluate::test_records::record;
    use crate::report::test_results;

    fn results() -> Results {
        let of = |dataset: &str, method: &str| Record {
            method: method.into(),
            ..record(dataset, 0, 0)
        };
        let records = vec![of("d", "a"), of("d", "b"), of("e", "a"), of("e", "b")];
        test_results::results(&[MetricKey::PSNR, MetricKey::DISTS], records)
    }

    fn listed(names: &[&str]) -> Vec<String> {
        names.iter().map(|name| (*name).to_owned()).collect()
    }

    #[test]
    fn lists_choose_and_order_and_names_replace() {
        let shown = Shown {
            methods: listed(&["b", "Ours"]),
            datasets: listed(&["e"]),
            metrics: vec![MetricKey::DISTS],
            renamed: vec![("a".into(), "Ours".into())],
        };
        let [found] = shown.of([results()]).unwrap();
        let records = found.records.iter();
        let records: Vec<_> = records
            .map(|r| (r.dataset.as_str(), r.method.as_str()))
            .collect();
        assert_eq!(records, [("e", "b"), ("e", "Ours")]);
        let labels = found.manifest.methods.iter().map(|m| m.label.as_str());
        assert_eq!(labels.collect::<Vec<_>>(), ["b", "Ours"]);
        assert_eq!(found.manifest.datasets.len(), 1);
        assert_eq!(found.manifest.metrics[0].info.key, MetricKey::DISTS);
        assert!(found.methods_listed);
        // The old name also selects the method.
        let old = Shown {
            methods: listed(&["a"]),
            ..shown
        };
        assert_eq!(old.of([results()]).unwrap()[0].records[0].method, "Ours");
    }

    #[test]
    fn datasets_are_known_by_their_title_and_in_any_case() {
        let records = ["scannetpp", "D", "d"].map(|dataset| record(dataset, 0, 0));
        let results = test_results::results(&[MetricKey::PSNR], records.to_vec());
        let datasets = listed(&["ScanNet++", "d"]);
        let shown = Shown {
            datasets,
            ..Shown::default()
        };
        let [found] = shown.of([results]).unwrap();
        let found = found.manifest.datasets.iter().map(|d| d.name.as_str());
        assert_eq!(found.collect::<Vec<_>>(), ["scannetpp", "d"]);
    }

    #[test]
    fn an_unknown_name_is_refused_with_the_known_ones() {
        let refused = |shown: Shown| shown.of([results()]).unwrap_err().to_string();
        let methods = listed(&["sharp"]);
        let error = refused(Shown {
            methods,
            ..Shown::default()
        });
        assert_eq!(
            error,
            "--methods: no method 'sharp' in the results; known: a, b"
        );
        let metrics = vec![MetricKey::SSIM];
        assert!(
            refused(Shown {
                metrics,
                ..Shown::default()
            })
            .contains("known: dists, psnr")
        );
        let renamed = vec![("a".into(), "b".into())];
        let error = refused(Shown {
            renamed,
            ..Shown::default()
        });
        assert_eq!(error, "--rename: two methods would be called 'b'");
    }
}
