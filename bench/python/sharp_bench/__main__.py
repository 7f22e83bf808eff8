"""The command line: ``python -m sharp_bench``, and ``sharp-bench`` where the package is installed."""

import os
import signal
import sys


def main():
    # Like the standalone program, silence a message of Mesa on standard error, and end at once on Ctrl-C.
    if "XDG_RUNTIME_DIR" not in os.environ and "MESA_VK_DEVICE_SELECT" not in os.environ:
        os.environ["NODEVICE_SELECT"] = "1"
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    from . import _sharp_bench

    sys.exit(_sharp_bench.main(["sharp-bench", *sys.argv[1:]]))


if __name__ == "__main__":
    main()
