//! Executes a plan: one thread predicts and renders a pair while another scores the previous pair.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::mpsc::{SyncSender, sync_channel};

use super::doubts::doubts;
use super::error::EvaluateError;
use super::folder::RunFolder;
use super::gaussians::gaussian_store::GaussianStore;
use super::job::{Job, Stages, UnitCounts};
use super::picture_check::change::{is_checked, note_change};
use super::picture_check::order::{Thumbnails, note_order};
use super::predict::{PairWork, Prepared, Reuse, Sources};
use super::score::{MemoryShares, PairTruth, score_pair};
use crate::io::observer::Observer;

/// A pair with its prepared units, or with as many of them as fit into memory.
struct PreparedPair<'a> {
    truth: Arc<PairTruth<'a>>,
    units: Vec<(String, Prepared)>,
    made: UnitCounts,
}

/// Executes a plan in a folder. Reuses finished units and retries failed ones. If a pair fails, records the failure and
/// continues.
///
/// While a pair is scored, only the next one is predicted. Memory therefore holds the pictures of at most two pairs, or
/// of two parts of a pair if the pictures of all methods do not fit. Results do not depend on this.
pub(super) fn run(
    job: &Job,
    folder: &RunFolder,
    observer: &dyn Observer,
) -> Result<UnitCounts, EvaluateError> {
    let logs = folder.logs_path(job.shard);
    for method in job.methods {
        method.begin(&logs, folder.root());
    }
    // A channel without buffer: the predicting thread waits until the scoring thread is ready.
    let (sender, pairs) = sync_channel(0);
    let units = job.pairs.len() * job.methods.len();
    let memory = MemoryShares::of(job.options.memory_limit_bytes);
    observer.begin("", units, "units");
    std::thread::scope(|scope| {
        scope.spawn(move || prepare_all(job, folder, &sender, observer));
        let mut counts = UnitCounts::default();
        let mut doubted = BTreeSet::new();
        let mut thumbnails = Thumbnails::default();
        for pair in pairs {
            let PreparedPair { truth, units, made } = pair?;
            counts.predicted += made.predicted;
            counts.rendered += made.rendered;
            let mut unscored = Vec::new();
            for (method, unit) in units {
                let pair_id = &truth.planned.pair.pair_id;
                observer.progress(counts.units, &format!("{method} {pair_id}"));
                counts.units += 1;
                match unit {
                    Prepared::Done(unit, reuse) => {
                        counts.count(&unit.record, observer);
                        counts.reused += usize::from(reuse == Reuse::Complete);
                    }
                    Prepared::Waiting => counts.waiting += 1,
                    Prepared::Left => counts.left += 1,
                    Prepared::Unscored(mut item) => {
                        let maker = job.methods.iter().find(|m| m.label() == method);
                        if maker.is_some_and(|maker| is_checked(&maker.identity().kind))
                            && let Ok(photograph) = truth.get()
                        {
                            let shown = photograph.with_excluded_of(&item.picture);
                            let record = &mut item.unit.record;
                            let planned = &truth.planned;
                            let source = || thumbnails.of(planned, planned.source);
                            note_change(record, photograph.image(), &shown, source);
                            let both = (photograph.image(), &*shown);
                            note_order(record, planned, &job.sample, both, &mut thumbnails);
                        }
                        let mut new = doubts(&item.unit.record);
                        new.retain(|about, _| {
                            doubted.insert((method.clone(), (*about).to_owned()))
                        });
                        if !new.is_empty() {
                            let texts: Vec<String> = new.into_values().collect();
                            observer.warn(&format!("method '{method}': {}", texts.join("; ")));
                        }
                        unscored.push(*item);
                    }
                }
            }
            if observer.stop() && job.options.keeps_pictures() {
                counts.left += unscored.len();
            } else {
                for unit in score_pair(&truth, unscored, job.scoring, job.keys, memory, folder)? {
                    counts.scored += 1;
                    counts.count(&unit.record, observer);
                }
            }
        }
        observer.progress(counts.units, "");
        observer.end();
        counts.left += units - counts.units;
        counts.units = units;
        Ok(counts)
    })
}

/// Prepares the pairs in order and sends them, until an error occurs, a stop is requested or the
/// receiver is closed.
fn prepare_all<'a>(
    job: &Job<'a>,
    folder: &RunFolder,
    sender: &SyncSender<Result<PreparedPair<'a>, EvaluateError>>,
    observer: &dyn Observer,
) {
    let runs_at_once = matches!(job.options.stages, Stages::All | Stages::Pictures);
    let kept = job.options.keep_gaussians || !runs_at_once;
    let memory = MemoryShares::of(job.options.memory_limit_bytes);
    let gaussians = kept.then(|| folder.gaussians_path());
    let gaussians = GaussianStore::new(gaussians, folder.root(), memory.gaussians);
    let mut sources = Sources::new(gaussians);
    for planned in &job.pairs {
        if observer.stop() {
            return;
        }
        let mut pair = PairWork::new(job, *planned, folder, observer);
        for methods in job.methods.chunks(memory.pictures_of(planned.target)) {
            let units: Result<Vec<_>, EvaluateError> = methods
                .iter()
                .map(|method| {
                    let prepared = if observer.stop() {
                        Prepared::Left
                    } else {
                        pair.prepare(method.as_ref(), &mut sources)?
                    };
                    Ok((method.label().to_owned(), prepared))
                })
                .collect();
            let failed = units.is_err();
            let prepared = units.map(|units| PreparedPair {
                truth: Arc::clone(&pair.truth),
                units,
                made: std::mem::take(&mut pair.made),
            });
            // On a send error, the scoring thread has stopped and reports the reason itself.
            if sender.send(prepared).is_err() || failed {
                return;
            }
        }
    }
}
