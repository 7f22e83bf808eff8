//! Computes this crate's statistics for a cross-check against other libraries.
//!
//! Reads a JSON request from standard input and writes the answer to standard output:
//! * request: `samples`, each a list of datasets, each a list of `[cluster, a, b]`; `seed` and `resamples`; `p`, lists
//!   of p values for Holm; `t`, triples of t, degrees of freedom and a level; `normal`, numbers;
//! * answer: the result of `infer` per sample, with sign flips and bootstrap if they were used; `holm`; `t_two_sided`,
//!   `t_critical`, `detectable_shift` per triple; `normal_tail` and `normal_quantile` (of the tail) per number.

use std::error::Error;
use std::io::{Write, stdin, stdout};
use std::num::NonZeroU32;

use serde::Deserialize;
use serde_json::{Value, json};
use sharp_statistics::distributions::{
    detectable_shift, normal_quantile, normal_tail, t_critical, t_two_sided,
};
use sharp_statistics::{ALPHA, Bootstrap, Clusters, Jackknife, POWER, Resampling, holm, infer};

#[derive(Deserialize)]
struct Request {
    samples: Vec<Vec<Vec<(u64, f64, f64)>>>,
    seed: u64,
    resamples: NonZeroU32,
    p: Vec<Vec<f64>>,
    t: Vec<(f64, f64, f64)>,
    normal: Vec<f64>,
}

fn main() -> Result<(), Box<dyn Error>> {
    let request: Request = serde_json::from_reader(stdin().lock())?;
    let resampling = Resampling {
        seed: request.seed,
        count: request.resamples,
    };
    let sample = |datasets: &Vec<Vec<(u64, f64, f64)>>| -> Result<Value, Box<dyn Error>> {
        let datasets: Vec<Clusters> = datasets
            .iter()
            .map(|pairs| Clusters::new(pairs.iter().map(|&(cluster, a, b)| (cluster, [a, b]))))
            .collect();
        let inference = infer(&datasets.iter().collect::<Vec<_>>(), resampling)?;
        let jackknives = datasets.iter().map(Jackknife::new).map(|jackknife| {
            json!({"variance": jackknife.variance, "degrees_of_freedom": jackknife.degrees_of_freedom})
        });
        let bootstrap = datasets
            .first()
            .map(|first| Bootstrap::new(first, resampling));
        Ok(json!({
            "mean": inference.mean,
            "interval": inference.interval,
            "p": inference.p,
            "detectable": inference.detectable(),
            "procedure": format!("{:?}", inference.procedure),
            "jackknives": jackknives.collect::<Vec<_>>(),
            "sign_flip": inference.sign_flip.map(|flips| json!({
                "p": flips.p,
                "floor": flips.floor,
                "interval": flips.interval(ALPHA),
            })),
            "bootstrap": bootstrap.map(|bootstrap| json!({
                "means": bootstrap.means(),
                "interval": bootstrap.interval(ALPHA),
                "p": bootstrap.p(),
            })),
        }))
    };
    let correct = |p: &Vec<f64>| holm(&p.iter().copied().map(Some).collect::<Vec<_>>());
    let shift = |&(_, degrees, alpha): &(f64, f64, f64)| detectable_shift(POWER, alpha, degrees);
    let t = &request.t;
    let answer = json!({
        "samples": request.samples.iter().map(sample).collect::<Result<Vec<_>, _>>()?,
        "holm": request.p.iter().map(correct).collect::<Vec<_>>(),
        "t_two_sided": t.iter().map(|&(t, degrees, _)| t_two_sided(t, degrees)).collect::<Vec<_>>(),
        "t_critical": t.iter().map(|&(_, degrees, alpha)| t_critical(alpha, degrees)).collect::<Vec<_>>(),
        "detectable_shift": t.iter().map(shift).collect::<Vec<_>>(),
        "normal_tail": request.normal.iter().map(|&x| normal_tail(x)).collect::<Vec<_>>(),
        "normal_quantile": request.normal.iter().map(|&x| normal_quantile(normal_tail(x))).collect::<Vec<_>>(),
    });
    writeln!(stdout(), "{answer}")?;
    Ok(())
}
