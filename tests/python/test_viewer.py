"""The page of `render --viewer` in a report; tests/product/browser.rs tests what it draws."""

import json
import subprocess

import pytest
from conftest import ROOT


def test_a_report_links_the_page_that_lies_beside_a_kept_picture(program, tmp_path):
    run = tmp_path / "run"
    program("run", "--dataset", "synthetic=size=48x36,views=4", "--method", "copy", "--metrics", "psnr", "--limit", 3, "--out", run)
    picture = sorted((run / "predictions/copy").rglob("*.png"))[1]
    page = picture.with_suffix(".html")
    program("render", ROOT / "tests/golden/model/tiny_golden.ply", "--viewer", page)
    program("report", run)
    html = (run / "report/index.html").read_text()
    link = "../" + page.relative_to(run).as_posix()
    assert html.count('"viewer":') == 1 and f'"viewer":"{link}"' in html
    assert "Its Gaussians" in html
    # It loads nothing, and only its own script runs.
    text = page.read_text()
    assert "default-src 'none'" in text and "http" not in text.split("</style>")[1].split("<script id=")[0]


def test_what_a_page_is_not_written_to(program, tmp_path):
    scene = ROOT / "tests/golden/model/tiny_golden.ply"

    def refused(*arguments):
        with pytest.raises(subprocess.CalledProcessError) as found:
            program("render", scene, *arguments)
        return found.value.stderr

    assert "--out" in refused()
    assert "end in .html" in refused("--viewer", tmp_path / "page.png")
    mine = tmp_path / "mine.html"
    mine.write_text("mine")
    assert "mine.html" in refused("--viewer", mine) and mine.read_text() == "mine"
    assert "absent.json" in refused("--camera", tmp_path / "absent.json", "--viewer", tmp_path / "page.html")
    assert not (tmp_path / "page.html").exists()


def test_a_page_changes_nothing_of_what_is_said_of_the_pictures(program, tmp_path):
    frames = ["render", ROOT / "tests/golden/model/tiny_golden.ply", "--trajectory", "swipe", "--frames", 20, "--json"]
    alone = json.loads(program(*frames, "--out", tmp_path / "a"))
    beside = json.loads(program(*frames, "--out", tmp_path / "b", "--viewer", tmp_path / "page.html"))
    assert beside["files"][1:] == [str(tmp_path / "page.html")]
    assert {key: alone[key] for key in ("mean_alpha", "views")} == {key: beside[key] for key in ("mean_alpha", "views")}
    page = json.loads(program(*frames, "--viewer", tmp_path / "page.html"))
    assert page["out"] is None and page["views"] == 20
