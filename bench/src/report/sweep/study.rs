//! Bin means by dataset and method, with their intervals.

use std::collections::{BTreeMap, BTreeSet};

use sharp_metrics::Direction;
use sharp_statistics::{Clusters, Resampling, infer};

use super::crossing::{Crossing, Sample};
use super::{Band, Split, SweepSpec};
use crate::evaluate::Results;
use crate::evaluate::record::{Record, Status};
use crate::methods::TrueDepth;
use crate::report::board::{Board, DatasetBoard};
use crate::report::column::Column;
use crate::report::error::ReportError;
use sharp_plots::bins::{Cuts, bins};
use sharp_plots::curves::Banded;
use sharp_plots::panels::BinCount;

/// Scores against camera motion, ready for drawing and writing.
#[derive(Debug, Clone, PartialEq)]
pub struct Sweep {
    pub spec: SweepSpec,
    pub metrics: Vec<Column>,
    /// Panels with at least one line.
    pub panels: Vec<SweepPanel>,
    /// Panels without a line, because no pair has both a score and a known motion.
    pub without_lines: Vec<SweepPanel>,
    /// Crossings in the order of panels, their lines, and metrics.
    pub crossings: Vec<FoundCrossing>,
    pub resampling: Resampling,
}

/// Lines over one horizontal axis.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepPanel {
    /// What the panel shows: the dataset as named in tables, the method, or the dataset with the
    /// privilege of its methods.
    pub split: String,
    /// Number of pairs in the panel's datasets.
    pub pairs: usize,
    /// Number of pairs with unknown motion.
    pub unplaced: usize,
    /// Number of pairs outside all bins: beyond the given edges, or so far from zero that the bins cannot resolve them.
    pub outside: usize,
    pub lines: Vec<SweepLine>,
}

/// The line of a method on a dataset: its bins for each metric.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepLine {
    pub dataset: String,
    pub method: String,
    /// Label in the legend.
    pub label: String,
    /// Index that determines the line's colour and marker.
    pub style: usize,
    /// Bins by metric, in the order of [`Sweep::metrics`].
    pub bins: Vec<Vec<SweepBin>>,
}

/// A bin, limited to those of its pairs that have a score.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepBin {
    pub banded: Banded,
    /// 95 % interval of the mean over clusters; `None` if it is unbounded, as with a single cluster.
    pub interval: Option<(f64, f64)>,
}

/// The motion beyond which a method violates a limit.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundCrossing {
    pub dataset: String,
    pub method: String,
    pub split: String,
    /// Index in [`Sweep::metrics`].
    pub metric: usize,
    pub rule: CrossingRule,
    pub found: Crossing,
}

/// A limit on a method's scores.
#[derive(Debug, Clone, PartialEq)]
pub enum CrossingRule {
    /// The method must not be worse than the named one, in the mean over common pairs.
    Behind(String),
    /// The mean must not be worse than this value.
    Beyond(f64),
}

impl SweepPanel {
    /// The bins of a metric, keyed by bin number, each with the smallest and the largest number of pairs among the
    /// panel's lines.
    pub(super) fn counts(&self, metric: usize) -> BTreeMap<i64, BinCount> {
        let mut counts: BTreeMap<i64, BinCount> = BTreeMap::new();
        for bin in self.lines.iter().flat_map(|line| &line.bins[metric]) {
            let bin = &bin.banded.bin;
            let (low, high, n) = (bin.low, bin.high, (bin.n(), bin.n()));
            let count = counts
                .entry(bin.number)
                .or_insert(BinCount { low, high, n });
            count.n = (count.n.0.min(bin.n()), count.n.1.max(bin.n()));
        }
        counts
    }
}

impl Sweep {
    /// Lines in all panels that have scores of a metric.
    pub(super) fn lines_with(&self, metric: usize) -> impl Iterator<Item = &SweepLine> {
        let lines = self.panels.iter().flat_map(|panel| &panel.lines);
        lines.filter(move |line| !line.bins[metric].is_empty())
    }

