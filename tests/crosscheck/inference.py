"""Our statistics of clustered paired differences against scipy, statsmodels and their definitions in numpy."""

import itertools
import json
from types import SimpleNamespace

import numpy as np
from scipy import integrate, linalg, stats
from statsmodels.regression.linear_model import OLS
from statsmodels.stats.multitest import multipletests
from statsmodels.stats.power import TTestPower

# Closed formulas, in f64.
FORMULA = 1e-12
# Our quadrature against scipy's series, relative.
DISTRIBUTION = 1e-11
# Power: both sides integrate a function that is steep for few degrees of freedom.
POWER = 1e-8
# scipy takes 1 - p, whose rounding counts where p is small.
CONFIDENCE = 1e-9
# Degrees of freedom: roots of a tail that we state to nine digits.
DEGREES = 1e-7
# A p value that counts patterns.
COUNT = 1e-12
# Our drawn signs against scipy's: six standard deviations of either share.
DRAWN = 6 * (2 * 0.25 / 10_000) ** 0.5

RESAMPLES = 10_000
ALPHA = 0.05
MASK = 2**64 - 1

# Pairs per cluster of a sample's datasets.
DESIGNS = [
    [[70] * 7],
    [[100] * 3],
    [[4, 8, 10, 12, 15, 18, 20, 22, 25, 30, 36, 40, 60]],
    [[10, 10, 10, 10, 120]],
    [[1, 2, 300]],
    [[8] * 10] * 6,
    [[3, 9, 20], [30] * 9, [1] * 40],
    [[8] * 40],
    [list(range(1, 61))],
    [[1, 1, 2] * 100],
]
MANY = {7, 8, 9}

EXPECTED = {
    "normal tail", "normal quantile", "t tail", "t quantile", "detectable shift", "power of it",
    "Holm", "mean over clusters", "CV3", "cluster-robust OLS", "degrees of freedom",
    "t: p and interval", "the more careful", "resampled means", "sign flips, all", "sign flips, drawn", "sign flips: interval", "BCa interval", "BCa p"}


def draw(rng, design):
    """Lists of (cluster, a, b); scenes and pairs vary, the means are near what is significant."""
    datasets = []
    for sizes in design:
        shift = rng.normal(0, 0.02)
        scenes = rng.gamma(2, 0.02, len(sizes)) - 0.04 + shift
        pairs = [(scene, a, a + scenes[scene] + rng.normal(0, 0.05))
                 for scene, size in enumerate(sizes) for a in rng.uniform(0.2, 0.8, size)]
        datasets.append(pairs)
    return datasets


def sums(pairs):
    """Sum of differences and number of pairs, by cluster."""
    scene, a, b = np.array(pairs).T
    scene = scene.astype(int)
    return np.bincount(scene, b - a), np.bincount(scene).astype(float)


def cv3(s, n):
    """From its definition: G - 1 over G times the squared moves of the mean without one cluster."""
    without = np.array([np.delete(s, g).sum() / np.delete(n, g).sum() for g in range(len(s))])
    return (len(s) - 1) / len(s) * np.sum((without - s.sum() / n.sum()) ** 2)


def variances_of_means(pairs, n):
    """Between clusters, plus within them over n, by the analysis of variance of unweighted means."""
    scene, a, b = np.array(pairs).T
    groups = [(b - a)[scene == g] for g in range(len(n))]
    within = sum(np.sum((g - g.mean()) ** 2) for g in groups) / (n.sum() - len(n))
    between = np.var([g.mean() for g in groups], ddof=1) - within * np.mean(1 / n)
    return max(between, 0) + within / n


def exact_tail(c, n, variances):
    """P(|mean| > c sqrt(CV3)) of independent normal cluster means, by eigenvalues."""
    w, count = n / n.sum(), len(n)
    residual = np.eye(count) - np.outer(np.ones(count), w)
    scale = np.diag((count - 1) / count * (w / (1 - w)) ** 2)
    form = c**2 * residual.T @ scale @ residual - np.outer(w, w)
    values = linalg.eigvalsh(form * np.sqrt(np.outer(variances, variances)))
    ratio = np.maximum(values[1:], 0) / -values[0]
    product = lambda phi: np.prod(1 + ratio / np.sin(phi) ** 2) ** -0.5
    return integrate.quad(product, 0, np.pi / 2, epsabs=1e-13, epsrel=1e-12, limit=400)[0] * 2 / np.pi


