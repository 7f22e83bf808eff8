"""The notebook, cell by cell, as a kernel runs it: what a cell ends with is shown."""

import ast
import json
import pathlib
import warnings

NOTEBOOK = pathlib.Path(__file__).parents[2] / "bench/python/notebook.ipynb"


def shown(source, names):
    tree = ast.parse(source)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "cell", "exec"), names)
    if last is None:
        return None
    value = eval(compile(ast.Expression(last.value), "cell", "eval"), names)
    return value._repr_html_() if hasattr(value, "_repr_html_") else repr(value)


def test_every_cell_runs(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.mkdtemp", lambda: str(tmp_path))
    cells = json.loads(NOTEBOOK.read_text())["cells"]
    assert len(cells) == 20 and not any(cell.get("outputs") for cell in cells)
    # Whose source text is asked for.
    monkeypatch.setattr("inspect.getsource", lambda function: function.__name__)
    names = {"__name__": "__main__"}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        outputs = [shown("".join(cell["source"]), names) for cell in cells if cell["cell_type"] == "code"]
    text = "\n".join(output for output in outputs if output)
    for part in ["dists", 'View "', "<td>", "plane", "depth-splat", "'reused': 3", "difference"]:
        assert part in text, part
