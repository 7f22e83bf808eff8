"""Behaviour in shells: pipes, terminals, colours, and paths of arbitrary bytes."""

import fcntl
import os
import pty
import re
import shutil
import struct
import subprocess
import termios

import pytest
from conftest import PROGRAM, ROOT

PAIR = ROOT / "datasets/bundled/middlebury/Motorcycle-quarter"


def on_terminal(arguments, folder, columns, **environment):
    """The output of the program on a terminal of the given width, and its exit code."""
    child, terminal = pty.fork()
    if child == 0:
        os.chdir(folder)
        fcntl.ioctl(0, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
        os.execve(PROGRAM, [PROGRAM, *arguments], {"PATH": os.environ["PATH"], "HOME": str(folder), "TERM": "xterm-256color", **environment})
    said = b""
    while True:
        try:
            part = os.read(terminal, 1 << 16)
        except OSError:
            break
        if not part:
            break
        said += part
    os.close(terminal)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), said.decode()


def shown(text):
    """Lines without escapes."""
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text)
    return re.split(r"[\r\n]+", plain)


def test_colours_are_only_where_they_are_wanted(tmp_path):
    assert "\x1b[" in on_terminal(["run", "--help"], tmp_path, 80)[1]
    assert "\x1b[" not in on_terminal(["run", "--help"], tmp_path, 80, NO_COLOR="1")[1]
    piped = subprocess.run([PROGRAM, "run", "--help"], capture_output=True, text=True, check=True)
    assert "\x1b[" not in piped.stdout


@pytest.mark.parametrize("columns", [12, 40, 80, 200])
def test_terminals_of_any_width(columns, tmp_path):
    arguments = ["run", "--dataset", "synthetic=size=48x36,views=4", "--method", "copy", "--metrics", "psnr", "--out", "r"]
    code, said = on_terminal(arguments, tmp_path, columns)
    assert code == 0 and "panicked" not in said
    code, help_page = on_terminal(["pairs", "--help"], tmp_path, columns)
    assert code == 0
    if columns >= 80:
        assert max(map(len, shown(help_page))) <= columns
        bars = [line for line in shown(said) if "/" in line and "left" in line]
        assert bars and max(map(len, bars)) <= columns


def test_a_reader_that_stops_is_no_error():
    for command in ("metrics --explain --metrics all", "run --help-all", "datasets list", "table quantitative --json"):
        script = f'"$0" {command} | head -c 1 >/dev/null; exit "${{PIPESTATUS[0]}}"'
        done = subprocess.run(["bash", "-c", script, PROGRAM], capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (0, ""), command
    # A full disk is an error.
    done = subprocess.run(["bash", "-c", '"$0" datasets list >/dev/full', PROGRAM], capture_output=True, text=True)
    assert done.returncode == 1 and "No space left" in done.stderr


def test_paths_of_any_bytes(tmp_path):
    odd = os.path.join(os.fsencode(tmp_path), b"caf\xe9 \xff \"it's\" $HOME *")
    os.mkdir(odd)

    def run(*arguments):
        parts = [os.fsencode(part) for part in arguments]
        return subprocess.run([os.fsencode(PROGRAM), b"--quiet", *parts], capture_output=True)

    runs = [os.path.join(odd, name) for name in (b"run", b"other")]
    dataset = ["--dataset", "synthetic=size=48x36,views=4", "--method", "copy", "--metrics", "psnr"]
    for folder in runs:
        assert run("run", *dataset, "--out", folder).returncode == 0
        assert run("status", folder).returncode == 0
    assert run("compare", *runs).returncode == 0
    assert run("bundle", runs[0], "--out", os.path.join(odd, b"b.zip")).returncode == 0
    picture = os.path.join(odd, b"im0.png")
    os.symlink(os.fsencode(PAIR / "im0.png"), picture)
    assert b"inf" in run("metrics", picture, os.fsencode(PAIR / "im0.png"), "--metrics", "psnr").stdout
    # A path within a specification must be text; otherwise, an error says so.
    done = run("run", "--dataset", b"stereo=" + odd, "--method", "copy", "--out", os.path.join(odd, b"x"))
    assert done.returncode == 2 and b"invalid UTF-8" in done.stderr


def test_spaces_and_quotes_in_every_path(tmp_path):
    folder = tmp_path / "my data, 'final' $1"
    scene = folder / "Middlebury 2014/Motorcycle"
    shutil.copytree(PAIR, scene)
    run = ["run", "--dataset", f"real:middlebury={scene.parent}", "--method", "copy", "--metrics", "psnr", "--out", str(folder / "a run")]
    for arguments in (run, ["report", str(folder / "a run")]):
        subprocess.run([PROGRAM, "--quiet", *arguments], check=True, capture_output=True)
    assert (folder / "a run/report/index.html").is_file()
