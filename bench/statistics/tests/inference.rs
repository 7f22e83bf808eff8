//! Results of the inference for typical and for unusual samples.

use rayon::ThreadPoolBuilder;
use sharp::random::SplitMix64;
use sharp_statistics::{
    ALPHA, Clusters, Inference, MANY_CLUSTERS, NoInference, Procedure, Resampling, Verdict, holm,
    infer, verdict,
};

fn one(sample: &Clusters) -> Result<Inference, NoInference> {
    infer(&[sample], Resampling::default())
}

/// Scores around 20 whose differences vary by scene and by pair.
fn drawn(sizes: &[usize], shift: f64, seed: u64) -> Vec<(usize, [f64; 2])> {
    let mut random = SplitMix64::new(seed);
    let mut pairs = Vec::new();
    for (scene, size) in sizes.iter().enumerate() {
        let of_scene = shift + random.between(-1.0, 1.0);
        for _ in 0..*size {
            let a = random.between(15.0, 25.0);
            pairs.push((scene, [a, a + of_scene + random.between(-1.0, 1.0)]));
        }
    }
    pairs
}

#[test]
fn p_is_below_alpha_exactly_where_the_interval_leaves_zero_out() {
    let mut seen = [0; 2];
    for seed in 0..400 {
        let sizes: &[&[usize]] = &[&[5; 3], &[9, 2, 4, 40], &[3; 35], &[1; 60]];
        let sizes = sizes[seed as usize % 4];
        let shift = 0.03 * (seed % 50) as f64;
        let found = one(&Clusters::new(drawn(sizes, shift, seed))).expect("several scenes");
        let (low, high) = found.interval;
        assert_eq!(found.p < ALPHA, low > 0.0 || high < 0.0, "{found:?}");
        assert!(low <= found.mean && found.mean <= high);
        let many = sizes.len() >= MANY_CLUSTERS as usize;
        assert_eq!(matches!(found.procedure, Procedure::Resampled(_)), many);
        seen[usize::from(found.p < ALPHA)] += 1;
    }
    assert!(seen.iter().all(|count| *count > 50), "{seen:?}");
}

#[test]
fn unequal_sizes_make_many_clusters_few() {
    let mut sizes = vec![4; 100];
    sizes[0] = 400;
    let sample = Clusters::new(drawn(&sizes, 0.0, 1));
    assert!(sample.effective_clusters() < MANY_CLUSTERS);
    assert_eq!(
        one(&sample).expect("many scenes").procedure,
        Procedure::Jackknife
    );
}

#[test]
fn any_sizes_have_an_answer() {
    let mut random = SplitMix64::new(3);
    let mut extreme = vec![vec![100_000, 1], vec![1, 1, 50_000], vec![20_000; 3]];
    extreme.push(
        (0..1000)
            .map(|k| if k == 0 { 100_000 } else { 1 })
            .collect(),
    );
    for _ in 0..100 {
        let range = random.between(0.0, 9.0);
        let size = |random: &mut SplitMix64| random.between(0.0, range).exp() as usize;
        extreme.push(
            (0..2 + random.below(30))
                .map(|_| size(&mut random))
                .collect(),
        );
    }
    for (seed, sizes) in extreme.iter().enumerate() {
        let found =
            one(&Clusters::new(drawn(sizes, 0.1, seed as u64))).expect("two scenes or more");
        assert!(found.p > 0.0 && found.p <= 1.0, "{sizes:?}: {}", found.p);
        assert!(found.interval.0 < found.mean && found.mean < found.interval.1);
        assert!(
            found.degrees_of_freedom >= 0.9,
            "{sizes:?}: {}",
            found.degrees_of_freedom
        );
        assert!(found.detectable() > found.standard_error, "{sizes:?}");
    }
}