    /// Computes the sweep of some results.
    ///
    /// # Errors
    /// If they contradict each other, or a named metric or method is missing.
    pub fn of(results: &Results, spec: SweepSpec) -> Result<Self, ReportError> {
        let board = &Board::of(results)?;
        let privileged = results.manifest.methods.iter();
        let privileged = privileged.filter(|m| m.privilege.depth != TrueDepth::None);
        let privileged: BTreeSet<&str> = privileged.map(|m| m.label.as_str()).collect();
        let metrics = Column::chosen(&board.metrics, &spec.metrics)?;
        for threshold in &spec.thresholds {
            Column::chosen(&metrics, &[threshold.metric])?;
        }
        let labels = || board.methods.iter().map(|m| m.label.as_str());
        if let Some(name) = &spec.against
            && !labels().any(|label| label == name)
        {
            return Err(ReportError::absent("method", name, labels()));
        }
        let shown: Vec<usize> = (0..board.methods.len())
            .filter(|m| {
                let method = &board.methods[*m];
                let is = privileged.contains(method.label.as_str());
                let is_shown = method.is_plotted || spec.against.as_ref() == Some(&method.label);
                is_shown && spec.privileged.is_none_or(|wanted| wanted == is)
            })
            .collect();
        let all = || 0..board.datasets.len();
        let plans: Vec<(String, Vec<usize>, Vec<usize>)> = match spec.split {
            Split::Dataset => all()
                .map(|d| (title(board, d), vec![d], shown.clone()))
                .collect(),
            Split::Method => shown
                .iter()
                .map(|m| (board.methods[*m].label.clone(), all().collect(), vec![*m]))
                .collect(),
            Split::Privileged => all()
                .flat_map(|d| {
                    let is = |m: &usize| privileged.contains(board.methods[*m].label.as_str());
                    let (with, without): (Vec<usize>, Vec<usize>) =
                        shown.iter().partition(|m| is(m));
                    let name = title(board, d);
                    [
                        (format!("{name}, no depth given"), vec![d], without),
                        (format!("{name}, privileged depth"), vec![d], with),
                    ]
                })
                .collect(),
        };
        let mut sweep = Self {
            metrics,
            panels: Vec::new(),
            without_lines: Vec::new(),
            crossings: Vec::new(),
            resampling: Resampling::default(),
            spec,
        };
        for (split, datasets, methods) in plans {
            sweep.add_panel(board, split, &datasets, &methods);
        }
        Ok(sweep)
    }

    fn add_panel(
        &mut self,
        board: &Board<'_>,
        split: String,
        datasets: &[usize],
        methods: &[usize],
    ) {
        let x = self.spec.x;
        let of = |d: &usize| &board.datasets[*d];
        let pairs = || datasets.iter().flat_map(|d| &of(d).pairs);
        let places: Vec<f64> = pairs().filter_map(|pair| x.of(pair.facts)).collect();
        let cuts = self.spec.binning.cuts(places.iter().copied(), x.start());
        let mut panel = SweepPanel {
            pairs: pairs().count(),
            unplaced: pairs().count() - places.len(),
            outside: places.iter().filter(|x| !cuts.hold(**x)).count(),
            lines: Vec::new(),
            split,
        };
        for &d in datasets {
            for &m in methods {
                let by_method = self.spec.split == Split::Method;
                let line = SweepLine {
                    dataset: of(&d).dataset.name.clone(),
                    method: board.methods[m].label.clone(),
                    label: if by_method {
                        title(board, d)
                    } else {
                        board.methods[m].label.clone()
                    },
                    style: if by_method { d } else { m },
                    bins: self
                        .metrics
                        .iter()
                        .map(|metric| self.bins(of(&d), m, metric, &cuts))
                        .collect(),
                };
                if line.bins.iter().all(Vec::is_empty) {
                    continue;
                }
                let crossings = self.crossings_of(board, of(&d), m, &cuts).into_iter();
                self.crossings
                    .extend(crossings.map(|(metric, rule, found)| FoundCrossing {
                        dataset: line.dataset.clone(),
                        method: line.method.clone(),
                        split: panel.split.clone(),
                        metric,
                        rule,
                        found,
                    }));
                panel.lines.push(line);
            }
        }
        if !panel.lines.is_empty() {
            self.panels.push(panel);
        } else if !methods.is_empty() {
            self.without_lines.push(panel);
        }
    }