def power(shift, nu, alpha):
    """Of the t test: P(|Z + shift| > critical value * chi / sqrt(nu)), averaged over chi."""
    critical, chi = stats.t.isf(alpha / 2, nu), stats.chi(nu)

    def seen(x):
        edge = critical * x / nu**0.5
        return chi.pdf(x) * (stats.norm.sf(edge - shift) + stats.norm.sf(edge + shift))

    ends = chi.ppf([0, 1e-9, 0.01, 0.5, 0.99, 1 - 1e-9]).tolist() + [chi.isf(1e-30)]
    parts = [integrate.quad(seen, *part, epsabs=1e-14, epsrel=1e-12, limit=400)[0]
             for part in itertools.pairwise(ends)]
    return sum(parts)


def compare_power(comparison, quantity, shift, nu, alpha):
    comparison.add(quantity, "scipy", power(shift, nu, alpha), 0.8, POWER)
    # The range in which the underlying noncentral t is accurate.
    if nu > 5 and alpha > 0.01:
        theirs = TTestPower().power(shift / (nu + 1) ** 0.5, nu + 1, alpha)
        comparison.add(quantity, "statsmodels", theirs, 0.8, POWER)


def compare_inference(comparison, rng, sample, found, many, seed):
    by_dataset = [sums(pairs) for pairs in sample]
    means = [s.sum() / n.sum() for s, n in by_dataset]
    comparison.add("mean over clusters", "numpy", found["mean"], np.mean(means), FORMULA)
    variances = np.array([cv3(s, n) for s, n in by_dataset])
    ours = found["jackknives"]
    comparison.add("CV3", "numpy", [j["variance"] ** 0.5 for j in ours], variances**0.5, FORMULA)
    degrees = np.array([j["degrees_of_freedom"] for j in ours])
    for pairs, (_, n), nu in zip(sample, by_dataset, degrees):
        if np.ptp(n) == 0:
            comparison.add("degrees of freedom", "numpy", nu, len(n) - 1.0, DEGREES)
        else:
            critical = stats.t.isf(ALPHA / 2, nu)
            tails = [exact_tail(critical, n, v) for v in (np.ones(len(n)), variances_of_means(pairs, n))]
            comparison.add("degrees of freedom", "numpy, scipy", max(tails) / ALPHA, 1.0, DEGREES)
    # statsmodels has CV1: with clusters of equal size it is CV3.
    for pairs, (s, n), variance in zip(sample, by_dataset, variances):
        if np.ptp(n) == 0 and n[0] > 1:
            scene, a, b = np.array(pairs).T
            fit = OLS(b - a, np.ones(len(a))).fit(cov_type="cluster", cov_kwds={"groups": scene})
            comparison.add("cluster-robust OLS", "statsmodels", variance**0.5, fit.bse[0], FORMULA)
    error = variances.sum() ** 0.5 / len(sample)
    nu = variances.sum() ** 2 / np.sum(variances**2 / degrees)
    mean = np.mean(means)
    if not many:
        reach = stats.t.isf(ALPHA / 2, nu) * error
        theirs = [2 * stats.t.sf(abs(mean) / error, nu), mean - reach, mean + reach]
        comparison.add("t: p and interval", "scipy", [found["p"], *found["interval"]], theirs, DISTRIBUTION)
    compare_power(comparison, "power of it", found["detectable"] / error, nu, ALPHA)
    if len(sample) == 1:
        compare_sign_flips(comparison, rng, *by_dataset[0], found["sign_flip"])
        compare_bootstrap(comparison, *by_dataset[0], found["bootstrap"], seed)
        if many:
            each = found["sign_flip"], found["bootstrap"]
            outer = [max(e["p"] for e in each), min(e["interval"][0] for e in each),
                     max(e["interval"][1] for e in each)]
            comparison.add("the more careful", "both", [found["p"], *found["interval"]], outer, 0)


def flipped(s, n, mean, signs):
    """Share of patterns under which the sums' deviation from `mean` is as large as it is."""
    deviations = s - mean * n
    return np.mean(np.abs(signs @ deviations) >= abs(deviations.sum()) - 1e-12)


def mix(z):
    z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9 & MASK
    z = (z ^ z >> 27) * 0x94D049BB133111EB & MASK
    return z ^ z >> 31


def resampled_means(s, n, seed, count):
    """The first means of the bootstrap, by its documented generator."""
    for k in range(count):
        state, drawn = mix(seed ^ mix(2 * k)), []
        for _ in s:
            state = state + 0x9E3779B97F4A7C15 & MASK
            drawn.append(mix(state) * len(s) >> 64)
        yield s[drawn].sum() / n[drawn].sum()


