"""Evaluate single-photograph view synthesis from Python, with the same numbers as the ``sharp-bench`` command.

Cameras are OpenCV's: x right, y down, z forward; lengths are metres, extrinsics world-to-camera, and pixel centres lie at
half-integer coordinates. Pictures are sRGB: uint8, or floats in 0..1, which :func:`metrics` scores unchanged and a run
rounds to levels.
"""

import functools
import hashlib
import inspect
import json
import os
import subprocess
import sys
import textwrap
import threading
import warnings

import numpy as np

from . import _arrays, _sharp_bench
from ._sharp_bench import Camera, Dataset, Error, Gaussians, Rendering, Scene, Source, Sweep, Table, View, bundled_data

_folders = [os.path.dirname(os.path.abspath(__file__))]
try:
    # VGG16's weights, which are in a package of their own.
    import sharp_bench_weights as _weights

    _folders += _weights.__path__
except ImportError:
    pass
_sharp_bench.lies_in(_folders)

__all__ = [
    "Camera",
    "Dataset",
    "Error",
    "Gaussians",
    "Rendering",
    "Run",
    "Scene",
    "Source",
    "Sweep",
    "Table",
    "View",
    "bundled_data",
    "compare",
    "conventions",
    "datasets",
    "evaluate",
    "figure",
    "gate",
    "history",
    "load_scores",
    "merge",
    "metrics",
    "pairs",
    "predict",
    "render",
    "report",
    "sweep",
    "table",
]