#[test]
fn one_scene_alone_is_never_significant() {
    for sizes in [
        &[10; 3][..],
        &[10; 7],
        &[5, 5, 5, 80],
        &[300, 1, 1],
        &[6; 40],
        &[1; 200],
    ] {
        for changed in [0, sizes.len() - 1] {
            let scenes = sizes
                .iter()
                .enumerate()
                .flat_map(|(scene, size)| (0..*size).map(move |_| scene));
            let pairs =
                scenes.map(|scene| (scene, [30.0, if scene == changed { 21.0 } else { 30.0 }]));
            let found = one(&Clusters::new(pairs)).expect("several scenes");
            assert!(found.mean < 0.0 && found.p > 0.1, "{sizes:?}: {}", found.p);
        }
    }
}

#[test]
fn datasets_count_equally() {
    let small = Clusters::new(drawn(&[2; 5], 1.0, 1));
    let large = Clusters::new(drawn(&[50; 5], 0.0, 2));
    let both = infer(&[&small, &large], Resampling::default()).expect("five scenes each");
    assert_eq!(both.mean, (small.mean() + large.mean()) / 2.0);
    assert_eq!((both.n_pairs, both.n_clusters), (260, 10));
    assert_eq!(
        (both.procedure, &both.sign_flip),
        (Procedure::Jackknife, &None)
    );
    let errors = [&small, &large].map(|d| one(d).expect("five scenes").standard_error);
    let expected = errors[0].hypot(errors[1]) / 2.0;
    assert!((both.standard_error / expected - 1.0).abs() < 1e-12);
    assert!(both.degrees_of_freedom >= 4.0 && both.degrees_of_freedom <= 8.0);
}

#[test]
fn threads_and_the_order_of_pairs_change_nothing() {
    let pairs = drawn(&[3; 50], 0.2, 9);
    let sample = Clusters::new(pairs.clone());
    let with_threads = |threads| {
        let pool = ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads");
        pool.install(|| one(&sample).expect("many scenes"))
    };
    let found = with_threads(1);
    assert_eq!(found, with_threads(5));
    let reversed = one(&Clusters::new(pairs.into_iter().rev())).expect("many scenes");
    assert!(
        (found.p - reversed.p).abs() < 1e-9
            && (found.interval.0 - reversed.interval.0).abs() < 1e-9
    );
    let resampling = Resampling {
        seed: 1,
        ..Resampling::default()
    };
    let other = infer(&[&sample], resampling).expect("many scenes");
    assert_ne!(found.interval, other.interval);
    assert_eq!(other.procedure, Procedure::Resampled(resampling));
}

#[test]
fn scores_in_another_unit_give_the_same_p() {
    for sizes in [&[4, 9, 2, 7][..], &[3; 40]] {
        let pairs = drawn(sizes, 0.1, 4);
        let found = one(&Clusters::new(pairs.clone())).expect("several scenes");
        let scaled = Clusters::new(
            pairs
                .into_iter()
                .map(|(scene, [a, b])| (scene, [-1024.0 * a, -1024.0 * b])),
        );
        let scaled = one(&scaled).expect("several scenes");
        assert!(
            (scaled.p / found.p - 1.0).abs() < 1e-6,
            "{} and {}",
            scaled.p,
            found.p
        );
        assert!((scaled.detectable() / (1024.0 * found.detectable()) - 1.0).abs() < 1e-9);
    }
}

#[test]
fn all_equal() {
    for scenes in [1, 3, 40] {
        let sample = Clusters::new((0..3 * scenes).map(|k| (k % scenes, [25.0, 25.0])));
        assert!(sample.all_equal());
        let found = one(&sample).expect("equal pairs need no spread");
        assert_eq!(
            (found.mean, found.p, found.interval),
            (0.0, 1.0, (0.0, 0.0))
        );
        assert!(found.detectable().is_nan());
        let corrected = holm(&[Some(found.p)])[0];
        let word = verdict(Some(&found), corrected, true, true, 0.0);
        assert_eq!(word, Verdict::None);
    }
    let sample = Clusters::new([(0, [25.0, 25.0])]);
    assert_eq!(
        infer(&[&sample, &sample], Resampling::default())
            .expect("equal")
            .p,
        1.0
    );
}