    fn bins(
        &self,
        dataset: &DatasetBoard<'_>,
        method: usize,
        metric: &Column,
        cuts: &Cuts,
    ) -> Vec<SweepBin> {
        let records = dataset.records_of(method);
        let samples: Vec<(&Record, f64, f64)> = records
            .filter_map(|r| Some((r, self.spec.x.of(r)?, score(r, metric)?)))
            .collect();
        let values: Vec<(f64, f64)> = samples.iter().map(|(_, x, value)| (*x, *value)).collect();
        let found = bins(&values, cuts).into_iter().map(|bin| {
            let members = bin.members.iter().map(|i| &samples[*i]);
            let scores = members.map(|(record, _, value)| (record.cluster.as_str(), [0.0, *value]));
            let interval = mean_interval(&Clusters::new(scores), self.resampling);
            let banded = match self.spec.band {
                Band::Sd => Banded::deviation(bin),
                Band::Ci95 => Banded {
                    bin,
                    band: interval,
                },
                Band::None => Banded { bin, band: None },
            };
            SweepBin {
                banded: banded.from(metric.least()),
                interval,
            }
        });
        found.collect()
    }

    /// Crossings of a method, each with the index of its metric and the rule.
    fn crossings_of(
        &self,
        board: &Board<'_>,
        dataset: &DatasetBoard<'_>,
        method: usize,
        cuts: &Cuts,
    ) -> Vec<(usize, CrossingRule, Crossing)> {
        let other = self.spec.against.as_ref().and_then(|name| {
            let at = board.methods.iter().position(|m| m.label == *name)?;
            (at != method).then_some((at, name))
        });
        let mut found = Vec::new();
        for (k, metric) in self.metrics.iter().enumerate() {
            let worse = match metric.direction {
                Some(Direction::Higher) => -1.0,
                _ => 1.0,
            };
            let limits = self.spec.thresholds.iter();
            let limits = limits.filter(|threshold| threshold.metric.to_string() == metric.key);
            let rules = limits.map(|threshold| (CrossingRule::Beyond(threshold.value), None));
            let behind = other.map(|(at, name)| (CrossingRule::Behind(name.clone()), Some(at)));
            for (rule, at) in rules.chain(behind) {
                let pairs = dataset.pairs.iter().filter_map(|pair| {
                    let record = pair.by_method[method]?;
                    let value = score(record, metric)?;
                    let limit = match (&rule, at) {
                        (CrossingRule::Beyond(limit), _) => *limit,
                        (CrossingRule::Behind(_), at) => score(pair.by_method[at?]?, metric)?,
                    };
                    let loss = if value == limit {
                        0.0
                    } else {
                        (value - limit) * worse
                    };
                    Some(Sample {
                        x: self.spec.x.of(record)?,
                        value: loss,
                        cluster: &record.cluster,
                    })
                });
                let samples: Vec<Sample<'_>> = pairs.collect();
                let crossing = Crossing::of(&samples, cuts, self.resampling);
                found.extend(crossing.map(|crossing| (k, rule, crossing)));
            }
        }
        found
    }
}

fn title(board: &Board<'_>, dataset: usize) -> String {
    board.datasets[dataset].dataset.title().to_owned()
}

fn score(record: &Record, metric: &Column) -> Option<f64> {
    let score = (record.status == Status::Ok).then(|| record.scores.get(&metric.key))??;
    score.value().filter(|value| !value.is_nan())
}

/// 95 % interval of the mean; `None` if it is unbounded, for a single cluster or an infinite value.
fn mean_interval(sample: &Clusters, resampling: Resampling) -> Option<(f64, f64)> {
    let (low, high) = infer(&[sample], resampling).ok()?.interval;
    let bounded = sample.n_clusters() > 1 && low.is_finite() && high.is_finite();
    bounded.then_some((low, high))
}