def metrics(prediction, target, metrics="paper", mask=None, layout=None, weights=None):
    """Scores of a prediction against its target: a dictionary from metric key to number.

    ``prediction`` and ``target`` are arrays or tensors of one size, uint8 or floats in 0..1 (sRGB): [H, W, 3] or [3, H, W], or
    batches [N, H, W, 3] or [N, 3, H, W], for which each score is an array [N]. If both the first and the last axis of a picture
    have length 3, the last is taken for the channels; ``layout="chw"`` or ``"hwc"`` sets the layout. ``metrics`` is a list of
    keys or groups as for ``sharp-bench metrics --metrics``. ``mask`` [H, W] adds the scores inside the mask, under keys that
    end in ``@mask``. ``weights`` maps a network to its file. Numbers equal those of the command line to the last digit.

    Contiguous [H, W, 3] of uint8 or float32 is read in place from NumPy, torch on the CPU (also in ``channels_last``), and
    anything with DLPack or a buffer; other layouts and floats are converted first, picture by picture. Tensors are detached, and
    copied to the CPU if they are on a GPU. The core holds a copy of the two pictures that it scores.

    A metric that cannot be computed is left out with a warning if it belongs to a group; if it was named itself, it is an error.
    """
    metrics = metrics if isinstance(metrics, str) else ",".join(metrics)
    files = tuple(sorted((name, os.fspath(file)) for name, file in (weights or {}).items()))
    scorer = _scorer(metrics, mask is not None, files)
    predictions, is_batch = _arrays.pictures("prediction", prediction, layout)
    targets, _ = _arrays.pictures("target", target, layout)
    if not predictions:
        raise ValueError("prediction: the batch has no pictures")
    if len(targets) not in (1, len(predictions)):
        raise ValueError(f"{len(predictions)} predictions and {len(targets)} targets: expected equally many, or one target")
    targets = targets * (len(predictions) // len(targets))
    given = [None] * len(predictions) if mask is None else _arrays.masks(mask, len(predictions))
    all_scores, reasons = [], {}
    for at, (one, other, inside) in enumerate(zip(predictions, targets, given)):
        try:
            scores, absent = scorer.score(one, other, inside)
        except (Error, ValueError) as error:
            raise type(error)(f"picture {at}: {error}") if is_batch else error
        all_scores.append(dict(scores))
        reasons.update(absent)
    for key, reason in reasons.items():
        warnings.warn(f"{key} is left out: {reason}", stacklevel=2)
    if not is_batch:
        return all_scores[0]
    keys = list(dict.fromkeys(key for scores in all_scores for key in scores))
    return {key: np.array([scores.get(key, np.nan) for scores in all_scores]) for key in keys}


@functools.lru_cache(maxsize=8)
def _scorer(metrics, masked, weights):
    return _sharp_bench.Scorer(metrics, masked, dict(weights))


def conventions(metrics="all"):
    """What each metric key means: window, borders, colour, weights, and the public code that computes the same value."""
    return json.loads(_scorer(metrics, False, ()).conventions())


def datasets(*specs, scenes=None):
    """Opens datasets, each given as for ``--dataset``, ``[NAME:]FORMAT=PATH[,key=value…]``; ``scenes`` is a pattern of scene ids."""
    if not specs:
        raise TypeError("a dataset is needed: [NAME:]FORMAT=PATH[,key=value…]")
    return _sharp_bench.datasets([os.fspath(spec) for spec in specs], scenes)


def pairs(*specs, options="", scenes=None, out=None):
    """The pairs of datasets by the paper's rules, changed by ``options`` as ``--pair-options`` takes them; writes ``out``, if given."""
    table, notes = _sharp_bench.pairs(list(specs), scenes, options, out)
    _warn(notes)
    return table


def load_scores(run):
    """The records of a run folder or bundle, one per pair and method."""
    return _sharp_bench.load_scores(run)


def merge(*runs, out=None):
    """Joins run folders into ``out``, or writes the tables of one folder whose shards are done; returns a :class:`Run`.

    Its ``counts`` are units, missing and failed. Missing units cause a warning.
    """
    done = _command("merge", runs, (75,), out=out)
    if done["missing"]:
        units = "unit is" if done["missing"] == 1 else "units are"
        warnings.warn(f"{done['run']}: {done['missing']} {units} missing: run their shards", stacklevel=2)
    return Run(done.pop("run"), done)


def compare(a, b=None, methods=(), **options):
    """Compares run B with run A pair by pair; returns the dictionary of ``sharp-bench compare --json``.

    ``methods`` are labels, or ``(label in A, label in B)``; by default, methods with the same label are compared. Without ``b``,
    ``methods`` names pairs of methods of one run. ``options`` are those of the command: ``metrics=["psnr"]``, ``flips=True``.
    """
    options["method"] = [f"{old}={new}" for old, new in _pairs(methods)]
    return _command("compare", [a] if b is None else [a, b], **options)


def sweep(*runs, x="baseline_m", bins=None, band="sd", split="dataset", metrics=(), methods=(), datasets=(), rename=None):
    """Scores against camera motion: ``figures`` (SVG, shown in a notebook), ``csv`` and ``latex``. The options are those of
    ``sharp-bench sweep`` with these names; ``rename`` is a dictionary. Only the command writes PNG and PDF."""
    shown = metrics.split(",") if isinstance(metrics, str) else list(metrics), list(methods), list(datasets), list((rename or {}).items())
    return Sweep([os.fspath(run) for run in runs], x, bins, band, split, *shown)


def report(*runs, out=None, **options):
    """Writes the report of runs, each ``"NAME=RUN"`` or a path; returns the dictionary of ``sharp-bench report --json``.

    ``options`` are those of the command, by name: ``methods=["a", "b"]``, ``rename={"old": "New"}``, ``uncertainty="ci95"``,
    ``public=True``. So are those of :func:`table`, :func:`figure`, :func:`gate` and :func:`history`.
    """
    return _command("report", runs, out=out, **options)


def table(name, rows=None, **options):
    """A table of the SHARP paper with your rows, ``{"label": "RUN:METHOD"}``: the dictionary of ``sharp-bench table --json``."""
    return _command("table", [name], row=rows, **options)


def figure(name, *runs, out, **options):
    """Makes a figure of the paper; returns the dictionary of ``sharp-bench figure NAME --json``."""
    return _command("figure", [name, *runs], out=out, **options)


def gate(baseline, candidate, fail_if=(), methods=(), **options):
    """Whether one run may replace another: the dictionary of ``sharp-bench gate --json``, whose ``["gate"]["state"]`` is
    passed, fired or inconclusive. ``methods`` has the form that :func:`compare` takes."""
    options["method"] = [f"{old}={new}" for old, new in _pairs(methods)]
    return _command("gate", [], (3, 5), baseline=baseline, candidate=candidate, fail_if=list(fail_if), **options)


def history(*arguments, **options):
    """A history of runs: ``history("show", "FOLDER")`` is the dictionary of ``sharp-bench history show FOLDER --json``."""
    return _command("history", arguments, **options)


def _pairs(methods):
    """``(label in A, label in B)`` of each method; a single label is used for both."""
    return [(method, method) if isinstance(method, str) else tuple(method) for method in methods]


def _command(name, arguments, answers=(), **options):
    """Runs a command and returns its JSON. Exit code 4 (with warnings, which are passed on) and the codes ``answers`` are not errors."""
    line = [sys.executable, "-m", "sharp_bench", name, *map(os.fspath, arguments), "--json"]
    for key, value in options.items():
        option = "--" + key.replace("_", "-")
        if isinstance(value, dict):
            value = [f"{one}={os.fspath(other)}" for one, other in value.items()]
        elif not isinstance(value, (list, tuple)):
            value = [value]
        elif key in _LISTS:
            value = [",".join(map(str, value))] if value else []
        for one in value:
            if one is True:
                line.append(option)
            elif one is not None and one is not False:
                # A single argument, so that a value may begin with a dash.
                line.append(f"{option}={os.fspath(one) if isinstance(one, os.PathLike) else one}")
    # The package may be in a folder that only this process searches.
    paths = [os.path.dirname(os.path.dirname(os.path.abspath(__file__))), os.environ.get("PYTHONPATH")]
    environment = dict(os.environ, PYTHONPATH=os.pathsep.join(filter(None, paths)))
    done = subprocess.run(line, capture_output=True, encoding="utf-8", env=environment)
    if done.returncode not in (0, 4, *answers):
        reason = done.stderr.strip().removeprefix("error: ") or f"exit code {done.returncode}"
        raise (ValueError if done.returncode == 2 else Error)(reason)
    _warn((note.split(": ", 1)[1] for note in done.stderr.splitlines() if note.startswith(("warning: ", "note: "))), 4)
    return json.loads(done.stdout)


_LISTS = ("methods", "datasets", "metrics", "require_power")


def render(gaussians, camera, *, background="black", eps2d=0.0, backend="cpu"):
    """Renders Gaussians given in the camera's world space, as a run does; see :class:`Rendering`."""
    return _sharp_bench.render(gaussians, camera, background=background, eps2d=eps2d, backend=backend)


def predict(image, focal_px=None, *, checkpoint=None, config=None, layout=None):
    """Gaussians of a photograph by the SHARP network, in the metric space of its camera.

    ``focal_px`` (pixels) sets the metric scale; the default is a 30 mm lens on 35 mm film. ``checkpoint`` defaults to the locally
    stored file of the release.
    """
    found, is_batch = _arrays.pictures("image", image, layout)
    if is_batch:
        raise ValueError(f"image: a batch of {len(found)}, expected one photograph")
    return _predictor(checkpoint and os.fspath(checkpoint), config).predict(found[0], focal_px)


@functools.lru_cache(maxsize=1)
def _predictor(checkpoint, config):
    return _sharp_bench.Predictor(checkpoint, config)


class Run:
    """A run folder. A notebook and ``print`` show the means of its scores."""

    def __init__(self, path, counts=None):
        self.path = os.fspath(path)
        self.counts = counts
        """Counts of the evaluation: units, reused, scored, failed, left."""

    @property
    def scores(self):
        """The records of the run as a table."""
        return load_scores(self.path)

    def __fspath__(self):
        return self.path

    def __repr__(self):
        return f"Run({self.path!r})"

    def __str__(self):
        return _sharp_bench.means_text(self.path)

    def _repr_html_(self):
        return _sharp_bench.means_html(self.path)


def evaluate(
    function,
    datasets=None,
    out=None,
    *,
    label=None,
    version=None,
    privilege=None,
    config=None,
    methods=(),
    metrics=None,
    shard=None,
    progress=None,
    **options,
):
    """Evaluates a function as a method, into the run folder ``out``; returns a :class:`Run`.

    ``function(source, camera)`` returns the picture that ``camera`` sees, [H, W, 3] or [3, H, W] in the camera's size, uint8 or
    floats in 0..1 (which a run rounds to 8 bits), or :class:`Gaussians` in the source camera's space.
    ``camera.camera_from_world`` maps from the source camera's space to the camera's. ``function(source)`` with one parameter
    returns Gaussians for all targets of a source. ``source`` has ``name``, ``camera``, ``image()``, and with
    ``privilege="source-depth"`` the true ``depth()``.

    An exception is recorded as a failure of the pair, and the other pairs continue. A stopped run (Ctrl-C stops it, too)
    continues when this function is called again. Finished pairs are reused as long as ``version`` is the same. By default, the
    version is a hash of the function's source text. It does not change if only code or weights that the function uses change,
    so set a version that names your weights.

    ``methods`` are evaluated in addition (``"copy"``, ``"depth-splat"``, …), or alone if the function is ``None``. ``config`` is
    a ``run.toml``; ``options`` are those of ``sharp-bench run`` by name (``limit=10``, ``pairs="pairs.csv"``,
    ``pair_options="order=once"``, ``common_region=True``) and override the file's.
    ``shard=(1, 4)``, ``"1/4"`` or ``"auto"`` in an array of Slurm, Kubernetes or AWS Batch evaluates this part of the pairs.
    Shards may share ``out`` or have a folder each; :func:`merge` joins them. Scores are byte for byte those of the whole run.

    ``progress`` is called with the phase, the number of steps done and that of all steps (0 if unknown); True shows a bar
    (``tqdm``'s if it is installed, also in notebooks).
    """
    if privilege not in (None, "source-depth"):
        raise ValueError(f"privilege={privilege!r}: expected None or 'source-depth'")
    if not isinstance(shard, (tuple, list, str, type(None))):
        raise TypeError(f"shard={shard!r}: expected (I, N) or 'I/N'")
    if out is None:
        raise TypeError("evaluate() needs out=, the run folder")
    keys = {key.replace("_", "-"): _plain(value) for key, value in options.items()}
    keys["dataset"] = [datasets] if isinstance(datasets, str) else [os.fspath(spec) for spec in datasets or ()]
    keys["method"] = list(methods)
    keys["metrics"] = metrics if metrics is None or isinstance(metrics, str) else ",".join(metrics)
    function_of = 2 if function is None else _parameters(function)
    adapted = function and (_of_source(function) if function_of == 1 else _of_pair(function))
    asked = {
        "out": out,
        "label": label or getattr(function, "__name__", type(function).__name__).strip("<>"),
        "version": version or (function and _source_hash(function)) or "",
        "of_source": function_of == 1,
        "privileged": privilege is not None,
        "shard": "/".join(map(str, shard)) if isinstance(shard, (tuple, list)) else shard,
        "config": config,
        "keys": json.dumps(keys),
    }
    counts, notes = _interruptible(lambda stop: _sharp_bench.evaluate(adapted, asked, stop, _display(progress)))
    _warn(notes)
    return Run(out, counts)


def _plain(value):
    return os.fspath(value) if isinstance(value, os.PathLike) else value


def _parameters(function):
    try:
        parameters = inspect.signature(function).parameters.values()
    except ValueError:
        return 2
    needed = [p for p in parameters if p.default is p.empty and p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    starred = any(p.kind == p.VAR_POSITIONAL for p in parameters)
    count = max(len(needed), 2 if starred else 0)
    if count not in (1, 2):
        raise TypeError(f"the function takes {count} arguments, expected (source, camera) or (source)")
    return count


def _of_pair(function):
    def call(source, camera):
        answer = function(source, camera)
        if isinstance(answer, Gaussians):
            return answer
        found, is_batch = _arrays.pictures("the returned picture", answer)
        if is_batch:
            raise ValueError(f"the returned picture: shape {np.shape(answer)}, expected [H, W, 3]")
        return found[0]

    return call


def _of_source(function):
    def call(source):
        answer = function(source)
        if not isinstance(answer, Gaussians):
            raise TypeError(f"a function of only the source must return Gaussians, not {type(answer).__name__}")
        return answer

    return call


def _source_hash(function):
    try:
        text = textwrap.dedent(inspect.getsource(function))
    except (OSError, TypeError):
        raise ValueError("version= is needed: the function has no source text, so changes to it cannot be detected") from None
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _interruptible(work):
    """Runs ``work`` in a thread, so that Ctrl-C requests a stop instead of interrupting it."""
    stop, done = _sharp_bench.Stop(), {}

    def run():
        try:
            done["value"] = work(stop)
        except BaseException as error:  # raised again below
            done["error"] = error

    thread = threading.Thread(target=run, name="sharp-bench")
    thread.start()
    interrupted = None
    while thread.is_alive():
        try:
            thread.join(0.2)
        except KeyboardInterrupt as error:
            stop.set()
            interrupted = error
    if interrupted is not None:
        raise interrupted
    if "error" in done:
        raise done["error"]
    return done["value"]


def _display(progress):
    if progress is not True:
        return progress or None
    try:
        from tqdm.auto import tqdm
    except ImportError:
        return _print_progress
    bars = {}

    def draw(phase, done, of):
        if phase not in bars:
            bars[phase] = tqdm(desc=phase or "evaluating")
        bar = bars[phase]
        bar.total = of or None
        bar.update(done - bar.n)
        if of and done >= of:
            bar.close()

    return draw


def _print_progress(phase, done, of):
    end = "\n" if of and done == of else ""
    print(f"\r{phase or 'evaluating'}: {done} of {of or '?'}   ", end=end, file=sys.stderr, flush=True)


def _warn(notes, level=3):
    """Warns at the line of the caller's caller, or ``level`` calls up."""
    for note in notes:
        warnings.warn(note, stacklevel=level)