def compare_sign_flips(comparison, rng, s, n, found):
    ends = [end for end in found["interval"] if end is not None]
    if len(s) <= 14:
        signs = np.array(list(itertools.product([-1, 1], repeat=len(s))))
        comparison.add("sign flips, all", "numpy", found["p"], flipped(s, n, 0, signs), COUNT)
        comparison.add("sign flips, all", "numpy", found["floor"], 2 / 2 ** len(s), COUNT)
        if np.ptp(n) == 0:
            theirs = stats.permutation_test((s,), np.sum, permutation_type="samples", n_resamples=np.inf)
            comparison.add("sign flips, all", "scipy", found["p"], theirs.pvalue, COUNT)
        # The test accepts means just inside an end of the interval, and rejects those just outside.
        centre = s.sum() / n.sum()
        for end in ends:
            step = 1e-9 * (end - centre)
            kept = flipped(s, n, end - step, signs) >= ALPHA
            left = flipped(s, n, end + step, signs) < ALPHA
            comparison.add("sign flips: interval", "numpy", kept and left, True, 0)
        comparison.add("sign flips: interval", "numpy", len(ends), 2 if 2 / 2 ** len(s) < ALPHA else 0, 0)
    else:
        drawn = stats.permutation_test((s,), np.sum, permutation_type="samples",
                                       n_resamples=RESAMPLES, rng=rng).pvalue
        comparison.add("sign flips, drawn", "scipy", found["p"], drawn, DRAWN)
        signs = rng.choice([-1.0, 1.0], (RESAMPLES, len(s)))
        for end in ends:
            comparison.add("sign flips: interval", "numpy, drawn", flipped(s, n, end, signs), ALPHA, DRAWN)


def compare_bootstrap(comparison, s, n, found, seed):
    def mean(s, n, axis=-1):
        return s.sum(axis=axis) / n.sum(axis=axis)

    # scipy's interval of the means that we drew: what remains is the correction itself. Equal means of other draws differ
    # by rounding, which scipy takes for a difference.
    drawn = np.array(found["means"])
    for mean_of_one in resampled_means(s, n, seed, 20):
        nearest = np.min(np.abs(drawn - mean_of_one))
        comparison.add("resampled means", "numpy", nearest, 0, FORMULA)
    drawn[np.abs(drawn - mean(s, n)) < 1e-13] = mean(s, n)

    def interval(alpha):
        result = stats.bootstrap((s, n), mean, paired=True, vectorized=True, n_resamples=0, method="BCa",
                                 confidence_level=1 - alpha,
                                 bootstrap_result=SimpleNamespace(bootstrap_distribution=drawn))
        return [result.confidence_interval.low, result.confidence_interval.high]

    comparison.add("BCa interval", "scipy", found["interval"], interval(ALPHA), DISTRIBUTION)
    if 0 < found["p"] < 1:
        nearest = np.min(np.abs(interval(found["p"])))
        comparison.add("BCa p", "scipy", nearest, 0, CONFIDENCE)


def compare(comparison, run_json, program, rng):
    samples = [draw(rng, design) for design in DESIGNS]
    p = [rng.uniform(0, 0.2, size).tolist() for size in (1, 2, 7, 30)] + [[0.01, 0.01, 0.04, 1.0]]
    t = [(float(np.exp(rng.uniform(-3, 4))), float(np.exp(rng.uniform(0, 8))),
          float(np.exp(rng.uniform(-5, -1)))) for _ in range(60)]
    normal = rng.uniform(-6, 30, 60).tolist()
    request = {"samples": samples, "seed": int(rng.integers(2**32)), "resamples": RESAMPLES,
               "p": p, "t": t, "normal": normal}
    ours = run_json([program], json.dumps(request, default=int))

    def relative(quantity, reference, ours, theirs, tolerance):
        ours, theirs = np.array(ours), np.array(theirs)
        comparison.add(quantity, reference, ours / theirs, np.ones(len(theirs)), tolerance)

    value, nu, alpha = np.array(t).T
    relative("normal tail", "scipy", ours["normal_tail"], stats.norm.sf(normal), DISTRIBUTION)
    low = np.array(normal) > -2
    relative("normal quantile", "scipy", -np.array(ours["normal_quantile"])[low],
             np.array(normal)[low], DISTRIBUTION)
    tails = 2 * stats.t.sf(value, nu)
    normal_floats = tails > 1e-290
    relative("t tail", "scipy", np.array(ours["t_two_sided"])[normal_floats], tails[normal_floats], DISTRIBUTION)
    relative("t quantile", "scipy", ours["t_critical"], stats.t.isf(alpha / 2, nu), DISTRIBUTION)
    for shift, degrees, level in zip(ours["detectable_shift"], nu, alpha):
        compare_power(comparison, "detectable shift", shift, degrees, level)
    for values, corrected in zip(p, ours["holm"]):
        comparison.add("Holm", "statsmodels", corrected, multipletests(values, method="holm")[1], FORMULA)
    for number, (sample, found) in enumerate(zip(samples, ours["samples"])):
        compare_inference(comparison, rng, sample, found, number in MANY, request["seed"])