#[test]
fn ties_count_as_differences_of_zero() {
    let ties = [
        (0, [1.0, 1.0]),
        (0, [1.0, 2.0]),
        (1, [3.0, 3.0]),
        (1, [3.0, 5.0]),
    ];
    let sample = Clusters::new(ties);
    assert_eq!(
        (sample.mean(), sample.n_pairs(), sample.all_equal()),
        (0.75, 4, false)
    );
    assert!(one(&sample).is_ok());
}

#[test]
fn clusters_that_all_move_alike_leave_the_signs() {
    // Sums and differences that are not exact in binary.
    let moved = |scenes: usize, by: f64| {
        Clusters::new((0..4 * scenes).map(move |k| {
            (
                k % scenes,
                [30.0 + 0.1 * k as f64, 30.0 + 0.1 * k as f64 + by],
            )
        }))
    };
    let many = one(&moved(7, -0.1)).expect("seven scenes");
    assert_eq!(
        (many.p, many.procedure),
        (2.0 / 128.0, Procedure::SignFlips)
    );
    assert!((many.mean + 0.1).abs() < 1e-12 && many.interval == (many.mean, many.mean));
    let few = one(&moved(5, -0.1)).expect("five scenes");
    assert_eq!(
        (few.p, few.interval),
        (0.0625, (f64::NEG_INFINITY, f64::INFINITY))
    );
    let opposite = infer(&[&moved(5, 0.1), &moved(5, -0.3)], Resampling::default());
    assert_eq!(opposite, Err(NoInference::NoSpread));
    let alike = infer(&[&moved(5, 0.1), &moved(3, 0.3)], Resampling::default());
    assert_eq!(alike.map(|found| found.p), Ok(2.0 / 256.0));
}

#[test]
fn one_pair_one_scene_and_none() {
    let pair = Clusters::new([("scene", [20.0, 21.0])]);
    assert_eq!(
        (pair.mean(), pair.mean_a(), pair.mean_b()),
        (1.0, 20.0, 21.0)
    );
    assert_eq!(one(&pair), Err(NoInference::OneCluster));
    let scene = Clusters::new(drawn(&[50], 5.0, 1));
    assert_eq!(one(&scene), Err(NoInference::OneCluster));
    let scenes = Clusters::new(drawn(&[5; 5], 5.0, 1));
    assert_eq!(
        infer(&[&scenes, &scene], Resampling::default()),
        Err(NoInference::OneCluster)
    );
    let none = Clusters::new(Vec::<(u8, [f64; 2])>::new());
    assert!(none.mean().is_nan());
    assert_eq!(one(&none), Err(NoInference::NoPairs));
    assert_eq!(infer(&[], Resampling::default()), Err(NoInference::NoPairs));
}

#[test]
fn infinite_scores_and_nan() {
    let inf = f64::INFINITY;
    let both = Clusters::new([(0, [inf, inf]), (1, [20.0, 21.0]), (2, [20.0, 20.5])]);
    assert_eq!(
        (both.n_infinite(), both.mean(), both.mean_a()),
        (1, 0.5, inf)
    );
    assert!(one(&both).expect("finite differences").p.is_finite());
    for (b, mean) in [(inf, inf), (-inf, -inf)] {
        let single = Clusters::new([(0, [20.0, b]), (1, [20.0, 21.0])]);
        assert_eq!((single.n_infinite(), single.mean()), (1, mean));
        assert_eq!(one(&single), Err(NoInference::NotFinite));
    }
    let opposite = Clusters::new([(0, [20.0, inf]), (1, [inf, 20.0])]);
    assert!(opposite.mean().is_nan());
    assert_eq!(one(&opposite), Err(NoInference::NotFinite));
    let nan = Clusters::new([(0, [20.0, f64::NAN]), (1, [20.0, 21.0])]);
    assert!(nan.mean().is_nan() && !nan.all_equal());
    assert_eq!(one(&nan), Err(NoInference::NotFinite));
}
