"""The page of `render --viewer` in a report; what it draws is tested in tests/product/browser.rs."""

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
    # It loads nothing, and nothing but its own script runs.
    text = page.read_text()
    assert "default-src 'none'" in text and "http" not in text.split("</style>")[1].split("<script id=")[0]
