"""Runs the Python blocks of the pages that use this package, unchanged, on the bundled data."""

import pathlib
import re

import numpy as np
import pytest

import sharp_bench as sb

ROOT = pathlib.Path(__file__).parents[2]
DOCS = ["README.md", "bench/docs/your-method.md", "bench/python/README.md"]


def blocks(document):
    found = re.findall(r"```python\n(.*?)```", (ROOT / document).read_text(), re.DOTALL)
    return [block for block in found if "sharp_bench" in block]


@pytest.mark.parametrize("document", DOCS)
def test_documented_blocks_run(document, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    data = pathlib.Path(sb.bundled_data(tmp_path / "unpacked"))
    (tmp_path / "data").mkdir()
    data.rename(tmp_path / "data/Middlebury2014")
    # The names that the surrounding text mentions.
    picture = np.full((64, 80, 3), 90, np.uint8)
    names = {"prediction": picture, "target": picture + 9, "function": lambda source, camera: source.image()}
    monkeypatch.setattr("inspect.getsource", repr)
    assert blocks(document)
    for block in blocks(document):
        exec(compile(block, document, "exec"), names)
    assert names["run"].counts["failed"] == 0 and names["run"].counts["scored"] > 0
